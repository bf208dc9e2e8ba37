"""Writes two sessions side by side for a terminal, as a page, as Markdown and as JSON, and the later session in other formats."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from textwrap import wrap
from typing import Any

import msgspec

from pytest_rvads.logic.outcome import Tallied, counted
from pytest_rvads.report.files import FORMATS, fitting, write
from pytest_rvads.report.markdown import section
from pytest_rvads.report.matrix import Entry, Matrix
from pytest_rvads.report.outline import Section
from pytest_rvads.report.page import rendered
from pytest_rvads.report.side_by_side import Ruled, Shared, SideBySide, changed, differing
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.wording import first, one_line, plural

__all__ = ["save", "sections", "text"]

_TITLE = "rvads: two sessions side by side"
_MOST = 10
"""Most lines of a section, and most tables, that a terminal shows; the others are counted."""
_LINE = 2000
"""Most characters of a line on a terminal."""


def text(found: SideBySide, width: int) -> str:
    """Return the text for a terminal of `width` columns; only unbreakable words, such as an id, are wider."""
    wrapped = partial(wrap, width=width, break_long_words=False, break_on_hyphens=False)
    lines = []
    for part in sections(found, _MOST):
        lines += wrapped(one_line(part.title, _LINE))
        for line in part.lines:
            lines += wrapped(one_line(line, _LINE), initial_indent="  ", subsequent_indent="      ")
        lines.append("")
    if any("... and " in line for line in lines):
        lines += wrapped("what is left out here stands in files: -o FILE.html, FILE.md or FILE.json")
    return "\n".join(lines)


def save(path: Path, found: SideBySide) -> None:
    """Write two sessions side by side, in the format that the suffix of `path` names.

    A format with a row or case per item, which can't show two sessions, shows the later session and the changes.

    Raises:
        RvadsError: no format has this suffix.
        OSError: the file can't be written.
    """
    own = _FORMATS.get(fitting(path).suffix)
    write(path, own(found) if own else FORMATS[path.suffix](found.later, path.parent))


def sections(found: SideBySide, most: int | None = None) -> Iterator[Section]:
    """Yield the sections on two sessions, in order; empty sections are left out.

    Args:
        found: the sessions.
        most: most lines of a section, most tables, and most changes of a kind; the others are counted.
    """
    for letter, side in (("A", found.a), ("B", found.b)):
        yield Section(f"{letter}: {side.name}", (*(f"note: {note}" for note in side.notes), *side.head), side=True)
    if found.comparison.versions:
        yield Section("versions that differ", found.comparison.versions)
    changes = replace(found.comparison, versions=())
    yield Section("what changed from A to B", (changes.headline if found.differ else _same(found),))
    yield from _tables(found, most)
    for kind, lines in groupby(changes.lines(most), lambda line: line.partition(" ")[0]):
        yield Section(f"{kind}: {plural(changes.count(kind), 'item')}", tuple(line.removeprefix(kind).strip() for line in lines))
    yield Section(
        "verdicts per rule",
        tuple(_cut([_sums(ruled) for ruled in found.rules], most)),
        ("rule", "A", "B"),
        tuple(((ruled.rule, ""), (counted(ruled.a), ""), (counted(ruled.b), "")) for ruled in found.rules),
    )
    if found.causes:
        yield Section(
            "causes of failures",
            tuple(_cut([_told(cause) for cause in found.causes], most)),
            ("where", "A", "B", "rule", "cause", "first"),
            tuple(
                ((c.where, _mark(c)), (_count(c.a), ""), (_count(c.b), ""), (c.rule, ""), (c.text, ""), (c.example, ""))
                for c in found.causes
            ),
        )


def _same(found: SideBySide) -> str:
    """Return the sentence that no verdict differs, with its limitations."""
    absent = found.comparison.count("OUTSIDE")
    more = f"; {plural(absent, 'item')} of A not selected in B" if absent else ""
    dated = any(line.startswith("began ") for line in found.a.head)
    once = "; they are reports of one session" if dated and found.a.head == found.b.head else ""
    return f"no verdict of the {plural(found.common, 'item')} that both have differs{more}{once}"


def _tables(found: SideBySide, most: int | None) -> Iterator[Section]:
    """Yield a section per table with differing cells."""
    if found.matrices is None:
        yield Section("verdicts", ("too many for tables: the changes name the items",))
        return
    told = [matrix for matrix in found.matrices if differing(matrix)]
    for matrix in told[:most]:
        yield _table(matrix, most)
    if most is not None and len(told) > most:
        yield Section("more tables", (f"... and {plural(len(told) - most, 'more table')} in which something differs",))


def _table(matrix: Matrix, most: int | None) -> Section:
    """Return a section with the rows and columns of a matrix that contain differing cells."""
    columns = [i for i in range(len(matrix.columns)) if any(changed(entries[i]) for _, entries in matrix.rows)]
    rows = [i for i, (_, entries) in enumerate(matrix.rows) if any(map(changed, entries))]
    count = differing(matrix)
    cells = sum(
        len(members) * sum(bool(entry.text) for entry in entries)
        for (_, entries), members in zip(matrix.rows, matrix.members, strict=True)
    )
    return Section(
        f"{matrix.title}: {count:,} of {cells:,} cells differ{'s' if count == 1 else ''}",
        tuple(_cut([line for i in rows for line in _row(matrix, i)], most)),
        (matrix.corner, *(matrix.headings[i] for i in columns)),
        tuple(
            ((matrix.rows[i][0], ""), *((matrix.rows[i][1][k].text, _better(matrix.rows[i][1][k])) for k in columns))
            for i in rows
        ),
    )


def _row(matrix: Matrix, number: int) -> Iterator[str]:
    """Yield the differences in a row of a matrix, a line per rule and change: ``v3, class 07, p1: pass -> FAIL (C, E)``."""
    label, entries = matrix.rows[number]
    found: dict[tuple[str, str], list[str]] = {}
    for (cfg, rule), entry in zip(matrix.columns, entries, strict=True):
        if changed(entry):
            found.setdefault((rule, entry.text), []).append(cfg)
    variant = matrix.variants[number]
    name = f"{matrix.corner.removeprefix('variant, ')} {label.removeprefix(variant).strip()}"
    for (rule, text), cfgs in found.items():
        where = f" ({first(cfgs, None)})" if any(cfgs) else ""
        yield f"{f'{variant}, ' if variant else ''}{name}, {rule}: {text}{where}"


def _better(entry: Entry) -> str:
    """Return whether a cell has changed to good or bad; empty for a cell without change or without such a value."""
    passed = entry.outcome is not None and entry.outcome.meaning == "passed"
    return "bad" if entry.bad else "good" if passed and changed(entry) else ""


def _sums(ruled: Ruled) -> str:
    was, now = counted(ruled.a) or "none", counted(ruled.b) or "none"
    return f"{ruled.rule}: {now} in both" if was == now else f"{ruled.rule}: {was} -> {now}"


def _told(cause: Shared) -> str:
    count = f"{cause.a} -> {cause.b}" if cause.a and cause.b else str(cause.a or cause.b)
    return f"{cause.where}: {count} x {cause.rule}: {cause.text} (first: {cause.example})"


def _mark(cause: Shared) -> str:
    return "" if cause.a and cause.b else "bad" if cause.b else "good"


def _count(number: int) -> str:
    return str(number) if number else ""


def _cut(lines: list[str], most: int | None) -> list[str]:
    more = 0 if most is None else len(lines) - most
    return lines if more <= 0 else [*lines[:most], f"... and {more} more"]


def _page(found: SideBySide) -> str:
    return rendered(_TITLE, sections(found), {})


def _markdown(found: SideBySide) -> str:
    lines = [f"# {_TITLE}"]
    for part in sections(found):
        lines += ["", *section(part)]
    return "\n".join(lines) + "\n"


def _json(found: SideBySide) -> str:
    """Return all sections for programs. Numbers of verdicts have the name of their status as key, known failures ``known``."""
    tables = None if found.matrices is None else list(map(_cells, found.matrices))
    content = {
        "format": "rvads-comparison",
        "version": 1,
        "a": asdict(found.a),
        "b": asdict(found.b),
        "common": found.common,
        "versions": found.comparison.versions,
        "changes": [asdict(change) for change in found.comparison.changes if change.kind != "UNCHANGED"],
        "tables": tables,
        "rules": [{"rule": one.rule, "a": _by_name(one.a), "b": _by_name(one.b)} for one in found.rules],
        "causes": [{"where": cause.where, **asdict(cause)} for cause in found.causes],
    }
    return msgspec.json.format(encode(content), indent=1).decode() + "\n"


def _cells(matrix: Matrix) -> dict[str, Any]:
    rows = [
        {"label": label, "variant": variant, "cells": [entry.text for entry in entries]}
        for (label, entries), variant in zip(matrix.rows, matrix.variants, strict=True)
    ]
    return {"title": matrix.title, "junction": matrix.junction, "corner": matrix.corner, "columns": matrix.columns, "rows": rows}


def _by_name(counts: dict[Tallied, int]) -> dict[str, int]:
    return {"known" if kind is None else kind.value: count for kind, count in counts.items()}


_FORMATS: dict[str, Callable[[SideBySide], str]] = {".html": _page, ".md": _markdown, ".json": _json}
"""What shows both sessions, by the ending of the file."""
