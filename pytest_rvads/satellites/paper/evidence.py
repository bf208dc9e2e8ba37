"""Evidence for the replication: margins of p1, ablation of the mechanisms, and room of the free constants.

``rvads paper --margins``, ``--ablation`` and ``--null-models`` print this evidence, and ``docs/replication.md`` quotes it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import numpy as np

from pytest_rvads.drivers.lgsvl import Constants
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.satellites.paper.experiment import (
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
    run_entry,
)
from pytest_rvads.satellites.paper.tables import FITTED, null_models, published
from pytest_rvads.support.executors import Progress, spread

__all__ = [
    "FREE",
    "Free",
    "Room",
    "ablation",
    "p1_margin",
    "p1_margins",
    "rooms",
    "text_ablation",
    "text_margins",
    "text_null_models",
    "text_rooms",
]

Margins = Mapping[tuple[int, int, str], int]
"""Margin of p1 in ticks, by class, row and configuration."""
Flips = Mapping[str, list[tuple[Key, str, str]]]
"""Flipped cells per switched-off deficiency: cell, verdict with the deficiency, verdict without the deficiency."""


@dataclass(frozen=True, slots=True)
class Free:
    """A free constant of the surrogate, with a function that moves the constant, and the tables that depend on it."""

    move: Callable[[float], Setup]
    """Returns the setup of the experiment with the constant moved by the argument."""
    resolution: float
    """Step of the search for the room, in the unit of the constant."""
    limit: float
    """Farthest tried move, in the unit of the constant."""
    tables: tuple[Table, ...] = TABLES


@dataclass(frozen=True, slots=True)
class Room:
    """The farthest moves of a constant that change no cell of its tables."""

    down: float
    up: float
    limit: float
    """Farthest tried move."""


def _setup_with(constants: Constants) -> Setup:
    """Return the setup with constants and the random draw that follows from these constants."""
    return Setup(constants, wait=crossing_wait(Setup(constants)))


def _setup_with_zone(**moves: float) -> Setup:
    """Return the setup with the zone of the X-junction moved; the draw stays, because junctions with lights have no zone."""
    box = Constants().zone4
    return Setup(replace(Constants(), zone4=replace(box, **{name: getattr(box, name) + by for name, by in moves.items()})))


FREE: dict[str, Free] = {
    "zone, toward exit 1 [m]": Free(lambda by: _setup_with_zone(x=by), 0.06, 0.9, (STOP,)),
    "zone, toward exit 0 [m]": Free(lambda by: _setup_with_zone(y=-by), 0.06, 0.9, (STOP,)),
    "zone, half extent [m]": Free(lambda by: _setup_with_zone(half_x=by, half_y=by), 0.06, 0.9, (STOP,)),
    "launch [s]": Free(lambda by: _setup_with(replace(Constants(), launch=Constants().launch + by)), 0.02, 0.14),
    "halt [m]": Free(lambda by: _setup_with(replace(Constants(), halt=Constants().halt + by)), 0.05, 0.35),
    "braking": Free(lambda by: _setup_with(replace(Constants(), braking=Constants().braking + by)), 0.03, 0.21),
    "draw [s]": Free(lambda by: Setup(wait=round(Setup().wait + by, 6)), 0.01, 0.15, (LIGHT,)),
}


def p1_margin(run: Run) -> int:
    """Return the margin of p1 on a run, in ticks; the verdict changes with the sign of the margin.

    A positive margin is the shortest time from the exit of a vehicle to the entry of the next vehicle. A negative margin is the
    longest time that two vehicles were in the junction together.
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
    """Return `p1_margin` per class, row and configuration of the stop table."""
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
    """Return the flipped cells per switched-off deficiency, compared to the verdicts `base` with all deficiencies."""
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
    """Return the room of each free constant, with all other constants fixed and every cell as in `base`."""
    jobs = [(name, sign, dict(base)) for name in names for sign in (-1.0, 1.0)]
    farthest = list(spread(_farthest_move, jobs, executor, progress, batch=1))
    return {name: Room(farthest[2 * k], farthest[2 * k + 1], FREE[name].limit) for k, name in enumerate(names)}


def text_margins(margins: Margins) -> str:
    """Return the margins of p1 as a table."""
    lines = [
        "Ticks of 0.01 s that p1 hangs on: > 0 shortest gap between two vehicles in the junction, < 0 longest time together",
        "class, row" + "".join(f"{letter:>7}" for letter in STOP.configurations),
    ]
    for number in STOP.classes:
        for row in range(ROWS):
            cells = "".join(f"{margins[number, row, letter]:7}" for letter in STOP.configurations)
            lines.append(f"{number:5}, {row + 1:<3}{cells}")
    least = min(abs(ticks) for ticks in margins.values())
    return "\n".join([*lines, f"The closest cell hangs on {least} ticks."])


def text_rooms(rooms_by_name: Mapping[str, Room]) -> str:
    """Return the room of the constants as a table."""
    lines = ["How far a constant can move with no cell of its tables changing, the others fixed"]
    for name, room in rooms_by_name.items():
        down, up = (f"{by:+.2f}" + (" or more" if abs(by) >= room.limit - 1e-9 else "") for by in (room.down, room.up))
        lines.append(f"{name:<26}{down:<16}{up}")
    return "\n".join(lines)


def text_ablation(flips: Flips) -> str:
    """Return the flipped cells per switched-off deficiency as text, with a line per rule and configuration."""
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
    """Return the scores of the models without a simulation as text."""
    rows = [f"{name:<32}{score:4} of {len(published(FITTED))}" for name, score in null_models().items()]
    return "\n".join(["Cells of classes 1 and 3 that a table would get with the best answer to cells it can't tell apart", *rows])


def _margin(entry: Entry) -> int:
    return p1_margin(run_entry(entry, Setup()))


def _farthest_move(job: tuple[str, float, Mapping[Key, str]]) -> float:
    """Return the farthest move of a constant in a direction that changes no cell."""
    name, sign, base = job
    free = FREE[name]
    steps = 0
    while steps < round(free.limit / free.resolution) and _same_verdicts(free, sign * (steps + 1) * free.resolution, base):
        steps += 1
    return round(sign * steps * free.resolution, 6)


def _same_verdicts(free: Free, by: float, base: Mapping[Key, str]) -> bool:
    setup = free.move(by)
    # The configurations with the smallest margins come first, because they change first.
    order = [
        entry for letters in ("CFJ", "BEG", "ADHI") for t in free.tables for entry in entries(t) if entry.configuration in letters
    ]
    return all(base[entry.key(rule)] == value for entry in order for rule, value in judge((entry, setup)).items())
