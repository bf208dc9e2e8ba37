"""Decides which vehicle has the right of way, is due, is first at its line, may go, is free to go, or waives its right.

A vehicle has to give way to a vehicle with the better right if the vehicle with the better right *is due*. A vehicle is due if it
comes "so closely as to be a hazard" (California Vehicle Code 21801(a), 21453(b)), or stands first at its line with the right to
go.

Conduct is judged by hazard, in seconds and metres, and not by zones: rights hold from the entrance zone until the vehicle that
must give way is clear of the shared stretch. Rules and shipped drivers read the same definitions: the predicates of rules, such
as ``owes``, ``meet`` and ``may_go``, take their numbers from this package.

A pair of vehicles has at most one `Ground` on which one gives way to the other, which stays the same in the run. Lights decide
between two vehicles that come to lights. At an all-way stop the order of arrival decides. In all other cases the map, the signs
and the sides from which both vehicles come decide (`Junction.yields`).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.crosswalks import Crossing, Parking
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import ABSENT, EXIT, Block, Cast, Pairs, everybody, pairs, signal, sized
from pytest_rvads.logic.conduct.standing import (
    STOP_PLACE,
    TIE,
    arrivals,
    arrived,
    entered,
    facing,
    lasting,
    leads,
    stands,
    waited,
)
from pytest_rvads.logic.conduct.stretches import (
    Places,
    ahead_by,
    contested,
    contested_places,
    neighbours,
    places,
    places_of,
    roads,
    takes_crosswalk,
    walk,
    walkers,
)
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import RunError

_MINOR = (Sign.STOP, Sign.YIELD)
"""Signs that oblige to give way. A vehicle without such a sign that gives way because of signs does so by `Ground.PRIORITY`."""
GREEN, YELLOW, RED = int(Colour.GREEN), int(Colour.YELLOW), int(Colour.RED)
_ALL_WAY = JunctionControl.STOP
_LONG_AGO = -(10**9)
"""Tick that stands for "never" in the tick at which a vehicle last stood at its line with the right to go."""
DUE = 4.0
"""Time to the shared stretch, at the present speed, below which a vehicle is due [s]: the usual critical gap of a left turn
across oncoming traffic (Highway Capacity Manual: 4.1 s)."""
WAIVER = 3.0
"""Time after which a vehicle that stands first at its line, free to go, waives its right [s]: perception and reaction take up to
2.5 s (AASHTO, A Policy on Geometric Design)."""
PACE = 1.4
"""Walking pace [m/s]: a slower vehicle loses time if it could go."""
GAP = 6.0
"""Distance to a slow body ahead below which a vehicle need not go [m]."""
ROOM = 2.5
"""Room that a vehicle needs on its exit road behind a slow body, in addition to its length, to leave its line [m]."""


class Ground(StrEnum):
    """The grounds (reasons) on which a vehicle has to give way to another vehicle."""

    SIGN = "sign"
    """The vehicle comes past a stop or yield sign, and the other vehicle does not."""
    PRIORITY = "priority"
    """The other vehicle has a priority sign and this vehicle has no sign, or the map says which movement has priority."""
    SIDE = "side"
    """The other vehicle comes from the near side: the right, where traffic keeps right."""
    TURN = "turn"
    """The vehicle turns across the way of oncoming traffic."""
    MERGE = "merge"
    """According to the map, the lane of the vehicle joins the lane of the other vehicle."""


def lit(junction: Junction, entrance: int) -> bool:
    """Return whether an entrance, given by number, has a light; further numbers are starts of ways that begin at no entrance."""
    return junction.starts[entrance].sign is Sign.LIGHTS


def ground_of(junction: Junction, way: Key, other: Key) -> Ground | None:
    """Return the ground on which an agent on way `way` has to give way to an agent on way `other`; None without a ground."""
    if junction.control is JunctionControl.STOP:
        return None
    if junction.yields is None:
        raise RunError("the run holds no geometry of its junction")
    reason = junction.yields.get((way, other))
    if lit(junction, way[0]) and lit(junction, other[0]):
        return Ground.TURN if reason is Reason.TURN else None
    match reason:
        case Reason.SIGN:
            return Ground.SIGN if junction.entrances[way[0]].sign in _MINOR else Ground.PRIORITY
        case Reason.STATED:
            return Ground.PRIORITY
        case Reason.RIGHT:
            return Ground.SIDE
        case Reason.TURN:
            return Ground.TURN
        case Reason.MERGE:
            return Ground.MERGE
    return None


def in_turn(junction: Junction, way: Key, other: Key) -> bool:
    """Return whether, at an all-way stop, the order of arrival decides which of two vehicles on given movements goes first.

    The order of arrival decides between movements from different arms that share a stretch (California Vehicle Code 21800(a)
    protects a vehicle that has entered). If the places of the lanes are unknown, the order of arrival decides between all
    movements from different arms.
    """
    if not junction.movements.keys() >= {way, other} or junction.entrances[way[0]].arm == junction.entrances[other[0]].arm:
        return False
    return junction.conflicts is None or (way, other) in junction.conflicts


def may_owe(run: Run | Cast, agent: int, other: int) -> bool:
    """Return whether it is possible that the agent has to give way to the other agent: on a `Ground`, or in a turn on red.

    Pedestrians are owed crosswalks, see `walkers`, and parked vehicles are owed nothing.
    """
    me, you, junction = run.agents[agent], run.agents[other], run.junction
    if agent == other or junction.control is JunctionControl.STOP or isinstance(you.way, Crossing | Parking):
        return False
    if not lit(junction, me.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    if me.turn is junction.near:
        return True
    if not lit(junction, you.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    return me.turn is junction.far and you.turn is not junction.far and (me.entrance, you.entrance) in junction.opposite


def lights(cast: Cast) -> NDArray[np.bool_]:
    """Return whether each vehicle comes to a light, shape ``(agents,)``."""
    return np.array([lit(cast.junction, agent.entrance) for agent in cast.agents], dtype=np.bool_)


@signal
def has_way(block: Block) -> NDArray[np.bool_]:
    """Return whether the light of each vehicle is (or was at its entry) green or yellow, or the vehicle comes to no light."""
    colour = facing(block)
    return ~block.cast.static(lights) | (colour == GREEN) | (colour == YELLOW)


def owing(cast: Cast) -> Pairs:
    """Return the pairs of vehicles of which the first can owe the second the way (have to give way to the second)."""
    return pairs(cast, lambda agent, other: may_owe(cast, agent, other))


owed_places = places(owing, contested)
"""The stretches that the ways of the pairs `owing` share, see `contested`."""


def _always(cast: Cast) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return, per pair of `owing`, whether the first vehicle gives way at any colour of its light, and turns to the near side."""
    rows, junction = [], cast.junction
    for agent, other in cast.static(owing).column:
        me, you = cast.agents[agent], cast.agents[other]
        near, free = me.turn is junction.near, not lit(junction, you.entrance)
        ground = near and free and ground_of(junction, me.way.key, you.way.key) is not None
        rows.append((not lit(junction, me.entrance) or ground, near))
    always, near_side = np.array(rows, dtype=np.bool_).reshape(-1, 2).T
    return always, near_side


