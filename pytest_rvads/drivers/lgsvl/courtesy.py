"""Who yields at lights: the incomplete lists of deficiency I5, and what a vehicle without I4 or I5 looks out for."""

from __future__ import annotations

from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.states import Colour, VehicleState, Zone

__all__ = ["listed", "oncoming", "prior_on_red"]

NEAR = 45.0
"""A vehicle that is to be yielded to matters from this distance to the junction on [m]: some five seconds at full speed."""


def listed(seen: Observation) -> bool:
    """Return whether a left turn, already over its line, yields to somebody on its list (I5).

    The list holds the opposite lane through the junction and the road before it, and nothing else: whoever goes straight
    on counts, also in the junction; a right turn counts only as long as it is on the road.
    """
    return any(
        (other.zone is Zone.JUNCTION and other.turn is Turn.STRAIGHT and in_the_way(seen, other))
        or (other.zone in (Zone.APPROACH, Zone.ENTRANCE) and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
        if (seen.me.entrance, other.entrance) in seen.junction.opposite
    )


def oncoming(seen: Observation) -> bool:
    """Return whether a left turn has to wait before its line: what is done instead of I5."""
    for other in seen.others:
        if in_the_way(seen, other):
            return True
        if (seen.me.entrance, other.entrance) in seen.junction.opposite and other.turn is not Turn.LEFT and _comes(seen, other):
            return True
    return False


def prior_on_red(seen: Observation) -> bool:
    """Return whether a right turn on red has to wait: what is done instead of I4."""
    for other in seen.others:
        if in_the_way(seen, other):
            return True
        if (seen.me.entrance, other.entrance) in seen.junction.right_of and _comes(seen, other):
            return True
    return False


def _comes(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is about to enter: its light lets it, or it is too fast to stop."""
    if other.zone is not Zone.APPROACH and other.zone is not Zone.ENTRANCE:
        return False
    if seen.lights[other.entrance] is Colour.RED and other.speed < 1.0:
        return False
    return other.station > -NEAR
