"""Getting on: who could go and does not, and who stands in the junction for no good reason.

A vehicle may wait for somebody: for a body ahead in its lane, for one that is on the stretch their movements share, for one
that has the better right and is due. Those that wait for each other have no such excuse, but for who came in on red. Time
is lost as far as a vehicle that could go gets on more slowly than at walking pace.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.rights import PACE
from pytest_rvads.conduct.stretches import before_exit, position
from pytest_rvads.conduct.waiting import at_line, circles, reasons
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = [
    "BLOCKING_TIME",
    "PATIENCE",
    "blocking_time",
    "blocks",
    "idles",
    "inside",
    "lost_time",
    "may_go",
    "part",
]

PATIENCE = 10.0
"""Whoever could go for this long and has not, impedes traffic [s]; laws give no number (StVO, section 3(2); CVC 22400(a))."""
BLOCKING_TIME = 3.0
"""A vehicle that loses more time than this in the junction blocks it [s]."""


def may_go(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent could get on: its light or its turn allows it, and it waits for nobody that does not wait for it as well."""
    return _waiting(run).free[:, agent]


def idles(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has lost more time than `PATIENCE` while it could go: before the junction, in it, or on its way out."""
    lost = lost_time(run)[:, agent]
    found = np.zeros(run.steps, dtype=np.bool_)
    begun = np.flatnonzero(np.diff(part(run, agent))) + 1
    for start, end in pairwise((0, *begun.tolist(), run.steps)):
        found[start:end] = np.cumsum(lost[start:end]) > PATIENCE
    return found


def part(run: Run, agent: int) -> NDArray[np.int8]:
    """Return where the agent is on its way: before the junction, in it, or beyond; each has a patience of its own."""
    found: NDArray[np.int8] = np.clip(run.zone[:, agent], Zone.ENTRANCE, Zone.EXIT)
    return found


def lost_time(run: Run) -> NDArray[np.float64]:
    """Return the time that every agent loses in each state although it could go, shape ``(steps, agents)`` [s]."""
    return once(run, _lose_time)


def _lose_time(run: Run) -> NDArray[np.float64]:
    return np.where(_waiting(run).free, _slowness(run, run.advance), 0.0)


def blocks(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has lost more time than `BLOCKING_TIME` with part of its body in the junction, giving way to nobody."""
    found: NDArray[np.bool_] = np.cumsum(blocking_time(run, agent)) > BLOCKING_TIME
    return found


def blocking_time(run: Run, agent: int) -> NDArray[np.float64]:
    """Return the time for which an agent blocks the junction in each state, shape ``(steps,)`` [s]."""
    slow = _slowness(run, np.abs(run.need("speed")[:, [agent]]))[:, 0]
    return np.where(inside(run, agent) & ~_waiting(run).gives_way[:, agent], slow, 0.0)


def inside(run: Run, agent: int) -> NDArray[np.bool_]:
    """Part of the body of the agent is in the junction."""
    front, _ = position(run, agent)
    _, behind = before_exit(run, agent)
    found: NDArray[np.bool_] = (front > 0.0) & (behind < 0.0) & run.here[:, agent]
    return found


def _slowness(run: Run, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of every step that is lost against walking pace [s]."""
    # Rounded, so that three hundred steps at rest are three seconds.
    return np.round((1.0 - np.clip(speed / PACE, 0.0, 1.0)) * run.dt, 12)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """Who waits in a run."""

    free: NDArray[np.bool_]
    """Who could get on, shape ``(steps, agents)``."""
    gives_way: NDArray[np.bool_]
    """Who lets somebody pass whose way it would cross, and who does not wait for it, likewise."""


def _waiting(run: Run) -> _Waiting:
    """Return who waits in a run, worked out once."""
    return once(run, _work_out)


def _work_out(run: Run) -> _Waiting:
    held, gives_way = circles(run, list(reasons(run)))
    allowed = [_allowed(run, agent) for agent in range(len(run.agents))]
    return _Waiting(np.stack(allowed, axis=1) & ~held if allowed else held, gives_way)


def _allowed(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether nothing but other vehicles can keep the agent from getting on; once far down its exit road, it has arrived."""
    arrived = before_exit(run, agent)[0] >= LEAVE
    facing = run.facing[:, agent]
    waits = at_line(run, agent) & (facing != Colour.GREEN) & (facing != Colour.NONE)
    found: NDArray[np.bool_] = run.here[:, agent] & ~arrived & ~waits
    return found
