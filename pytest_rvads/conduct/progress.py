"""Getting on: who could go and does not, and who stands in the junction for no good reason.

A vehicle may wait for somebody: for a body ahead in its lane, for one that is on the stretch their movements share, for one
that has the better right and is due. Those that wait for each other have no such excuse, but for who came in on red. Time
is lost as far as a vehicle that could go gets on more slowly than at walking pace.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.grounds import in_turn, may_owe
from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.predicates import ticks
from pytest_rvads.conduct.priority import due, yields
from pytest_rvads.conduct.standing import TIE
from pytest_rvads.conduct.stretches import before_exit, on_stretch, parting, position, shared
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = [
    "BLOCKING_TIME",
    "PACE",
    "PATIENCE",
    "blocking_time",
    "blocks",
    "comes_first",
    "idles",
    "inside",
    "lost_time",
    "may_go",
    "part",
]

PACE = 1.4
"""Walking pace [m/s]: who could go and is slower loses time."""
PATIENCE = 10.0
"""Whoever could go for this long and has not, impedes traffic [s]; laws give no number (StVO, section 3(2); CVC 22400(a))."""
BLOCKING_TIME = 3.0
"""A vehicle that loses more time than this in the junction blocks it [s]."""
GAP = 6.0
"""Behind a body that is this near ahead a vehicle need not go [m]."""
ROOM = 2.5
"""Room that a vehicle wants on its exit road behind who stands there, beside its own length [m]."""
AT_LINE = 5.0
"""Nearer to the stopping line than this, a vehicle that stands waits for the light or for its turn [m]."""
MOST = 200_000_000
"""States times pairs of vehicles that are looked at."""


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
    count = len(run.agents)
    if run.steps * count * count > MOST:
        raise RunError(f"{count} vehicles in {run.steps:,} states are too many to tell who waits for whom: cut the run in parts")
    queued = np.zeros((count, count, run.steps), dtype=np.bool_)
    yielding = np.zeros_like(queued)
    for one, two in permutations(range(count), 2):
        common = shared(run, one, two)
        queued[one, two] = _behind(run, one, two, common)
        yielding[one, two] = _lets_pass(run, one, two, common) | queued[one, two] & _cut_off(run, one, two)
    reach = queued | yielding
    for via in range(count):
        reach |= reach[:, via, None] & reach[None, via, :]
    mutual = reach & reach.swapaxes(0, 1)
    red = (run.zone >= Zone.JUNCTION) & (run.facing == Colour.RED)
    # Whoever came in on red is in the way of those who did not, whatever they do to each other.
    one_way = ~mutual | (red.T[None] & ~red.T[:, None])
    held: NDArray[np.bool_] = np.any((queued | yielding) & one_way, axis=1).T
    gives_way: NDArray[np.bool_] = np.any(yielding & one_way, axis=1).T
    allowed = [_allowed(run, agent) for agent in range(count)]
    return _Waiting(np.stack(allowed, axis=1) & ~held if allowed else held, gives_way)


def _allowed(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether nothing but other vehicles can keep the agent from getting on; once far down its exit road, it has arrived."""
    arrived = before_exit(run, agent)[0] >= LEAVE
    facing = run.facing[:, agent]
    waits = _at_line(run, agent) & (facing != Colour.GREEN) & (facing != Colour.NONE)
    found: NDArray[np.bool_] = run.here[:, agent] & ~arrived & ~waits
    return found


def _at_line(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether the agent is before the junction and so near to its line that it may wait there."""
    line = -run.junction.setbacks[run.agents[agent].entrance]
    found: NDArray[np.bool_] = (run.zone[:, agent] <= Zone.ENTRANCE) & (run.need("station")[:, agent] > line - AT_LINE)
    return found


def _behind(run: Run, agent: int, other: int, common: Shared | None) -> NDArray[np.bool_]:
    """Whether the other one is slow and near ahead in the agent's lane, or leaves it no room on its exit road."""
    me, you = run.agents[agent], run.agents[other]
    slow = (run.need("speed")[:, other] < PACE) & run.here[:, other]
    zone = run.zone[:, agent]
    found = np.zeros(run.steps, dtype=np.bool_)
    if me.entrance == you.entrance:
        (front, _), (ahead, behind) = position(run, agent), position(run, other)
        same = behind < parting(run.junction, me.route.key, you.route.key)
        found |= same & (ahead > front) & (behind - front < GAP)
    if me.exit == you.exit:
        (front, _), (ahead, behind) = before_exit(run, agent), before_exit(run, other)
        merged = ahead >= (common.yours.start - you.route.length if common else 0.0)
        found |= (zone >= Zone.JUNCTION) & merged & (ahead > front) & (behind - front < GAP)
        found |= (zone == Zone.ENTRANCE) & (run.zone[:, other] == Zone.EXIT) & (behind < run.size(agent)[0] + ROOM)
    found &= slow
    return found


def _cut_off(run: Run, agent: int, other: int) -> NDArray[np.bool_]:
    """Whether the agent was in the junction before the other one, which then is ahead because it pushed in."""
    found: NDArray[np.bool_] = (run.zone[:, agent] >= Zone.JUNCTION) & (run.entered[other] > run.entered[agent])
    return found


def _lets_pass(run: Run, agent: int, other: int, common: Shared | None) -> NDArray[np.bool_]:
    """Whether the agent has reason to let the other one pass."""
    zone, theirs = run.zone[:, agent], run.zone[:, other]
    before = _at_line(run, agent)
    found = np.zeros(run.steps, dtype=np.bool_)
    if run.junction.control is JunctionControl.STOP:
        found |= before & (theirs == Zone.JUNCTION)
        found |= comes_first(run, agent, other)
    if common is None:
        return found
    front = position(run, agent)[0]
    ahead = front < common.mine.start
    there = on_stretch(run, other, common.yours)
    found |= there & (ahead | on_stretch(run, agent, common.mine))
    gives = yields(run, other, agent) if may_owe(run, other, agent) else np.zeros_like(found)
    found |= ahead & (theirs == Zone.JUNCTION) & (position(run, other)[0] < common.yours.start) & ~gives
    coming = due(run, other, common.yours) & (run.need("speed")[:, other] > PACE)
    found |= before & coming
    if may_owe(run, agent, other):
        found |= ahead & yields(run, agent, other) & due(run, other, common.yours)
    found &= before | (zone == Zone.JUNCTION)
    return found


def comes_first(run: Run, agent: int, other: int) -> NDArray[np.bool_]:
    """Both are at entrances and take turns, and the other one goes first: clearly earlier there, or at once from the right."""
    if not in_turn(run.junction, run.agents[agent].route.key, run.agents[other].route.key):
        return np.zeros(run.steps, dtype=np.bool_)
    both = (run.zone[:, agent] == Zone.ENTRANCE) & (run.zone[:, other] == Zone.ENTRANCE)
    later = run.wt[:, other] - run.wt[:, agent]
    tie = ticks(run, TIE)
    right = (run.agents[other].entrance, run.agents[agent].entrance) in run.junction.right_of
    found: NDArray[np.bool_] = both & ((later > tie) | (right & (later >= -tie)))
    return found
