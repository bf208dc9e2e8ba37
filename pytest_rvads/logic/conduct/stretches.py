"""Locates agents on the stretches that the ways of two agents through the junction share, and pedestrians on crosswalks.

A crosswalk is owed to a pedestrian who is on the vehicle's half of the roadway, or who is on the other half and comes into the
lane of the vehicle within `DUE_ON_FOOT` (Uniform Vehicle Code 11-502(a), California Vehicle Code 21950(a)). It is not owed to a
pedestrian who is past the lane of the vehicle and walks away from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import Shared, Stretch
from pytest_rvads.geometry.crosswalks import Crossing, Side, half
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import CONFLICT_WIDTH, Key
from pytest_rvads.logic.conduct.blocks import ENTRANCE, Block, Cast, Pairs, pairs, signal, sized
from pytest_rvads.logic.conduct.standing import STANDSTILL, entered, facing, latched, stands
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.support.errors import RunError

_SPACING = 0.5
"""Distance between the stations at which two ways are compared [m]."""


def shared(run: Run | Cast, agent: int, other: int) -> Shared | None:
    """Return the stretches that the ways of two agents, given by column, share; None if the ways don't meet."""
    stretches = run.junction.stretches
    if stretches is None:
        raise RunError("the run holds no geometry of its junction")
    return stretches.get((run.agents[agent].way.key, run.agents[other].way.key))


def contested(run: Run | Cast, agent: int, other: int) -> Shared | None:
    """Return the stretches that the ways of two agents share, with the first `LEAVE` of a common exit road; None if none.

    At the beginning of a common exit road, the vehicle that merged is still slow, and the other vehicle can run into it.
    """
    common = shared(run, agent, other)
    if common is None or not common.merges:
        return common
    ends = (run.agents[k].way.length + LEAVE for k in (agent, other))
    stretch, other_stretch = (Stretch(part.start, end) for part, end in zip((common.mine, common.yours), ends, strict=True))
    return Shared(stretch, other_stretch, merges=True)


@lru_cache(maxsize=4096)
def parting(junction: Junction, way: Key, other: Key) -> float:
    """Return the station up to which vehicles on two ways from the same start have no room beside each other [m]; or infinity."""
    paths = junction.every_way[way].path, junction.every_way[other].path
    if paths[0] is None or paths[1] is None:
        raise RunError("the run holds no geometry of its junction")
    if way[1] == other[1]:
        return math.inf
    along = np.arange(0.0, min(path.length for path in paths if path), _SPACING)
    first, second = (np.array([path.pose(float(s))[:2] for s in along]) for path in paths if path)
    together = np.flatnonzero(np.hypot(*(first - second).T) < CONFLICT_WIDTH)
    return float(along[together[-1]]) if len(together) else 0.0


@lru_cache(maxsize=4096)
def first_stretch(junction: Junction, way: Key) -> float:
    """Return the first station at which a way shares a stretch with a way from another start [m]; infinity without a stretch."""
    return min((common.mine.start for (key, _), common in (junction.stretches or {}).items() if key == way), default=math.inf)


def meeting(cast: Cast) -> Pairs:
    """Return the pairs of agents whose ways through the junction share a stretch."""
    return pairs(cast, lambda agent, other: shared(cast, agent, other) is not None)


class Places(NamedTuple):
    """The stations at which the stretches that pairs of vehicles share begin and end, arrays of shape ``(pairs,)`` [m]."""

    begin: NDArray[np.float64]
    """Station at which the stretch begins on the way of the first vehicle."""
    end: NDArray[np.float64]
    begin_of_two: NDArray[np.float64]
    """Station at which the stretch begins on the way of the second vehicle."""
    end_of_two: NDArray[np.float64]
    merges: NDArray[np.bool_]
    """Whether both ways lead into the same exit."""


def places(of: Callable[[Cast], Pairs], common: Callable[[Cast, int, int], Shared | None]) -> Callable[[Cast], Places]:
    """Return a function with the places of the stretches that pairs of vehicles have in common; NaN for a pair without any."""

    def work(cast: Cast) -> Places:
        nothing = (math.nan,) * 4 + (False,)
        commons = [common(cast, agent, other) for agent, other in cast.static(of).column]
        rows = [nothing if c is None else (*c.mine, *c.yours, c.merges) for c in commons]
        begin, end, begin_of_two, end_of_two, merges = np.array(rows, dtype=np.float64).reshape(-1, 5).T
        return Places(begin, end, begin_of_two, end_of_two, merges.astype(np.bool_))

    return work


_meeting_places = places(meeting, shared)


