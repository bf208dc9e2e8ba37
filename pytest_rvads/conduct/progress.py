"""Getting on: which vehicle could go and does not, and which vehicle stands in the junction for no good reason.

A vehicle may wait for a body ahead in its lane, for a vehicle on the stretch that their movements share, for a vehicle with the
better right that is due or first at its line, and in a queue before a light that is not green. Vehicles that wait for each other
have no such excuse, but for an intruder, see `waiting.circles`. A vehicle that could go loses time as far as it is slower than
walking pace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.motion import advance, facing, inside
from pytest_rvads.conduct.rights import PACE
from pytest_rvads.conduct.stretches import before_exit, first_stretch, position
from pytest_rvads.conduct.waiting import QUEUE_GAP, circles, reasons, since
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

__all__ = [
    "BLOCKING_TIME",
    "CRAWL",
    "NOTHING",
    "PASSED",
    "PATIENCE",
    "STUCK_TIME",
    "Lost",
    "blocks",
    "idles",
    "losses",
    "may_go",
    "part",
]

PATIENCE = 10.0
"""Whoever could go for this long and has not, impedes traffic [s]; laws give no number (StVO, section 3(2); CVC 22400(a))."""
BLOCKING_TIME = 3.0
"""A vehicle that loses more time than this in the junction blocks it [s]."""
STUCK_TIME = 1.0
"""A vehicle that entered without room and then stands in the junction for longer than this blocks it [s]."""
CRAWL = 0.5
"""A vehicle that is faster than this crosses the junction, however slowly, and does not block it [m/s]."""
PASSED = 1.0
"""A vehicle has passed a part of its way for good when its rear has left it by this [m]: fronts flicker over a line."""


def may_go(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent could get on: its light or its turn allows it, and it waits for nobody that does not wait for it as well."""
    return _waiting(run).free[:, agent]


def idles(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has lost more time than `PATIENCE` while it could go: before the junction, in it, or on its way out.

    Or it has lost as much in a circle of vehicles that wait for each other, since that circle began.
    """
    lost = once(run, losses, agent)
    found: NDArray[np.bool_] = np.maximum(lost.idle, lost.circle) > PATIENCE
    return found


class Lost(NamedTuple):
    """What a vehicle has lost by some state, as numbers, or by every state, as arrays [s].

    In the present part of its way it has lost `idle` although it could go, and `circle` in a circle of vehicles that wait for
    each other; in the junction `blocked` while no vehicle kept it. For `stuck` it has been standing there behind a vehicle that
    left it no room when it entered. `part` is no time: it counts the parts that the vehicle has passed.
    """

    part: Any = 0
    idle: Any = 0.0
    circle: Any = 0.0
    blocked: Any = 0.0
    stuck: Any = 0.0


NOTHING = Lost()


def losses(run: Run, agent: int, before: Lost = NOTHING) -> Lost:
    """Return what an agent has lost by each state, where it had lost `before` when the run began."""
    found = _waiting(run)
    lost, circling = found.lost[:, agent], found.circling[:, agent]
    stays = _stays(run, agent)
    blocked = np.where(stays & ~found.held[:, agent], _slowness(run, np.abs(run.need("speed")[:, agent])), 0.0)
    stuck = stays & found.stuck[:, agent]
    parts = np.maximum(part(run, agent), before.part)
    goes_on = np.diff(parts, prepend=before.part) > 0
    return Lost(
        parts,
        since(np.where(circling, 0.0, lost), goes_on, before.idle),
        since(np.where(circling, lost, 0.0), goes_on | ~circling, before.circle),
        since(blocked, np.zeros_like(stuck), before.blocked),
        since(stuck * run.dt, ~stuck, before.stuck),
    )


def part(run: Run, agent: int) -> NDArray[np.int8]:
    """Return how many parts of its way the agent has passed for good: the one before the junction, and the one in it.

    Each part has a patience of its own. A part is passed when the rear has left it by `PASSED`, wherever the agent goes then.
    """
    (_, rear), (_, behind) = position(run, agent), before_exit(run, agent)
    found: NDArray[np.int8] = np.maximum.accumulate((rear > PASSED).astype(np.int8) + (behind > PASSED).astype(np.int8))
    return found


def blocks(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has lost more time than `BLOCKING_TIME` in the junction, or is stuck there for more than `STUCK_TIME`."""
    lost = once(run, losses, agent)
    found: NDArray[np.bool_] = (lost.blocked > BLOCKING_TIME) | (lost.stuck > STUCK_TIME)
    return found


def _stays(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether the agent is in the junction at `CRAWL` or less, unless it overran its line on yellow or red and now waits."""
    overran = _at_light(run, agent) & (facing(run)[:, agent] != Colour.GREEN)
    found: NDArray[np.bool_] = inside(run, agent) & (np.abs(run.need("speed")[:, agent]) <= CRAWL) & ~overran
    return found


def _at_light(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether the agent's light is not green, and its front is near the line or beyond it, before the first shared stretch."""
    me, station = run.agents[agent], run.need("station")[:, agent]
    light = run.lights[:, me.entrance]
    begin, end = -run.junction.setbacks[me.entrance] - QUEUE_GAP, first_stretch(run.junction, me.route.key)
    found: NDArray[np.bool_] = ((light == Colour.RED) | (light == Colour.YELLOW)) & (station > begin) & (station < end)
    return found


def _slowness(run: Run, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of every step that is lost against walking pace [s]."""
    # Rounded, so that three hundred steps at rest are three seconds.
    return np.round((1.0 - np.clip(speed / PACE, 0.0, 1.0)) * run.dt, 12)


@dataclass(frozen=True, slots=True)
class _Waiting:
    """Which vehicles wait in a run; all arrays have the shape ``(steps, agents)``."""

    free: NDArray[np.bool_]
    """Which vehicle could get on."""
    lost: NDArray[np.float64]
    """How much time it then loses in each state [s]."""
    held: NDArray[np.bool_]
    """See `circles`, as of the others."""
    circling: NDArray[np.bool_]
    stuck: NDArray[np.bool_]


def _waiting(run: Run) -> _Waiting:
    """Return who waits in a run, worked out once."""
    return once(run, _work_out)


def _work_out(run: Run) -> _Waiting:
    found = list(reasons(run))
    held, circling, stuck = circles(run, found)
    free, slow = ~held, _slowness(run, advance(run))
    for agent in range(len(run.agents)):
        free[:, agent] &= _allowed(run, agent)
    queues, changed = [r for r in found if r.trailing.any()], True
    while changed:  # behind a vehicle that loses no time nobody does, and so on
        changed = False
        for r in queues:
            when = slice(r.begin, r.begin + len(r.trailing))
            excused = r.trailing & free[when, r.agent] & ~(free[when, r.other] & (slow[when, r.other] > 0.0))
            free[when, r.agent] &= ~excused
            changed |= bool(excused.any())
    return _Waiting(free, np.where(free, slow, 0.0), held, circling, stuck)


def _allowed(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether nothing but other vehicles can keep the agent from getting on; once far down its exit road, it has arrived."""
    arrived = before_exit(run, agent)[0] >= LEAVE
    found: NDArray[np.bool_] = run.here[:, agent] & ~arrived & ~_at_light(run, agent)
    return found
