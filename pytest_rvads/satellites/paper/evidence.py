"""Evidence for the replication of the paper's tables.

``rvads paper margins`` prints by how many ticks each verdict of rule p1 is decided. ``ablation`` prints which cells change if
a deficiency of the driver is switched off, and how far each constant that the paper does not fix can change without a change of
verdicts (its room). ``null-models`` prints how well cells can be guessed without a simulation. ``docs/replication.md`` quotes
this evidence.

``snapshots`` draws a violation of each of p1 to p6 as in the paper's figures: the state before the violation and the state of
the violation, with the scheduler's zone shaded. None of the five deficiencies of the driver violates p3, because the scheduler's
queue is first in, first out. So the violation of p3 is shown for a faulty driver, whose scheduler calls the last vehicle first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pytest_rvads.drivers.interface import Drives, Observation
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.report.scene import picture
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.satellites.lgsvl import Box, Constants, LgsvlLike, Pilot, Scheduler, zone_of
from pytest_rvads.satellites.paper.tables import (
    FITTED,
    LIGHT,
    ROWS,
    STOP,
    TABLES,
    Entry,
    Key,
    Setup,
    Table,
    crossing_wait,
    entries,
    judge,
    null_models,
    published,
    run_entry,
)
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import usual
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.executors import Progress, spread
from pytest_rvads.support.storage import write_file

Margins = Mapping[tuple[int, int, str], int]
"""Margin of rule p1 in ticks of 0.01 s, see `p1_margin`, by class, row and configuration."""
Flips = Mapping[str, list[tuple[Key, str, str]]]
"""By name of a switched-off deficiency, the changed cells: cell, verdict with the deficiency, verdict without the deficiency."""


@dataclass(frozen=True, slots=True)
class Free:
    """A constant that the paper does not fix, with a function that changes it, and the tables whose verdicts depend on it."""

    move: Callable[[float], Setup]
    """Returns the settings of the experiment, given by how much the constant is changed."""
    resolution: float
    """Step between the changes that are tried, in the unit of the constant."""
    limit: float
    """Greatest change that is tried, in the unit of the constant."""
    tables: tuple[Table, ...] = TABLES


@dataclass(frozen=True, slots=True)
class Room:
    """The room of a constant: its greatest decrease and its greatest increase that change no verdict of its tables."""

    down: float
    up: float
    limit: float
    """Greatest change that was tried; a decrease or increase of this size may be possible beyond it."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Two pictures of a violation, as SVG documents."""

    rule: str
    before: str
    """Picture of the state before the violation."""
    broken: str
    """Picture of the state of the violation: the first state after which no continuation of the run satisfies the rule."""


def _setup_with(name: str, by: float) -> Setup:
    """Return the settings with a constant changed, and with the waiting time that `crossing_wait` derives from it."""
    constants = replace(Constants(), **{name: getattr(Constants(), name) + by})
    return Setup(constants, wait=crossing_wait(Setup(constants)))


def _setup_with_zone(**moves: float) -> Setup:
    """Return the settings with changes of the scheduler's zone at the 4-way stop, by field of the zone [m].

    The random draw keeps its value, because the draw affects only junctions with lights, which have no scheduler.
    """
    box = Constants().zone4
    return Setup(replace(Constants(), zone4=replace(box, **{name: getattr(box, name) + by for name, by in moves.items()})))


FREE: dict[str, Free] = {
    "zone, toward exit 1 [m]": Free(lambda by: _setup_with_zone(x=by), 0.06, 0.9, (STOP,)),
    "zone, toward exit 0 [m]": Free(lambda by: _setup_with_zone(y=-by), 0.06, 0.9, (STOP,)),
    "zone, half extent [m]": Free(lambda by: _setup_with_zone(half_x=by, half_y=by), 0.06, 0.9, (STOP,)),
    "launch [s]": Free(partial(_setup_with, "launch"), 0.02, 0.14),
    "halt [m]": Free(partial(_setup_with, "halt"), 0.05, 0.35),
    "braking": Free(partial(_setup_with, "braking"), 0.03, 0.21),
    "draw [s]": Free(lambda by: Setup(wait=round(Setup().wait + by, 6)), 0.01, 0.15, (LIGHT,)),
}
SHOWN: Mapping[str, Entry] = {
    "p1": Entry(STOP, 2, 0, "C"),
    "p2": Entry(STOP, 1, 0, "E"),
    "p3": Entry(STOP, 1, 0, "E"),
    "p4": Entry(LIGHT, 3, 0, "F"),
    "p5": Entry(LIGHT, 4, 0, "J"),
    "p6": Entry(LIGHT, 3, 0, "G"),
}
"""By rule, the run whose violation is drawn; the runs of p1, p2, p5 and p6 are also the runs in the paper's figures."""


