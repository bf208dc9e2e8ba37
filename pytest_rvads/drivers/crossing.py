"""The meetings of ways in a junction: which vehicles the own vehicle meets, and where."""

from __future__ import annotations

import math
from collections.abc import Set
from functools import lru_cache
from typing import NamedTuple

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.way_ahead import track
from pytest_rvads.geometry.conflicts import Key, Shared
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Turn
from pytest_rvads.geometry.yielding import Reason
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, JUNCTION, VehicleState

__all__ = [
    "ROLLING",
    "Meeting",
    "Meetings",
    "ahead_in_lane",
    "conflicts",
    "exit_blocked",
    "in_the_way",
    "may_meet",
    "may_yield",
    "not_queued",
    "runs_through",
]

ROLLING = 3.0
"""A vehicle before the junction that goes first and is this fast drives on, and the vehicle behind it may follow [m/s]."""
RUNNER = 4.5
"""A vehicle that needs a higher deceleration than this to stop before the junction will not stop [m/s^2]."""
SOON = 1.5
"""A vehicle that is this time away from the junction and does not brake is about to enter [s]."""


class Meeting(NamedTuple):
    """The shared stretch of the own movement and a possible movement of another vehicle, and which of the two gives way."""

    shared: Shared
    mine: bool
    """Whether the own movement gives way."""
    yours: bool
    """Whether the other movement gives way."""
    slow: float
    """Speed of the other vehicle in the narrowest bend of its movement [m/s]; inf for a straight movement."""


class Meetings:
    """The meetings of the own movement with the movements of other vehicles, computed once per other vehicle.

    Args:
        junction: the junction.
        itinerary: the own itinerary.
    """

    def __init__(self, junction: Junction, itinerary: Itinerary) -> None:
        self._junction, self._key = junction, (itinerary.entrance, itinerary.exit)
        self._cache: dict[str, tuple[Meeting, ...]] = {}

    def of(self, other: VehicleState) -> tuple[Meeting, ...]:
        """Return the meetings with the movements that `other` may take; empty if no movement is in the way."""
        meetings = self._cache.get(other.name)
        if meetings is None:
            meetings = self._cache[other.name] = self._meetings_with(other)
        return meetings

    def _meetings_with(self, other: VehicleState) -> tuple[Meeting, ...]:
        own_key, junction = self._key, self._junction
        shared, yields = junction.stretches or {}, _settled(junction)
        keys = [way.key for way in junction.by_turn[other.entrance, other.turn]]
        return tuple(
            Meeting(shared[own_key, key], (own_key, key) in yields, (key, own_key) in yields, _bend_speed(junction, key))
            for key in keys
            if (own_key, key) in shared
        )


def _settled(junction: Junction) -> Set[tuple[Key, Key]]:
    """Return the pairs of movements of which the first gives way; of the undecided pairs, whoever is nearer goes first."""
    return {pair for pair, reason in (junction.yields or {}).items() if reason is not Reason.UNDECIDED}


@lru_cache(maxsize=4096)
def _bend_speed(junction: Junction, key: Key) -> float:
    return track(itinerary(junction, *key), 0.0).slowest(junction.every_way[key].length)


def ahead_in_lane(seen: Observation) -> VehicleState | None:
    """Return the next vehicle ahead that came by the own entrance, in any zone; None without any."""
    me = seen.me
    entrance, ahead = me.entrance, None
    for other in seen.others:
        if other.entrance == entrance and other.station > me.station and (ahead is None or other.station < ahead.station):
            ahead = other
    return ahead


def conflicts(seen: Observation, other: VehicleState) -> list[Shared]:
    """Return the stretches that the own movement shares with the possible movements of `other`.

    The list is empty if all these movements can be driven at the same time as the own movement, or if the geometry is unknown.
    """
    junction, own_key = seen.junction, (seen.itinerary.entrance, seen.itinerary.exit)
    stretches = junction.stretches or {}
    return [shared for way in junction.by_turn[other.entrance, other.turn] if (shared := stretches.get((own_key, way.key)))]


@lru_cache(maxsize=4096)
def may_meet(junction: Junction, vehicle: tuple[int, Turn], other_vehicle: tuple[int, Turn]) -> bool:
    """Return whether two vehicles of different arms may share a stretch; each vehicle is given by its entrance and indicator.

    The answer is True if the geometry of the junction is unknown.
    """
    if junction.starts[vehicle[0]].arm == junction.starts[other_vehicle[0]].arm:
        return False
    pairs, ways = junction.conflicts, junction.by_turn
    return pairs is None or any((way.key, other_way.key) in pairs for way in ways[vehicle] for other_way in ways[other_vehicle])


@lru_cache(maxsize=4096)
def may_yield(junction: Junction, vehicle: tuple[int, Turn], other_vehicle: tuple[int, Turn]) -> bool:
    """Return whether the first of two vehicles, as for `may_meet`, may have to give way to the second."""
    pairs, ways = _settled(junction), junction.by_turn
    return any((way.key, other_way.key) in pairs for way in ways[vehicle] for other_way in ways[other_vehicle])


def not_queued(seen: Observation) -> list[tuple[int, VehicleState]]:
    """Return the other vehicles with their numbers, without vehicles that queue behind a slow vehicle before the junction."""
    slow: dict[int, float] = {}
    for other in seen.others:
        if other.speed < ROLLING and other.zone < JUNCTION:
            slow[other.entrance] = max(slow.get(other.entrance, -math.inf), other.station)
    return [(k, other) for k, other in enumerate(seen.others) if other.station >= slow.get(other.entrance, -math.inf)]


def in_the_way(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is in the junction and has not yet left the stretch that it shares with the own movement."""
    return other.zone is JUNCTION and any(other.station - other.length < shared.yours.end for shared in conflicts(seen, other))


def runs_through(other: VehicleState) -> bool:
    """Return whether `other`, before the junction, can't stop there, or is about to enter without braking."""
    if other.speed < 1.0 or (other.zone is not APPROACH and other.zone is not ENTRANCE):
        return False
    distance = max(-other.station, 0.1)
    needed = other.speed * other.speed / (2.0 * distance)
    return needed > RUNNER or (distance < SOON * other.speed and -other.acceleration < needed / 2.0)


def exit_blocked(seen: Observation) -> bool:
    """Return whether a vehicle stands on the own exit road and leaves no room behind it."""
    me = seen.me
    for other in seen.others:
        if other.zone is EXIT and other.speed < 1.0:
            for movement in seen.junction.by_turn[other.entrance, other.turn]:
                room = other.station - other.length - movement.length
                if movement.exit == seen.itinerary.exit and room < me.length + 2.5:
                    return True
    return False
