"""Which movements of a junction get in each other's way, and where."""

from __future__ import annotations

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.junctions.junction import Junction, Movement
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, JUNCTION, VehicleState

__all__ = ["RUNNER", "conflict", "exit_blocked", "in_the_way", "movements", "occupied", "runs_through"]

RUNNER = 4.5
"""Who would have to brake harder than this to stop before the junction is not going to [m/s^2]."""
SOON = 1.5
"""Who is this near to the junction and does not brake is about to enter [s]."""


def conflict(junction: Junction, mine: tuple[int, int], other: tuple[int, int]) -> Shared | None:
    """Return where two movements, each given as (entrance, exit), are too near each other for two vehicles.

    None where both can be driven at the same time, or where the geometry is not known.
    """
    return (junction.stretches or {}).get((mine, other))


def movements(junction: Junction, entrance: int, turn: Turn) -> tuple[Movement, ...]:
    """Return the movements that a vehicle from `entrance` with this indicator may make."""
    return junction.by_turn[entrance, turn]


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