def p1_margin(run: Run) -> int:
    """Return by how many ticks a run keeps rule p1 (at most one vehicle in the junction), or violates p1 if negative.

    A positive margin is the shortest time between a vehicle's exit from the junction and the entry of a later vehicle. A negative
    margin is the longest time that two vehicles were in the junction together.
    """
    inside = run.zone == Zone.JUNCTION
    spans = []
    for column in range(len(run.agents)):
        ticks = np.flatnonzero(inside[:, column])
        if len(ticks):
            spans.append((int(ticks[0]), int(ticks[-1]) + 1))
    spans.sort()
    gaps = [later[0] - earlier[1] for k, later in enumerate(spans) for earlier in spans[:k]]
    return min(gaps, default=run.steps)


def p1_margins(*, executor: Executor | int | None = None, progress: Progress | None = None) -> dict[tuple[int, int, str], int]:
    """Return `p1_margin` by class, row and configuration of the paper's table of the stop junction."""
    stop_entries = list(entries(STOP))
    margins = spread(_margin, stop_entries, executor, progress)
    return {(e.number, e.row, e.configuration): ticks for e, ticks in zip(stop_entries, margins, strict=True)}


def ablation(
    base: Mapping[Key, str],
    *,
    names: tuple[str, ...] = ("i1", "i2", "i3", "i4", "i5"),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> Flips:
    """Return, by name of a deficiency of the driver, the cells whose verdicts change if only this deficiency is switched off."""
    jobs = [(entry, Setup(off=(name,))) for name in names for table in TABLES for entry in entries(table)]
    flips: dict[str, list[tuple[Key, str, str]]] = {name: [] for name in names}
    for (entry, setup), verdicts in zip(jobs, spread(judge, jobs, executor, progress), strict=True):
        for rule, value in verdicts.items():
            if base[entry.key(rule)] != value:
                flips[setup.off[0]].append((entry.key(rule), base[entry.key(rule)], value))
    return flips


def rooms(
    base: Mapping[Key, str],
    *,
    names: tuple[str, ...] = tuple(FREE),
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[str, Room]:
    """Return how far each free constant can be changed, with all others fixed, so that every verdict stays as in `base`."""
    jobs = [(name, sign, dict(base)) for name in names for sign in (-1.0, 1.0)]
    farthest = list(spread(_farthest_move, jobs, executor, progress, batch=1))
    return {name: Room(farthest[2 * k], farthest[2 * k + 1], FREE[name].limit) for k, name in enumerate(names)}


def text_margins(margins: Margins) -> str:
    """Return the margins of rule p1 as a text table."""
    lines = [
        "Ticks of 0.01 s that p1 depends on: > 0 shortest gap between two vehicles in the junction, < 0 longest time together",
        "class, row" + "".join(f"{letter:>7}" for letter in STOP.configurations),
    ]
    for number in STOP.classes:
        for row in range(ROWS):
            cells = "".join(f"{margins[number, row, letter]:7}" for letter in STOP.configurations)
            lines.append(f"{number:5}, {row + 1:<3}{cells}")
    least = min(abs(ticks) for ticks in margins.values())
    return "\n".join([*lines, f"The closest cell depends on {least} ticks."])


def text_rooms(rooms_by_name: Mapping[str, Room]) -> str:
    """Return the room of the constants as a text table."""
    lines = ["How far a constant can move with no cell of its tables changing, the others fixed"]
    for name, room in rooms_by_name.items():
        down, up = (f"{by:+.2f}" + (" or more" if abs(by) >= room.limit - 1e-9 else "") for by in (room.down, room.up))
        lines.append(f"{name:<26}{down:<16}{up}")
    return "\n".join(lines)


def text_ablation(flips: Flips) -> str:
    """Return the cells that change per switched-off deficiency as text, with a line per rule, configuration and change."""
    lines = ["Cells of 240 that flip when a deficiency is switched off"]
    for name, cells in flips.items():
        lines.append(f"{name.upper()}: {len(cells)} cells")
        groups: dict[tuple[str, str, str, str], list[str]] = {}
        for (number, row, letter, rule), before, after in cells:
            groups.setdefault((rule, letter, before, after), []).append(f"{number}.{row + 1}")
        lines += [
            f"  {rule} of {letter}  {before} -> {after}  class.row {' '.join(rows)}"
            for (rule, letter, before, after), rows in groups.items()
        ]
    return "\n".join(lines)


def text_null_models() -> str:
    """Return, as text, how many cells models get right that predict cells without a simulation, see `null_models`."""
    rows = [f"{name:<32}{score:4} of {len(published(FITTED))}" for name, score in null_models().items()]
    return "\n".join(["Cells of classes 1 and 3 that a table would get with the best answer to cells it can't tell apart", *rows])


class LastFirst(LgsvlLike):
    """A driver with one fault: its scheduler waits until all vehicles are in the queue, and then calls the last vehicle first."""

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of creation."""
        scheduler = _LastFirst((agent.name for agent in agents), self.switches.i3)
        return [Pilot(self.switches, self.constants, scheduler) for _ in agents]


class _LastFirst(Scheduler):
    def next_vehicle(self, seen: Observation) -> str:
        return self._queue[-1].name if len(self._queue) > len(seen.others) else ""


def snapshots() -> dict[str, Snapshot]:
    """Return a snapshot of a violation of every rule of the paper."""
    setup = Setup()
    by_rule = {}
    for rule, entry in SHOWN.items():
        system: Any = LastFirst if rule == "p3" else setup.system()
        by_rule[rule] = snapshot(usual()(Case(entry.scenario(setup.wait), system)), rule, setup.constants)
    return by_rule


def write_snapshots(folder: str | Path) -> list[Path]:
    """Write `snapshots`, two pictures per rule, into a folder, and return the paths; a missing folder is made."""
    folder = Path(folder)
    paths = []
    for rule, pictures in snapshots().items():
        for moment, svg in (("before", pictures.before), ("broken", pictures.broken)):
            path = folder / f"{rule}-{moment}.svg"
            write_file(path, svg.encode())
            paths.append(path)
    return paths


def snapshot(run: Run, rule: str, constants: Constants) -> Snapshot:
    """Return the two pictures of the first violation of `rule` on `run`."""
    verdict = check(run, rule)
    if verdict.status is not Status.FAIL or verdict.time is None or verdict.time <= 0.0:
        raise RunError(f"run {run.label} has no violation of {rule} to show: {verdict.message}")
    tick = round(verdict.time / run.dt)
    violated = [instance for instance in verdict.instances if instance.failed == tick]
    guilty = [name for instance in violated for name in instance.responsible]
    names = {name for _, name in violated[0].binding}
    heads = {tick - 1: f"{rule}, t-1 = {(tick - 1) * run.dt:.2f} s", tick: f"{rule} broken, t = {tick * run.dt:.2f} s"}
    # Junctions with lights have no scheduler.
    zone = zone_of(run.junction, constants, hidden=True) if run.junction.control is JunctionControl.STOP else None
    pictures = []
    for at, head in heads.items():
        places = []
        for agent, number in zip(run.agents, run.zone[at].tolist(), strict=True):
            if agent.name in names:
                words = {Zone.APPROACH: f"before entrance {agent.entrance}", Zone.ENTRANCE: f"at entrance {agent.entrance}"}
                words[Zone.JUNCTION] = "in the junction"
                places.append(f"{agent.name} {words.get(Zone(number), 'past the junction')}")
        svg = picture(run, at, f"{head}: {', '.join(places)}", guilty)
        if isinstance(zone, Box):
            points = " ".join(f"{x:.2f},{-y:.2f}" for x, y in zone.corners())
            polygon = f'<polygon class="zone" points="{points}" fill="#444" fill-opacity="0.25"/>'
            # The zone is drawn above the road and below the vehicles.
            svg = svg.replace('<polyline class="trail"', polygon + '<polyline class="trail"', 1)
        pictures.append(svg)
    return Snapshot(rule, *pictures)


def _margin(entry: Entry) -> int:
    return p1_margin(run_entry(entry, Setup()))


def _farthest_move(job: tuple[str, float, Mapping[Key, str]]) -> float:
    """Return the greatest change of a constant in one direction that changes no cell."""
    name, sign, base = job
    free = FREE[name]
    # The configurations with the smallest margins are simulated first, because their verdicts are the first to change.
    order = [
        entry for letters in ("CFJ", "BEG", "ADHI") for t in free.tables for entry in entries(t) if entry.configuration in letters
    ]
    steps = 0
    while steps < round(free.limit / free.resolution):
        setup = free.move(sign * (steps + 1) * free.resolution)
        if any(base[entry.key(rule)] != value for entry in order for rule, value in judge((entry, setup)).items()):
            break
        steps += 1
    return round(sign * steps * free.resolution, 6)
