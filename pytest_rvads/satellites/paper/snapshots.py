"""Snapshots of violations as in the paper's figures: the state before the violation and the state of the violation.

Each of p1 to p6 has a snapshot; the scheduler's zone is shaded. None of the five deficiencies breaks p3, because the queue is
first in, first out. So p3 is shown for a mutant, which calls the last vehicle of the queue first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pytest_rvads.drivers.interface import Drives, Observation
from pytest_rvads.drivers.lgsvl import Constants, LgsvlLike
from pytest_rvads.drivers.lgsvl.pilot import Pilot
from pytest_rvads.drivers.lgsvl.scheduler import Box, Scheduler, zone_of
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.report.draw.picture import picture
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.paper.experiment import LIGHT, STOP, Entry, Setup
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.planar import usual
from pytest_rvads.support.errors import RunError

__all__ = ["SHOWN", "LastFirst", "Snapshot", "snapshot", "snapshots", "write"]

SHOWN: Mapping[str, Entry] = {
    "p1": Entry(STOP, 2, 0, "C"),
    "p2": Entry(STOP, 1, 0, "E"),
    "p3": Entry(STOP, 1, 0, "E"),
    "p4": Entry(LIGHT, 3, 0, "F"),
    "p5": Entry(LIGHT, 4, 0, "J"),
    "p6": Entry(LIGHT, 3, 0, "G"),
}
"""Run of the snapshot of each rule; the runs of p1, p2, p5 and p6 are the paper's."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Two pictures of a violation, as SVG documents."""

    rule: str
    before: str
    """Picture of the state before the violation."""
    broken: str
    """Picture of the violation, which is the first state that no continuation can repair."""


class LastFirst(LgsvlLike):
    """A mutant: its scheduler waits until all vehicles are in the queue, and then calls the last vehicle first."""

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of creation."""
        scheduler = _LastFirst((agent.name for agent in agents), self.switches.i3)
        return [Pilot(self.switches, self.constants, scheduler) for _ in agents]


class _LastFirst(Scheduler):
    def _next_vehicle(self, seen: Observation) -> str:
        return self._queue[-1].name if len(self._queue) > len(seen.others) else ""


def snapshots() -> dict[str, Snapshot]:
    """Return a snapshot of a violation of every rule of the paper."""
    setup = Setup()
    by_rule = {}
    for rule, entry in SHOWN.items():
        system: Any = LastFirst if rule == "p3" else setup.system()
        by_rule[rule] = snapshot(usual()(Case(entry.scenario(setup.wait), system)), rule, setup.constants)
    return by_rule


def write(folder: str | Path) -> list[Path]:
    """Write `snapshots`, two pictures per rule, into a folder, and return the paths; a missing folder is made."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for rule, pictures in snapshots().items():
        for moment, svg in (("before", pictures.before), ("broken", pictures.broken)):
            path = folder / f"{rule}-{moment}.svg"
            path.write_text(svg, encoding="utf-8")
            written.append(path)
    return written


def snapshot(run: Run, rule: str, constants: Constants) -> Snapshot:
    """Return the two pictures of the first violation of `rule` on `run`.

    Raises:
        RunError: the run does not violate the rule, or does so in its first state.
    """
    verdict = check(run, rule)
    if verdict.status is not Status.FAIL or verdict.time is None or verdict.time <= 0.0:
        raise RunError(f"run {run.label} has no violation of {rule} to show: {verdict.message}")
    tick = round(verdict.time / run.dt)
    violated = [instance for instance in verdict.instances if instance.failed == tick]
    guilty = [name for instance in violated for name in instance.responsible]
    names = {name for _, name in violated[0].binding}
    involved = [column for column, agent in enumerate(run.agents) if agent.name in names]
    heads = {tick - 1: f"{rule}, t-1 = {(tick - 1) * run.dt:.2f} s", tick: f"{rule} broken, t = {tick * run.dt:.2f} s"}
    before, after = (
        _shaded(picture(run, t, f"{head}: {', '.join(_where(run, t, column) for column in involved)}", guilty), run, constants)
        for t, head in heads.items()
    )
    return Snapshot(rule, before, after)


def _where(run: Run, tick: int, column: int) -> str:
    """Return the place of a vehicle in words."""
    agent, zone = run.agents[column], Zone(run.zone[tick, column])
    places = {Zone.APPROACH: f"before entrance {agent.entrance}", Zone.ENTRANCE: f"at entrance {agent.entrance}"}
    return f"{agent.name} {places.get(zone, 'in the junction' if zone is Zone.JUNCTION else 'past the junction')}"


def _shaded(svg: str, run: Run, constants: Constants) -> str:
    """Add the scheduler's zone to a picture, above the road and below the vehicles; lights have no scheduler."""
    if run.junction.control is not JunctionControl.STOP:
        return svg
    zone = zone_of(run.junction, constants, hidden=True)
    if not isinstance(zone, Box):
        return svg
    points = " ".join(f"{x:.2f},{-y:.2f}" for x, y in zone.corners())
    polygon = f'<polygon class="zone" points="{points}" fill="#444" fill-opacity="0.25"/>'
    return svg.replace('<polyline class="trail"', polygon + '<polyline class="trail"', 1)
