"""Which movements of a junction get in each other's way, and where."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.junction import Junction, Movement
from pytest_rvads.maps.segment import Segment, Turn
from pytest_rvads.semantics.states import APPROACH, ENTRANCE, EXIT, JUNCTION, Observation, VehicleState

__all__ = ["CLEARANCE", "RUNNER", "Stretch", "conflict", "exit_blocked", "in_the_way", "movements", "occupied", "runs_through"]

CLEARANCE = 2.6
"""Two centre lines nearer than this are in conflict [m]: a vehicle's width and the room it needs in a bend."""
RUNNER = 4.5
"""Who would have to brake harder than this to stop before the junction is not going to [m/s^2]."""
SOON = 1.5
"""Who is this near to the junction and does not brake is about to enter [s]."""
_SPACING = 0.5


class Stretch(NamedTuple):
    """Part of a movement, in metres after the entrance vertex."""

    start: float
    end: float


@lru_cache(maxsize=4096)
def conflict(junction: Junction, mine: tuple[int, int], other: tuple[int, int]) -> tuple[Stretch, Stretch] | None:
    """Return where two movements, each given as (entrance, exit), are too near each other for two vehicles.

    Returns:
        The stretch on `mine` and the stretch on `other`, or None where both can be driven at the same time.
    """
    if junction.geometry is None:
        return None
    one_at, one = _sample(junction.geometry.movements[mine])
    two_at, two = _sample(junction.geometry.movements[other])
    distance = np.hypot(one[:, None, 0] - two[None, :, 0], one[:, None, 1] - two[None, :, 1])
    near = distance < CLEARANCE
    if not near.any():
        return None
    along, across = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    return _stretch(along, one_at), _stretch(across, two_at)


@lru_cache(maxsize=4096)
def movements(junction: Junction, entrance: int, turn: Turn) -> tuple[Movement, ...]:
    """Return the movements that a vehicle from `entrance` with this indicator may make."""
    return tuple(m for m in junction.movements.values() if m.entrance == entrance and m.turn is turn)


def in_the_way(junction: Junction, mine: tuple[int, int], other: VehicleState) -> bool:
    """Return whether `other`, in the junction, has yet to leave where its movement and `mine` conflict."""
    if other.zone is not JUNCTION:
        return False
    for movement in movements(junction, other.entrance, other.turn):
        found = conflict(junction, mine, (movement.entrance, movement.exit))
        if found is not None and other.station - other.length < found[1].end:
            return True
    return False


def occupied(junction: Junction, mine: tuple[int, int], other: VehicleState) -> bool:
    """Return whether `other` is in the junction on a movement that conflicts with `mine`, wherever on it."""
    return other.zone is JUNCTION and any(
        conflict(junction, mine, (movement.entrance, movement.exit)) is not None
        for movement in movements(junction, other.entrance, other.turn)
    )


def runs_through(other: VehicleState) -> bool:
    """Return whether `other`, before the junction, can't stop there, or is about to enter and does not brake for it."""
    if other.speed < 1.0 or (other.zone is not APPROACH and other.zone is not ENTRANCE):
        return False
    distance = max(-other.station, 0.1)
    needed = other.speed * other.speed / (2.0 * distance)
    return needed > RUNNER or (distance < SOON * other.speed and -other.acceleration < needed / 2.0)


def exit_blocked(seen: Observation) -> bool:
    """Return whether somebody stands on the exit road so near that there would be no room behind."""
    me = seen.me
    for other in seen.others:
        if other.zone is EXIT and other.speed < 1.0:
            for movement in movements(seen.junction, other.entrance, other.turn):
                room = other.station - other.length - movement.length
                if movement.exit == seen.itinerary.exit and room < me.length + 2.5:
                    return True
    return False


def _stretch(near: NDArray[np.int_], stations: NDArray[np.float64]) -> Stretch:
    return Stretch(float(stations[near[0]]), float(stations[near[-1]]))


def _sample(segment: Segment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations [m] along a movement, ends included, and the places (x, y) there [m]."""
    stations = np.minimum(np.arange(0.0, segment.length + _SPACING, _SPACING), segment.length)
    return stations, np.array([segment.pose(float(s))[:2] for s in stations])
