"""Coverage: which cells of the tables a session exercised, of those that its tests ask for.

A cell is (junction, class, configuration, rule), and with a subject its seat and the traffic around it. It is exercised when
a rule asked something of the system under test there, and got an answer: PASS, FAIL or OPEN, expected or not. What only the
traffic was asked exercises nothing, nor does NA, an error, or an item that did not run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Cell, Report, cell_of

__all__ = ["Coverage", "at_junctions", "dropped", "measure", "shortfall", "traced"]


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
    cells: dict[Cell, list[Record]] = {cell: [] for cell in report.planned}
    for record in report.records:
        cells.setdefault(cell_of(record), []).append(record)
    idle: Counter[str] = Counter()
    for records in cells.values():
        if not any(record.asked for record in records):
            # The first reason that applies to one of its items.
            whys = sorted((record.status for record in records if not record.status.judges), key=lambda why: why.severity)
            idle[whys[0].small if whys else _UNSELECTED] += 1
    order = (*(outcome.small for outcome in Outcome.worst_first()), _UNSELECTED)
    return Coverage(len(cells), len(cells) - idle.total(), {why: idle[why] for why in order if idle[why]})


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


def dropped(report: Report) -> list[str]:
    """Return a line on the points of grids that were left out because nobody could stop there, if there are any."""
    if not report.left_out:
        return []
    tests = ", ".join(f"{count} of {test}" for test, count in report.left_out.items())
    count = sum(report.left_out.values())
    return [f"{count} point{'' if count == 1 else 's'} beyond v(d)max left out: {tests}"]


def traced(records: Sequence[Record]) -> list[str]:
    """Return a line per requirement: the verdicts that trace to it, by status."""
    found: dict[str, list[Record]] = {}
    for record in records:
        for requirement in record.requirements:
            found.setdefault(requirement, []).append(record)
    return [f"requirement {name}: {_counted(found[name])}" for name in sorted(found)]


def at_junctions(records: Sequence[Record], totals: Mapping[int, tuple[int, int]]) -> list[str]:
    """Return a line per junction: what was exercised of it, and the verdicts by status.

    Args:
        records: of a session.
        totals: per number of ways, how many classes and how many full scenarios exist, where that is known.
    """
    here: dict[str, list[Record]] = {}
    for record in records:
        here.setdefault(record.junction, []).append(record)
    return [_at(junction, found, *totals.get(found[0].ways, ("?", "?"))) for junction, found in here.items()]


def _at(junction: str, records: Sequence[Record], classes: int | str, scenarios: int | str) -> str:
    ran = [record for record in records if record.hash and record.status is not Outcome.ERROR]
    seen = {record.cls for record in ran} - {0}
    members = {record.scenario for record in ran if record.cls}
    # As seen from its seat, equal scenarios are rotations of each other; with a subject there are as many classes as scenarios.
    seated = {r.scenario[r.seat :] + r.scenario[: r.seat] for r in ran if r.cls and r.seat is not None}
    seats = f"{len(seated)}/{scenarios} classes with a subject, " if seated else ""
    runs = {record.hash for record in ran}
    idle = sorted({record.asks for record in records} - {r.asks for r in records if r.status is not Outcome.NA})
    return (
        f"{junction}: {len(seen)}/{classes} classes, {seats}{len(members)}/{scenarios} scenarios, {len(runs)} runs, "
        f"{len(records)} verdicts: {_counted(records)}" + (f"  (never applicable: {', '.join(idle)})" if idle else "")
    )


def _counted(records: Sequence[Record]) -> str:
    """Return the verdicts by status: ``3 pass, 1 known failures, 2 NA``."""
    counts = Counter(record.status for record in records if not record.known)
    told = [(outcome, f"{counts[outcome]} {outcome.word}") for outcome in Outcome if counts[outcome]]
    known = sum(bool(record.known) for record in records)
    parts = [text for _, text in told]
    if known:
        # After all that was found out of somebody, before what was not.
        place = sum(outcome.judges or outcome.meaning == "passed" for outcome, _ in told)
        parts.insert(place, f"{known} known failures")
    return ", ".join(parts)
