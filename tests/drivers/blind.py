"""Drivers with one fault in what they see: the reference autopilot, which gets to see only a part of the traffic."""

import math
from collections.abc import Callable
from functools import partial

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control
from pytest_rvads.runs.states import VehicleState

__all__ = ["BLIND"]

Seen = rvads.Observation
Sight = Callable[[Seen, VehicleState], VehicleState | None]
"""What is seen of another vehicle; None where it is overlooked."""


class Blind(rvads.Reference):
    """The reference autopilot with a sight of its own, called anew in every step for every other vehicle."""

    def __init__(self, sight: Callable[[], Sight]) -> None:
        super().__init__(tie=0.5)
        self._sight = sight()

    def control(self, seen: Seen, /) -> Control:
        sights = [(k < seen.created, self._sight(seen, other)) for k, other in enumerate(seen.others)]
        kept = [(before, other) for before, other in sights if other is not None]
        return super().control(seen._replace(others=tuple(other for _, other in kept), created=sum(before for before, _ in kept)))


def side(seen: Seen, entrance: int) -> str:
    """Return from where, seen from the own entrance, vehicles of another one come: left, ahead, right, or behind."""

    def course(number: int) -> float:
        (x, y), (ahead_x, ahead_y) = seen.junction.way_in(number).points[-2:]
        return math.degrees(math.atan2(ahead_y - y, ahead_x - x))

    turned = (course(entrance) - course(seen.me.entrance) + 45.0) % 360.0
    return ("behind", "right", "ahead", "left")[int(turned // 90.0)]


def _overlooking(where: str) -> Sight:
    """Overlook vehicles from one side until they have left the junction."""
    return lambda seen, other: None if other.zone < rvads.Zone.EXIT and side(seen, other.entrance) == where else other


def _overlooking_inside() -> Sight:
    return lambda _seen, other: None if other.zone is rvads.Zone.JUNCTION else other


def _a_second_late() -> Sight:
    """See vehicles before the junction where they were a second ago, so that gaps before them look a second longer."""
    past: dict[str, list[VehicleState]] = {}

    def sight(_seen: Seen, other: VehicleState) -> VehicleState:
        states = past.setdefault(other.name, [])
        states.append(other)
        return states[max(len(states) - 101, 0)] if other.zone < rvads.Zone.JUNCTION else other

    return sight


BLIND: dict[str, Callable[[], rvads.Autopilot]] = {
    **{f"blind {where}": partial(Blind, partial(_overlooking, where)) for where in ("left", "right", "ahead")},
    "blind to whoever is inside": partial(Blind, _overlooking_inside),
    "gaps a second too short": partial(Blind, _a_second_late),
}
