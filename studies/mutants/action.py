"""Mutants that decide rightly and drive wrongly."""

from __future__ import annotations

import math

from pytest_rvads.drivers.follower import STANDING
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.spacing import Stopping
from pytest_rvads.runs.states import Zone

_CREEP = 0.12
"""How fast the creeping one creeps [m/s]."""
_LATE = 0.8
"""How far beyond the right place the late one stops [m]."""
_FAR = 2.5
"""How far before the right place the timid one stops [m]."""
_OVER = 1.3
"""Share of the speed limit that the fast one drives at."""
_PAUSE = 5.0
"""How long the dawdling one stands in the junction [s]."""


class Creeps(Reference):
    """Creeps on at 0.12 m/s instead of standing before the line."""

    def drive(self, seen: Observation, acceleration: float) -> Control:
        if acceleration == -math.inf and seen.me.zone <= Zone.ENTRANCE:
            acceleration = 2.0 * (_CREEP - seen.me.speed)
        return super().drive(seen, acceleration)


class _Shifted(Stopping):
    """Stops somewhere else, by `shift` metres along the way."""

    def __init__(self, shift: float) -> None:
        super().__init__()
        self._shift = shift

    def acceleration(self, seen: Observation) -> float:
        me = seen.me
        moved = me._replace(station=me.station - self._shift)
        return super().acceleration(seen._replace(me=moved._replace(zone=seen.itinerary.zone(moved.station))))


class LateBrake(Reference):
    """Brakes for a place 0.8 m too far on, beyond the line."""

    def __init__(self) -> None:
        super().__init__()
        self._stopping = _Shifted(_LATE)


class StopsFar(Reference):
    """Stops 2.5 m too early, so that it never reaches its entrance zone."""

    def __init__(self) -> None:
        super().__init__()
        self._stopping = _Shifted(-_FAR)


class WeakBrake(Reference):
    """Has half of the braking force that the driver assumes."""

    def drive(self, seen: Observation, acceleration: float) -> Control:
        control = super().drive(seen, acceleration)
        return control._replace(brake=control.brake / 2.0)


class HitsLeader(Reference):
    """Past the line, does not look at vehicles ahead."""

    def control(self, seen: Observation) -> Control:
        return super().control(seen._replace(others=()) if seen.me.station > 0.0 else seen)


class Speeds(Reference):
    """Drives 30 % above the speed limit."""

    def control(self, seen: Observation) -> Control:
        return super().control(seen._replace(speed_limit=_OVER * seen.speed_limit))


class Dawdles(Reference):
    """Stops in the middle of the junction for five seconds."""

    def __init__(self) -> None:
        super().__init__()
        self._since: float | None = None

    def target_speed(self, seen: Observation) -> float:
        me = seen.me
        if me.zone is not Zone.JUNCTION or me.station < seen.itinerary.length / 2.0:
            return super().target_speed(seen)
        if self._since is None and me.speed < STANDING:
            self._since = seen.time
        return 0.0 if self._since is None or seen.time - self._since < _PAUSE else super().target_speed(seen)
