"""Which movements of a junction get in each other's way, and where."""

from __future__ import annotations

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, JUNCTION, VehicleState

__all__ = ["conflicts", "exit_blocked", "in_the_way", "runs_through"]

RUNNER = 4.5
"""Who would have to brake harder than this to stop before the junction is not going to [m/s^2]."""
SOON = 1.5
"""Who is this near to the junction and does not brake is about to enter [s]."""


def conflicts(seen: Observation, other: VehicleState) -> list[Shared]:
    """Return what the own movement shares with each that `other` may make: there two vehicles would be too near each other.

    Nothing where both can be driven at the same time, or where the geometry is not known.
    """
    junction, mine = seen.junction, (seen.itinerary.entrance, seen.itinerary.exit)
    known = junction.stretches or {}
    return [found for way in junction.by_turn[other.entrance, other.turn] if (found := known.get((mine, way.key)))]


def in_the_way(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other`, in the junction, has yet to leave where its movement and the own one conflict."""
    return other.zone is JUNCTION and any(other.station - other.length < found.yours.end for found in conflicts(seen, other))


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
            for movement in seen.junction.by_turn[other.entrance, other.turn]:
                room = other.station - other.length - movement.length
                if movement.exit == seen.itinerary.exit and room < me.length + 2.5:
                    return True
    return False
