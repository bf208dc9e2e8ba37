"""Six drivers with a fault in what they know of other vehicles, for tests that must find these faults."""

import math

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control
from pytest_rvads.runs.states import VehicleState

__all__ = ["BLIND", "BlindAhead", "BlindInside", "BlindLeft", "BlindRight", "DeafToFast", "ShortGaps"]

LATE = 1.0
"""How much later than in truth `ShortGaps` sees other vehicles arrive [s]."""
FAST = 8.0
"""Greatest speed of the vehicles that `DeafToFast` notices [m/s]."""


class BlindLeft(rvads.Autopilot):
    """A controller of an all-way stop that looks only to its right.

    The controller stops at the line, and waits for 0.5 s. The controller goes unless a vehicle is at the entrance to the right or
    is in the junction and came from that entrance. The controller never looks to its left or ahead.
    """

    def __init__(self) -> None:
        self._stood = 0.0
        self._goes = False

    def control(self, seen: rvads.Observation, /) -> rvads.TargetSpeed:
        me = seen.me
        right = {other.zone for other in seen.others if (other.entrance, me.entrance) in seen.junction.right_of}
        self._stood += self.period * (me.zone is rvads.Zone.ENTRANCE and me.speed < 0.01)
        self._goes = self._goes or (self._stood > 0.5 and not right & {rvads.Zone.ENTRANCE, rvads.Zone.JUNCTION})
        line = seen.itinerary.line - 0.35 - me.station
        return rvads.TargetSpeed(seen.speed_limit if self._goes else math.sqrt(4.0 * max(line, 0.0)))


class _Partial(rvads.Reference):
    """The reference autopilot, which sees of every other vehicle only what `perceived` returns."""

    def __init__(self) -> None:
        super().__init__(tie=0.5)

    def control(self, seen: rvads.Observation, /) -> Control:
        states = [self.perceived(seen, other) for other in seen.others]
        created = sum(state is not None for state in states[: seen.created])
        return super().control(seen._replace(others=tuple(state for state in states if state is not None), created=created))

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        """Return the state in which another vehicle is seen; None for an overlooked vehicle. Called once per step and vehicle."""
        raise NotImplementedError


class BlindAhead(_Partial):
    """Never sees vehicles from the opposite entrance, until these have left the junction."""

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        return None if other.zone < rvads.Zone.EXIT and side(seen, other.entrance) == "ahead" else other


class BlindRight(_Partial):
    """Never sees vehicles from the entrance to the right, until these have left the junction."""

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        return None if other.zone < rvads.Zone.EXIT and side(seen, other.entrance) == "right" else other


class BlindInside(_Partial):
    """Does not see vehicles in the junction."""

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        return None if other.zone is rvads.Zone.JUNCTION else other


class DeafToFast(_Partial):
    """Does not notice vehicles that are faster than 8 m/s."""

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        return None if other.speed > FAST else other


class ShortGaps(_Partial):
    """Judges gaps 1 s too short: sees vehicles before the junction where they were 1 s ago, and so arrive 1 s late."""

    def __init__(self) -> None:
        super().__init__()
        self._past: dict[str, list[VehicleState]] = {}

    def perceived(self, seen: rvads.Observation, other: VehicleState) -> VehicleState | None:
        states = self._past.setdefault(other.name, [])
        states.append(other)
        return states[max(len(states) - 1 - round(LATE / self.period), 0)] if other.zone < rvads.Zone.JUNCTION else other


def side(seen: rvads.Observation, entrance: int) -> str:
    """Return from where vehicles of another entrance come, as seen from the own entrance: left, ahead, right, or behind."""

    def course(number: int) -> float:
        (x, y), (ahead_x, ahead_y) = seen.junction.way_in(number).points[-2:]
        return math.degrees(math.atan2(ahead_y - y, ahead_x - x))

    turned = (course(entrance) - course(seen.me.entrance) + 45.0) % 360.0
    return ("behind", "right", "ahead", "left")[int(turned // 90.0)]


BLIND: dict[str, type[rvads.Autopilot]] = {
    "blind left": BlindLeft,
    "blind ahead": BlindAhead,
    "blind right": BlindRight,
    "blind to whoever is inside": BlindInside,
    "deaf to fast vehicles": DeafToFast,
    "gaps a second too short": ShortGaps,
}
