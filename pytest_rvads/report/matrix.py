"""The verdict matrix of a session, as plain values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.wording import first

__all__ = ["Entry", "Matrices", "Matrix", "group_of", "member_of"]


_CLASS = re.compile(r"-class(\d{2,9})-")
_LONG = 8
"""A configuration with a longer label is numbered in tables and spelled out below them."""
_NAMED = 3
"""Recordings of a row that are named."""
_SPANS = 10
"""Ranges of classes of a row that are told in short."""
_WIDE, _TABLES = 200, 100
"""Most columns of a table, and most tables, that anybody reads; beyond them sums are told."""
_MOST = 200_000
"""Most entries of a matrix, and most cells of all of them: nobody reads more, and most of a larger matrix would be empty."""
_Counts = dict[tuple[str, Outcome], int]
"""How many verdicts have a status, known failures apart by what a cell calls them."""


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
    junction: str = ""

    @property
    def numbers(self) -> dict[str, str]:
        """What stands for configurations with long labels, in every format: ``#1``, ``#2``, in the order of the columns."""
        long = [label for label in dict.fromkeys(cfg for cfg, _ in self.columns) if len(label) > _LONG]
        return {label: f"#{number}" for number, label in enumerate(long, start=1)}

    @property
    def headings(self) -> list[str]:
        """Configuration, where there is one, and rule of each column."""
        return [f"{cfg} {rule}".lstrip() for cfg, rule in self.columns]

    def shortened(self, most: int) -> Matrix:
        """Return the matrix with at most so many rows, and no long labels: those in which something is wrong, then the first."""
        wrong = [any(entry.bad or entry.known for entry in entries) for _, entries in self.rows]
        kept = sorted(sorted(range(len(self.rows)), key=lambda i: not wrong[i])[:most])
        rows = tuple((_brief(self.rows[i][0]), self.rows[i][1]) for i in kept)
        return replace(self, rows=rows, members=tuple(self.members[i] for i in kept))


class Matrices:
    """Takes records in and gives a matrix per test file, test function, junction and kind of traffic, in the order of items."""

    def __init__(self) -> None:
        self._groups: dict[str, _Group] = {}
        self._room = _MOST
        """How many more cells are kept; below 0 nobody could read them, and none are."""

    @property
    def too_many(self) -> bool:
        """Whether the verdicts are too many for tables."""
        return self._room < 0 or len(self._groups) > _TABLES or any(group.wide for group in self._groups.values())

    def add(self, record: Record) -> None:
        """Take a record in."""
        if self._room < 0:
            return
        title = group_of(record)
        group = self._groups.get(title) or self._groups.setdefault(title, _Group(record))
        self._room -= group.add(record)
        if self._room < 0:
            self._groups.clear()

    def matrices(self) -> list[Matrix]:
        """Return the matrices; none where the verdicts are too many."""
        return [group.matrix(title) for title, group in self._groups.items()]


def group_of(record: Record) -> str:
    """Return the title of the matrix that a record belongs to: junction, traffic, and test, where there is one."""
    among = " as recorded" if record.recording else f" among {record.traffic} traffic" if record.traffic else ""
    return f"{record.junction}{among}   {record.nodeid.partition('[')[0] if record.test else ''}".rstrip()


class _Group:
    """What was counted for a matrix: per member and column the verdicts, by reason where they are known failures."""

    def __init__(self, first: Record) -> None:
        self._junction, self._recorded = first.junction, bool(first.recording)
        self._width = 0
        self._columns: set[tuple[str, str]] = set()
        self._cells: dict[Any, dict[tuple[str, str], _Counts]] = {}

    @property
    def wide(self) -> bool:
        """Whether there are more columns than anybody reads."""
        return len(self._columns) > _WIDE

    def add(self, record: Record) -> bool:
        """Take a record in, and return whether it is the first of its cell."""
        self._width = max(self._width, _width(record))
        row = self._cells.setdefault(member_of(record), {})
        column = (record.cfg, record.asks)
        new = column not in row
        self._columns.add(column)
        counts = row.setdefault(column, {})
        kind = f"xfail {record.known.partition(':')[0]}" if record.known else "", record.status
        counts[kind] = counts.get(kind, 0) + 1
        return new

    def matrix(self, title: str) -> Matrix:
        """Return the matrix; one without rows where nobody could read it."""
        columns = tuple(sorted(self._columns))
        if len(self._cells) * len(columns) > _MOST:
            what = "recordings" if self._recorded else "classes"
            said = f"{len(self._cells):,} {what} in {len(columns):,} columns are too many for a table"
            return Matrix(f"{title}: {said}", (), (), junction=self._junction)
        alike: dict[tuple[Entry, ...], list[Any]] = {}
        for member in sorted(self._cells):
            row = tuple(_entry(self._cells[member].get(column, {})) for column in columns)
            alike.setdefault(row, []).append(member)
        rows = tuple(
            (first(found, _NAMED) if self._recorded else _spans(found, self._width), row) for row, found in alike.items()
        )
        corner = "recording" if self._recorded else "class"
        return Matrix(title, columns, rows, tuple(map(tuple, alike.values())), corner, self._junction)


def member_of(record: Record) -> int | str:
    """Return what a record stands for in a row of its matrix: the number of its class, or its recording."""
    return record.recording or record.cls


def _brief(label: str) -> str:
    """Return the label of a row with no more classes than a line has room for."""
    return first(label.split(", "), _SPANS)


def _width(record: Record) -> int:
    """Return how many digits the number of a class has in ids, at least two."""
    found = _CLASS.search(record.nodeid)
    return len(found[1]) if found else 2


def _entry(found: _Counts) -> Entry:
    """Return an outcome, or where the rows differ the bad ones with their share; known failures apart."""
    if not found:
        return Entry()
    counts: Counter[Outcome] = Counter()
    known: Counter[str] = Counter()
    for (reason, outcome), count in found.items():
        if reason:
            known[reason] += count
        else:
            counts[outcome] += count
    worst = min((outcome for _, outcome in found), key=lambda outcome: outcome.severity)
    bad = [outcome for outcome in Outcome.worst_first() if counts[outcome] and outcome.bad]
    only_known = bool(known) and not bad
    if len(counts) + len(known) == 1:
        return Entry(next(iter(known), worst.cell), worst, only_known)
    shown = [(counts[outcome], outcome.small) for outcome in bad] + [(known[name], name) for name in sorted(known)]
    if not shown:
        # What did not run comes first: it may be anything.
        rest = sorted(counts, key=lambda outcome: (outcome is not Outcome.NOT_RUN, outcome.severity))
        shown = [(counts[outcome], outcome.cell) for outcome in rest]
    rows = counts.total() + known.total()
    return Entry(", ".join(f"{count}/{rows} {name}" for count, name in shown), worst, only_known)


def _spans(numbers: Sequence[int], width: int) -> str:
    """Return class numbers as ranges: ``01-04, 07``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a:0{width}d}" if a == b else f"{a:0{width}d}-{b:0{width}d}" for a, b in spans)
