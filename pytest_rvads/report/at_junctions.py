"""Junctions: what was exercised and found at each, in one pass over any number of records."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sized
from itertools import combinations

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.record import Record, RecordedItem, SimulatedItem
from pytest_rvads.report.session_report import Extent, Move
from pytest_rvads.support.wording import first, plural

__all__ = ["FEW", "AtJunction", "AtJunctions"]

FEW = 4
"""Junctions that are told one by one; of more of them sums are told, and the worst."""

_IDLE = 10
"""Rules named that were never applicable."""
_TOGETHER = 0.5
"""Longest time between two vehicles that arrive together [s]: the tie window of the road rulebook, `TIE`."""
_NEAR = 2.0
"""Two vehicles on a shared stretch met if one reached it less than this time after the other had left it [s]."""


class AtJunctions:
    """Takes records in and tells of each junction what was exercised and found there, what was recorded apart.

    Args:
        totals: per number of ways, how many classes and how many full scenarios exist, where that is known.
        extents: how much there is to cover at junctions of which that does not tell.
    """

    def __init__(self, totals: Mapping[int, tuple[int, int]], extents: Mapping[str, Extent] | None = None) -> None:
        self._totals, self._extents = totals, extents or {}
        self._found: dict[tuple[str, bool], AtJunction] = {}

    def add(self, record: Record) -> None:
        """Take a record in."""
        key = record.junction, isinstance(record, RecordedItem)
        one = self._found.get(key) or self._found.setdefault(key, self._new(record))
        one.add(record)

    def _new(self, record: Record) -> AtJunction:
        if isinstance(record, RecordedItem):
            return AtJunction(record)
        return AtJunction(record, self._totals.get(record.ways), self._extents.get(record.junction))

    @property
    def many(self) -> bool:
        """Whether there are more junctions than can be told one by one."""
        return len({junction for junction, _ in self._found}) > FEW

    @property
    def found(self) -> list[AtJunction]:
        """All of them, in the order of their first records."""
        return list(self._found.values())


class AtJunction:
    """What was exercised and found at a junction, or recorded there.

    Args:
        first: the first of its records.
        totals: how many classes and full scenarios exist, where that is known.
        extent: how much there is to cover, where that does not tell.
    """

    def __init__(self, first: Record, totals: tuple[int, int] | None = None, extent: Extent | None = None) -> None:
        self.junction, self.kind = first.junction, first.kind
        self.counts: dict[str, Counter[Tallied]] = {}
        """By rule how many verdicts there are of a kind."""
        self.runs: set[str] = set()
        """Hashes of the judged runs."""
        self.wrong: set[str] = set()
        """Runs with an unexpected failure."""
        self._recorded, self._totals, self._extent = isinstance(first, RecordedItem), totals, extent
        self._turns = extent.turns if extent else first.ways
        self._full = {"arms": _Full(), "lanes": _Full()}
        """Of full scenarios, by occupancy; together in the first where there is one way to occupy a junction."""
        self._partial: dict[str, set[int | str]] = {"arms": set(), "lanes": set()}
        self._pairs: set[tuple[Move, Move]] = set()
        self._arrivals = Arrivals()

    def add(self, record: Record) -> None:
        """Take a record in."""
        counts = self.counts.get(record.asks) or self.counts.setdefault(record.asks, Counter())
        counts[record.counts_as] += 1
        if record.status.bad and not record.known:
            self.wrong.add(record.ran_as)
        if record.hash and record.status is not Outcome.ERROR:
            if record.hash not in self.runs:
                self._arrivals.add(record)
            self.runs.add(record.hash)
            if isinstance(record, SimulatedItem):
                self._add_scenario(record)

    def _add_scenario(self, record: SimulatedItem) -> None:
        if record.cls:
            # Numbers alone are those of occupied arms.
            self._full["lanes" if self._extent and record.orbit else "arms"].add(record, self._turns)
        if not self._extent:
            return
        name = record.orbit or record.cls
        for occupancy, names in self._partial.items():
            if occupancy == "lanes" or _alone(record.scenario):
                names.add(name)
        self._pairs.update(combinations(sorted({(agent.entrance, agent.exit) for agent in record.agents}), 2))

    @property
    def tally(self) -> Counter[Tallied]:
        """How many verdicts there are of a kind."""
        return sum(self.counts.values(), Counter())

    @property
    def share(self) -> float:
        """In which share of the runs something went wrong."""
        return len(self.wrong) / max(len(self.runs | self.wrong), 1)

    def lines(self) -> list[str]:
        """Return `line`, and in which orders the subject and the others arrived."""
        return [self.line(), *self._arrivals.lines(self.junction)]

    def line(self) -> str:
        """Return what was exercised, and the verdicts by status."""
        verdicts = self.tally
        name = f"{self.junction} as recorded" if self._recorded else self.junction
        told = ", ".join([*self._covered(), plural(len(self.runs), "run"), plural(verdicts.total(), "verdict")])
        idle = sorted(rule for rule, counts in self.counts.items() if set(counts) == {Outcome.NA})
        return f"{name}: {told}: {counted(verdicts)}" + (f"  (never applicable: {first(idle, _IDLE)})" if idle else "")

    def _covered(self) -> Iterator[str]:
        """Yield what was exercised: by occupancy, and of partial scenarios and pairs of movements where tests asked for them."""
        if self._extent is None:
            if not self._recorded:
                totals = self._totals and (*self._totals, self._totals[1])
                yield from self._full["arms"].told(totals)
            return
        extent = self._extent
        for occupancy, known in extent.classes.items():
            where = (
                {"arms": " with a vehicle per arm", "lanes": " with one per lane"}[occupancy] if len(extent.classes) > 1 else ""
            )
            yield from self._full[occupancy].told(known, where)
        for occupancy, total in extent.partial.items():
            yield f"{len(self._partial[occupancy])}/{total} classes with partial ones"
        apart = "lanes" not in extent.classes
        for what, pairs in (("pairs of movements", extent.pairs), ("conflicting pairs", extent.conflicts)):
            possible = [pair for pair in pairs if not (apart and pair[0][0][0] == pair[1][0][0])]
            ruled_out = len(pairs) - len(possible)
            if possible:
                more = f" (and {ruled_out} of one arm, only with occupancy='lanes')" if ruled_out else ""
                yield f"{len(self._pairs.intersection(possible))}/{len(possible)} {what}{more}"


class _Full:
    """What was exercised of full scenarios."""

    def __init__(self) -> None:
        self._classes: set[int] = set()
        self._scenarios: set[str] = set()
        self._seated: set[tuple[str, int]] = set()
        """Scenarios as seen from the seat of the subject: rotations of a scenario give the same entry."""

    def add(self, record: SimulatedItem, turns: int) -> None:
        """Take in a record of a run at a junction with so many rotations."""
        self._classes.add(record.cls)
        self._scenarios.add(record.scenario)
        if record.seat is not None:
            self._seated.add(_seated(record.scenario, record.seat, turns))

    def told(self, totals: tuple[int, int, int] | None, where: str = "") -> Iterator[str]:
        """Yield it in words.

        Args:
            totals: how many classes, full scenarios and classes with a subject there are, where that is known.
            where: which entrances are occupied.
        """
        classes, scenarios, seats = (f"/{total}" for total in totals) if totals else ("", "", "")
        yield f"{_of(self._classes, classes, 'class', 'classes')}{where}"
        if self._seated:
            yield f"{_of(self._seated, seats, 'class', 'classes')} with a subject{where}"
        yield f"{_of(self._scenarios, scenarios, 'scenario')}{where}"


def _of(found: Sized, total: str, thing: str, several: str = "") -> str:
    """Return how many things were found, of how many: ``7/24 classes``; ``1 class`` where the total is not known."""
    return f"{len(found)}{total} {several or f'{thing}s'}" if total else plural(len(found), thing, several)


def _seated(scenario: str, seat: int, turns: int) -> tuple[str, int]:
    """Return the least of the rotations of a scenario and its seat."""
    code = scenario.replace("_", "")
    rows = range(0, len(code), len(code) // turns)
    return min((code[len(code) - row :] + code[: len(code) - row], (seat + row) % len(code)) for row in rows)


def _alone(scenario: str) -> bool:
    """Return whether no two vehicles of a scenario stand on one arm."""
    return "_" not in scenario or all(len(arm.replace("0", "")) <= 1 for arm in scenario.split("_"))


class Arrivals:
    """Collects a record per run with a subject, and counts the orders in which the subject and the nearest vehicle arrived."""

    def __init__(self) -> None:
        self._gaps: dict[str, list[float]] = defaultdict(list)
        """By order, the times between the arrivals of the subject and of the vehicle nearest in time [s]."""
        self._apart = 0

    def add(self, record: Record) -> None:
        """Add a record of a run, once per run."""
        subject = next((verdict.subject for verdict in record.verdicts if verdict.subject), None)
        kpis = record.kpis
        times = {one.agent: one.arrival for one in kpis.vehicles if one.arrival is not None} if kpis else {}
        if kpis is None or subject not in times:
            return
        gaps = [time - times[subject] for agent, time in times.items() if agent != subject]
        gap = min(gaps, key=abs, default=0.0)
        order = "others first" if gap < -_TOGETHER else "subject first" if gap > _TOGETHER else "simultaneous"
        self._gaps[order if gaps else "alone"].append(abs(gap))
        self._apart += bool(gaps) and (kpis.pet is None or kpis.pet >= _NEAR)

    def lines(self, junction: str) -> list[str]:
        """Return a line on the orders of arrival at a junction, with the gaps; no line if no run has a subject."""
        total = sum(map(len, self._gaps.values()))
        told: list[str] = []
        for order in ("simultaneous", "others first", "subject first", "alone"):
            if gaps := self._gaps.get(order):
                least, most = f"{min(gaps):.1f}", f"{max(gaps):.1f}"
                wide = f" (by {least if least == most else f'{least} to {most}'} s)" if order.endswith("first") else ""
                told.append(f"{len(gaps)} of {total} arrivals {order}{wide}" if not told else f"{len(gaps)} {order}{wide}")
        if self._apart:
            told.append(f"{plural(self._apart, 'run')} in which no two came within {_NEAR:g} s of each other on a shared stretch")
        return [f"{junction}: {', '.join(told)}"] if told else []
