"""Figures of a session, a line each: who drove and what simulated, how near, how hard, how long, and how slow."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping
from typing import Any

from pytest_rvads.report.record import Computing, Record, SimulatedItem
from pytest_rvads.runs.measured import Kpis, PairKpis, VehicleKpis
from pytest_rvads.support.wording import first, plural

__all__ = ["Extremes", "Makers", "Timing", "Titles", "slowest"]

_Pick = Callable[..., Any]
_LINES: tuple[tuple[str, tuple[tuple[str, str, _Pick, str], ...]], ...] = (
    ("nearest", (("time to collision", "ttc", min, "s"), ("post-encroachment time", "pet", min, "s"))),
    ("most", (("braking", "deceleration", max, "m/s^2"), ("waiting", "waiting", max, "s"), ("delay", "delay", max, "s"))),
)
"""Per line: the first word, and its indicators, each with heading, field of the record, function that selects, and unit."""
_PICKS = tuple((key, pick) for _, indicators in _LINES for _, key, pick, _ in indicators)


_ENGINES = {"bullet": "pybullet", "mujoco": "mujoco", "sumo": "libsumo"}
"""Simulator to the package that it is built on."""


class Makers:
    """Takes records in and tells who drove and what simulated."""

    def __init__(self) -> None:
        self._runs: dict[tuple[str, str, str], set[str]] = {}

    def add(self, record: Record) -> None:
        """Take a record in."""
        if not isinstance(record, SimulatedItem):
            return
        for made in (("driven", record.driver, record.source), ("simulated", record.simulator, "")):
            if made[1]:
                runs = self._runs.get(made) or self._runs.setdefault(made, set())
                runs.add(record.ran_as)

    def lines(self, versions: Mapping[str, str]) -> list[str]:
        """Return a line per system under test, and one per simulator: name, code or version, and how many runs it made.

        Args:
            versions: of packages, by name.
        """
        lines = []
        for (what, name, source), runs in sorted(self._runs.items(), key=lambda entry: entry[0][0]):
            engine = _ENGINES.get(name, "") if what == "simulated" else ""
            code = source or (f"{engine} {versions[engine]}" if engine in versions else "")
            lines.append(f"{what} by {name}{f' ({code})' if code else ''}: {plural(len(runs), 'run')}")
        return lines


class Titles:
    """Takes records in and tells what rules are called in words, of those whose names share none with their titles."""

    def __init__(self) -> None:
        self._titles: dict[str, str] = {}

    def add(self, record: Record) -> None:
        """Take a record in."""
        for verdict in record.verdicts:
            if verdict.title and {*verdict.rule.casefold().split("_")}.isdisjoint(verdict.title.casefold().split()):
                self._titles.setdefault(verdict.rule, verdict.title)

    def lines(self, most: int | None) -> list[str]:
        """Return a line with at most `most` rules and their titles; no line if no rule has a title besides its name."""
        told = [f"{rule} ({title})" for rule, title in sorted(self._titles.items())]
        return [f"rules: {first(told, most)}"] if told else []


class Extremes:
    """Takes records in and tells how near, how hard and how long it got at most; of equal values the first counts."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[float, PairKpis | VehicleKpis, Record]] = {}
        self._last: Kpis | None = None

    def add(self, record: Record) -> None:
        """Take a record in."""
        entries: tuple[PairKpis | VehicleKpis, ...]
        # The records of a run share its indicators where they come from a campaign.
        entries = (*record.kpis.pairs, *record.kpis.vehicles) if record.kpis and record.kpis is not self._last else ()
        self._last = record.kpis
        for key, pick in _PICKS:
            for entry in entries:
                value = getattr(entry, key, None)
                if value is not None and (key not in self._found or pick(value, self._found[key][0]) != self._found[key][0]):
                    self._found[key] = value, entry, record

    def lines(self) -> list[str]:
        """Return at most two lines: the nearest encounters, and the hardest braking, longest wait and longest delay.

        What no run records is left out.
        """
        lines = []
        for word, indicators in _LINES:
            told = [f"{name} {self._told(key, unit)}" for name, key, _, unit in indicators if key in self._found]
            lines += [f"{word}: {', '.join(told)}"] if told else []
        return lines

    def _told(self, key: str, unit: str) -> str:
        value, entry, record = self._found[key]
        who = " and ".join(entry.agents) if isinstance(entry, PairKpis) else entry.agent
        return f"{value:.2f} {unit} ({who} in {record.where})"


class Timing:
    """Takes records in and tells how long stacks in other processes computed: real time, which no verdict depends on."""

    def __init__(self) -> None:
        self._runs: set[tuple[str | None, str | None]] = set()
        self._stacks: dict[str, _Computed] = {}

    def add(self, record: Record) -> None:
        """Take a record in."""
        run = record.run, record.hash
        if record.timing and run not in self._runs:
            self._runs.add(run)
            for one in record.timing.values():
                self._stacks.setdefault(one.stack, _Computed()).add(one)
            for stack in {one.stack for one in record.timing.values()}:
                self._stacks[stack].runs += 1

    def lines(self) -> list[str]:
        """Return a line per stack: in how many runs it made how many decisions, and how long they took."""
        return [found.line(stack) for stack, found in self._stacks.items()]


class _Computed:
    """How much one stack computed."""

    def __init__(self) -> None:
        self.runs = 0
        """A stack may drive several vehicles of one."""
        self._decisions, self._longest, self._seconds = 0, 0.0, array("d")

    def add(self, one: Computing) -> None:
        self._decisions += one.decisions
        self._longest = max(self._longest, one.longest)
        self._seconds.append(one.compute)

    def line(self, stack: str) -> str:
        mean = math.fsum(self._seconds) / max(self._decisions, 1)
        told = f"{plural(self._decisions, 'decision')} in {plural(self.runs, 'run')}"
        return f"{stack}: {told}, {1000 * mean:.2g} ms each, {1000 * self._longest:.2g} ms the longest"


def slowest(seconds: Mapping[str, float], most: int, least: float = 0.0) -> list[str]:
    """Return a line that names the slowest runs; an empty list if no run took `least` seconds.

    Args:
        seconds: the time that every run took, by the name of the run [s].
        most: number of runs that the line names.
        least: the time from which on a run is slow [s].
    """
    ranked = sorted(seconds.items(), key=lambda entry: -entry[1])[:most]
    if not ranked or ranked[0][1] < least:
        return []
    return ["slowest: " + ", ".join(f"{taken:.1f} s {run}" for run, taken in ranked)]
