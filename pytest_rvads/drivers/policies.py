"""Traffic policies whose drivers hesitate, yield late, run red lights or never enter."""

from __future__ import annotations

import math

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Gate, Reference
from pytest_rvads.drivers.spacing import CREEP, STAND_OFF, Stopping
from pytest_rvads.runs.states import Zone

__all__ = ["Hesitant", "LateYielder", "RedLightRunner", "Stopped"]

HESITATION = 2.0
"""How long the hesitant driver waits when it could go [s]; after 3 s the driver would have waived its right."""
HESITANT_SPEED = 0.6
"""Share of the speed limit at which the hesitant driver drives."""
LATE = 0.85
"""Share of the full service brake with which the late yielder counts on stopping."""


class Hesitant(Reference):
    """Obeys every rule, but waits for two seconds when it could go, and drives slowly."""

    def make_gate(self, seen: Observation) -> Gate:
        """Return what decides when to enter."""
        return _Hesitating(super().make_gate(seen))

    def target_speed(self, seen: Observation) -> float:
        """Return a low speed [m/s]."""
        return HESITANT_SPEED * super().target_speed(seen)


class LateYielder(Reference):
    """Obeys every rule, but brakes for the line hard and at the last moment."""

    def __init__(self, tie: float = 0.0) -> None:
        super().__init__(tie)
        self._stopping = _LateStopping()


class RedLightRunner(Reference):
    """Enters at any light and in front of any vehicle, without a stop at stop signs; stops for bodies in its way."""

    def make_gate(self, _seen: Observation) -> Gate:
        """Return what decides when to enter."""
        return _Constant(True)


class Stopped(Reference):
    """Drives up to the stopping line, stops, and never goes on."""

    def make_gate(self, _seen: Observation) -> Gate:
        """Return what decides when to enter."""
        return _Constant(False)


class _Constant:
    """Always gives the same answer."""

    def __init__(self, answer: bool) -> None:
        self._answer = answer

    def allows(self, _seen: Observation) -> bool:
        return self._answer


class _Hesitating:
    """Allows the entry after another gate has allowed it for `HESITATION`."""

    def __init__(self, gate: Gate) -> None:
        self._gate = gate
        self._since: float | None = None

    def allows(self, seen: Observation) -> bool:
        if not self._gate.allows(seen):
            self._since = None
            return False
        if self._since is None:
            self._since = seen.time
        return seen.time - self._since >= HESITATION


class _LateStopping(Stopping):
    """Brakes for the line when nearly all of the service brake is needed."""

    def acceleration(self, seen: Observation) -> float:
        """Return the acceleration that a late stop needs [m/s^2]; positive while braking is too early, -inf holds the vehicle."""
        me, vehicle = seen.me, seen.vehicle
        distance = seen.itinerary.line - STAND_OFF - me.station
        if me.speed < CREEP and (distance < 0.02 or me.zone is Zone.ENTRANCE):
            return -math.inf
        full = vehicle.brake[seen.aggression - 1]
        room = distance - me.speed * (vehicle.brake_lag + (0.0 if self._braking else vehicle.drive_lag))
        needed = me.speed * me.speed / (2.0 * room) if room > 0.0 else math.inf
        self._braking = self._braking or needed >= LATE * full
        if self._braking:
            return -min(needed, full)
        return 1.0 + distance