@signal(pairs=owing)
def yields(block: Block) -> NDArray[np.bool_]:
    """Return whether the first vehicle of each pair has to give way to the second, at the present colours of the lights.

    A vehicle that turns across oncoming traffic gives way to oncoming vehicles whose light lets them go (Vienna Convention on
    Road Traffic, Art. 16(2)). A vehicle that turns to the near side (right, where traffic keeps right) on red gives way to all
    vehicles whose light lets them go (CVC 21453(b)). A vehicle without a light gives way as signs and sides say, and to a vehicle
    at a light only while the light lets that vehicle go.
    """
    both, (always, near) = block.cast.static(owing), block.cast.static(_always)
    bound = always | ((both.first(facing(block)) == RED) == near)
    return bound & both.second(has_way(block))


def coming(block: Block, both: Pairs, at: Places) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle is on the shared stretch, or reaches the stretch within `DUE` at its speed."""
    front, reach = block.need("station"), DUE * np.maximum(block.need("speed"), 0.0)
    rear = front - block.cast.length
    near: NDArray[np.bool_] = at.begin_of_two - both.second(front) <= both.second(reach)
    near &= (both.second(rear) <= at.end_of_two) & both.second(block.here)
    return near


@signal(pairs=owing)
def comes(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle is on the shared stretch, or reaches it within `DUE` at its present speed."""
    return coming(block, block.cast.static(owing), block.cast.static(owed_places))


