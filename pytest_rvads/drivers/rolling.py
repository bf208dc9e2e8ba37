"""An autopilot with plain faults, for examples and for trying out rules."""

from __future__ import annotations

import math

from pytest_rvads.drivers.at_light import Light
from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.give_way import GiveWay
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Gate, Reference, by_zones
from pytest_rvads.drivers.stop_sign import PATIENCE, PATIENCE_STEP
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["RollingStop"]

ROLL = 2.5
"""Speed at which the driver rolls over a free stopping line [m/s]."""
NEAR = 5.0
"""Distance to the junction from which on a vehicle counts for right before left [m]."""


class RollingStop(Reference):
    """Treats stop signs as yield signs, and turns on red without looking.

    The driver has two faults. At a stop sign it does not stop: it slows down, gives way to vehicles in the junction and to a
    vehicle standing on its right, and rolls on, without regard to the order of arrival. At a red light it turns to the near side,
    the right where traffic keeps right, without regard to vehicles with green, as long as no vehicle is in its way. The reference
    driver does everything else, including giving way where signs differ or arms have several lanes.
    """

    def make_gate(self, seen: Observation) -> Gate:
        """Return what decides when to enter."""
        if not by_zones(seen.junction):
            return _Rolling(seen, self.track(seen), stops=False)
        return _RightOnRed(paper=False) if seen.junction.control is JunctionControl.LIGHTS else _Yield()

    def target_speed(self, seen: Observation) -> float:
        """Return the speed limit, or a lower speed before a line that the driver rolls over [m/s]."""
        line = seen.itinerary.line - seen.me.station
        signs = seen.junction.control is JunctionControl.STOP or seen.junction.entrances[seen.me.entrance].sign is Sign.STOP
        if not (signs or _turns_on_red(seen)) or seen.me.station > 0.0:
            return super().target_speed(seen)
        return min(super().target_speed(seen), math.hypot(ROLL, self.stopping_speed(line - ENTRANCE_ZONE)))


class _Yield:
    """Gives way to vehicles on the right and to vehicles in the junction."""

    def __init__(self) -> None:
        self._stuck_since: float | None = None

    def allows(self, seen: Observation) -> bool:
        me = seen.me
        if any(other.zone is Zone.JUNCTION for other in seen.others):
            self._stuck_since = None
            return False
        waiting = [o for o in seen.others if o.zone is Zone.ENTRANCE or (o.zone is Zone.APPROACH and o.station > -NEAR)]
        if not any((other.entrance, me.entrance) in seen.junction.right_of for other in waiting):
            self._stuck_since = None
            return True
        if self._stuck_since is None or me.zone is not Zone.ENTRANCE:
            self._stuck_since = seen.time
        return seen.time - self._stuck_since >= PATIENCE + PATIENCE_STEP * seen.created


class _Rolling(GiveWay):
    """Treats stop signs as yield signs, and ignores a red light for a turn to the near side."""

    def allows(self, seen: Observation) -> bool:
        if not _turns_on_red(seen):
            return super().allows(seen)
        return not any(in_the_way(seen, other) for other in seen.others)


class _RightOnRed(Light):
    """Obeys the light, except that red does not hold a turn to the near side."""

    def allows(self, seen: Observation) -> bool:
        if not _turns_on_red(seen):
            return super().allows(seen)
        return not any(in_the_way(seen, other) for other in seen.others)


def _turns_on_red(seen: Observation) -> bool:
    return seen.me.turn is seen.junction.near and seen.lights[seen.me.entrance] is Colour.RED
