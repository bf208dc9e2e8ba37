"""How well recorded runs are predicted: verdicts, order of entry, and entry times.

A junction is built from the turn and length of the recorded movements, and the LGSVL-like autopilot is run from the
recorded distances, speeds and rotation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.readers import read_recorded
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.paper.tables import outcome
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import named, simulate
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.executors import Progress, spread
from studies.agreement import Entries, same_order
from studies.requests import DEFAULT_WAIT, DURATION, RULES
from studies.site import build_junction

NAMES = {
    "p1": "one-car-in-junction",
    "p2": "right-of-priority",
    "p3": "fifo-priority",
    "p4": "traffic-light",
    "p5": "right-turn-priority",
    "p6": "opposite-turn-priority",
}
"""The rules, as the recordings call them."""
_WORDS = {"True": "PASS", "False": "FAIL", "None": "NA"}
_Kind = tuple[int, Turn, float, float, int]
"""Entrance, turn, distance, speed, and the phase of the lights."""


@dataclass(frozen=True, slots=True)
class Compared:
    """A recorded run beside its prediction."""

    name: str
    verdicts: Mapping[str, tuple[str, str]]
    """Per rule the recorded verdict and the simulated one."""
    entries: Entries
    """Per vehicle when it enters the junction, recorded and simulated [s]."""
    free: Mapping[str, float]
    """Per vehicle how much later it enters in simulation when it is alone than in the earliest recording of its kind [s]."""

    @property
    def same_order(self) -> bool:
        """Whether every two vehicles enter in the same order, or together, in both."""
        return same_order(self.entries)


def compare(
    path: str | Path, *, simulator: str | None = None, executor: Executor | int | None = None, progress: Progress | None = None
) -> list[Compared]:
    """Simulate every run of a recorded file by the simulator of that name."""
    runs = read_recorded(path)
    sites = [site_of(run) for run in runs]
    kinds = [_kinds(run, site) for run, site in zip(runs, sites, strict=True)]
    lone = {
        kind: _lone(site, run.agents[k].entrance)
        for run, site, row in zip(runs, sites, kinds, strict=True)
        for k, kind in enumerate(row)
    }
    earliest: dict[_Kind, float] = {}
    for run, row in zip(runs, kinds, strict=True):
        for column, kind in enumerate(row):
            earliest[kind] = min(_late(run.entry(column)), earliest.get(kind, math.inf))
    simulated = list(spread(partial(_simulate, simulator), [*sites, *lone.values()], executor, progress))
    alone = zip(lone, simulated[len(sites) :], strict=True)
    free = {kind: _late(entries[kind[0]]) - earliest[kind] for kind, (_, entries) in alone}
    return [
        Compared(
            run.label,
            {
                rule: (_WORDS.get(str(said), str(said)), verdicts[rule])
                for rule in verdicts
                if (said := run.provenance["verdicts"].get(NAMES[rule]))
            },
            {agent.name: (run.entry(k), entries[agent.entrance]) for k, agent in enumerate(run.agents)},
            {agent.name: free[kind] for agent, kind in zip(run.agents, row, strict=True)},
        )
        for run, row, (verdicts, entries) in zip(runs, kinds, simulated, strict=False)
    ]


def text_agreement(found: Sequence[Compared], title: str) -> str:
    """Return how often recording and prediction agree, and by how much entry times differ."""
    cells = [pair for run in found for pair in run.verdicts.values()]
    same = sum(recorded == simulated for recorded, simulated in cells)
    ordered = sum(run.same_order for run in found)
    lines = [
        title,
        f"  verdicts  {same} of {len(cells)} as recorded",
        f"  order     {ordered} of {len(found)} runs as recorded",
    ]
    both = [
        (two - one, two - one - run.free[name])
        for run in found
        for name, (one, two) in run.entries.items()
        if one is not None and two is not None
    ]
    for what, values in zip(("raw", "less the free run's difference"), zip(*both, strict=True), strict=False):
        size = np.abs(values)
        lines.append(
            f"  entry times, simulated - recorded [s], {what}: mean {np.mean(values):.2f}, mean absolute {size.mean():.2f}, "
            f"90 % below {np.quantile(size, 0.9):.2f}, worst {size.max():.2f}"
        )
    for run in found:
        for rule, (recorded, simulated) in run.verdicts.items():
            if recorded != simulated:
                lines.append(f"  {run.name}: {rule} is {simulated}, recorded {recorded}")
        if not run.same_order:
            times = ", ".join(f"{name} {_time(two)} (recorded {_time(one)})" for name, (one, two) in run.entries.items())
            lines.append(f"  {run.name}: another order of entry, {times}")
    return "\n".join(lines)


def site_of(run: Run) -> Scenario:
    """Return the scenario of a recorded run, at a junction with the recorded lengths."""
    recorded, starts = run.junction, run.provenance["starts"]
    ways = recorded.ways
    first = {agent.name: agent for agent in run.agents}.get("c0")
    if first is None or len(starts) != len(run.agents) or recorded.control not in RULES:
        raise RunError(
            f"run {run.label!r} can't be predicted: it needs a vehicle c0, a start for every vehicle, and stop signs or lights"
        )
    lengths = {key: (movement.turn, movement.length) for key, movement in recorded.movements.items()}
    directions, distances, speeds = [0] * ways, [0.0] * ways, [0.0] * ways
    for agent in run.agents:
        place = (agent.entrance - first.entrance) % ways
        directions[place] = (agent.exit - agent.entrance) % ways
        distances[place], speeds[place] = starts[agent.name]
    return Scenario(
        build_junction(recorded.name, recorded.control, lengths, ways),
        directions,
        distance=distances,
        speed=speeds,
        rotation=first.entrance,
        duration=DURATION[recorded.control],
        wait=DEFAULT_WAIT,
    )


def _kinds(run: Run, site: Scenario) -> list[_Kind]:
    """Return, per vehicle, what its way to the junction depends on if nobody else is there."""
    phase = site.rotation % 2 if run.junction.control is JunctionControl.LIGHTS else 0
    return [(agent.entrance, agent.turn, *run.provenance["starts"][agent.name], phase) for agent in run.agents]


def _lone(site: Scenario, entrance: int) -> Scenario:
    """Return the scenario with the vehicle at `entrance` alone."""
    place = (entrance - site.rotation) % site.ways
    directions = [d if k == place else 0 for k, d in enumerate(site.directions)]
    return site.but(directions=directions)


def _simulate(simulator: str | None, site: Scenario) -> tuple[dict[str, str], dict[int, float | None]]:
    """Return the verdicts of a run, and the entry times by entrance."""
    run = simulate(Case(site, LgsvlLike), named(simulator))
    return outcome(run, RULES[run.junction.control]), {agent.entrance: run.entry(k) for k, agent in enumerate(run.agents)}


def _late(entry: float | None) -> float:
    return math.inf if entry is None else entry


def _time(entry: float | None) -> str:
    return "never" if entry is None else f"{entry:.2f} s"