@signal
def first_at_line(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle has arrived at its line and has no vehicle ahead of it in its lane before the junction."""
    at_line: NDArray[np.bool_] = arrived(block)
    return at_line & leads(block) if at_line.any() else at_line


@signal(pairs=walkers)
def near_crosswalk(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's vehicle is up to `STOP_PLACE` or `DUE` before the crosswalk, or before the pedestrian on it."""
    both, at = block.cast.static(walkers), block.cast.static(places_of)
    front, reach = both.first(block.need("station")), DUE * both.first(block.need("speed"))
    near: NDArray[np.bool_] = at.begin - front <= np.maximum(reach, STOP_PLACE)
    near &= (front < at.far) & both.first(block.here)
    return near


@signal(pairs=walkers, needs=sized)
def owes_crossing(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's vehicle owes the crosswalk to the pedestrian, and comes there or takes it at present."""
    return (near_crosswalk(block) | takes_crosswalk(block)) & walk(block).owed


def _on_the_right(cast: Cast) -> NDArray[np.bool_]:
    right = [
        (cast.agents[b].entrance, cast.agents[a].entrance) in cast.junction.right_of for a, b in cast.static(everybody).column
    ]
    return np.array(right, dtype=np.bool_)


@signal(pairs=everybody)
def came_first(block: Block) -> NDArray[np.bool_]:
    """Return whether both vehicles of each pair have arrived, and the second vehicle came first.

    The second vehicle came first if it arrived earlier by more than `TIE`, or if both arrived within `TIE` and the second comes
    from the right of the first.
    """
    both, at_line, blind = block.cast.static(everybody), arrived(block), block.station is None or block.speed is None
    since = waited(block) if blind else -arrivals(block).tick
    later, tie = both.second(since) - both.first(since), round(TIE / block.dt)
    earlier: NDArray[np.bool_] = (later > tie) | (block.cast.static(_on_the_right) & (later >= -tie))
    earlier &= both.first(at_line) & both.second(at_line)
    return earlier


def in_turns(cast: Cast) -> Pairs:
    """Return the pairs of vehicles that go by the order of arrival, see `in_turn`."""
    return pairs(cast, lambda agent, other: in_turn(cast.junction, cast.agents[agent].way.key, cast.agents[other].way.key))


@signal(pairs=in_turns)
def comes_first(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle goes first, because their movements meet and it came first, see `came_first`."""
    return came_first(block)[:, block.cast.columns(in_turns, everybody)]


@signal
def held(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is held: it has to give way to a vehicle that comes or is first at its line.

    A vehicle that is first at its line holds other vehicles even if it is held itself. Therefore vehicles that are first at their
    lines can hold each other in a circle, in which no vehicle has the right to go. At an all-way stop, the vehicles that arrived
    first hold the other vehicles. Pedestrians hold the vehicles that owe them a crosswalk.
    """
    cast, at_line, on_foot = block.cast, first_at_line(block), block.cast.static(walkers)
    waits = on_foot.any(owes_crossing(block), len(cast)) if len(on_foot) else False
    if block.junction.control is _ALL_WAY:
        return cast.static(in_turns).any(comes_first(block), len(cast)) | waits
    owing_pairs, at = cast.static(owing), cast.static(owed_places)
    due = comes(block) | (owing_pairs.second(at_line) & ~np.isnan(at.begin))
    return owing_pairs.any(due & yields(block) & (owing_pairs.first(block.zone) != ABSENT), len(cast)) | waits


@signal
def next_to_go(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is first at its line and has the right to go."""
    green = ~block.cast.static(lights) | (facing(block) == GREEN)
    return first_at_line(block) & ~held(block) & green


@signal(start=(0, _LONG_AGO))
def starting(block: Block, before: NDArray[np.int64], last: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Return whether each vehicle is about to go: it is first at its line and may go, and has not waited for long.

    The vehicle has stood at the line, with the right to go, for at most `WAIVER`, or set off less than `WAIVER` ago.
    """
    standing, most = stands(block), round(WAIVER / block.dt)
    stood = next_to_go(block) & standing
    count = lasting(stood, before)
    since = np.maximum.accumulate(np.where(stood, block.ticks, last), axis=0)
    return next_to_go(block) & np.where(standing, count <= most, block.ticks - since < most), count, since


@signal(pairs=neighbours, needs=sized)
def close_behind(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle is slow, and close ahead of the first or in its room on the common exit road."""
    cast, both, rear = block.cast, block.cast.static(neighbours), ahead_by(block)
    near: NDArray[np.bool_] = rear < GAP
    at_line = both.first(arrived(block)) & both.second(block.zone == EXIT) & cast.static(roads).exit
    if at_line.any():
        room = (both.first(block.need("station")) - both.first(cast.way)) + rear
        near |= at_line & (room < both.first(cast.length) + ROOM)
    near &= both.second(block.need("speed") < PACE)
    return near


@signal(pairs=neighbours)
def _keeps(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle keeps the first vehicle at its line.

    The second vehicle is slow and close ahead of the first, or on the stretch that both ways share. A vehicle on the stretch that
    arrived later, or has to give way to the first vehicle, does not keep the first vehicle at its line.
    """
    cast, both, at = block.cast, block.cast.static(neighbours), block.cast.static(contested_places)
    ahead = both.second(block.need("station"))
    blocking: NDArray[np.bool_] = (
        (ahead >= at.begin_of_two) & (ahead - both.second(cast.length) <= at.end_of_two) & both.second(block.here)
    )
    if block.junction.control is _ALL_WAY:
        tick = arrivals(block).tick
        blocking &= both.second(tick) <= both.first(tick)
    else:
        debts = cast.columns(neighbours, owing, turned=True)
        blocking[:, debts >= 0] &= ~yields(block)[:, debts[debts >= 0]]
    blocking |= close_behind(block)
    return blocking


@signal(start=(0,))
def waives(block: Block, before: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """Return whether each vehicle waives its right: it has stood first at its line, free to go, for more than `WAIVER`."""
    free: NDArray[np.bool_] = next_to_go(block) & stands(block)
    if free.any():
        free &= ~block.cast.static(neighbours).any(_keeps(block), len(block.cast))
    count = lasting(free, before)
    return count > round(WAIVER / block.dt), count


@signal
def ready(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is due because it is first at its line, may go, and does not waive its right."""
    return next_to_go(block) & ~waives(block)


@signal
def gives_up(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle waives its right to go first, or has not arrived at its line.

    If the run does not record positions or speeds, no vehicle waives its right.
    """
    without_turn: NDArray[np.bool_] = ~arrived(block)
    if block.station is not None and block.speed is not None and block.junction.stretches is not None:
        without_turn |= waives(block)
    return without_turn


@signal(pairs=neighbours, start=(False,))
def kept_by(block: Block, before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Return whether each pair's second vehicle is slow and close ahead of the first, and was faster when the first entered."""
    both, entry = block.cast.static(neighbours), entered(block)
    enters = both.first(entry == block.ticks)
    slow = before | np.logical_or.accumulate(enters & (both.second(block.need("speed")) <= PACE), axis=0)
    return close_behind(block) & both.first(entry <= block.ticks) & ~slow, slow


@signal(pairs=walkers, start=(False,))
def kept_by_walker(block: Block, before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Return whether each pair's vehicle in the junction owes the crosswalk to a pedestrian who came there after its entry."""
    both, entry = block.cast.static(walkers), entered(block)
    walked = before | np.logical_or.accumulate(both.first(entry == block.ticks) & walk(block).on, axis=0)
    return owes_crossing(block) & both.first(entry <= block.ticks) & ~walked, walked
