"""The verdict matrices of a session: tables of outcomes by class, configuration and rule."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record, RecordedItem
from pytest_rvads.support.wording import first, natural

_CLASS = re.compile(r"-class(\d{2,9})-")
_LONG = 8
"""Length of a configuration's label above which tables show a number, and explain the number below the table."""
_NAMED = 3
"""Largest number of recordings of a row that are named."""
_SPANS = 10
"""Largest number of ranges of classes in the short label of a row."""
_WIDE, _TABLES = 200, 100
"""Largest numbers of columns of a table, and of tables, that anybody reads; a larger report has sums instead."""
_MOST = 200_000
"""Largest number of entries of a matrix, and of all matrices; nobody reads more, and a larger matrix would be mostly empty."""
SAME = "="
"""Text of a cell in a comparison of two sessions, if no item of the cell differs."""
_Row = tuple[str, Any]
"""A row: the variant (values of the test's other parameters), and the number of a class or the name of a recording."""
Place = tuple[str, _Row, tuple[str, str]]
"""The place of a cell: title of the matrix, row, and column."""
_Spot = tuple[_Row, tuple[str, str]]
"""The row and the column of a cell."""
_Counts = Counter[tuple[str, Outcome]]
"""Number of verdicts by reason and status; the reason is empty except for a known failure."""


class Entry(NamedTuple):
    """The content of a cell of a verdict matrix."""

    text: str = ""
    """``pass``, ``3/4 fail``, ``NA``, ``xfail I3``; empty for a cell without items."""
    outcome: Outcome | None = None
    """The worst outcome of the items; None for a cell without items."""
    known: bool = False
    """Whether all failures of the items were known."""

    @property
    def bad(self) -> bool:
        """Whether a test item of the cell failed and the failure was not known."""
        return bool(self.outcome and self.outcome.bad and not self.known)

    @property
    def style(self) -> str:
        """The style of the cell on a terminal; bold only if all test items of the cell failed."""
        style = self.outcome.style if self.outcome else ""
        return style if self.outcome and self.text == self.outcome.cell else style.removeprefix("bold ")


@dataclass(frozen=True, slots=True)
class Matrix:
    """The verdicts of one test at one junction, like a table of the paper."""

    title: str
    columns: tuple[tuple[str, str], ...]
    """(configuration, rule) of each column."""
    rows: tuple[tuple[str, tuple[Entry, ...]], ...]
    """Per row: a label of the classes or recordings with equal verdicts, and an entry per column. The rows of a variant follow
    each other, and their labels begin with the name of the variant."""
    members: tuple[tuple[int | str, ...], ...] = ()
    """Per row, the results of `member_of` for its records."""
    corner: str = "class"
    """Heading of the column with the labels: class or recording, with a variant if any test has variants."""
    junction: str = ""
    variants: tuple[str, ...] = ()
    """Per row, its variant; empty for a row without variant."""

    @property
    def numbers(self) -> dict[str, str]:
        """The numbers that replace long labels of configurations, by label: ``#1``, ``#2``, in the order of the columns."""
        long = [label for label in dict.fromkeys(cfg for cfg, _ in self.columns) if len(label) > _LONG]
        return {label: f"#{number}" for number, label in enumerate(long, start=1)}

    @property
    def headings(self) -> list[str]:
        """Headings of the columns: configuration and rule, or the rule alone for recorded runs."""
        return [f"{cfg} {rule}".lstrip() for cfg, rule in self.columns]

    def plain(self) -> Iterator[str]:
        """Yield the verdicts as lines of text."""
        for rows, entries in self.rows:
            texts = (f"{column} {e.text}" for column, e in zip(self.headings, entries, strict=True) if e.text)
            yield f"{self.corner} {rows}: {'; '.join(texts)}"

    def shortened(self, most: int) -> Matrix:
        """Return the matrix with at most `most` rows and short labels; rows with a failure are kept before other rows."""
        wrong = [any(entry.bad or entry.known for entry in entries) for _, entries in self.rows]
        shown_rows = sorted(sorted(range(len(self.rows)), key=lambda i: not wrong[i])[:most])
        variants = tuple(self.variants[i] for i in shown_rows)
        rows = []
        for i, variant in zip(shown_rows, variants, strict=True):
            label, entries = self.rows[i]
            begin = f"{variant}  " if variant else ""
            rows.append((begin + first(label.removeprefix(begin).split(", "), _SPANS), entries))
        return replace(self, rows=tuple(rows), members=tuple(self.members[i] for i in shown_rows), variants=variants)


