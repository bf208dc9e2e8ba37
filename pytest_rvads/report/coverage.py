"""Coverage: which cells of the tables a session exercised, of those that its tests ask for.

A cell is (junction, class, configuration, rule), and with a subject its seat and the traffic around it; of what was recorded it
is (junction, recording, rule). It is exercised when a rule asked something of the system under test there, and got an answer:
PASS, FAIL or OPEN, expected or not. What only the traffic was asked exercises nothing, nor does NA, what is UNSURE, an error, or
an item that did not run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Cell, Extent, Report, cell_of

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
    """Return a line on points of grids in which nobody could stop, and one on scenarios that did not fit, if there are any."""
    return [
        f"{sum(tests.values())} {what}{'' if sum(tests.values()) == 1 else 's'} {why} left out: "
        + ", ".join(f"{count} of {test}" for test, count in tests.items())
        for what, why, tests in (
            ("point", "beyond v(d)max", report.left_out),
            ("scenario", "in which a vehicle has no room where it starts", report.unfit),
        )
        if tests
    ]


def traced(records: Sequence[Record]) -> list[str]:
    """Return a line per requirement: the verdicts that trace to it, by status."""
    found: dict[str, list[Record]] = {}
    for record in records:
        for requirement in record.requirements:
            found.setdefault(requirement, []).append(record)
    return [f"requirement {name}: {_counted(found[name])}" for name in sorted(found)]


def at_junctions(
    records: Sequence[Record], totals: Mapping[int, tuple[int, int]], extents: Mapping[str, Extent] | None = None
) -> list[str]:
    """Return a line per junction: what was exercised of it, and the verdicts by status; one of its own for what was recorded.

    Args:
        records: of a session.
        totals: per number of ways, how many classes and how many full scenarios exist, where that is known.
        extents: how much there is to cover at junctions of which that does not tell.
    """
    here: dict[tuple[str, bool], list[Record]] = {}
    for record in records:
        here.setdefault((record.junction, bool(record.recording)), []).append(record)
    lines = []
    for (junction, recorded), found in here.items():
        extent = (extents or {}).get(junction)
        ran = [record for record in found if record.hash and record.status is not Outcome.ERROR]
        covered: list[str] = []
        if recorded:
            junction = f"{junction} as recorded"
        elif extent is None:
            classes, scenarios = totals.get(found[0].ways, ("?", "?"))
            covered = [*_classes(ran, (classes, scenarios, scenarios), found[0].ways)]
        else:
            covered = [*_extent(ran, extent)]
        lines.append(_at(junction, found, ran, covered))
    return lines


def _at(junction: str, records: Sequence[Record], ran: Sequence[Record], covered: Sequence[str]) -> str:
    runs = {record.hash for record in ran}
    idle = sorted({record.asks for record in records} - {r.asks for r in records if r.status is not Outcome.NA})
    told = ", ".join([*covered, f"{len(runs)} runs", f"{len(records)} verdicts"])
    return f"{junction}: {told}: {_counted(records)}" + (f"  (never applicable: {', '.join(idle)})" if idle else "")


def _classes(ran: Sequence[Record], totals: tuple[int | str, int | str, int | str], turns: int, where: str = "") -> Iterator[str]:
    """Yield what was exercised of full scenarios.

    Args:
        ran: records of runs; partial scenarios don't count.
        totals: how many classes, full scenarios and classes with a subject there are.
        turns: how many rotations the junction has.
        where: which entrances are occupied.
    """
    full = [record for record in ran if record.cls]
    classes, scenarios, seats = totals
    yield f"{len({record.cls for record in full})}/{classes} classes{where}"
    # As seen from its seat, equal scenarios are rotations of each other.
    seated = {_seated(record.scenario, record.seat, turns) for record in full if record.seat is not None}
    if seated:
        yield f"{len(seated)}/{seats} classes with a subject{where}"
    yield f"{len({record.scenario for record in full})}/{scenarios} scenarios{where}"


def _seated(scenario: str, seat: int, turns: int) -> tuple[str, int]:
    """Return the least of the rotations of a scenario and its seat."""
    code = scenario.replace("_", "")
    rows = range(0, len(code), len(code) // turns)
    return min((code[len(code) - row :] + code[: len(code) - row], (seat + row) % len(code)) for row in rows)


def _extent(ran: Sequence[Record], extent: Extent) -> Iterator[str]:
    """Yield what was exercised, by occupancy, and of partial scenarios and pairs of movements where tests asked for them."""
    for occupancy, totals in extent.classes.items():
        # Numbers alone are those of occupied arms.
        here = [record for record in ran if bool(record.orbit) == (occupancy == "lanes")]
        where = {"arms": " with a vehicle per arm", "lanes": " with one per lane"}[occupancy] if len(extent.classes) > 1 else ""
        yield from _classes(here, totals, extent.turns, where)
    for occupancy, total in extent.partial.items():
        alone = [record for record in ran if occupancy == "lanes" or _alone(record.scenario)]
        yield f"{len({record.orbit or record.cls for record in alone})}/{total} classes with partial ones"
    moves = [[(agent.entrance, agent.exit) for agent in record.agents] for record in ran]
    made = {pair for found in moves for pair in combinations(sorted(set(found)), 2)}
    apart = "lanes" not in extent.classes
    for what, pairs in (("pairs of movements", extent.pairs), ("conflicting pairs", extent.conflicts)):
        possible = [pair for pair in pairs if not (apart and pair[0][0][0] == pair[1][0][0])]
        ruled_out = len(pairs) - len(possible)
        if possible:
            more = f" (and {ruled_out} of one arm, only with occupancy='lanes')" if ruled_out else ""
            yield f"{len(made.intersection(possible))}/{len(possible)} {what}{more}"


def _alone(scenario: str) -> bool:
    """Return whether no two vehicles of a scenario stand on one arm."""
    return "_" not in scenario or all(len(arm.replace("0", "")) <= 1 for arm in scenario.split("_"))


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
