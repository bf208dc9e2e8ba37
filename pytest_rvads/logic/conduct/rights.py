"""Which vehicle has the right of way: which vehicle is due, is first at its line, may go, is free to go, and waives its right.

A vehicle gives way to a vehicle with the better right that *is due*: that comes "so closely as to be a hazard" (California
Vehicle Code 21801(a), 21453(b)), or stands first at its line with the right to go.

Conduct is judged by hazard, in seconds and metres, and not by zones: rights hold from the entrance zone until the vehicle that
must give way is clear of the shared stretch. Rules and shipped drivers read the same definitions: the words of rules, such as
``owes``, ``meet`` and ``may_go``, take their numbers from this package.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.logic.conduct.blocks import ABSENT, EXIT, Block, signal, sized
from pytest_rvads.logic.conduct.cast import Cast, Pairs, everybody, pairs
from pytest_rvads.logic.conduct.grounds import ground_of, in_turn, lit, may_owe
from pytest_rvads.logic.conduct.motion import entered, facing, lasting
from pytest_rvads.logic.conduct.standing import TIE, arrivals, arrived, leads, stands, waited
from pytest_rvads.logic.conduct.stretches import Places, ahead_by, contested, contested_places, neighbours, passed, places, roads
from pytest_rvads.runs.states import Colour

__all__ = [
    "DUE",
    "GAP",
    "PACE",
    "ROOM",
    "WAIVER",
    "came_first",
    "close_behind",
    "comes",
    "comes_first",
    "coming",
    "first_at_line",
    "gives_up",
    "has_way",
    "held",
    "in_turns",
    "kept_by",
    "next_to_go",
    "owed_places",
    "owing",
    "starting",
    "waives",
    "yields",
]

GREEN, YELLOW, RED = int(Colour.GREEN), int(Colour.YELLOW), int(Colour.RED)
_ALL_WAY = JunctionControl.STOP
_LONG_AGO = -(10**9)
"""Stands for the tick in which a vehicle last stood ready, for a vehicle that never stood ready."""
DUE = 4.0
"""A vehicle that reaches the shared stretch within this time at its present speed is due [s]: the usual critical gap of a left
turn across oncoming traffic (Highway Capacity Manual: 4.1 s)."""
WAIVER = 3.0
"""A vehicle that stands first at its line, free to go, for this long waives its right [s]: perception and reaction take up to
2.5 s (AASHTO, A Policy on Geometric Design)."""
PACE = 1.4
"""Walking pace [m/s]: a slower vehicle creeps, and loses time if it could go."""
GAP = 6.0
"""Distance to a body ahead below which a vehicle need not go [m]."""
ROOM = 2.5
"""Room that a vehicle needs on its exit road behind a standing body, in addition to its length [m]."""


def lights(cast: Cast) -> NDArray[np.bool_]:
    """Return which vehicles come to a light, shape ``(agents,)``."""
    return np.array([lit(cast.junction, agent.entrance) for agent in cast.agents], dtype=np.bool_)


@signal(steady=True)
def has_way(block: Block) -> NDArray[np.bool_]:
    """Which vehicle has no light against it: the light is green or yellow, was so at its entry, or there is no light."""
    colour = facing(block)
    allowed: NDArray[np.bool_] = ~block.cast.static(lights) | (colour == GREEN) | (colour == YELLOW)
    return allowed


def owing(cast: Cast) -> Pairs:
    """Return the pairs of vehicles of which the first may owe the way to the second.

    Raises:
        RunError: the places of the lanes are unknown, and the answer depends on them.
    """
    return pairs(cast, lambda agent, other: may_owe(cast, agent, other))


def owed_places(cast: Cast) -> Places:
    """Return the contested stretches of pairs of which the first may owe the way to the second."""
    return places(contested(cast, agent, other) for agent, other in cast.static(owing).column)


def _always(cast: Cast) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return, per pair of `owing`, whether the first vehicle owes the way at any colour, and whether it turns near."""
    rows, junction = [], cast.junction
    for agent, other in cast.static(owing).column:
        me, you = cast.agents[agent], cast.agents[other]
        near, free = me.turn is junction.near, not lit(junction, you.entrance)
        ground = near and free and ground_of(junction, me.way.key, you.way.key) is not None
        rows.append((not lit(junction, me.entrance) or ground, near))
    always, near_side = np.array(rows, dtype=np.bool_).reshape(-1, 2).T
    return always, near_side


