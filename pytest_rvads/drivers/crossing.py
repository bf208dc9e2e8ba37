"""Meetings in a junction: the stretches that the own movement shares with the possible movements of other vehicles.

The movements of another vehicle are possible if they start at its entrance and have the turn that its indicator shows. "Own"
refers to the vehicle whose driver decides.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from pytest_rvads.drivers.follower import track
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.conflicts import Shared
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Key
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, JUNCTION, VehicleState

ROLLING = 3.0
"""A vehicle before the junction that is at least this fast drives on, so that vehicles behind it are not queued [m/s]."""
RUNNER = 4.5
"""A vehicle that needs a higher deceleration than this to stop before the junction will not stop [m/s^2]."""
SOON = 1.5
"""A vehicle that will reach the junction within this time and does not brake is about to enter [s]."""


class Meeting(NamedTuple):
    """The stretches that the own movement and a possible movement of another vehicle share, and which movement gives way."""

    shared: Shared
    mine: bool
    """Whether the own movement has to give way."""
    yours: bool
    """Whether the movement of the other vehicle has to give way."""
    slow: float
    """Highest speed at which the other vehicle takes the narrowest bend of its movement [m/s]; inf for a straight movement."""


class Meetings:
    """The meetings of the own movement with the movements of other vehicles, computed once per other vehicle."""

    def __init__(self, junction: Junction, itinerary: Itinerary) -> None:
        self._junction, self._key = junction, (itinerary.entrance, itinerary.exit)
        self._cache: dict[str, tuple[Meeting, ...]] = {}

    def of(self, other: VehicleState) -> tuple[Meeting, ...]:
        """Return a meeting per possible movement of `other` that shares a stretch with the own movement."""
        meetings = self._cache.get(other.name)
        if meetings is None:
            own_key, junction = self._key, self._junction
            shared = junction.stretches or {}
            yields = {pair for pair, reason in (junction.yields or {}).items() if reason is not Reason.UNDECIDED}
            keys = [way.key for way in junction.by_turn[other.entrance, other.turn]]
            meetings = self._cache[other.name] = tuple(
                Meeting(shared[own_key, key], (own_key, key) in yields, (key, own_key) in yields, _bend_speed(junction, key))
                for key in keys
                if (own_key, key) in shared
            )
        return meetings


@lru_cache(maxsize=4096)
def _bend_speed(junction: Junction, key: Key) -> float:
    return track(itinerary(junction, *key), 0.0).slowest(junction.every_way[key].length)


def ahead_in_lane(seen: Observation) -> VehicleState | None:
    """Return the nearest vehicle ahead of the own vehicle that came from the own entrance, in any zone; None without one."""
    me = seen.me
    entrance, ahead = me.entrance, None
    for other in seen.others:
        if other.entrance == entrance and other.station > me.station and (ahead is None or other.station < ahead.station):
            ahead = other
    return ahead


def conflicts(seen: Observation, other: VehicleState) -> list[Shared]:
    """Return the stretches that the own movement shares with the possible movements of `other`; none without a geometry."""
    junction, own_key = seen.junction, (seen.itinerary.entrance, seen.itinerary.exit)
    stretches = junction.stretches or {}
    return [shared for way in junction.by_turn[other.entrance, other.turn] if (shared := stretches.get((own_key, way.key)))]


@lru_cache(maxsize=4096)
def may_meet(junction: Junction, vehicle: tuple[int, Turn], other_vehicle: tuple[int, Turn]) -> bool:
    """Return whether possible movements of two vehicles from different arms share a stretch; True without a geometry."""
    if junction.starts[vehicle[0]].arm == junction.starts[other_vehicle[0]].arm:
        return False
    pairs, ways = junction.conflicts, junction.by_turn
    return pairs is None or any((way.key, other_way.key) in pairs for way in ways[vehicle] for other_way in ways[other_vehicle])


@lru_cache(maxsize=4096)
def may_yield(junction: Junction, vehicle: tuple[int, Turn], other_vehicle: tuple[int, Turn]) -> bool:
    """Return whether a possible movement of `vehicle` has to give way to a possible movement of `other_vehicle`."""
    yields, ways = junction.yields or {}, junction.by_turn
    pairs = ((way.key, other_way.key) for way in ways[vehicle] for other_way in ways[other_vehicle])
    return any(yields.get(pair, Reason.UNDECIDED) is not Reason.UNDECIDED for pair in pairs)


def not_queued(seen: Observation) -> list[tuple[int, VehicleState]]:
    """Return the other vehicles with their positions in `seen.others`, but not vehicles that are behind a slow vehicle.

    A vehicle before the junction is slow if its speed is below `ROLLING`; the vehicles behind it at the same entrance queue.
    """
    slow: dict[int, float] = {}
    for other in seen.others:
        if other.speed < ROLLING and other.zone < JUNCTION:
            slow[other.entrance] = max(slow.get(other.entrance, -math.inf), other.station)
    return [(k, other) for k, other in enumerate(seen.others) if other.station >= slow.get(other.entrance, -math.inf)]


def in_the_way(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is in the junction and has not yet left the stretch that it shares with the own movement."""
    return other.zone is JUNCTION and any(other.station - other.length < shared.yours.end for shared in conflicts(seen, other))


def runs_through(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other`, before the junction, can no longer stop, or is about to enter and brakes too little to stop."""
    if other.speed < 1.0 or (other.zone is not APPROACH and other.zone is not ENTRANCE):
        return False
    distance = max(-other.station, -seen.junction.setbacks[other.entrance] - other.station, 0.1)
    needed = other.speed * other.speed / (2.0 * distance)
    return needed > RUNNER or (distance < SOON * other.speed and -other.acceleration < needed / 2.0)


def exit_blocked(seen: Observation) -> bool:
    """Return whether a vehicle that stands on the own exit road leaves too little room behind it for the own vehicle."""
    me = seen.me
    for other in seen.others:
        if other.zone is EXIT and other.speed < 1.0:
            for movement in seen.junction.by_turn[other.entrance, other.turn]:
                room = other.station - other.length - movement.length
                if movement.exit == seen.itinerary.exit and room < me.length + 2.5:
                    return True
    return False
