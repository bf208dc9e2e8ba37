"""Compares reports side by side: the command and result of each, the verdicts per rule, and the causes of failures.

Items are matched by node id, as with a baseline, so controllers are compared by running the same tests with each controller. Of
two reports, the comparison also has the items whose verdicts differ. A comparison is text for a terminal, a page, Markdown or
JSON; other formats show the last report.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from textwrap import wrap
from typing import Any

import msgspec

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report import triage
from pytest_rvads.report.files import FORMATS, fitting, section, write
from pytest_rvads.report.matrix import SAME, Entry, Matrices, Matrix, Place, place_of
from pytest_rvads.report.outline import Head, Section, outline
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Comparison, Report, cell_of, compare, with_baseline
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.installed import load
from pytest_rvads.support.wording import first, one_line, plural

_TITLE = "rvads: sessions side by side"
_LINE = 2000
"""Largest number of characters of a line on a terminal."""


@dataclass(frozen=True, slots=True)
class Side:
    """One of the compared reports."""

    label: str
    """A letter, or the name of a driver."""
    name: str
    """The file of the report, or the name of a driver."""
    began: str
    """Date and time at which the session began; empty if they are not known."""
    head: tuple[str, ...]
    """Lines on the time, command and driver of the session, its totals, and its end."""
    notes: tuple[str, ...]
    """Missing or doubtful parts of the report."""


@dataclass(frozen=True, slots=True)
class Shared:
    """A cause of failures, and the number of failures with this cause in each report."""

    where: str
    """Which reports have the cause, in words."""
    rule: str
    text: str
    counts: tuple[int, ...]
    example: str
    """Node id of the first item with the cause."""
    side: int
    """Number of the report with this item."""
    run: str
    """Name of the run of this item."""
    look: str
    """Path of the replay of this item; empty without one."""


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Compared reports, and their differences."""

    sides: tuple[Side, ...]
    common: int
    """Number of items that the first report shares with another."""
    rules: tuple[tuple[str, tuple[Counter[Tallied], ...]], ...]
    """By rule, the number of verdicts of each kind in each report."""
    causes: tuple[Shared, ...]
    comparison: Comparison
    """The changes from A to B; empty unless there are two reports."""
    matrices: tuple[Matrix, ...] | None
    """Per test and junction, with ``pass -> FAIL`` for an item that differs; None if the verdicts are too many for tables."""
    later: Report
    """The last report, with A as its baseline if there are two reports."""

    @property
    def differ(self) -> bool:
        """Whether any verdict differs between two reports."""
        return (
            self.comparison.count("UNCHANGED", "OUTSIDE") < len(self.comparison.changes)
            or self.matrices is None
            or any(map(differing, self.matrices))
        )


def side_by_side(reports: Sequence[tuple[str, Report]], labels: Sequence[str] = ()) -> SideBySide:
    """Return the comparison of reports; `labels` are letters by default."""
    (first_name, earlier), *others = reports
    own_ids = {record.nodeid for record in earlier.records}
    common = 0
    for name, report in others:
        both = len(own_ids & {record.nodeid for record in report.records})
        common = max(common, both)
        if not both:
            items = [plural(len(records), "item") for records in (earlier.records, report.records)]
            raise RvadsError(
                f"{first_name} ({items[0]}) and {name} ({items[1]}) have no item in common, and items are matched by their ids: "
                "compare sessions of the same tests"
            )
    labels = labels or [chr(ord("A") + n) if n < 26 else f"R{n + 1}" for n in range(len(reports))]
    sides = []
    for label, (name, report) in zip(labels, reports, strict=True):
        head = next((tuple(block.plain()) for block in outline(report) if isinstance(block, Head)), ())
        sides.append(Side(label, name, report.began, head, report.notes))
    rules: dict[str, tuple[Counter[Tallied], ...]] = {}
    for number, (_, report) in enumerate(reports):
        for record in report.records:
            rules.setdefault(record.asks, tuple(Counter() for _ in reports))[number][record.counts_as] += 1
    comparison, later = Comparison("A", ()), reports[-1][1]
    matrices: tuple[Matrix, ...] | None = ()
    if len(reports) == 2:
        planned = set(later.planned)
        lost = {record.nodeid for record in earlier.records if cell_of(record) not in planned}
        comparison = compare(later, earlier, labels[0], lost.__contains__, same=False)
        matrices = _merged_matrices(earlier, later)
        later = with_baseline(later, comparison)
    causes = _shared_causes([report for _, report in reports], labels)
    return SideBySide(tuple(sides), common, tuple(sorted(rules.items())), causes, comparison, matrices, later)


