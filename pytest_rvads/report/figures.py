"""Lines with figures of a session: drivers and simulators, extreme indicators, computing times, slowest runs."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping
from typing import Any

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Computing, Record, SimulatedItem
from pytest_rvads.runs.measured import Kpis, PairKpis, VehicleKpis
from pytest_rvads.support.wording import first, plural

_Pick = Callable[..., Any]
_LINES: tuple[tuple[str, tuple[tuple[str, str, _Pick, str], ...]], ...] = (
    ("nearest", (("time to collision", "ttc", min, "s"), ("post-encroachment time", "pet", min, "s"))),
    ("most", (("braking", "deceleration", max, "m/s^2"), ("waiting", "waiting", max, "s"), ("delay", "delay", max, "s"))),
)
"""Per line of extremes: its first word, and its indicators. An indicator is (heading, field of `Kpis`, min or max, unit)."""
_PICKS = tuple((key, pick) for _, indicators in _LINES for _, key, pick, _ in indicators)


_ENGINES = {"bullet": "pybullet", "mujoco": "mujoco", "sumo": "libsumo"}
"""By name of a simulator, the package on which the simulator is built."""


class Makers:
    """Counts the runs of each driver and each simulator over records."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str, str], set[str]] = {}

    def add(self, record: Record) -> None:
        """Add the driver and the simulator of a record."""
        if not isinstance(record, SimulatedItem):
            return
        for maker in (("driven", record.driver, record.source), ("simulated", record.simulator, "")):
            if maker[1]:
                runs = self._runs.get(maker) or self._runs.setdefault(maker, set())
                runs.add(record.ran_as)

    def lines(self, versions: Mapping[str, str]) -> list[str]:
        """Return a line per system under test and per simulator: name, code or version, and number of runs."""
        lines = []
        for (verb, name, source), runs in sorted(self._runs.items(), key=lambda entry: entry[0][0]):
            engine = _ENGINES.get(name, "") if verb == "simulated" else ""
            code = source or (f"{engine} {versions[engine]}" if engine in versions else "")
            lines.append(f"{verb} by {name}{f' ({code})' if code else ''}: {plural(len(runs), 'run')}")
        return lines


class Titles:
    """Collects the titles of rules from records, for rules whose title shares no word with the name of the rule."""

    def __init__(self) -> None:
        self._titles: dict[str, str] = {}

    def add(self, record: Record) -> None:
        """Add the rule of a record."""
        for verdict in record.verdicts:
            if verdict.title and {*verdict.rule.casefold().split("_")}.isdisjoint(verdict.title.casefold().split()):
                self._titles.setdefault(verdict.rule, verdict.title)

    def lines(self, most: int | None) -> list[str]:
        """Return a line with at most `most` titles; no line without titles."""
        titles = [f"{rule} ({title})" for rule, title in sorted(self._titles.items())]
        return [f"rules: {first(titles, most)}"] if titles else []


class Extremes:
    """Collects the extreme indicators of runs, such as the hardest braking, from records; of equal values, the first is kept."""

    def __init__(self) -> None:
        self._extremes: dict[str, tuple[float, PairKpis | VehicleKpis, Record]] = {}
        self._last: Kpis | None = None
        self._contacts: dict[str, Outcome] = {}
        """The outcome of the rule on collisions, by run with a time to collision of 0."""

    def add(self, record: Record) -> None:
        """Add the indicators of a record."""
        entries: tuple[PairKpis | VehicleKpis, ...]
        if record.asks == "no_collision" and record.kpis and any(pair.ttc == 0.0 for pair in record.kpis.pairs):
            self._contacts[record.where] = record.status
        # The records of a run from a campaign share one object with the indicators.
        entries = (*record.kpis.pairs, *record.kpis.vehicles) if record.kpis and record.kpis is not self._last else ()
        self._last = record.kpis
        for key, pick in _PICKS:
            for entry in entries:
                value = getattr(entry, key, None)
                if value is not None and (
                    key not in self._extremes or pick(value, self._extremes[key][0]) != self._extremes[key][0]
                ):
                    self._extremes[key] = value, entry, record

    def lines(self) -> list[str]:
        """Return at most two lines of extremes: the nearest encounters; the hardest braking, longest wait and longest delay."""
        lines = []
        for word, indicators in _LINES:
            texts = []
            for name, key, _, unit in indicators:
                if key not in self._extremes:
                    continue
                value, entry, record = self._extremes[key]
                agents = " and ".join(entry.agents) if isinstance(entry, PairKpis) else entry.agent
                touch = ""
                if key == "ttc" and value == 0.0:  # bodies are covered by discs, which reach beyond the bodies
                    collision = self._contacts.get(record.where)
                    if collision in (None, Outcome.PASS, Outcome.NA):
                        touch = ": discs around the bodies touch" + (", the bodies do not" if collision else "")
                    else:
                        touch = f": no_collision is {collision}"
                texts.append(f"{name} {value:.2f} {unit} ({agents} in {record.where}{touch})")
            lines += [f"{word}: {', '.join(texts)}"] if texts else []
        return lines