@signal(pairs=meeting, needs=sized)
def meet(block: Block) -> NDArray[np.bool_]:
    """Return whether the vehicles of each pair meet: the bodies of both are on a stretch shared by their ways.

    Vehicles with movements into the same exit meet while they are side by side, not while one vehicle follows the other.
    """
    cast, both, at = block.cast, block.cast.static(meeting), block.cast.static(_meeting_places)
    front = block.need("station")
    rear = front - cast.length
    meeting_pairs: NDArray[np.bool_] = (both.first(front) >= at.begin) & (both.first(rear) <= at.end)
    meeting_pairs &= (both.second(front) >= at.begin_of_two) & (both.second(rear) <= at.end_of_two)
    meeting_pairs &= both.first(block.here) & both.second(block.here)
    if cast.crossing.any():  # the stretch can begin at the kerb, where a pedestrian stands in nobody's way
        on_road = ~cast.crossing | (block.zone > ENTRANCE)
        meeting_pairs &= both.first(on_road) & both.second(on_road)
    if meeting_pairs.any():
        front = block.need("station") - cast.way
        rear = block.need("station") - cast.length - cast.way
        meeting_pairs = meeting_pairs & (
            ~at.merges | (both.first(front) > both.second(rear)) & (both.second(front) > both.first(rear))
        )
    return np.asarray(meeting_pairs)


def neighbours(cast: Cast) -> Pairs:
    """Return the pairs of vehicles whose ways share a stretch, an entrance or an exit."""

    def belong(agent: int, other: int) -> bool:
        me, you = cast.agents[agent], cast.agents[other]
        return shared(cast, agent, other) is not None or me.entrance == you.entrance or me.exit == you.exit

    return pairs(cast, belong)


contested_places = places(neighbours, contested)
"""The contested stretches (shared stretches with a part of the exit road) of the pairs `neighbours`."""


class _Roads(NamedTuple):
    """The lanes and exit roads that the two vehicles of each pair of `neighbours` share, arrays of shape ``(pairs,)``."""

    exit: NDArray[np.bool_]
    """Whether both vehicles leave by the same exit."""
    parting: NDArray[np.float64]
    """Station up to which the second vehicle is in the lane of the first [m]; minus infinity for vehicles of two entrances."""
    joining: NDArray[np.float64]
    """Station from which on the second vehicle is in the exit lane of the first [m]; infinity unless only the exit is shared."""
    shift: NDArray[np.float64]
    """Length of the movement of the second vehicle minus that of the first [m]; 0 for vehicles of the same entrance."""


def roads(cast: Cast) -> _Roads:
    """Return the lanes and exit roads that the two vehicles of each pair of `neighbours` share."""
    both, agents = cast.static(neighbours), cast.agents
    commons = [shared(cast, agent, other) for agent, other in both.column]
    entrance, exit = both.first(cast.entrance) == both.second(cast.entrance), both.first(cast.exit) == both.second(cast.exit)
    partings = [
        parting(cast.junction, agents[agent].way.key, agents[other].way.key) if same else -math.inf
        for (agent, other), same in zip(both.column, entrance.tolist(), strict=True)
    ]
    joins = [c.yours.start if c else agents[other].way.length for (_, other), c in zip(both.column, commons, strict=True)]
    joining = np.where(exit & ~entrance, np.array(joins, dtype=np.float64), np.inf)
    shift = np.where(entrance, 0.0, both.second(cast.way) - both.first(cast.way))
    return _Roads(exit, np.array(partings), joining, shift)


@signal(pairs=neighbours, needs=sized, otherwise=math.inf)
def ahead_by(block: Block) -> NDArray[np.float64]:
    """Return how far the second vehicle's rear is ahead of the first vehicle's front in the same lane [m].

    The value is infinite if the second vehicle is not ahead, or not in the entrance or exit lane of the first.
    """
    both, road, station = block.cast.static(neighbours), block.cast.static(roads), block.need("station")
    front, ahead = both.first(station), both.second(station)
    behind = ahead - both.second(block.cast.length)
    way, front = (behind < road.parting) | (ahead >= road.joining), front + road.shift
    return np.where(way & (ahead > front) & both.second(block.here), behind - front, np.inf)


DUE_ON_FOOT = 3.0
"""Time to the lane of a vehicle below which a pedestrian on the other half of the roadway is due [s]: a lane of 3.5 m at 1.2 m/s,
which 85 % of pedestrians exceed. "Within one lane of the half of the roadway" says Revised Code of Washington 46.61.235(1)."""


def walkers(cast: Cast) -> Pairs:
    """Return the pairs of a vehicle and a pedestrian whose crossing the vehicle drives over."""
    if not cast.crossing.any():
        return Pairs([])
    on_foot = cast.crossing.tolist()
    return pairs(cast, lambda agent, other: on_foot[other] > on_foot[agent] and shared(cast, agent, other) is not None)


