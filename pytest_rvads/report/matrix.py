"""The verdict matrix of a session, as plain values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record

__all__ = ["Entry", "Matrix", "group_of", "matrices", "member_of"]


_CLASS = re.compile(r"-class(\d{2,9})-")
_NAMED = 3
"""Recordings of a row that are named."""
_MOST = 200_000
"""Most entries of a matrix: nobody reads a larger one, and most of it would be empty."""


class Entry(NamedTuple):
    """What stands where a row and a column of a matrix meet."""

    text: str = ""
    """``pass``, ``3/4 fail``, ``NA``, ``xfail I3``; empty where no item is."""
    outcome: Outcome | None = None
    """The worst in it."""
    known: bool = False
    """Whether all that went wrong was known."""

    @property
    def bad(self) -> bool:
        """Whether something went wrong that was not known."""
        return bool(self.outcome and self.outcome.bad and not self.known)

    @property
    def style(self) -> str:
        """How a terminal shows it: bold only where all of it went wrong."""
        style = self.outcome.style if self.outcome else ""
        return style if self.outcome and self.text == self.outcome.cell else style.removeprefix("bold ")


@dataclass(frozen=True, slots=True)
class Matrix:
    """The verdicts of one test at one junction, like a table of the paper."""

    title: str
    columns: tuple[tuple[str, str], ...]
    """(configuration, rule) of each column."""
    rows: tuple[tuple[str, tuple[Entry, ...]], ...]
    """Classes with equal verdicts, and an entry per column; likewise of runs that were recorded."""
    members: tuple[tuple[int | str, ...], ...] = ()
    """Per row its classes by number, or its recordings by name."""
    corner: str = "class"
    """What a row is: class, or recording."""

    @property
    def headings(self) -> list[str]:
        """Configuration, where there is one, and rule of each column."""
        return [f"{cfg} {rule}".lstrip() for cfg, rule in self.columns]

    def shortened(self, most: int) -> Matrix:
        """Return the matrix with at most so many rows: those in which something is wrong, then the first ones."""
        wrong = [any(entry.bad or entry.known for entry in entries) for _, entries in self.rows]
        kept = sorted(sorted(range(len(self.rows)), key=lambda i: not wrong[i])[:most])
        return replace(self, rows=tuple(self.rows[i] for i in kept), members=tuple(self.members[i] for i in kept))


def matrices(records: Sequence[Record]) -> list[Matrix]:
    """Return a matrix per test file, test function, junction and kind of traffic, in the order of the items."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(group_of(record), []).append(record)
    return [_matrix(title, group) for title, group in groups.items()]


def group_of(record: Record) -> str:
    """Return the title of the matrix that a record belongs to."""
    among = " as recorded" if record.recording else f" among {record.traffic} traffic" if record.traffic else ""
    return f"{record.junction}{among}   {record.nodeid.partition('[')[0]}"


def _matrix(title: str, records: Sequence[Record]) -> Matrix:
    columns = tuple(sorted({(record.cfg, record.asks) for record in records}))
    recorded = bool(records[0].recording)
    cells: dict[Any, dict[tuple[str, str], list[Record]]] = {}
    for record in records:
        cells.setdefault(member_of(record), {}).setdefault((record.cfg, record.asks), []).append(record)
    if len(cells) * len(columns) > _MOST:
        what = "recordings" if recorded else "classes"
        return Matrix(f"{title}: {len(cells):,} {what} in {len(columns):,} columns are too many for a table", (), ())
    alike: dict[tuple[Entry, ...], list[Any]] = {}
    for member in sorted(cells):
        row = tuple(_entry(cells[member].get(column, [])) for column in columns)
        alike.setdefault(row, []).append(member)
    width = max(map(_width, records))
    rows = tuple((_names(found) if recorded else _spans(found, width), row) for row, found in alike.items())
    return Matrix(title, columns, rows, tuple(map(tuple, alike.values())), "recording" if recorded else "class")


def member_of(record: Record) -> int | str:
    """Return what a record stands for in a row of its matrix: the number of its class, or its recording."""
    return record.recording or record.cls


def _names(recordings: Sequence[str]) -> str:
    """Return the first recordings of a row, and how many more there are."""
    more = len(recordings) - _NAMED
    return ", ".join(recordings[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _width(record: Record) -> int:
    """Return how many digits the number of a class has in ids, at least two."""
    found = _CLASS.search(record.nodeid)
    return len(found[1]) if found else 2


def _entry(records: Sequence[Record]) -> Entry:
    """Return an outcome, or where the rows differ the bad ones with their share; known failures apart."""
    if not records:
        return Entry()
    counts = Counter(record.status for record in records if not record.known)
    known = Counter(f"xfail {record.known.partition(':')[0]}" for record in records if record.known)
    worst = min((record.status for record in records), key=lambda outcome: outcome.severity)
    bad = [outcome for outcome in Outcome.worst_first() if counts[outcome] and outcome.bad]
    only_known = bool(known) and not bad
    if len(counts) + len(known) == 1:
        return Entry(next(iter(known), worst.cell), worst, only_known)
    shown = [(counts[outcome], outcome.small) for outcome in bad] + [(known[name], name) for name in sorted(known)]
    if not shown:
        # What did not run comes first: it may be anything.
        rest = sorted(counts, key=lambda outcome: (outcome is not Outcome.NOT_RUN, outcome.severity))
        shown = [(counts[outcome], outcome.cell) for outcome in rest]
    return Entry(", ".join(f"{count}/{len(records)} {name}" for count, name in shown), worst, only_known)


def _spans(numbers: Sequence[int], width: int) -> str:
    """Return class numbers as ranges: ``01-04, 07``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a:0{width}d}" if a == b else f"{a:0{width}d}-{b:0{width}d}" for a, b in spans)
