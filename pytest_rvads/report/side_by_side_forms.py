"""Writes a comparison of reports for a terminal, as a page, Markdown or JSON; other formats show the last report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from itertools import groupby
from operator import attrgetter, itemgetter
from pathlib import Path
from textwrap import wrap
from typing import Any

import msgspec

from pytest_rvads.logic.outcome import counted
from pytest_rvads.report.files import FORMATS, fitting, write
from pytest_rvads.report.markdown import section
from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Section
from pytest_rvads.report.side_by_side import Shared, SideBySide, changed, differing
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.installed import load
from pytest_rvads.support.wording import first, one_line, plural

_TITLE = "rvads: sessions side by side"
_Again = Callable[[Shared], str]
_MOST = 10
"""Largest number of lines of a section, and of tables, that a terminal shows; further lines and tables are counted."""
_LINE = 2000
"""Largest number of characters of a line on a terminal."""


def text(compared: SideBySide, width: int) -> str:
    """Return a comparison as text for a terminal of `width` columns; only a longer word makes a line wider."""
    wrapped = partial(wrap, width=width, break_long_words=False, break_on_hyphens=False)
    lines, parts = list[str](), list(sections(compared, _MOST))
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


def sections(compared: SideBySide, most: int | None = None, again: _Again = attrgetter("example")) -> Iterator[Section]:
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


def _markdown(compared: SideBySide) -> str:
    lines = [f"# {_TITLE}"]
    for part in sections(compared):
        lines += ["", *section(part)]
    return "\n".join(lines) + "\n"


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
    ".md": lambda compared, _: _markdown(compared),
    ".json": lambda compared, _: json_of(content(compared)),
}
"""By the ending of a file, the function that renders the reports for a file in a folder."""
