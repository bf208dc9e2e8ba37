"""The verdict matrix of a session, as plain values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, RecordedItem
from pytest_rvads.report.rollup import natural
from pytest_rvads.support.wording import first

__all__ = ["SAME", "Entry", "Matrices", "Matrix", "Place", "group_of", "member_of", "place_of"]


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
SAME = "="
"""What stands in a cell of two sessions in which no item differs."""
_Row = tuple[str, Any]
"""A variant, and the number of a class or the name of a recording."""
Place = tuple[str, _Row, tuple[str, str]]
"""Of a cell: title, row, and column."""
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
    """Per row: a label of the classes or recordings with equal verdicts, and an entry per column. The rows of a variant stand
    below each other, and their labels begin with the name of the variant."""
    members: tuple[tuple[int | str, ...], ...] = ()
    """Per row what `member_of` says of its records."""
    corner: str = "class"
    """What a row is: class, or recording, with a variant where there are any."""
    junction: str = ""
    variants: tuple[str, ...] = ()
    """Per row its variant, empty without any."""

    @property
    def numbers(self) -> dict[str, str]:
        """What stands for configurations with long labels, in every format: ``#1``, ``#2``, in the order of the columns."""
        long = [label for label in dict.fromkeys(cfg for cfg, _ in self.columns) if len(label) > _LONG]
        return {label: f"#{number}" for number, label in enumerate(long, start=1)}

    @property
    def headings(self) -> list[str]:
        """Headings of the columns: configuration and rule, or the rule alone for recorded runs."""
        return [f"{cfg} {rule}".lstrip() for cfg, rule in self.columns]

    def shortened(self, most: int) -> Matrix:
        """Return the matrix with at most `most` rows and short labels; rows with a failure are kept before other rows."""
        wrong = [any(entry.bad or entry.known for entry in entries) for _, entries in self.rows]
        kept = sorted(sorted(range(len(self.rows)), key=lambda i: not wrong[i])[:most])
        variants = tuple(self.variants[i] for i in kept)
        rows = tuple((_brief(self.rows[i][0], variant), self.rows[i][1]) for i, variant in zip(kept, variants, strict=True))
        return replace(self, rows=rows, members=tuple(self.members[i] for i in kept), variants=variants)


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
        title, row, column = place_of(record)
        group = self._groups.get(title) or self._groups.setdefault(title, _Group(record))
        self._room -= group.add(record, row, column)
        if self._room < 0:
            self._groups.clear()

    def matrices(self) -> list[Matrix]:
        """Return the matrices; none where the verdicts are too many."""
        return [group.matrix(title) for title, group in self._groups.items()]

    def after(self, earlier: Matrices, changed: Container[Place]) -> list[Matrix]:
        """Return the matrices of an earlier session and this one as one each, in the order of this one.

        Args:
            earlier: of the other session.
            changed: cells in which items differ.
        """
        found = []
        for title in {**self._groups, **earlier._groups}:
            groups = [all_of[title] for all_of in (earlier._groups, self._groups) if title in all_of]
            found.append(_tabled(title, groups, partial(self._change, earlier, changed, title)))
        return found

    def _change(self, earlier: Matrices, changed: Container[Place], title: str, row: _Row, column: tuple[str, str]) -> Entry:
        """Return what became of a cell."""
        was, now = (
            all_of[title].entry(row, column) if title in all_of else Entry() for all_of in (earlier._groups, self._groups)
        )
        if (title, row, column) not in changed:
            return Entry(SAME if now.text else "")
        return Entry(f"{was.text or 'absent'} -> {now.text or 'absent'}", now.outcome, now.known)


def group_of(record: Record) -> str:
    """Return the title of the matrix that a record belongs to: junction, traffic, and test, where there is one."""
    among = " as recorded" if isinstance(record, RecordedItem) else f" among {record.traffic} traffic" if record.traffic else ""
    return f"{record.junction}{among}   {record.nodeid.partition('[')[0] if record.test else ''}".rstrip()


class _Group:
    """What was counted for a matrix: per row and column the verdicts, by reason where they are known failures."""

    def __init__(self, first: Record) -> None:
        self.junction, self.recorded = first.junction, isinstance(first, RecordedItem)
        self.width = 0
        self.columns: set[tuple[str, str]] = set()
        self.cells: dict[_Row, dict[tuple[str, str], _Counts]] = {}

    @property
    def wide(self) -> bool:
        """Whether there are more columns than anybody reads."""
        return len(self.columns) > _WIDE

    def add(self, record: Record, row: _Row, column: tuple[str, str]) -> bool:
        """Take a record of a cell in, and return whether it is the first of it."""
        self.width = max(self.width, _width(record))
        columns = self.cells.setdefault(row, {})
        new = column not in columns
        self.columns.add(column)
        counts = columns.setdefault(column, {})
        kind = f"xfail {record.known.partition(':')[0]}" if record.known else "", record.status
        counts[kind] = counts.get(kind, 0) + 1
        return new

    def entry(self, row: _Row, column: tuple[str, str]) -> Entry:
        """Return what stands in a cell."""
        return _entry(self.cells.get(row, {}).get(column, {}))

    def matrix(self, title: str) -> Matrix:
        """Return the matrix; one without rows where nobody could read it."""
        return _tabled(title, (self,), self.entry)


def _tabled(title: str, groups: Sequence[_Group], entry: Callable[[_Row, tuple[str, str]], Entry]) -> Matrix:
    """Return the matrix over the cells of groups, in which variants follow each other and equal rows of one are merged."""
    columns = tuple(sorted(set().union(*(group.columns for group in groups))))
    # Whoever numbers versions means that the tenth comes after the ninth.
    cells = sorted(set().union(*(group.cells for group in groups)), key=lambda row: (natural(row[0]), *row))
    recorded, junction = groups[0].recorded, groups[0].junction
    if len(cells) * len(columns) > _MOST:
        what = "recordings" if recorded else "classes"
        said = f"{len(cells):,} {what} in {len(columns):,} columns are too many for a table"
        return Matrix(f"{title}: {said}", (), (), junction=junction)
    alike: dict[tuple[str, tuple[Entry, ...]], list[Any]] = {}
    for row in cells:
        alike.setdefault((row[0], tuple(entry(row, column) for column in columns)), []).append(row[1])
    width = max(group.width for group in groups)
    variants = tuple(variant for variant, _ in alike)
    corner = "recording" if recorded else "class"
    return Matrix(
        title,
        columns,
        tuple(
            (_label(variant, first(found, _NAMED) if recorded else _spans(found, width)), entries)
            for (variant, entries), found in alike.items()
        ),
        tuple(tuple(_named(variant, member) for member in found) for (variant, _), found in alike.items()),
        f"variant, {corner}" if any(variants) else corner,
        junction,
        variants,
    )


def place_of(record: Record) -> Place:
    """Return the cell of a matrix that a record belongs to."""
    if isinstance(record, RecordedItem):
        return group_of(record), (record.variant, record.recording), ("", record.asks)
    return group_of(record), (record.variant, record.cls), (record.cfg, record.asks)


def member_of(record: Record) -> int | str:
    """Return what a record stands for in a row of its matrix: the number of its class, or its recording; with its variant."""
    return _named(*place_of(record)[1])


def _named(variant: str, member: int | str) -> int | str:
    return f"{variant} {member}" if variant else member


def _label(variant: str, members: str) -> str:
    return f"{variant}  {members}" if variant else members


def _brief(label: str, variant: str) -> str:
    """Return the label of a row with no more classes than a line has room for."""
    return _label(variant, first(label.removeprefix(_label(variant, "")).split(", "), _SPANS))


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
