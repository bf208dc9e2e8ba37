"""Coverage: the share of the planned cells that a session exercised.

A cell is (junction, class, configuration, rule). If the scenario has a subject (vehicle under test), the cell also names the
entrance of the subject and the traffic around the subject. If somebody walks, the cell also names the pedestrians. A cell of a
recording is (junction, recording, rule). A cell is
exercised if a rule required something of the system under test in the cell, and the verdict is PASS, FAIL or OPEN, expected or
not. A rule that required something only of the traffic exercises no cell. NA, UNSURE, errors and items that did not run exercise
no cell either. A cell counts once, even if several tests or several variants of a test contain the cell.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Cell, Report, cell_of
from pytest_rvads.support.wording import first

__all__ = ["Cells", "Coverage", "Requirements", "dropped", "measure", "shortfall"]


@dataclass(frozen=True, slots=True)
class Coverage:
    """The number of planned and of exercised cells."""

    planned: int
    """Cells that the collected tests expand to, before tests are deselected."""
    exercised: int
    idle: dict[str, int]
    """Number of cells that were not exercised, by reason: the status of their test items, or ``not selected``."""

    @property
    def percent(self) -> float:
        """Percentage of the planned cells that were exercised; 0 if no cells were planned."""
        return 100 * self.exercised / self.planned if self.planned else 0.0

    def __str__(self) -> str:
        # Rounded down: 99.96 % is not 100.0 %.
        share = int(self.percent * 10) / 10
        idle = ", ".join(f"{count} {why}" for why, count in self.idle.items())
        return f"{self.exercised}/{self.planned} cells exercised ({share:.1f} %)" + (f": {idle}" if idle else "")


class Cells:
    """Counts cells (junction, class, configuration, rule) by their outcome; records are added one by one.

    Args:
        planned: the planned cells; a planned cell counts even if no record of the cell is added.
    """

    def __init__(self, planned: Iterable[Cell] = ()) -> None:
        self._rules: dict[str, int] = {}
        self._rows: dict[tuple[object, ...], bytearray] = {}
        """By cell without its rule, a byte per rule; bytes save memory, because a session can have a million cells."""
        for cell in planned:
            self._note_outcome(cell, _PLANNED)

    def add(self, record: Record) -> None:
        """Add the outcome of a record to its cell."""
        self._note_outcome(cell_of(record), _EXERCISED if record.asked else _EXERCISED + 1 + record.status.severity)

    def _note_outcome(self, cell: Cell, value: int) -> None:
        """Note the outcome of a cell as a byte; if a cell has several outcomes, the least byte counts."""
        junction, cls, configuration, rule, seat, traffic = cell
        row = self._rows.setdefault((junction, cls, configuration, seat, traffic), bytearray())
        number = self._rules.setdefault(rule, len(self._rules))
        row.extend([_NO_CELL] * (number + 1 - len(row)))
        row[number] = min(row[number], value)

    def coverage(self) -> Coverage:
        """Return the numbers of planned and of exercised cells."""
        counts: Counter[int] = Counter()
        for row in self._rows.values():
            counts.update(row)
        del counts[_NO_CELL]
        # A cell with several outcomes counts under its worst outcome: the worst outcome has the least byte.
        reasons = [(outcome.small, counts[_EXERCISED + 1 + outcome.severity]) for outcome in Outcome.worst_first()]
        idle = {why: count for why, count in (*reasons, (_UNSELECTED, counts[_PLANNED])) if count}
        return Coverage(counts.total(), counts[_EXERCISED], idle)


def measure(report: Report) -> Coverage:
    """Return the coverage of a session: the numbers of planned and of exercised cells."""
    cells = Cells(report.planned)
    for record in report.records:
        cells.add(record)
    return cells.coverage()


_EXERCISED, _PLANNED, _NO_CELL = 0, 254, 255
"""Bytes for the state of a cell: exercised, planned without a record, or no cell; other bytes are 1 + an outcome's severity."""
_UNSELECTED = "not selected"


def shortfall(report: Report, least: float) -> str:
    """Return a sentence if the coverage of a report is below `least`; an empty text if it is not.

    Args:
        report: the report of a session, or of several sessions merged.
        least: least share of the planned cells that has to be exercised [%].
    """
    coverage = measure(report)
    if coverage.planned and 100 * coverage.exercised >= least * coverage.planned:
        return ""
    return f"coverage is below {least:g} %: {coverage}"


def dropped(report: Report, most: int | None = None) -> list[str]:
    """Return a line on left-out starts (faster than the braking envelope v(d)max), and a line on scenarios without room to start.

    Args:
        report: the report of a session, or of several sessions merged.
        most: largest number of tests that a line names; further tests are counted.
    """
    return [
        f"{sum(tests.values())} {what}{'' if sum(tests.values()) == 1 else 's'} {why} left out: "
        + first([f"{count} of {test}" for test, count in tests.items()], most)
        for what, why, tests in (
            ("point", "beyond v(d)max", report.left_out),
            ("scenario", "in which a vehicle has no room where it starts", report.unfit),
        )
        if tests
    ]


class Requirements:
    """Counts the verdicts on each requirement of the user; records are added one by one."""

    def __init__(self) -> None:
        self._counts: dict[str, Counter[Tallied]] = {}

    def add(self, record: Record) -> None:
        """Count the verdict of a record for each of its requirements."""
        for requirement in record.requirements:
            self._counts.setdefault(requirement, Counter())[record.counts_as] += 1

    def lines(self) -> list[str]:
        """Return a line per requirement with its verdicts by status."""
        return [f"requirement {name}: {counted(self._counts[name])}" for name in sorted(self._counts)]
