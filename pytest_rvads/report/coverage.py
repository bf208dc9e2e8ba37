"""Coverage: the share of the planned cells that a session exercised.

A cell is (junction, class, configuration, rule), with a subject also the subject's seat and the traffic around it. A cell of a
recording is (junction, recording, rule). A cell is exercised if a rule required something of the system under test in the cell,
and the verdict is PASS, FAIL or OPEN, expected or not. A rule that bound only the traffic exercises no cell. NA, UNSURE, errors
and items that did not run exercise no cell either. Tests that plan the same cells share them, and so do the variants of a test.
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
    """Number of cells that were not exercised, by reason: the status of their items, or ``not selected``."""

    @property
    def percent(self) -> float:
        """Share of the exercised cells among the planned cells [%]; 0 if no cells were planned."""
        return 100 * self.exercised / self.planned if self.planned else 0.0

    def __str__(self) -> str:
        # Rounded down: 99.96 % is not 100.0 %.
        share = int(self.percent * 10) / 10
        idle = ", ".join(f"{count} {why}" for why, count in self.idle.items())
        return f"{self.exercised}/{self.planned} cells exercised ({share:.1f} %)" + (f": {idle}" if idle else "")


class Cells:
    """Counts cells by their outcome; records are added singly.

    Args:
        planned: the planned cells, which count without a record as well.
    """

    def __init__(self, planned: Iterable[Cell] = ()) -> None:
        self._rules: dict[str, int] = {}
        self._rows: dict[tuple[object, ...], bytearray] = {}
        """By cell without its rule, a byte per rule: a session may have a million cells."""
        for cell in planned:
            self._note(cell, _PLANNED)

    def add(self, record: Record) -> None:
        """Add a record."""
        self._note(cell_of(record), _EXERCISED if record.asked else _EXERCISED + 1 + record.status.severity)

    def _note(self, cell: Cell, found: int) -> None:
        """Note the outcome of a cell; of several outcomes the least byte counts."""
        junction, cls, configuration, rule, seat, traffic = cell
        row = self._rows.setdefault((junction, cls, configuration, seat, traffic), bytearray())
        number = self._rules.setdefault(rule, len(self._rules))
        row.extend([_NO_CELL] * (number + 1 - len(row)))
        row[number] = min(row[number], found)

    def coverage(self) -> Coverage:
        """Return the number of cells and of exercised cells."""
        found: Counter[int] = Counter()
        for row in self._rows.values():
            found.update(row)
        del found[_NO_CELL]
        # By the first reason that applies to an item of the cell.
        whys = [(outcome.small, found[_EXERCISED + 1 + outcome.severity]) for outcome in Outcome.worst_first()]
        idle = {why: count for why, count in (*whys, (_UNSELECTED, found[_PLANNED])) if count}
        return Coverage(found.total(), found[_EXERCISED], idle)


def measure(report: Report) -> Coverage:
    """Return the coverage of a session over its cells."""
    cells = Cells(report.planned)
    for record in report.records:
        cells.add(record)
    return cells.coverage()


_EXERCISED, _PLANNED, _NO_CELL = 0, 254, 255
"""Values of a cell's byte; between the first two, 1 plus the severity of the outcome that exercised nothing."""
_UNSELECTED = "not selected"


def shortfall(report: Report, least: float) -> str:
    """Return the sentence that the coverage is too low, or an empty text.

    Args:
        report: the report of a session, or of several sessions merged.
        least: the least share of the planned cells that have to be exercised [%].
    """
    coverage = measure(report)
    if coverage.planned and 100 * coverage.exercised >= least * coverage.planned:
        return ""
    return f"coverage is below {least:g} %: {coverage}"


def dropped(report: Report, most: int | None = None) -> list[str]:
    """Return a line on the points of grids beyond v(d)max, and a line on the scenarios without room, if there are any.

    Args:
        report: the report of a session, or of several sessions merged.
        most: most tests or junctions named in a line; the others are counted.
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
    """Counts the verdicts that trace to each requirement; records are added singly."""

    def __init__(self) -> None:
        self._found: dict[str, Counter[Tallied]] = {}

    def add(self, record: Record) -> None:
        """Add a record."""
        for requirement in record.requirements:
            self._found.setdefault(requirement, Counter())[record.counts_as] += 1

    def lines(self) -> list[str]:
        """Return a line per requirement with its verdicts by status."""
        return [f"requirement {name}: {counted(self._found[name])}" for name in sorted(self._found)]
