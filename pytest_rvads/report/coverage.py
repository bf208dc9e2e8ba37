"""Coverage: which cells of the tables a session exercised, of those that its tests ask for.

A cell is (junction, class, configuration, rule), and with a subject its seat and the traffic around it. It is exercised when
a rule asked something of the system under test there, and got an answer: PASS, FAIL or OPEN, expected or not. What only the
traffic was asked exercises nothing, nor does NA, an error, or an item that did not run.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from pytest_rvads.report.record import Record, asked
from pytest_rvads.report.session_report import Cell, Report, cell_of

__all__ = ["Coverage", "dropped", "measure", "shortfall"]

_REASONS = ("ERROR", "FLAKY", "NOT JUDGED", "UNAVOIDABLE", "PROVOKED", "NA", "NOT RUN")
"""Why a cell is not exercised, the first that applies to one of its items."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How much of what the tests ask for was exercised."""

    planned: int
    """Cells that the collected tests expand to, before anything was deselected."""
    exercised: int
    idle: dict[str, int]
    """Why the others were not: status of their items, or ``not selected``; with how many cells."""

    @property
    def percent(self) -> float:
        """Share of the planned cells [%]; 0 where nothing was planned."""
        return 100 * self.exercised / self.planned if self.planned else 0.0

    def __str__(self) -> str:
        # Rounded down: 99.96 % is not 100.0 %.
        share = int(self.percent * 10) / 10
        idle = ", ".join(f"{count} {why}" for why, count in self.idle.items())
        return f"{self.exercised}/{self.planned} cells exercised ({share:.1f} %)" + (f": {idle}" if idle else "")


def measure(report: Report) -> Coverage:
    """Return the coverage of a session over its cells."""
    cells: dict[Cell, list[Record]] = {tuple(cell): [] for cell in report.planned}  # type: ignore[misc]
    for record in report.records:
        cells.setdefault(cell_of(record), []).append(record)
    idle: Counter[str] = Counter()
    for records in cells.values():
        if not any(map(asked, records)):
            statuses = {record["status"] for record in records}
            idle[next((reason for reason in _REASONS if reason in statuses), "not selected")] += 1
    order = (*_REASONS, "not selected")
    ordered = {why if why == "NA" else why.lower(): idle[why] for why in order if idle[why]}
    return Coverage(len(cells), len(cells) - idle.total(), ordered)


def shortfall(report: Report, least: float) -> str:
    """Return why the coverage is not enough, in one sentence, or nothing.

    Args:
        report: a session or several merged.
        least: share of the planned cells that have to be exercised [%].
    """
    found = measure(report)
    if found.planned and 100 * found.exercised >= least * found.planned:
        return ""
    return f"coverage is below {least:g} %: {found}"


def dropped(report: Report) -> list[str]:
    """Return a line on the points of grids that were left out because nobody could stop there, if there are any."""
    if not report.left_out:
        return []
    tests = ", ".join(f"{count} of {test}" for test, count in report.left_out.items())
    count = sum(report.left_out.values())
    return [f"{count} point{'' if count == 1 else 's'} beyond v(d)max left out: {tests}"]
