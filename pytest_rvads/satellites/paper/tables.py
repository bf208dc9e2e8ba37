"""The two tables of the paper's experiment: computed, swept over the random waiting time of vehicles, and as published.

The tables are shown as text and as a picture in the layout of the paper; cells that differ from the published cells are marked.

The published verdicts are those of Li, Sifakis, Wang, Yan, Zhang: Simulation-based Validation for Autonomous Driving Systems
(ISSTA 2023). The paper has tables of classes 1 and 3; the text of the paper gives some cells of classes 2 and 4.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace

from pytest_rvads.report.svg import document, polyline, text
from pytest_rvads.satellites.paper.experiment import (
    LIGHT,
    ROWS,
    STOP,
    TABLES,
    WAIT,
    Job,
    Key,
    Setup,
    Table,
    draw_range,
    entries,
    judge,
)
from pytest_rvads.scenarios.classes import label, parse, rotate
from pytest_rvads.support.executors import Progress, spread
from pytest_rvads.support.wording import page

FITTED = (1, 3)
"""Classes to whose published cells the constants of the LGSVL-like driver were fitted."""

_STATUSES = {"F": "FAIL", "P": "PASS", "-": "NA"}
# Per configuration, a word per rule of the table: a letter for each row, or a single letter if all rows have the same verdict.
_CLASS_1 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "FFPF F -", "E": "FFPF F P"}
_CLASS_2 = {"A": "F F -", "B": "F F -", "C": "FFPF F -", "D": "? F -", "E": "? F P"}
_CLASS_3 = {"F": "F - F", "G": "P - F", "H": "P - F", "I": "P - F", "J": "P - F"}
_CLASS_4 = {"F": "- P -", "G": "- P -", "H": "- - -", "I": "- - -", "J": "- F -"}
_CLASSES = {1: (STOP, _CLASS_1), 2: (STOP, _CLASS_2), 3: (LIGHT, _CLASS_3), 4: (LIGHT, _CLASS_4)}
Shares = dict[str, float]
"""For each of the verdicts FAIL, PASS and NA, its share of the tried waiting times."""
SWEEP_STEP = 0.05
"""Difference between successive waiting times of a sweep [s]."""
MARK = "!"
"""Sign that is printed after a verdict that differs from the published verdict."""
_WORDS = {"FAIL": "Fail", "PASS": "Pass", "NA": "NA"}
_COLOURS = {"FAIL": "#b3261e", "PASS": "#1b6e3c", "NA": "#777"}


def compute(
    setup: Setup | None = None,
    *,
    tables: Sequence[Table] = TABLES,
    numbers: Sequence[int] = (1, 2, 3, 4),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[Key, str]:
    """Return the verdict PASS, FAIL or NA of every cell of some classes, by default in runs with the settings of the paper."""
    chosen_entries = [entry for table in tables for entry in entries(table) if entry.number in numbers]
    jobs = [(entry, setup or Setup()) for entry in chosen_entries]
    verdicts: dict[Key, str] = {}
    for entry, statuses in zip(chosen_entries, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in statuses.items():
            verdicts[entry.key(rule)] = value
    return verdicts


def sweep(
    setup: Setup | None = None, *, executor: Executor | int | None = None, progress: Progress | None = None
) -> dict[Key, Shares]:
    """Return, for every cell whose run has a random waiting time, the share of waiting times with each verdict.

    The waiting times are spread evenly over the range from which the driver draws, see `draw_range`.
    """
    setup = setup or Setup()
    jobs: list[Job] = []
    for entry in (entry for table in TABLES for entry in entries(table)):
        span = draw_range(entry)
        if span is not None:
            low, high = span
            count = round((high - low) / SWEEP_STEP) + 1
            waits = [round(low + k * SWEEP_STEP, 6) for k in range(count)]
            jobs += [(entry, replace(setup, wait=wait)) for wait in waits]
    values_of_cell: dict[Key, list[str]] = {}
    for (entry, _), statuses in zip(jobs, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in statuses.items():
            values_of_cell.setdefault(entry.key(rule), []).append(value)
    return {
        key: {word: values.count(word) / len(values) for word in ("FAIL", "PASS", "NA")} for key, values in values_of_cell.items()
    }


def nested(cells: dict[Key, str] | dict[Key, Shares]) -> dict[str, dict[str, dict[str, dict[str, object]]]]:
    """Return the cells nested by table, class and row, with the directions of each row, as ``rvads paper --json`` prints them."""
    result: dict[str, dict[str, dict[str, dict[str, object]]]] = {}
    for table in TABLES:
        for number, directions in table.classes.items():
            for row in range(ROWS):
                entry: dict[str, object] = {"directions": label(rotate(parse(directions), row))}
                for letter in table.configurations:
                    cells_of_entry = {r: cells[number, row, letter, r] for r in table.rules if (number, row, letter, r) in cells}
                    if cells_of_entry:
                        entry[letter] = cells_of_entry
                result.setdefault(table.name, {}).setdefault(f"class{number}", {})[f"row{row + 1}"] = entry
    return result


def published(numbers: tuple[int, ...] = (1, 2, 3, 4)) -> dict[Key, str]:
    """Return the published verdicts of the cells of some classes; a cell without a published verdict is left out."""
    cells: dict[Key, str] = {}
    for number in numbers:
        table, cells_by_letter = _CLASSES[number]
        for letter, words in cells_by_letter.items():
            for rule, word in zip(table.rules, words.split(), strict=True):
                for row in range(ROWS):
                    mark = word[row] if len(word) == ROWS else word
                    if mark != "?":
                        cells[number, row, letter, rule] = _STATUSES[mark]
    return cells


def agreement(verdicts: Mapping[Key, str], numbers: tuple[int, ...]) -> tuple[int, int]:
    """Return, for some classes, the number of published cells that `verdicts` reproduces, and the number of published cells."""
    cells = published(numbers)
    return sum(verdicts[key] == value for key, value in cells.items()), len(cells)


def null_models() -> dict[str, int]:
    """Return, by name of a model that guesses cells without a simulation, how many cells of classes 1 and 3 it can get right.

    A model gives the same answer to all cells that it can't distinguish. Its best answer to these cells is their most frequent
    verdict.
    """
    models: dict[str, Callable[[Key], object]] = {
        "one verdict for everything": lambda _: None,
        "by rule": lambda key: key[3],
        "by rule and configuration": lambda key: key[2:],
        "by rule, configuration and row": lambda key: key[1:],
    }
    cells = published(FITTED)
    scores = {}
    for name, group in models.items():
        counters: dict[object, Counter[str]] = {}
        for key, value in cells.items():
            counters.setdefault(group(key), Counter())[value] += 1
        scores[name] = sum(max(counter.values()) for counter in counters.values())
    return scores


def disagreements(verdicts: Mapping[Key, str]) -> list[tuple[Key, str, str]]:
    """Return the cells that differ from the published cells: cell, verdict, published verdict."""
    return [(key, verdicts[key], value) for key, value in published().items() if key in verdicts and verdicts[key] != value]


def text_tables(verdicts: Mapping[Key, str]) -> str:
    """Return both tables of the paper as text, followed by a summary."""
    lines = []
    for table in TABLES:
        groups = " | ".join(f"{letter:<17}" for letter in table.configurations)
        rules = " | ".join(" ".join(f"{rule:<5}" for rule in table.rules) for _ in table.configurations)
        lines += [_title(table), f"{'':>23} | {groups}".rstrip(), f"class  {'scenario':<16} | {rules}".rstrip()]
        for number, row, scenario in _rows(table):
            cells = [f"{number if row == 0 else '':>5}  {scenario:<16}"]
            for letter in table.configurations:
                words = (_marked_word(verdicts, (number, row, letter, rule)) for rule in table.rules)
                cells.append(" ".join(f"{word:<5}" for word in words))
            lines.append(" | ".join(cells).rstrip())
        lines.append("")
    return "\n".join([*lines, *_summary_lines(verdicts)])


def text_sweep(shares: Mapping[Key, Shares]) -> str:
    """Return the result of `sweep` as text, with a line per cell: the shares of FAIL, PASS and NA in per cent."""
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
        pairs = [(letter, rule) for letter in table.configurations for rule in table.rules]
        columns = [(190.0 + 46 * k, letter, rule) for k, (letter, rule) in enumerate(pairs)]
        body.append(text(20, y, "class", fill="#444"))
        body += [text(x, y - 14, letter, font_weight="bold") for x, letter, _ in columns[::3]]
        body += [text(x, y, rule, fill="#444") for x, _, rule in columns]
        body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#222"))
        for number, row, scenario in _rows(table):
            y += 20
            body += [text(20, y, str(number) if row == 0 else ""), text(50, y, scenario)]
            for x, letter, rule in columns:
                key = number, row, letter, rule
                word = _marked_word(verdicts, key)
                style = {"font_weight": "bold"} if word.endswith(MARK) else {}
                body.append(text(x, y, word, fill=_COLOURS[verdicts[key]], **style))
            if row == ROWS - 1:
                body.append(polyline([(20, y + 6), (wide, y + 6)], stroke="#bbb"))
        y += 40
    for line in _summary_lines(verdicts):
        body.append(text(20, y, line, fill="#444"))
        y += 18
    return document(wide + 20, y, body)


def _title(table: Table) -> str:
    kind = "stop" if table.name == "stop4" else "traffic light"
    return f"4-way {kind} junction ({table.junction}), LGSVL-like autopilot, one draw of {WAIT:g} s for all runs"


def _rows(table: Table) -> Iterator[tuple[int, int, str]]:
    for number, directions in table.classes.items():
        for row in range(ROWS):
            placed = rotate(parse(directions), row)
            yield number, row, " ".join(f"{entrance}d{d}" for entrance, d in enumerate(placed))


def _marked_word(verdicts: Mapping[Key, str], key: Key) -> str:
    return _WORDS[verdicts[key]] + ("" if published().get(key, verdicts[key]) == verdicts[key] else MARK)


def _summary_lines(verdicts: Mapping[Key, str]) -> list[str]:
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