class Matrices:
    """Counts records in a verdict matrix per test function, junction and kind of traffic, in the order of the test items."""

    def __init__(self) -> None:
        self._counts: dict[str, dict[_Spot, _Counts]] = defaultdict(lambda: defaultdict(Counter))
        """By title of a matrix and by row and column, the number of verdicts."""
        self._first: dict[str, Record] = {}
        self._digits: dict[str, int] = {}
        """Number of digits of the class numbers in the ids of the items, at least two."""

    @property
    def too_many(self) -> bool:
        """Whether the report has too many verdicts to show matrices."""
        columns = (len({column for _, column in cells}) for cells in self._counts.values())
        return self._too_large or len(self._counts) > _TABLES or max(columns, default=0) > _WIDE

    @property
    def _too_large(self) -> bool:
        return sum(map(len, self._counts.values())) > _MOST

    def add(self, record: Record) -> None:
        """Count the outcome of a record."""
        title, row, column = place_of(record)
        self._first.setdefault(title, record)
        number = _CLASS.search(record.nodeid)
        self._digits[title] = max(self._digits.get(title, 2), len(number[1]) if number else 2)
        reason = f"xfail {record.known.partition(':')[0]}" if record.known else ""
        self._counts[title][row, column][reason, record.status] += 1

    def matrices(self) -> list[Matrix]:
        """Return the verdict matrices; no matrices if the report has too many verdicts."""
        if self._too_large:
            return []
        return [
            _matrix(title, self._first[title], self._digits[title], {spot: _entry(counts) for spot, counts in cells.items()})
            for title, cells in self._counts.items()
        ]

    def after(self, earlier: Matrices, changed: Container[Place]) -> list[Matrix]:
        """Return the matrices of this session; a cell has its outcomes in an earlier session and in this session, or `SAME`."""
        matrices = []
        for title in {**self._counts, **earlier._counts}:
            old, new = earlier._counts.get(title, {}), self._counts.get(title, {})
            entries = {}
            for row, column in {**old, **new}:
                was, now = (_entry(cells.get((row, column), Counter())) for cells in (old, new))
                entry = Entry(SAME if now.text else "")
                if (title, row, column) in changed:
                    entry = Entry(f"{was.text or 'absent'} -> {now.text or 'absent'}", now.outcome, now.known)
                entries[row, column] = entry
            first = earlier._first.get(title) or self._first[title]
            digits = max(earlier._digits.get(title, 2), self._digits.get(title, 2))
            matrices.append(_matrix(title, first, digits, entries))
        return matrices


def group_of(record: Record) -> str:
    """Return the title of the verdict matrix of a record: junction, traffic, and test if the record has a test."""
    among = " as recorded" if isinstance(record, RecordedItem) else f" among {record.traffic} traffic" if record.traffic else ""
    return f"{record.junction}{among}   {record.nodeid.partition('[')[0] if record.test else ''}".rstrip()


def _entry(verdicts: _Counts) -> Entry:
    """Return the content of a cell: the outcome of all items, or the share of each bad outcome and of each known failure."""
    if not verdicts:
        return Entry()
    counts: Counter[str] = Counter()
    for (reason, outcome), count in verdicts.items():
        counts[reason or outcome] += count
    worst = min((outcome for _, outcome in verdicts), key=lambda outcome: outcome.severity)
    outcomes = sorted({outcome for reason, outcome in verdicts if not reason}, key=lambda outcome: outcome.severity)
    reasons = sorted({reason for reason, _ in verdicts if reason})
    bad = [outcome for outcome in outcomes if outcome.bad]
    only_known = bool(reasons) and not bad
    if len(counts) == 1:
        return Entry(reasons[0] if reasons else worst.cell, worst, only_known)
    shown = [(counts[outcome], outcome.small) for outcome in bad] + [(counts[reason], reason) for reason in reasons]
    if not shown:
        # Items that did not run come first: they could have any outcome.
        outcomes.sort(key=lambda outcome: outcome is not Outcome.NOT_RUN)
        shown = [(counts[outcome], outcome.cell) for outcome in outcomes]
    return Entry(", ".join(f"{count}/{counts.total()} {name}" for count, name in shown), worst, only_known)


def _matrix(title: str, first_record: Record, digits: int, entries: Mapping[_Spot, Entry]) -> Matrix:
    """Return a verdict matrix, in which equal rows of a variant are merged; a matrix that is too large to be read has no rows."""
    columns = tuple(sorted({column for _, column in entries}))
    # The natural order of names puts version 10 after version 9.
    rows = sorted({row for row, _ in entries}, key=lambda row: (natural(row[0]), *row))
    recorded, junction = isinstance(first_record, RecordedItem), first_record.junction
    if len(rows) * len(columns) > _MOST:
        what = "recordings" if recorded else "classes"
        limit_text = f"{len(rows):,} {what} in {len(columns):,} columns are too many for a table"
        return Matrix(f"{title}: {limit_text}", (), (), junction=junction)
    alike: dict[tuple[str, tuple[Entry, ...]], list[Any]] = {}
    for row in rows:
        alike.setdefault((row[0], tuple(entries.get((row, column), Entry()) for column in columns)), []).append(row[1])
    variants = tuple(variant for variant, _ in alike)
    corner = "recording" if recorded else "class"
    return Matrix(
        title,
        columns,
        tuple(
            (
                (f"{variant}  " if variant else "") + (first(members, _NAMED) if recorded else _spans(members, digits)),
                row_entries,
            )
            for (variant, row_entries), members in alike.items()
        ),
        tuple(tuple(f"{variant} {m}" if variant else m for m in members) for (variant, _), members in alike.items()),
        f"variant, {corner}" if any(variants) else corner,
        junction,
        variants,
    )


def place_of(record: Record) -> Place:
    """Return the place of a record in the verdict matrices: title of the matrix, row and column."""
    if isinstance(record, RecordedItem):
        return group_of(record), (record.variant, record.recording), ("", record.asks)
    return group_of(record), (record.variant, record.cls), (record.cfg, record.asks)


def member_of(record: Record) -> int | str:
    """Return the number of a record's class, or the name of its recording; with the variant if the record has a variant."""
    variant, member = place_of(record)[1]
    return f"{variant} {member}" if variant else member


def _spans(numbers: Sequence[int], width: int) -> str:
    """Return class numbers as ranges: ``01-04, 07``."""
    spans: list[list[int]] = []
    for number in numbers:
        if spans and number == spans[-1][1] + 1:
            spans[-1][1] = number
        else:
            spans.append([number, number])
    return ", ".join(f"{a:0{width}d}" if a == b else f"{a:0{width}d}-{b:0{width}d}" for a, b in spans)
