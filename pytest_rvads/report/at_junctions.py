"""Counts the scenarios and verdicts at each junction in one pass over the records of a report."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sized
from itertools import combinations

from pytest_rvads.logic.outcome import Outcome, Tallied, counted
from pytest_rvads.report.arrivals import TOGETHER
from pytest_rvads.report.record import Record, RecordedItem, SimulatedItem
from pytest_rvads.report.session_report import Extent, Move
from pytest_rvads.support.wording import first, plural

__all__ = ["FEW", "AtJunction", "AtJunctions"]

FEW = 4
"""Largest number of junctions that a report lists singly; a report on more junctions has sums, and the worst junctions."""

_IDLE = 10
"""Largest number of never applicable rules that a line names; further rules are counted."""
_NEAR = 2.0
"""Two vehicles met if less than this time passed between their stays on a shared stretch [s]."""


class AtJunctions:
    """Counts records by junction; simulated and recorded runs at a junction are counted separately.

    Args:
        totals: by number of arms, the number of classes and the number of full scenarios (a vehicle at every arm), if known.
        extents: by name, the numbers of classes and scenarios at junctions that `totals` does not describe.
    """

    def __init__(self, totals: Mapping[int, tuple[int, int]], extents: Mapping[str, Extent] | None = None) -> None:
        self._totals, self._extents = totals, extents or {}
        self._junctions: dict[tuple[str, bool], AtJunction] = {}

    def add(self, record: Record) -> None:
        """Count a record at its junction."""
        key = record.junction, isinstance(record, RecordedItem)
        at_junction = self._junctions.get(key) or self._junctions.setdefault(key, self._new(record))
        at_junction.add(record)

    def _new(self, record: Record) -> AtJunction:
        if isinstance(record, RecordedItem):
            return AtJunction(record)
        return AtJunction(record, self._totals.get(record.ways), self._extents.get(record.junction))

    @property
    def many(self) -> bool:
        """Whether the records come from more than `FEW` junctions."""
        return len({junction for junction, _ in self._junctions}) > FEW

    @property
    def junctions(self) -> list[AtJunction]:
        """The junctions in the order of their first records."""
        return list(self._junctions.values())


class AtJunction:
    """The scenarios and verdicts at a junction, of simulated or of recorded runs.

    Args:
        first: the first record at the junction.
        totals: number of classes and of full scenarios, if they are known.
        extent: numbers of classes and scenarios at a junction that `totals` does not describe.
    """

    def __init__(self, first: Record, totals: tuple[int, int] | None = None, extent: Extent | None = None) -> None:
        self.junction, self.kind = first.junction, first.kind
        self.counts: dict[str, Counter[Tallied]] = {}
        """By rule, the number of verdicts of each kind."""
        self.runs: set[str] = set()
        """Hashes of the judged runs."""
        self.wrong: set[str] = set()
        """Runs with an unexpected failure."""
        self._recorded, self._totals, self._extent = isinstance(first, RecordedItem), totals, extent
        self._turns = extent.turns if extent else first.ways
        self._full = {"arms": _Full(), "lanes": _Full()}
        """Full scenarios by occupancy (a vehicle per arm or per lane); a junction with one lane per arm has only ``arms``."""
        self._partial: dict[str, set[int | str]] = {"arms": set(), "lanes": set()}
        self._pairs: set[tuple[Move, Move]] = set()
        self._arrivals = Arrivals()

    def add(self, record: Record) -> None:
        """Count a record of this junction."""
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
            # The scenarios of a class that its number alone identifies have a vehicle per arm.
            self._full["lanes" if self._extent and record.orbit else "arms"].add(record, self._turns)
        if not self._extent:
            return
        name = record.orbit or record.cls
        for occupancy, names in self._partial.items():
            if occupancy == "lanes" or _alone(record.scenario):
                names.add(name)
        vehicles = [agent for agent in record.agents if agent.name.startswith("a")]  # others are pedestrians and parked
        self._pairs.update(combinations(sorted({(agent.entrance, agent.exit) for agent in vehicles}), 2))

    @property
    def tally(self) -> Counter[Tallied]:
        """The number of verdicts of each kind."""
        return sum(self.counts.values(), Counter())

    @property
    def share(self) -> float:
        """The share of the runs at the junction with an unexpected failure, from 0 to 1."""
        return len(self.wrong) / max(len(self.runs | self.wrong), 1)

    def lines(self) -> list[str]:
        """Return a line on scenarios and verdicts, and a line on the orders in which the vehicles arrived."""
        return [self.line(), *self._arrivals.lines(self.junction)]

    def line(self) -> str:
        """Return a line on the exercised scenarios at the junction, and on the verdicts by status."""
        verdicts = self.tally
        name = f"{self.junction} as recorded" if self._recorded else self.junction
        exercised = ", ".join([*self._covered(), plural(len(self.runs), "run"), plural(verdicts.total(), "verdict")])
        idle = sorted(rule for rule, counts in self.counts.items() if set(counts) == {Outcome.NA})
        return f"{name}: {exercised}: {counted(verdicts)}" + (f"  (never applicable: {first(idle, _IDLE)})" if idle else "")

    def _covered(self) -> Iterator[str]:
        """Yield the numbers of exercised scenarios in words; also of partial scenarios and of pairs, if tests asked for these."""
        if self._extent is None:
            if not self._recorded:
                totals = self._totals and (*self._totals, self._totals[1])
                yield from self._full["arms"].texts(totals)
            return
        extent = self._extent
        for occupancy, class_totals in extent.classes.items():
            where = (
                {"arms": " with a vehicle per arm", "lanes": " with one per lane"}[occupancy] if len(extent.classes) > 1 else ""
            )
            yield from self._full[occupancy].texts(class_totals, where)
        for occupancy, total in extent.partial.items():
            yield f"{len(self._partial[occupancy])}/{total} classes with partial ones"
        apart = "lanes" not in extent.classes
        for name, pairs in (("pairs of movements", extent.pairs), ("conflicting pairs", extent.conflicts)):
            possible = [pair for pair in pairs if not (apart and pair[0][0][0] == pair[1][0][0])]
            ruled_out = len(pairs) - len(possible)
            if possible:
                more = f" (and {ruled_out} of one arm, only with occupancy='lanes')" if ruled_out else ""
                yield f"{len(self._pairs.intersection(possible))}/{len(possible)} {name}{more}"


class _Full:
    """Counts the exercised full scenarios (a vehicle at every arm, or at every lane) of a junction."""

    def __init__(self) -> None:
        self._classes: set[int] = set()
        self._scenarios: set[str] = set()
        self._seated: set[tuple[str, int]] = set()
        """Scenarios with the entrance of the subject; scenarios that are equal up to rotation are one entry (see `_seated`)."""

    def add(self, record: SimulatedItem, turns: int) -> None:
        """Add the record of a run at a junction with `turns` rotations."""
        self._classes.add(record.cls)
        self._scenarios.add(record.scenario)
        if record.seat is not None:
            self._seated.add(_seated(record.scenario, record.seat, turns))

    def texts(self, totals: tuple[int, int, int] | None, where: str = "") -> Iterator[str]:
        """Yield the numbers of exercised classes and scenarios in words.

        Args:
            totals: numbers of classes, of full scenarios, and of classes with a subject, if they are known.
            where: phrase on the occupied entrances.
        """
        classes, scenarios, seats = (f"/{total}" for total in totals) if totals else ("", "", "")
        yield f"{_share_of(self._classes, classes, 'class', 'classes')}{where}"
        if self._seated:
            yield f"{_share_of(self._seated, seats, 'class', 'classes')} with a subject{where}"
        yield f"{_share_of(self._scenarios, scenarios, 'scenario')}{where}"


def _share_of(exercised: Sized, total: str, thing: str, several: str = "") -> str:
    """Return the number of exercised things and the number of all things: ``7/24 classes``; ``1 class`` if the total is empty."""
    return f"{len(exercised)}{total} {several or f'{thing}s'}" if total else plural(len(exercised), thing, several)


def _seated(scenario: str, seat: int, turns: int) -> tuple[str, int]:
    """Return the first in sort order of all rotations of a scenario with its subject; all rotations have the same result."""
    code = scenario.replace("_", "")
    rows = range(0, len(code), len(code) // turns)
    return min((code[len(code) - row :] + code[: len(code) - row], (seat + row) % len(code)) for row in rows)


def _alone(scenario: str) -> bool:
    """Return whether no two vehicles of a scenario start on the same arm."""
    return "_" not in scenario or all(len(arm.replace("0", "")) <= 1 for arm in scenario.split("_"))


class Arrivals:
    """Counts runs by whether the subject (vehicle under test) arrived before or after the vehicle with the nearest arrival."""

    def __init__(self) -> None:
        self._gaps: dict[str, list[float]] = defaultdict(list)
        """By order of arrival, the time between the arrivals of the subject and of the vehicle nearest in time, per run [s]."""
        self._apart = 0

    def add(self, record: Record) -> None:
        """Count the order of arrival in the run of a record, once per run."""
        subject = next((verdict.subject for verdict in record.verdicts if verdict.subject), None)
        kpis = record.kpis
        times = {vehicle.agent: vehicle.arrival for vehicle in kpis.vehicles if vehicle.arrival is not None} if kpis else {}
        if kpis is None or subject not in times:
            return
        gaps = [time - times[subject] for agent, time in times.items() if agent != subject]
        gap = min(gaps, key=abs, default=0.0)
        order = "others first" if gap < -TOGETHER else "subject first" if gap > TOGETHER else "simultaneous"
        self._gaps[order if gaps else "alone"].append(abs(gap))
        self._apart += bool(gaps) and (kpis.pet is None or kpis.pet >= _NEAR)

    def lines(self, junction: str) -> list[str]:
        """Return a line on the orders of arrival at a junction, with the gaps; no line if no run has a subject."""
        total = sum(map(len, self._gaps.values()))
        texts: list[str] = []
        for order in ("simultaneous", "others first", "subject first", "alone"):
            if gaps := self._gaps.get(order):
                least, most = f"{min(gaps):.1f}", f"{max(gaps):.1f}"
                wide = f" (by {least if least == most else f'{least} to {most}'} s)" if order.endswith("first") else ""
                texts.append(f"{len(gaps)} of {total} arrivals {order}{wide}" if not texts else f"{len(gaps)} {order}{wide}")
        if self._apart:
            texts.append(
                f"{plural(self._apart, 'run')} in which no two came within {_NEAR:g} s of each other on a shared stretch"
            )
        return [f"{junction}: {', '.join(texts)}"] if texts else []
