"""The tables of the experiment as text and as a picture, in the layout of the paper and with marked disagreements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pytest_rvads.report.draw.svg import document, polyline, text
from pytest_rvads.satellites.paper.experiment import ROWS, TABLES, WAIT, Key, Table
from pytest_rvads.satellites.paper.tables import FITTED, Shares, agreement, null_models, published
from pytest_rvads.scenarios.classes import parse, rotate
from pytest_rvads.support.wording import page

__all__ = ["MARK", "disagreements", "svg_tables", "text_sweep", "text_tables"]

MARK = "!"
"""Mark after a verdict that differs from the published verdict."""
_WORDS = {"FAIL": "Fail", "PASS": "Pass", "NA": "NA"}
_COLOURS = {"FAIL": "#b3261e", "PASS": "#1b6e3c", "NA": "#777"}


def disagreements(verdicts: Mapping[Key, str]) -> list[tuple[Key, str, str]]:
    """Return the cells that differ from the published cells: cell, verdict, published verdict."""
    return [(key, verdicts[key], value) for key, value in published().items() if key in verdicts and verdicts[key] != value]


def text_tables(verdicts: Mapping[Key, str]) -> str:
    """Return both tables of the paper as text, followed by a summary."""
    lines = []
    for table in TABLES:
        lines += [_title(table), *_head(table)]
        for number, row, scenario in _rows(table):
            name = f"{number if row == 0 else '':>5}  {scenario:<16}"
            cells = (_group(verdicts, table, number, row, letter) for letter in table.configurations)
            lines.append(" | ".join([name, *cells]).rstrip())
        lines.append("")
    return "\n".join([*lines, *_summary(verdicts)])


def text_sweep(shares: Mapping[Key, Shares]) -> str:
    """Return the shares of FAIL, PASS and NA over the range of the draw as text, with a line per cell with a draw."""
    lines = ["Shares of Fail/Pass/NA over the range of the draw, in per cent"]
    for table in TABLES:
        for number, row, scenario in _rows(table):
            for letter in table.configurations:
                for rule in table.rules:
                    shares_of_cell = shares.get((number, row, letter, rule))
                    if shares_of_cell:
                        percent = "/".join(f"{100 * shares_of_cell[word]:.0f}" for word in ("FAIL", "PASS", "NA"))
                        lines.append(f"class {number}  {scenario}  {letter}  {rule}  {percent}")
    return "\n".join(lines)


def svg_tables(verdicts: Mapping[Key, str]) -> str:
    """Return both tables as an SVG document."""
    body, y, wide = [], 30.0, 190 + 5 * 3 * 46
    for table in TABLES:
        body.append(text(20, y, _title(table), font_weight="bold"))
        y += 26
        columns = [(letter, rule) for letter in table.configurations for rule in table.rules]
        body.append(text(20, y, "class", fill="#444"))
        body += [text(_x(k), y - 14, letter, font_weight="bold") for k, (letter, _) in enumerate(columns) if k % 3 == 0]
        body += [text(_x(k), y, rule, fill="#444") for k, (_, rule) in enumerate(columns)]
        body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#222"))
        for number, row, scenario in _rows(table):
            y += 20
            body += [text(20, y, str(number) if row == 0 else ""), text(50, y, scenario)]
            for k, (letter, rule) in enumerate(columns):
                key = number, row, letter, rule
                word = _word(verdicts, key)
                style = {"font_weight": "bold"} if word.endswith(MARK) else {}
                body.append(text(_x(k), y, word, fill=_COLOURS[verdicts[key]], **style))
            if row == ROWS - 1:
                body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#bbb"))
        y += 40
    for line in _summary(verdicts):
        body.append(text(20, y, line, fill="#444"))
        y += 18
    return document(wide + 20, y, body)


def _x(column: int) -> float:
    return 190.0 + 46 * column


def _title(table: Table) -> str:
    kind = "stop" if table.name == "stop4" else "traffic light"
    return f"4-way {kind} junction ({table.junction}), LGSVL-like autopilot, one draw of {WAIT:g} s for all runs"


def _head(table: Table) -> list[str]:
    groups = " | ".join(f"{letter:<17}" for letter in table.configurations)
    rules = " | ".join(" ".join(f"{rule:<5}" for rule in table.rules) for _ in table.configurations)
    return [f"{'':>23} | {groups}".rstrip(), f"class  {'scenario':<16} | {rules}".rstrip()]


def _rows(table: Table) -> Iterator[tuple[int, int, str]]:
    for number, directions in table.classes.items():
        for row in range(ROWS):
            placed = rotate(parse(directions), row)
            yield number, row, " ".join(f"{entrance}d{d}" for entrance, d in enumerate(placed))


def _group(verdicts: Mapping[Key, str], table: Table, number: int, row: int, letter: str) -> str:
    return " ".join(f"{_word(verdicts, (number, row, letter, rule)):<5}" for rule in table.rules)


def _word(verdicts: Mapping[Key, str], key: Key) -> str:
    return _WORDS[verdicts[key]] + ("" if published().get(key, verdicts[key]) == verdicts[key] else MARK)


def _summary(verdicts: Mapping[Key, str]) -> list[str]:
    differences = [
        f"  {MARK} class {k[0]} row {k[1] + 1} {k[2]} {k[3]}: {got}, published {want}" for k, got, want in disagreements(verdicts)
    ]
    fitted, unfitted = agreement(verdicts, FITTED), agreement(verdicts, (2, 4))
    guess = null_models()["by rule and configuration"]
    return [
        f"Replicated with a calibrated surrogate: {page('replication')}",
        f"Classes 1 and 3, fitted: {fitted[0]} of {fitted[1]} cells as published; "
        f"a table by rule and configuration alone would get {guess}.",
        f"Classes 2 and 4, not fitted: {unfitted[0]} of the {unfitted[1]} cells that the paper's text tells.",
        *differences,
    ]