def _merged_matrices(earlier: Report, later: Report) -> tuple[Matrix, ...] | None:
    """Return the verdict matrices of two reports in one; None if the reports have too many verdicts for tables."""
    old_matrices, new_matrices = Matrices(), Matrices()
    before: dict[str, tuple[Place, Outcome, str]] = {}
    for record in earlier.records:
        old_matrices.add(record)
        before[record.nodeid] = _standing(record)
    moved: set[Place] = set()
    for record in later.records:
        new_matrices.add(record)
        standing = _standing(record)
        was = before.pop(record.nodeid, None)
        if was != standing:
            moved |= {standing[0], (was or standing)[0]}
    moved |= {place for place, *_ in before.values()}
    return None if old_matrices.too_many or new_matrices.too_many else tuple(new_matrices.after(old_matrices, moved))


def _standing(record: Record) -> tuple[Place, Outcome, str]:
    """Return the place of a record in its verdict matrix, its status, and the reason of a known failure."""
    return place_of(record), record.status, (record.known or "").partition(":")[0]


def _shared_causes(reports: Sequence[Report], labels: Sequence[str]) -> tuple[Shared, ...]:
    """Return the causes of failures: of two reports the later's, the earlier's, the shared ones; of more by frequency.

    Causes with equal texts are the same cause. Among all other causes, causes whose texts differ only in numbers are the same.
    """
    rows: list[dict[int, triage.Cause]] = []
    readings: tuple[Callable[[str], str], ...] = (str, lambda text: re.sub(r"\d+(\.\d+)?", "#", text))
    facts: dict[tuple[int, str], tuple[str, str]] = {}
    for side, report in enumerate(reports):
        by_cause = triage.causes()
        for record in report.records:
            by_cause.add(record)
            if record.failed:
                facts[side, record.nodeid] = str(record.run), record.look
        waiting = by_cause.causes()
        for reading in readings:
            free: dict[str, list[dict[int, triage.Cause]]] = {}
            for row in rows:
                if side not in row:
                    free.setdefault(reading(next(iter(row.values())).text), []).append(row)
            for cause in list(waiting):
                if matching := free.get(reading(cause.text)):
                    matching.pop(0)[side] = cause
                    waiting.remove(cause)
        rows += [{side: cause} for cause in waiting]
    if len(reports) == 2:
        rows.sort(key=lambda row: (len(row), -max(row), -row[1].count if len(row) > 1 else 0))
    else:
        rows.sort(key=lambda row: -sum(cause.count for cause in row.values()))
    shared = []
    for row in rows:
        last, everywhere = max(row), "both" if len(reports) == 2 else "all"
        where = f"in {everywhere}" if len(row) == len(reports) else f"only in {', '.join(labels[side] for side in row)}"
        counts = tuple(row[side].count if side in row else 0 for side in range(len(reports)))
        cause = row[last]
        shared.append(Shared(where, cause.rule, cause.text, counts, cause.example, last, *facts[last, cause.example]))
    return tuple(shared)


def differing(matrix: Matrix) -> int:
    """Return the number of cells of a matrix in which two reports differ."""
    return sum(
        len(members) * sum(map(changed, entries)) for (_, entries), members in zip(matrix.rows, matrix.members, strict=True)
    )


def changed(entry: Entry) -> bool:
    """Return whether two reports differ in a cell of a matrix."""
    return entry.text not in ("", SAME)


def text(compared: SideBySide, width: int) -> str:
    """Return a comparison as text for a terminal of `width` columns; only a longer word makes a line wider."""
    wrapped = partial(wrap, width=width, break_long_words=False, break_on_hyphens=False)
    lines, parts = list[str](), list(sections(compared, 10))  # further lines and tables are counted
    for part in parts:
        lines += wrapped(one_line(part.title, _LINE))
        for line in part.lines:
            lines += wrapped(one_line(line, _LINE), initial_indent="  ", subsequent_indent="      ")
        lines.append("")
    if parts != list(sections(compared)):
        lines += wrapped("what is left out here stands in files: -o FILE.html, FILE.md or FILE.json")
    return "\n".join(lines)


