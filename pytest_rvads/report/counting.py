"""Counts the records of a report in one pass; every figure of a report is a function over these counts.

Sums and sets are kept, and no records but examples, so the results of a campaign on disk can be larger than memory.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Hashable
from itertools import combinations
from typing import Any, NamedTuple

from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.report.record import Computing, Record, RecordedItem, SimulatedItem
from pytest_rvads.report.session_report import Cell, Move, Report, cell_of
from pytest_rvads.runs.measured import PairKpis, VehicleKpis

TICKS = 100
"""Ticks per second: differences between arrivals are counted in ticks of 0.01 s."""
UNSELECTED = 1000
"""Rank of a planned cell without a record."""
EXERCISED = -1
"""Rank of an exercised cell; the rank of any other cell with a record is the severity of its outcome."""
TOGETHER = 0.5
"""Longest time between the arrivals of two vehicles that arrive together [s]: the tie window `TIE` of the rulebook ``road``."""
NEAR = 2.0
"""Two vehicles met if less than this time passed between their stays on a shared stretch [s]."""


class Site(NamedTuple):
    """A junction with its simulated or its recorded runs."""

    junction: str
    recorded: bool

    def __str__(self) -> str:
        return f"{self.junction} as recorded" if self.recorded else self.junction


EXTREMES: tuple[tuple[str, tuple[tuple[str, str, Callable[..., Any], str], ...]], ...] = (
    ("nearest", (("time to collision", "ttc", min, "s"), ("post-encroachment time", "pet", min, "s"))),
    ("most", (("braking", "deceleration", max, "m/s^2"), ("waiting", "waiting", max, "s"), ("delay", "delay", max, "s"))),
)
"""Per line of extremes: its first word, and its indicators. An indicator is (heading, field of `Kpis`, min or max, unit)."""
_PICKS = tuple((key, pick) for _, indicators in EXTREMES for _, key, pick, _ in indicators)


class Counts:
    """The counts of a report: a number of verdicts by junction, rule and outcome, and the sets that coverage needs."""

    def __init__(self, report: Report) -> None:
        self.report = report
        self.verdicts: Counter[tuple[Site, str, Tallied]] = Counter()
        """Number of verdicts by junction, rule and outcome; None stands for a known failure."""
        self.first: dict[Site, Record] = {}
        """The first record at each junction."""
        self.runs: defaultdict[Site, set[str]] = defaultdict(set)
        """Hashes of the judged runs at each junction."""
        self.wrong: defaultdict[Site, set[str]] = defaultdict(set)
        """Runs with an unexpected failure, at each junction."""
        self.seen: defaultdict[tuple[Site, str], set[Hashable]] = defaultdict(set)
        """What simulated runs exercised at each junction: ``classes``, ``scenarios`` and ``seated``, each followed by ``arms`` or
        ``lanes``, of full scenarios (a vehicle per arm or per lane); ``partial arms`` and ``partial lanes``, the names of
        classes; ``pairs``, pairs of movements."""
        self.orders: defaultdict[Site, list[float | None]] = defaultdict(list)
        """Per run at each junction, the arrival of the vehicle that arrived nearest in time minus the arrival of the subject [s];
        None if the subject was alone."""
        self.apart: Counter[Site] = Counter()
        """Number of runs with several vehicles of which no two met."""
        self.cells: dict[Cell, int] = dict.fromkeys(report.planned, UNSELECTED)
        """Rank of each cell; a cell with several outcomes has the least of their ranks."""
        self.requirements: Counter[tuple[str, Tallied]] = Counter()
        self.makers: defaultdict[tuple[str, str, str], set[str]] = defaultdict(set)
        """Runs by ``driven`` or ``simulated``, name of the driver or simulator, and source."""
        self.titles: dict[str, str] = {}
        """Titles of rules that share no word with the name of the rule."""
        self.extremes: dict[str, tuple[float, PairKpis | VehicleKpis, Record]] = {}
        """By indicator, its extreme value, the entry with this value, and its record; of equal values, the first is kept."""
        self.contacts: dict[str, Outcome] = {}
        """The outcome of the rule on collisions, by run with a time to collision of 0."""
        self.computed: defaultdict[str, list[tuple[str, Computing]]] = defaultdict(list)
        """Runs with the computing times in them, by stack; a run with several vehicles of a stack has several."""
        self.excess: dict[str, tuple[int, float]] = {}
        """By run, the number of accelerations beyond the limits of the vehicle, and the largest [m/s^2]."""
        self.pairs: dict[Site, int] = {}
        """Number of pairs of conflicting movements at each junction."""
        self.met: defaultdict[Site, defaultdict[tuple[Move, Move], Counter[int]]] = defaultdict(lambda: defaultdict(Counter))
        """By junction and pair of movements, how often each difference of arrivals was tried [ticks]."""
        self._tried: defaultdict[Site, set[str]] = defaultdict(set)
        self._measured: set[str] = set()

    def add(self, record: Record) -> None:
        """Count a record."""
        site, cell = Site(record.junction, isinstance(record, RecordedItem)), cell_of(record)
        self.first.setdefault(site, record)
        self.verdicts[site, record.asks, record.counts_as] += 1
        if record.status.bad and not record.known:
            self.wrong[site].add(record.ran_as)
        rank = EXERCISED if record.asked else record.status.severity
        self.cells[cell] = min(self.cells.get(cell, UNSELECTED), rank)
        for requirement in record.requirements:
            self.requirements[requirement, record.counts_as] += 1
        for verdict in record.verdicts:
            if verdict.title and {*verdict.rule.casefold().split("_")}.isdisjoint(verdict.title.casefold().split()):
                self.titles.setdefault(verdict.rule, verdict.title)
        self._add_indicators(record)
        self._add_arrivals(site, record)
        if isinstance(record, SimulatedItem):
            for maker in (("driven", record.driver, record.source), ("simulated", record.simulator, "")):
                if maker[1]:
                    self.makers[maker].add(record.ran_as)
        if record.hash and record.status is not Outcome.ERROR:
            if record.hash not in self.runs[site]:
                self._add_order(site, record)
            self.runs[site].add(record.hash)
            if isinstance(record, SimulatedItem):
                self._add_scenario(site, record)

    def _add_indicators(self, record: Record) -> None:
        """Count the extremes, the computing times and the excessive requests of the run of a record, once per run."""
        if record.asks == "no_collision" and record.kpis and any(pair.ttc == 0.0 for pair in record.kpis.pairs):
            self.contacts[record.where] = record.status
        run = f"{record.run} {record.hash}"
        if run in self._measured and record.hash:
            return
        self._measured.add(run)
        entries: tuple[PairKpis | VehicleKpis, ...] = (*record.kpis.pairs, *record.kpis.vehicles) if record.kpis else ()
        for entry in entries:
            for key, pick in _PICKS:
                value, known = getattr(entry, key, None), self.extremes.get(key)
                if value is not None and (known is None or pick(value, known[0]) != known[0]):
                    self.extremes[key] = value, entry, record
        for computing in (record.timing or {}).values():
            self.computed[computing.stack].append((run, computing))
        if record.excess:
            requests = sum(excess.requests for excess in record.excess.values())
            self.excess[run] = requests, max((excess.largest for excess in record.excess.values()), key=abs)

    def _add_arrivals(self, site: Site, record: Record) -> None:
        """Count the differences between arrivals that the run of a record tried, once per run."""
        arrivals = record.arrivals
        if arrivals is None:
            return
        self.pairs[site] = arrivals.pairs
        if not record.asked or record.ran_as in self._tried[site]:
            return
        self._tried[site].add(record.ran_as)
        rotations = range(0, record.ways, arrivals.symmetry)
        moves = [(agent.entrance, agent.exit) for agent in record.agents]

        def turned(move: Move, arms: int) -> Move:
            (start, start_lane), (end, end_lane) = move
            return ((start + arms) % record.ways, start_lane), ((end + arms) % record.ways, end_lane)

        for own, other, difference in arrivals.tried:
            pair = min((turned(moves[own], arms), turned(moves[other], arms)) for arms in rotations)
            self.met[site][pair][round(difference * TICKS)] += 1

    def _add_order(self, site: Site, record: Record) -> None:
        """Count whether the subject arrived before or after the vehicle with the nearest arrival in the run of a record."""
        subject = next((verdict.subject for verdict in record.verdicts if verdict.subject), None)
        kpis = record.kpis
        times = {vehicle.agent: vehicle.arrival for vehicle in kpis.vehicles if vehicle.arrival is not None} if kpis else {}
        if kpis is None or subject not in times:
            return
        gaps = [time - times[subject] for agent, time in times.items() if agent != subject]
        self.orders[site].append(min(gaps, key=abs) if gaps else None)
        self.apart[site] += bool(gaps) and (kpis.pet is None or kpis.pet >= NEAR)

    def _add_scenario(self, site: Site, record: SimulatedItem) -> None:
        """Add the scenario of a run to what was exercised at its junction."""
        extent = self.report.extents.get(site.junction)
        if record.cls:
            # The scenarios of a class that its number alone identifies have a vehicle per arm.
            full = "lanes" if extent and record.orbit else "arms"
            self.seen[site, f"classes {full}"].add(record.cls)
            self.seen[site, f"scenarios {full}"].add(record.scenario)
            if record.seat is not None:
                turns = extent.turns if extent else self.first[site].ways
                code = record.scenario.replace("_", "")
                rows = range(0, len(code), len(code) // turns)
                rotated = ((code[len(code) - row :] + code[: len(code) - row], (record.seat + row) % len(code)) for row in rows)
                self.seen[site, f"seated {full}"].add(min(rotated))  # all rotations of a scenario have the same least
        if not extent:
            return
        name = record.orbit or record.cls
        self.seen[site, "partial lanes"].add(name)
        # No two vehicles start on the same arm.
        if "_" not in record.scenario or all(len(arm.replace("0", "")) <= 1 for arm in record.scenario.split("_")):
            self.seen[site, "partial arms"].add(name)
        vehicles = [agent for agent in record.agents if agent.name.startswith("a")]  # others are pedestrians and parked
        self.seen[site, "pairs"].update(combinations(sorted({(agent.entrance, agent.exit) for agent in vehicles}), 2))


def counts_of(report: Report) -> Counts:
    """Return the counts of a report."""
    counts = Counts(report)
    for record in report.records:
        counts.add(record)
    return counts
