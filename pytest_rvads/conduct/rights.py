"""Which vehicle has the right of way: which vehicle is due, is first at its line, may go, is free to go, and waives its right.

A vehicle gives way to a vehicle with the better right that *is due*: that comes "so closely as to be a hazard" (California
Vehicle Code 21801(a), 21453(b)), or stands first at its line with the right to go. All functions look at whole runs; the
numbers are named here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.grounds import ground_of, in_turn, lit, may_owe
from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.motion import facing
from pytest_rvads.conduct.predicates import ticks
from pytest_rvads.conduct.presence import window
from pytest_rvads.conduct.standing import TIE, arrivals, leads, stands, waited
from pytest_rvads.conduct.stretches import ALWAYS, ahead_by, before_exit, contested, on_stretch, position
from pytest_rvads.junctions.conflicts import Shared, Stretch
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = [
    "DUE",
    "GAP",
    "PACE",
    "ROOM",
    "WAIVER",
    "came_first",
    "close_behind",
    "comes_first",
    "due",
    "find_waiving",
    "first_at_line",
    "has_way",
    "held",
    "kept_by",
    "starting",
    "waives",
    "yields",
]

DUE = 4.0
"""A vehicle that reaches the shared stretch within this time at its present speed is due [s]: the usual critical gap of a left
turn across oncoming traffic (Highway Capacity Manual: 4.1 s)."""
WAIVER = 3.0
"""A vehicle that stands first at its line, free to go, for this long waives its right [s]: perception and reaction take up to
2.5 s (AASHTO, A Policy on Geometric Design)."""
PACE = 1.4
"""Walking pace [m/s]: a slower vehicle creeps, and loses time if it could go."""
GAP = 6.0
"""Behind a body that is this near ahead a vehicle need not go [m]."""
ROOM = 2.5
"""Room that a vehicle wants on its exit road behind a body that stands there, beside its own length [m]."""


def has_way(run: Run, agent: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """No light keeps the agent from going: it is green or yellow, was when the agent entered, or there is none."""
    colour = facing(run)[when, agent]
    found: NDArray[np.bool_] = (colour == Colour.GREEN) | (colour == Colour.YELLOW)
    return found if lit(run.junction, run.agents[agent].entrance) else np.ones_like(found)


def yields(run: Run, agent: int, other: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """The agent has to give way to the other one where their ways meet, as the lights are.

    Turning across oncoming traffic it does to who also has the right to go (Vienna Convention on Road Traffic, Art. 16(2));
    turning to the near side on red to everybody who has it (CVC 21453(b)). Without lights it does on the ground that there is;
    to who comes to a light, as long as that lets it go.
    """
    me, you, junction = run.agents[agent], run.agents[other], run.junction
    colour = facing(run)[when, agent]
    if not lit(junction, me.entrance):
        mine = np.ones(len(colour), dtype=np.bool_)
    elif me.turn is junction.near:
        mine = colour == Colour.RED
        if not lit(junction, you.entrance) and ground_of(junction, me.route.key, you.route.key) is not None:
            mine = np.ones_like(mine)
    else:
        mine = colour != Colour.RED
    found: NDArray[np.bool_] = mine & has_way(run, other, when)
    return found


def due(run: Run, agent: int, stretch: Stretch, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """The agent is on a stretch of its way, reaches it within `DUE` at its present speed, or is first at its line and may go.

    A vehicle that waives its right is not due by standing at its line.
    """
    next_to_go = (_may_go_first(run) & ~waives(run))[when, agent]
    found: NDArray[np.bool_] = (_coming(run, agent, stretch, when) | next_to_go) & run.here[when, agent]
    return found


def _coming(run: Run, agent: int, stretch: Stretch, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """Whether the agent is on a stretch of its way, or reaches it within `DUE` at its present speed."""
    front, rear = position(run, agent, when)
    speed = run.need("speed")[when, agent]
    found: NDArray[np.bool_] = (stretch.start - front <= DUE * np.maximum(speed, 0.0)) & (rear <= stretch.end)
    return found


def first_at_line(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle has arrived and leads, shape ``(steps, agents)``."""
    return once(run, _find_first)


def _find_first(run: Run) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = arrivals(run).arrived
    return found & leads(run) if found.any() else found