class Timing:
    """Collects the computing times of drivers in other processes; these are real times, on which no verdict depends."""

    def __init__(self) -> None:
        self._runs: set[tuple[str | None, str | None]] = set()
        self._stacks: dict[str, _Computed] = {}

    def add(self, record: Record) -> None:
        """Add the computing times of a record."""
        run = record.run, record.hash
        if record.timing and run not in self._runs:
            self._runs.add(run)
            for computing in record.timing.values():
                self._stacks.setdefault(computing.stack, _Computed()).add(computing)
            for stack in {computing.stack for computing in record.timing.values()}:
                self._stacks[stack].runs += 1

    def lines(self) -> list[str]:
        """Return a line per driver in another process: numbers of decisions and runs, mean and longest time of a decision."""
        return [computed.line(stack) for stack, computed in self._stacks.items()]


class _Computed:
    """The computing times of a driver in another process."""

    def __init__(self) -> None:
        self.runs = 0
        """Number of runs; a run counts once, even if the stack drove several vehicles of the run."""
        self._decisions, self._longest, self._seconds = 0, 0.0, array("d")

    def add(self, computing: Computing) -> None:
        self._decisions += computing.decisions
        self._longest = max(self._longest, computing.longest)
        self._seconds.append(computing.compute)

    def line(self, stack: str) -> str:
        mean = math.fsum(self._seconds) / max(self._decisions, 1)
        extent = f"{plural(self._decisions, 'decision')} in {plural(self.runs, 'run')}"
        return f"{stack}: {extent}, {1000 * mean:.2g} ms each, {1000 * self._longest:.2g} ms the longest"


class Excesses:
    """Collects the accelerations that drivers asked for beyond the limits of their vehicles."""

    def __init__(self) -> None:
        self._runs: set[tuple[str | None, str | None]] = set()
        self._requests, self._largest = 0, 0.0

    def add(self, record: Record) -> None:
        """Add the requests of a record."""
        run = record.run, record.hash
        if record.excess and run not in self._runs:
            self._runs.add(run)
            self._requests += sum(excess.requests for excess in record.excess.values())
            self._largest = max(self._largest, *(excess.largest for excess in record.excess.values()), key=abs)

    def lines(self) -> list[str]:
        """Return a line with the numbers of requests and runs and the largest request; an empty list without requests."""
        if not self._runs:
            return []
        extent = f"{plural(self._requests, 'acceleration')} in {plural(len(self._runs), 'run')}"
        return [f"beyond the limits of the vehicle: {extent}, the largest {self._largest:.3g} m/s^2"]


def slowest(seconds: Mapping[str, float], most: int, least: float = 0.0) -> list[str]:
    """Return a list of one line that names the slowest of the runs with these times [s]; empty if no run took `least` [s]."""
    ranked = sorted(seconds.items(), key=lambda entry: -entry[1])[:most]
    if not ranked or ranked[0][1] < least:
        return []
    return ["slowest: " + ", ".join(f"{duration:.1f} s {run}" for run, duration in ranked)]
