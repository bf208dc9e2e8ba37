"""Compares two sessions side by side: the command and result of each session, and the test items whose verdicts differ.

Items are matched by node id, as with a baseline, so two controllers are compared by running the same tests with each controller.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.report import triage
from pytest_rvads.report.baseline import compare, with_baseline
from pytest_rvads.report.matrix import SAME, Entry, Matrices, Matrix, Place, place_of
from pytest_rvads.report.outline import Head, outline
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Comparison, Report, cell_of
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import plural

_NUMBER = re.compile(r"\d+(\.\d+)?")
_WHERE = {(True, False): "only in A", (False, True): "only in B", (True, True): "in both"}


@dataclass(frozen=True, slots=True)
class Side:
    """One of two compared sessions."""

    name: str
    head: tuple[str, ...]
    """Lines on the time, command and driver of the session, its totals, and its end."""
    notes: tuple[str, ...]
    """Missing or doubtful parts of the session."""


@dataclass(frozen=True, slots=True)
class Ruled:
    """The verdicts of a rule in each of two compared sessions."""

    rule: str
    a: Counter[Tallied]
    b: Counter[Tallied]


@dataclass(frozen=True, slots=True)
class Shared:
    """A cause of failures, and the number of failures with this cause in each of two compared sessions."""

    rule: str
    text: str
    a: int
    b: int
    example: str
    """Node id of the first item with the cause."""

    @property
    def where(self) -> str:
        """Which sessions have the cause, in words."""
        return _WHERE[self.a > 0, self.b > 0]


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Two compared sessions, called A and B, and their differences."""

    a: Side
    b: Side
    common: int
    """Number of items that both sessions have."""
    comparison: Comparison
    """The changes from A to B."""
    matrices: tuple[Matrix, ...] | None
    """Per test and junction, with ``pass -> FAIL`` for an item that differs; None if the verdicts are too many for tables."""
    rules: tuple[Ruled, ...]
    causes: tuple[Shared, ...]
    later: Report
    """The report of B, with A as its baseline."""

    @property
    def differ(self) -> bool:
        """Whether any verdict differs between the two sessions."""
        return (
            self.comparison.count("UNCHANGED", "OUTSIDE") < len(self.comparison.changes)
            or self.matrices is None
            or any(map(differing, self.matrices))
        )


def side_by_side(a: tuple[str, Report], b: tuple[str, Report]) -> SideBySide:
    """Return the comparison of two sessions."""
    (name_a, earlier), (name_b, later) = a, b
    common = len({record.nodeid for record in earlier.records} & {record.nodeid for record in later.records})
    if not common:
        raise RvadsError(
            f"{name_a} ({plural(len(earlier.records), 'item')}) and {name_b} ({plural(len(later.records), 'item')}) have no "
            "item in common, and items are matched by their ids: compare two sessions of the same tests"
        )
    planned = set(later.planned)
    lost = {record.nodeid for record in earlier.records if cell_of(record) not in planned}
    comparison = compare(later, earlier, "A", lost.__contains__, same=False)
    rules: dict[str, Ruled] = {}
    for second, records in enumerate((earlier.records, later.records)):
        for record in records:
            ruled = rules.get(record.asks) or rules.setdefault(record.asks, Ruled(record.asks, Counter(), Counter()))
            (ruled.b if second else ruled.a)[record.counts_as] += 1
    sides: list[Side] = []
    for name, report in (a, b):
        head = next((block.lines for block in outline(report) if isinstance(block, Head)), ())
        sides.append(Side(name, head, report.notes))
    return SideBySide(
        sides[0],
        sides[1],
        common,
        comparison,
        _merged_matrices(earlier.records, later.records),
        tuple(rules[rule] for rule in sorted(rules)),
        _shared_causes(earlier.records, later.records),
        with_baseline(later, comparison),
    )


def _merged_matrices(earlier_records: Iterable[Record], later_records: Iterable[Record]) -> tuple[Matrix, ...] | None:
    """Return the verdict matrices of two sessions in one; None if the sessions have too many verdicts for tables."""
    old_matrices, new_matrices = Matrices(), Matrices()
    before: dict[str, tuple[Place, Outcome, str]] = {}
    for record in earlier_records:
        old_matrices.add(record)
        before[record.nodeid] = _standing(record)
    moved: set[Place] = set()
    for record in later_records:
        new_matrices.add(record)
        standing = _standing(record)
        earlier = before.pop(record.nodeid, None)
        if earlier != standing:
            moved |= {standing[0], (earlier or standing)[0]}
    moved |= {place for place, *_ in before.values()}
    return None if old_matrices.too_many or new_matrices.too_many else tuple(new_matrices.after(old_matrices, moved))


def _standing(record: Record) -> tuple[Place, Outcome, str]:
    """Return the place of a record in its verdict matrix, its status, and the reason of a known failure."""
    return place_of(record), record.status, (record.known or "").partition(":")[0]


def _shared_causes(earlier_records: Iterable[Record], later_records: Iterable[Record]) -> tuple[Shared, ...]:
    """Return the causes of failures: first causes only in the later session, then only in the earlier session, then in both.

    Causes with equal texts are the same cause. Among all other causes, causes whose texts differ only in numbers are the same.
    """
    causes: list[list[triage.Cause]] = []
    for records in (earlier_records, later_records):
        by_cause = triage.causes()
        for record in records:
            by_cause.add(record)
        causes.append(by_cause.causes())
    old_causes, new_causes = causes
    shared: list[Shared] = []
    for reading in (str, lambda text: _NUMBER.sub("#", text)):
        waiting: dict[str, list[triage.Cause]] = {}
        for cause in old_causes:
            waiting.setdefault(reading(cause.text), []).append(cause)
        for cause in list(new_causes):
            if match := waiting.get(reading(cause.text)):
                earlier = match.pop(0)
                old_causes.remove(earlier)
                new_causes.remove(cause)
                shared.append(Shared(cause.rule, cause.text, earlier.count, cause.count, cause.example))
    only = [
        *(Shared(c.rule, c.text, 0, c.count, c.example) for c in new_causes),
        *(Shared(c.rule, c.text, c.count, 0, c.example) for c in old_causes),
    ]
    return (*only, *sorted(shared, key=lambda cause: -cause.b))


def differing(matrix: Matrix) -> int:
    """Return the number of cells of a matrix in which two sessions differ."""
    return sum(
        len(members) * sum(map(changed, entries)) for (_, entries), members in zip(matrix.rows, matrix.members, strict=True)
    )


def changed(entry: Entry) -> bool:
    """Return whether two sessions differ in a cell of a matrix."""
    return entry.text not in ("", SAME)