def held(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle owes the way to a vehicle that comes or is first at its line, shape ``(steps, agents)``.

    A vehicle first at its line counts even where it is held itself, so that of vehicles that hold each other in a circle none
    is due by standing there. At an all-way stop the order of arrival holds vehicles.
    """
    return once(run, _find_held)


def _find_held(run: Run) -> NDArray[np.bool_]:
    first = first_at_line(run)
    found = np.zeros_like(first)
    by_arrival = run.junction.control is JunctionControl.STOP
    for agent in range(len(run.agents)):
        for other in range(len(run.agents)):
            if by_arrival:
                if other != agent:
                    found[:, agent] |= comes_first(run, agent, other)
                continue
            common = contested(run, agent, other) if may_owe(run, agent, other) else None
            begin, end = window(run, (agent, other))
            if common is not None and begin < end:
                when = slice(begin, end)
                there = _coming(run, other, common.yours, when) & run.here[when, other]
                found[when, agent] |= (there | first[when, other]) & yields(run, agent, other, when)
    return found


def comes_first(run: Run, agent: int, other: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """Return when `other` goes before `agent`: their movements meet, and `other` came first, see `came_first`."""
    if not in_turn(run.junction, run.agents[agent].route.key, run.agents[other].route.key):
        return np.zeros_like(run.here[when, agent])
    return came_first(run, agent, other, when)


def came_first(run: Run, agent: int, other: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """Return when both vehicles have arrived, `other` clearly earlier, or within `TIE` of `agent` and on its right."""
    found: NDArray[np.bool_] = arrivals(run).arrived[when, agent] & arrivals(run).arrived[when, other]
    if found.any():
        later, tie = waited(run, other)[when] - waited(run, agent)[when], ticks(run, TIE)
        right = (run.agents[other].entrance, run.agents[agent].entrance) in run.junction.right_of
        found &= (later > tie) | (right & (later >= -tie))
    return found


def _may_go_first(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle is first at its line and has the right to go, shape ``(steps, agents)``."""
    return once(run, _find_next)


def _find_next(run: Run) -> NDArray[np.bool_]:
    found = first_at_line(run) & ~held(run)
    for agent, who in enumerate(run.agents):
        if lit(run.junction, who.entrance):
            found[:, agent] &= facing(run)[:, agent] == Colour.GREEN
    return found


def starting(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle is about to go, shape ``(steps, agents)``.

    The vehicle is first at its line and may go; it has stood so for less than `WAIVER`, or set off less than `WAIVER` ago.
    """
    return once(run, _find_starting)


def _find_starting(run: Run) -> NDArray[np.bool_]:
    may_go, standing = _may_go_first(run), stands(run)
    tick, most = np.arange(run.steps)[:, None], ticks(run, WAIVER)
    stood = may_go & standing
    last = np.maximum.accumulate(np.where(stood, tick, -1 - most), axis=0)
    found: NDArray[np.bool_] = may_go & np.where(standing, _lasting(stood) <= most, tick - last < most)
    return found


def waives(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle has stood first at its line, free to go, for `WAIVER` without a break, shape ``(steps, agents)``."""
    return once(run, find_waiving)


def find_waiving(run: Run) -> NDArray[np.bool_]:
    """Work out what `waives` returns."""
    free = _may_go_first(run) & stands(run)
    most = ticks(run, WAIVER)
    for agent in np.flatnonzero((_lasting(free) > most).any(axis=0)).tolist():
        for other in range(len(run.agents)):
            begin, end = window(run, (agent, other))
            if other != agent and begin < end:
                when = slice(begin, end)
                free[when, agent] &= ~_keeps(run, agent, other, when)
    return _lasting(free) > most


def _lasting(found: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return for how many states, up to each, something has been true without a break, shape ``(steps, agents)``."""
    tick = np.arange(len(found))[:, None]
    return tick - np.maximum.accumulate(np.where(found, -1, tick), axis=0)


def _keeps(run: Run, agent: int, other: int, when: slice) -> NDArray[np.bool_]:
    """Whether the other one keeps the agent, first at its line, from going: it is slow ahead, or occupies the agent's way.

    A vehicle that arrived later, or owes the agent the way, does not keep the agent from going.
    """
    common = contested(run, agent, other)
    found = close_behind(run, agent, other, common, when)
    if common is None:
        return found
    there = on_stretch(run, other, common.yours, when)
    if run.junction.control is JunctionControl.STOP:
        tick = arrivals(run).tick
        there &= tick[when, other] <= tick[when, agent]
    elif may_owe(run, other, agent):
        there &= ~yields(run, other, agent, when)
    return found | there


def close_behind(run: Run, agent: int, other: int, common: Shared | None, when: slice) -> NDArray[np.bool_]:
    """Whether the other one is slow and near ahead on the agent's way, or leaves it no room on its exit road."""
    rear = ahead_by(run, agent, other, common, when)
    near = rear < GAP
    if run.agents[agent].exit == run.agents[other].exit:
        room = before_exit(run, agent, when)[0] + rear
        at_line = arrivals(run).arrived[when, agent] & (run.zone[when, other] == Zone.EXIT)
        near |= at_line & (room < run.size(agent)[0] + ROOM)
    found: NDArray[np.bool_] = near & (run.need("speed")[when, other] < PACE)
    return found


def kept_by(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return which vehicle stands or creeps close ahead of the agent and did not when the agent entered, ``(steps, agents)``."""
    found = np.zeros((run.steps, len(run.agents)), dtype=np.bool_)
    entered = int(run.entered[agent])
    for other in range(len(run.agents)):
        begin, end = window(run, (agent, other))
        if other == agent or entered >= end or (entered >= begin and run.need("speed")[entered, other] <= PACE):
            continue
        when = slice(max(begin, entered), end)
        found[when, other] = close_behind(run, agent, other, contested(run, agent, other), when)
    return found