@signal(pairs=owing, steady=True)
def yields(block: Block) -> NDArray[np.bool_]:
    """Which first vehicle has to give way to the second where their ways meet, at the present colours of the lights.

    A vehicle that turns across oncoming traffic gives way to vehicles whose light lets them go (Vienna Convention on Road
    Traffic, Art. 16(2)). A vehicle that turns to the near side on red gives way to all vehicles whose light lets them go (CVC
    21453(b)). A vehicle without a light gives way as signs and sides say, and to a vehicle at a light only while the light lets
    that vehicle go.
    """
    both, (always, near) = block.cast.static(owing), block.cast.static(_always)
    bound = always | ((both.first(facing(block)) == RED) == near)
    gives_way: NDArray[np.bool_] = bound & both.second(has_way(block))
    return gives_way


@signal(steady=True)
def ready(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is due by standing at its line: the first vehicle at the line, if it may go and does not waive its right."""
    due: NDArray[np.bool_] = next_to_go(block) & ~waives(block)
    return due


def coming(block: Block, both: Pairs, at: Places) -> NDArray[np.bool_]:
    """Return which second vehicle is on the stretch of its way, or reaches it within `DUE` at its present speed.

    Args:
        block: the states.
        both: pairs of vehicles.
        at: the stretches that the pairs share.
    """
    front, reach = block.need("station"), DUE * np.maximum(block.need("speed"), 0.0)
    rear = front - block.cast.length
    near: NDArray[np.bool_] = at.begin_of_two - both.second(front) <= both.second(reach)
    near &= (both.second(rear) <= at.end_of_two) & both.second(block.here)
    return near


@signal(pairs=owing)
def comes(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle is on the contested stretch, or reaches it within `DUE` at its present speed."""
    near: NDArray[np.bool_] = coming(block, block.cast.static(owing), block.cast.static(owed_places))
    return near


@signal(steady=True)
def first_at_line(block: Block) -> NDArray[np.bool_]:
    """Which vehicle has arrived at its line and has no vehicle ahead of it in its lane before the junction."""
    at_line: NDArray[np.bool_] = arrived(block)
    return at_line & leads(block) if at_line.any() else at_line


@signal(steady=True)
def held(block: Block) -> NDArray[np.bool_]:
    """Which vehicle owes the way to a vehicle that comes or is first at its line.

    A held vehicle that is first at its line holds other vehicles too, so no vehicle of a circle is due by standing at its line.
    At an all-way stop the order of arrival holds vehicles.
    """
    cast, at_line = block.cast, first_at_line(block)
    if block.junction.control is _ALL_WAY:
        return cast.static(in_turns).any(comes_first(block), len(cast))
    owing_pairs, at = cast.static(owing), cast.static(owed_places)
    due = comes(block) | (owing_pairs.second(at_line) & ~np.isnan(at.begin))
    return owing_pairs.any(due & yields(block) & (owing_pairs.first(block.zone) != ABSENT), len(cast))


def in_turns(cast: Cast) -> Pairs:
    """Return the pairs of vehicles that go by the order of arrival, see `grounds.in_turn`."""
    return pairs(cast, lambda agent, other: in_turn(cast.junction, cast.agents[agent].way.key, cast.agents[other].way.key))


@signal(pairs=in_turns, steady=True)
def comes_first(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle goes before the first vehicle: their movements meet, and the second came first, see `came_first`."""
    both, cast = block.cast.static(everybody), block.cast
    columns = [both.column[pair] for pair in cast.static(in_turns).column]
    earlier: NDArray[np.bool_] = came_first(block)[:, columns]
    return earlier


def _on_the_right(cast: Cast) -> NDArray[np.bool_]:
    right = [
        (cast.agents[b].entrance, cast.agents[a].entrance) in cast.junction.right_of for a, b in cast.static(everybody).column
    ]
    return np.array(right, dtype=np.bool_)


@signal(pairs=everybody, steady=True)
def came_first(block: Block) -> NDArray[np.bool_]:
    """Whether both vehicles have arrived, the second clearly earlier, or within `TIE` and on the right of the first."""
    both, at_line, blind = block.cast.static(everybody), arrived(block), block.station is None or block.speed is None
    since = waited(block) if blind else -arrivals(block).tick
    later, tie = both.second(since) - both.first(since), round(TIE / block.dt)
    earlier: NDArray[np.bool_] = (later > tie) | (block.cast.static(_on_the_right) & (later >= -tie))
    earlier &= both.first(at_line) & both.second(at_line)
    return earlier


@signal(steady=True)
def next_to_go(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is first at its line and has the right to go."""
    green = ~block.cast.static(lights) | (facing(block) == GREEN)
    next_vehicles: NDArray[np.bool_] = first_at_line(block) & ~held(block) & green
    return next_vehicles


@signal(start=(0, _LONG_AGO))
def starting(block: Block, before: NDArray[np.int64], last: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Which vehicle is about to go.

    The vehicle is first at its line and may go. It has stood there for less than `WAIVER`, or set off less than `WAIVER` ago.
    """
    standing, most = stands(block), round(WAIVER / block.dt)
    stood = next_to_go(block) & standing
    count = lasting(stood, before)
    since = np.maximum.accumulate(np.where(stood, block.ticks, last), axis=0)
    return next_to_go(block) & np.where(standing, count <= most, block.ticks - since < most), count, since


@signal(steady=True)
def _free(block: Block) -> NDArray[np.bool_]:
    """Which vehicle stands first at its line, free to go."""
    free: NDArray[np.bool_] = next_to_go(block) & stands(block)
    if free.any():
        free &= ~block.cast.static(neighbours).any(_keeps(block), len(block.cast))
    return free


@signal(start=(0,))
def waives(block: Block, before: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Which vehicle has stood first at its line, free to go, for `WAIVER` without a break."""
    count = lasting(_free(block), before)
    return count > round(WAIVER / block.dt), count


@signal(steady=True)
def gives_up(block: Block) -> NDArray[np.bool_]:
    """Which vehicle waives its right, or has not arrived; without positions, only which vehicle has not arrived."""
    without_turn: NDArray[np.bool_] = ~arrived(block)
    if block.station is not None and block.speed is not None and block.junction.stretches is not None:
        without_turn |= waives(block)
    return without_turn


def _debts(cast: Cast) -> NDArray[np.int64]:
    """Return, per pair of `neighbours`, the column of the reversed pair in `owing`; -1 if `owing` has no such pair."""
    debts = cast.static(owing).column
    return np.array([debts.get((other, agent), -1) for agent, other in cast.static(neighbours).column], dtype=np.int64)


@signal(pairs=neighbours, steady=True)
def _keeps(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle keeps the first vehicle, at its line, from going: it is slow ahead, or is on the way of the first.

    A vehicle that arrived later, or owes the agent the way, does not keep the agent from going.
    """
    passed(block)  # stations change the value only where a border is passed
    cast, both, at = block.cast, block.cast.static(neighbours), block.cast.static(contested_places)
    ahead = both.second(block.need("station"))
    blocking: NDArray[np.bool_] = (
        (ahead >= at.begin_of_two) & (ahead - both.second(cast.length) <= at.end_of_two) & both.second(block.here)
    )
    if block.junction.control is _ALL_WAY:
        tick = arrivals(block).tick
        blocking &= both.second(tick) <= both.first(tick)
    else:
        debts = cast.static(_debts)
        blocking[:, debts >= 0] &= ~yields(block)[:, debts[debts >= 0]]
    blocking |= close_behind(block)
    return blocking


@signal(pairs=neighbours, needs=sized)
def close_behind(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle is slow and near ahead on the way of the first, or leaves the first no room on its exit road."""
    cast, both, rear = block.cast, block.cast.static(neighbours), ahead_by(block)
    near: NDArray[np.bool_] = rear < GAP
    at_line = _at_line_before_exit(block)
    if at_line.any():
        room = (both.first(block.need("station")) - both.first(cast.way)) + rear
        near |= at_line & (room < both.first(cast.length) + ROOM)
    near &= both.second(block.need("speed") < PACE)
    return near


@signal(pairs=neighbours, steady=True)
def _at_line_before_exit(block: Block) -> NDArray[np.bool_]:
    """Which first vehicle has arrived at its line while the second is on the exit road that the first leaves by."""
    both = block.cast.static(neighbours)
    at_line: NDArray[np.bool_] = both.first(arrived(block)) & both.second(block.zone == EXIT) & block.cast.static(roads).exit
    return at_line


@signal(pairs=neighbours, start=(False,), steady=True)
def kept_by(block: Block, before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Which second vehicle stands or creeps close ahead of the first and did not when the first entered."""
    both, entry = block.cast.static(neighbours), entered(block)
    enters = both.first(entry == block.ticks)
    slow = before | np.logical_or.accumulate(enters & (both.second(block.need("speed")) <= PACE), axis=0)
    return close_behind(block) & both.first(entry <= block.ticks) & ~slow, slow
