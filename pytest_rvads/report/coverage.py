"""Coverage: which cells of the tables a session exercised, of those that its tests ask for.

A cell is (junction, class, configuration, rule), and with a subject its seat and the traffic around it; of what was recorded it
is (junction, recording, rule). It is exercised when a rule asked something of the system under test there, and got an answer:
PASS, FAIL or OPEN, expected or not. What only the traffic was asked exercises nothing, nor does NA, what is UNSURE, an error, or
an item that did not run. Tests share the cells of what they both ask for, and so do the variants of a test.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from pytest_rvads.outcome import Outcome, Tallied, counted
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Cell, Report, cell_of
from pytest_rvads.wording import first

__all__ = ["Cells", "Coverage", "Requirements", "dropped", "measure", "shortfall"]


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


class Cells:
    """Counts cells by what became of them; takes records in.

    Args:
        planned: the cells that are there without a record, too.
    """

    def __init__(self, planned: Iterable[Cell] = ()) -> None:
        self._rules: dict[str, int] = {}
        self._rows: dict[tuple[object, ...], bytearray] = {}
        """Cells but for the rule, and for each rule a byte: there may be a million of them."""
        for cell in planned:
            self._note(cell, _PLANNED)

    def add(self, record: Record) -> None:
        """Take a record in."""
        self._note(cell_of(record), _EXERCISED if record.asked else _EXERCISED + 1 + record.status.severity)

    def _note(self, cell: Cell, found: int) -> None:
        """Note what was found in a cell; of several findings the least counts."""
        junction, cls, configuration, rule, seat, traffic = cell
        row = self._rows.setdefault((junction, cls, configuration, seat, traffic), bytearray())
        number = self._rules.setdefault(rule, len(self._rules))
        row.extend([_NO_CELL] * (number + 1 - len(row)))
        row[number] = min(row[number], found)

    def coverage(self) -> Coverage:
        """Return how many there are, and how many were exercised."""
        found: Counter[int] = Counter()
        for row in self._rows.values():
            found.update(row)
        del found[_NO_CELL]
        # The first reason that applies to one of its items.
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
"""What a byte says of a cell; between the first two why nothing was asked there, the worst first."""
_UNSELECTED = "not selected"


def shortfall(report: Report, least: float) -> str:
    """Return why the coverage is not enough, in one sentence, or nothing.

    Args:
        report: a session or several merged.
        least: share of the planned cells that have to be exercised [%].
    """
    coverage = measure(report)
    if coverage.planned and 100 * coverage.exercised >= least * coverage.planned:
        return ""
    return f"coverage is below {least:g} %: {coverage}"


def dropped(report: Report, most: int | None = None) -> list[str]:
    """Return a line on points of grids in which nobody could stop, and one on scenarios that did not fit, if there are any.

    Args:
        report: of a session, or merged.
        most: tests, or junctions, named in a line; the others are counted.
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
    """Counts the verdicts that trace to each requirement; takes records in."""

    def __init__(self) -> None:
        self._found: dict[str, Counter[Tallied]] = {}

    def add(self, record: Record) -> None:
        """Take a record in."""
        for requirement in record.requirements:
            self._found.setdefault(requirement, Counter())[record.counts_as] += 1

    def lines(self) -> list[str]:
        """Return a line per requirement: its verdicts by status."""
        return [f"requirement {name}: {counted(self._found[name])}" for name in sorted(self._found)]