def save(path: Path, compared: SideBySide) -> None:
    """Write a comparison in the format that the suffix of `path` names.

    A format with a row or case per item shows the last report, with its changes if there are two reports.
    """
    form = _FORMATS.get(fitting(path).suffix)
    write(path, form(compared, path.parent) if form else FORMATS[path.suffix](compared.later, path.parent))


def sections(
    compared: SideBySide, most: int | None = None, again: Callable[[Shared], str] = attrgetter("example")
) -> Iterator[Section]:
    """Yield the sections of a comparison in order; `again` returns the command that runs the example of a cause again."""
    two = len(compared.sides) == 2
    for side in compared.sides:
        title = side.name if side.label == side.name else f"{side.label}: {side.name}"
        yield Section(title, (*(f"note: {note}" for note in side.notes), *side.head), side=True)
    if two:
        yield from _change_sections(compared, most)
    lines, rows = [], []
    for rule, tallies in compared.rules:
        texts = [counted(tally) for tally in tallies]
        change = f"{texts[0]} in {'both' if two else 'all'}" if len(set(texts)) == 1 else " -> ".join(t or "none" for t in texts)
        lines.append(f"{rule}: {change}")
        marks = ["bad" if any(kind and kind.bad for kind in tally) else "" for tally in tallies]
        rows.append(((rule, ""), *zip(texts, marks, strict=True)))
    labels = [side.label for side in compared.sides]
    yield Section("verdicts per rule", tuple(_cut(lines, most)), ("rule", *labels), tuple(rows))
    cause_lines, cause_rows, drawn = [], [], any(cause.look for cause in compared.causes)
    for cause in compared.causes:
        count = " -> ".join(str(number) for number in cause.counts if number or len(labels) > 2)
        command = again(cause)
        cause_lines.append(f"{cause.where}: {count} x {cause.rule}: {cause.text} (first: {command})")
        mark = ("bad" if cause.counts[-1] else "good") if two and not all(cause.counts) else ""
        numbers = (str(number or "") for number in cause.counts)
        cells = ((text, "") for text in (*numbers, cause.rule, cause.text))
        look = ((cause.look, "look"),) if drawn else ()
        where = ((cause.where, mark),) if two else ()
        cause_rows.append((*where, *cells, *look, (command, "code")))
    if cause_lines:
        columns = (*(["where"] if two else []), *labels, "rule", "cause", *(["replay"] if drawn else []), "first")
        yield Section("causes of failures", tuple(_cut(cause_lines, most)), columns, tuple(cause_rows))


def _change_sections(compared: SideBySide, most: int | None) -> Iterator[Section]:
    """Yield the sections about what changed from one session to another."""
    if compared.comparison.versions:
        yield Section("versions that differ", compared.comparison.versions)
    changes = replace(compared.comparison, versions=())
    what_changed = changes.headline
    a, b = compared.sides
    if not compared.differ:
        absent = changes.count("OUTSIDE")
        more = f"; {plural(absent, 'item')} of A not selected in B" if absent else ""
        once = "; they are reports of one session" if a.began and a.head == b.head else ""
        what_changed = f"no verdict of the {plural(compared.common, 'item')} that both have differs{more}{once}"
    yield Section(f"what changed from {a.label} to {b.label}", (what_changed,))
    yield from _matrix_sections(compared, most)
    for kind, listed in groupby(changes.listed(most), itemgetter(0)):
        yield Section(f"{kind}: {plural(changes.count(kind), 'item')}", tuple(text for _, text in listed))


