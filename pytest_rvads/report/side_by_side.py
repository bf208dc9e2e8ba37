"""Compares reports side by side: the command and result of each, the verdicts per rule, and the causes of failures.

Items are matched by node id, as with a baseline, so controllers are compared by running the same tests with each controller. Of
two reports, the comparison also has the items whose verdicts differ.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
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
    readings: tuple[Callable[[str], str], ...] = (str, lambda text: _NUMBER.sub("#", text))
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