class CrosswalkPlaces(NamedTuple):
    """The places where vehicles meet pedestrians, arrays of shape ``(pairs,)`` [m].

    The first three are stations on the way of the vehicle, the others on the way of the pedestrian.
    """

    begin: NDArray[np.float64]
    """Beginning of the painted area."""
    near: NDArray[np.float64]
    """Beginning of the stretch shared with the crossing, around the line on which the pedestrian walks."""
    far: NDArray[np.float64]
    """End of this stretch."""
    lane: NDArray[np.float64]
    """Beginning of the lane of the vehicle."""
    lane_end: NDArray[np.float64]
    half: NDArray[np.float64]
    """Beginning of the half of the roadway on which the vehicle drives."""
    half_end: NDArray[np.float64]


def places_of(cast: Cast) -> CrosswalkPlaces:
    """Return the places where the pairs of `walkers` meet, see `CrosswalkPlaces`."""
    rows = []
    for agent, other in cast.static(walkers).column:
        way, common = cast.agents[other].way, shared(cast, agent, other)
        if isinstance(way, Crossing) and common:
            crosswalk, (lane, lane_end) = cast.junction.crossings[way.crosswalk], common.yours
            area = cast.junction.covers.get((way.crosswalk, cast.agents[agent].way.key), common.mine)
            middle = crosswalk.middle if way.side is Side.NEAR else way.length - crosswalk.middle
            halves = half(crosswalk, way, first=(lane + lane_end) / 2 < middle)
            rows.append((area.start, *common.mine, lane, lane_end, *halves))
    return CrosswalkPlaces(*np.array(rows).reshape(-1, 7).T)


class Walk(NamedTuple):
    """What the pedestrian of each pair of `walkers` does, arrays of shape ``(n, pairs)``."""

    on: NDArray[np.bool_]
    """Whether the pedestrian is on the roadway, and not past the lane of the vehicle."""
    claims: NDArray[np.bool_]
    """Whether the pedestrian is also on the half of the vehicle, or walks towards it."""
    owed: NDArray[np.bool_]
    """Whether the pedestrian is also on the half of the vehicle, or comes into its lane within `DUE_ON_FOOT`."""
    within: NDArray[np.bool_]
    """Whether the pedestrian is in the lane of the vehicle."""


@signal
def walk(block: Block) -> Walk:
    """Return where the pedestrian of each pair of `walkers` is, and whether it comes, see `Walk`; a negative speed leads back."""
    cast, both, at = block.cast, block.cast.static(walkers), block.cast.static(places_of)
    front, pace = both.second(block.need("station")), both.second(block.need("speed"))
    rear = front - both.second(cast.length)
    back, moves = pace < -STANDSTILL, np.abs(pace) > STANDSTILL
    road = (front > 0.0) & (rear < both.second(cast.way)) & both.second(block.here)
    on = road & np.where(back, front >= at.lane, rear <= at.lane_end)
    half = (front > at.half) & (rear < at.half_end)
    due = moves & (np.where(back, rear - at.lane_end, at.lane - front) <= DUE_ON_FOOT * np.abs(pace))
    within = road & (front >= at.lane) & (rear <= at.lane_end)
    return Walk(on, on & (half | moves), on & (half | due), within)


@signal(pairs=walkers)
def claims(block: Block) -> NDArray[np.bool_]:
    """Return whether the pedestrian of each pair claims the crosswalk, see `Walk.claims`."""
    return walk(block).claims


@signal(pairs=walkers, start=(np.nan, False, False), needs=sized)
def takes_crosswalk(
    block: Block, before: NDArray[np.float64], stood: NDArray[np.bool_], came: NDArray[np.bool_]
) -> tuple[NDArray[Any], ...]:
    """Return whether the vehicle of each pair takes the crosswalk: it drives onto the painted area, or sets off there.

    A vehicle also takes the crosswalk while it is where the pedestrian walks, if the pedestrian claimed the crosswalk when the
    vehicle drove onto it or set off there.
    """
    cast, both, at, steps = block.cast, block.cast.static(walkers), block.cast.static(places_of), walk(block)
    front, seen = both.first(block.need("station")), both.second(block.here)
    # What the vehicle did before the pedestrian appeared does not count, as in a monitor that does not know the pedestrian yet.
    known, still = np.where(seen, front, np.nan), both.first(stands(block)) & seen
    last, had_stood = np.concatenate((before[None], known[:-1])), np.concatenate((stood[None], still[:-1]))
    sets_off = had_stood & (both.first(block.need("speed")) > STANDSTILL) & (front >= at.begin) & (front < at.far)
    goes = ((last < at.begin) & (front >= at.begin)) | sets_off
    came_first = latched(goes & steps.claims, goes & ~steps.claims, came)
    meets = steps.within & (front >= at.near) & (front - both.first(cast.length) <= at.far)
    return both.first(block.here) & (goes | (meets & came_first)), known, still, came_first


@signal
def stepped_on_walk(block: Block) -> NDArray[np.bool_]:
    """Return whether the light of each pedestrian showed green (WALK) when the pedestrian stepped onto the crosswalk."""
    return (entered(block) <= block.ticks) & (facing(block) == Colour.GREEN)