def _matrix_sections(compared: SideBySide, most: int | None) -> Iterator[Section]:
    """Yield a section per verdict matrix with differing cells, with the rows and columns that contain these cells."""
    if compared.matrices is None:
        yield Section("verdicts", ("too many for tables: the changes name the items",))
        return
    differing_matrices = [matrix for matrix in compared.matrices if differing(matrix)]
    for matrix in differing_matrices[:most]:
        columns = [i for i in range(len(matrix.columns)) if any(changed(entries[i]) for _, entries in matrix.rows)]
        rows = [i for i, (_, entries) in enumerate(matrix.rows) if any(map(changed, entries))]
        table: list[tuple[tuple[str, str], ...]] = []
        for label, entries in (matrix.rows[i] for i in rows):
            cells_of_row = [(label, "")]
            for entry in (entries[k] for k in columns):
                passed = entry.outcome is not None and entry.outcome.meaning == "passed"
                cells_of_row.append((entry.text, "bad" if entry.bad else "good" if passed and changed(entry) else ""))
            table.append(tuple(cells_of_row))
        count = differing(matrix)
        cells = sum(
            len(members) * sum(bool(entry.text) for entry in entries)
            for (_, entries), members in zip(matrix.rows, matrix.members, strict=True)
        )
        yield Section(
            f"{matrix.title}: {count:,} of {cells:,} cells differ{'s' if count == 1 else ''}",
            tuple(_cut([line for i in rows for line in _row_differences(matrix, i)], most)),
            (matrix.corner, *(matrix.headings[i] for i in columns)),
            tuple(table),
        )
    if most is not None and len(differing_matrices) > most:
        yield Section(
            "more tables", (f"... and {plural(len(differing_matrices) - most, 'more table')} in which something differs",)
        )


def _row_differences(matrix: Matrix, number: int) -> Iterator[str]:
    """Yield the differences in a row of a matrix, a line per rule and change: ``v3, class 07, p1: pass -> FAIL (C, E)``."""
    label, entries = matrix.rows[number]
    configurations: dict[tuple[str, str], list[str]] = {}
    for (cfg, rule), entry in zip(matrix.columns, entries, strict=True):
        if changed(entry):
            configurations.setdefault((rule, entry.text), []).append(cfg)
    variant = matrix.variants[number]
    name = f"{matrix.corner.removeprefix('variant, ')} {label.removeprefix(variant).strip()}"
    for (rule, text), cfgs in configurations.items():
        where = f" ({first(cfgs, None)})" if any(cfgs) else ""
        yield f"{f'{variant}, ' if variant else ''}{name}, {rule}: {text}{where}"


def _cut(lines: list[str], most: int | None) -> list[str]:
    more = 0 if most is None else len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"... and {more} more"]


def content(compared: SideBySide) -> dict[str, Any]:
    """Return a comparison as values of JSON; numbers of verdicts have their status, or ``known``, as key."""
    tables: list[dict[str, Any]] = []
    for matrix in compared.matrices or ():
        rows = [
            {"label": label, "variant": variant, "cells": [entry.text for entry in entries]}
            for (label, entries), variant in zip(matrix.rows, matrix.variants, strict=True)
        ]
        names = {"title": matrix.title, "junction": matrix.junction, "corner": matrix.corner}
        tables.append({**names, "columns": matrix.columns, "rows": rows})
    return {
        "format": "rvads-comparison",
        "version": 1,
        "sides": [asdict(side) for side in compared.sides],
        "common": compared.common,
        "versions": compared.comparison.versions,
        "changes": [asdict(change) for change in compared.comparison.changes if change.kind != "UNCHANGED"],
        "tables": None if compared.matrices is None else tables,
        "rules": [
            {"rule": rule, "verdicts": [{kind or "known": count for kind, count in tally.items()} for tally in tallies]}
            for rule, tallies in compared.rules
        ],
        "causes": [asdict(cause) for cause in compared.causes],
    }


def json_of(values: dict[str, Any]) -> str:
    """Return values as indented JSON."""
    return msgspec.json.format(encode(values), indent=1).decode() + "\n"


_FORMATS: dict[str, Callable[[SideBySide, Path], str]] = {
    ".html": lambda compared, folder: load("pages", "blocks")(_TITLE, list(sections(compared)), {}, folder),
    ".md": lambda compared, _: "\n".join(
        [f"# {_TITLE}", *(line for part in sections(compared) for line in ("", *section(part))), ""]
    ),
    ".json": lambda compared, _: json_of(content(compared)),
}
"""By the ending of a file, the function that renders the reports for a file in a folder."""
