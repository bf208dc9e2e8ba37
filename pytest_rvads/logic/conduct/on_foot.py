"""Locates pedestrians on the crosswalks that vehicles drive over, and tells to which of them a crosswalk is owed.

A crosswalk is owed to a pedestrian who is on the vehicle's half of the roadway, or who is on the other half and comes into the
lane of the vehicle within `DUE_ON_FOOT` (Uniform Vehicle Code 11-502(a), California Vehicle Code 21950(a)). It is not owed to a
pedestrian who is past the lane of the vehicle and walks away from it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing, Side, half
from pytest_rvads.logic.conduct.blocks import Block, signal, sized
from pytest_rvads.logic.conduct.cast import Cast, Pairs, pairs
from pytest_rvads.logic.conduct.standing import STANDSTILL, entered, facing, latched, stands
from pytest_rvads.logic.conduct.stretches import shared
from pytest_rvads.runs.states import Colour

DUE_ON_FOOT = 3.0
"""Time to the lane of a vehicle below which a pedestrian on the other half of the roadway is due [s]: a lane of 3.5 m at 1.2 m/s,
which 85 % of pedestrians exceed. "Within one lane of the half of the roadway" says Revised Code of Washington 46.61.235(1)."""


def walkers(cast: Cast) -> Pairs:
    """Return the pairs of a vehicle and a pedestrian whose crossing the vehicle drives over."""
    if not cast.crossing.any():
        return Pairs([])
    on_foot = cast.crossing.tolist()
    return pairs(cast, lambda agent, other: on_foot[other] > on_foot[agent] and shared(cast, agent, other) is not None)


class Places(NamedTuple):
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


def places_of(cast: Cast) -> Places:
    """Return the places where the pairs of `walkers` meet, see `Places`."""
    rows = []
    for agent, other in cast.static(walkers).column:
        way, common = cast.agents[other].way, shared(cast, agent, other)
        if isinstance(way, Crossing) and common:
            crosswalk, (lane, lane_end) = cast.junction.crossings[way.crosswalk], common.yours
            area = cast.junction.covers.get((way.crosswalk, cast.agents[agent].way.key), common.mine)
            middle = crosswalk.middle if way.side is Side.NEAR else way.length - crosswalk.middle
            halves = half(crosswalk, way, first=(lane + lane_end) / 2 < middle)
            rows.append((area.start, *common.mine, lane, lane_end, *halves))
    return Places(*np.array(rows).reshape(-1, 7).T)


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
    on_walk: NDArray[np.bool_] = (entered(block) <= block.ticks) & (facing(block) == Colour.GREEN)
    return on_walk
