"""The driver of an LGSVL-like vehicle: target speed, decision to stop at the line, and yielding at lights.

The driver has the decisions of the original. The motion law of the original, a first-order pursuit of the target at up to
19 m/s^2, fits no car. Here the rates of the law determine shares of the drive and brake forces of a real car.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.lgsvl.constants import ADVANCE, DECIDE, HOLD, RAMP, RATES, SLOW, TURN_SHARE, TURN_WAIT, Constants
from pytest_rvads.drivers.lgsvl.scheduler import Guarded, Scheduler, zone_of
from pytest_rvads.drivers.spacing import clear_of_bodies
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.segment import Turn
from pytest_rvads.runs.states import Colour, VehicleState, Zone

__all__ = ["Pilot", "Switches", "listed", "oncoming", "prior_on_red"]

NEAR = 45.0
"""Distance to the junction from which on a prior vehicle matters [m]: about five seconds at full speed."""
_SLOW = 0.05
"""Speed below which a vehicle that creeps to its stop counts as standing [m/s]."""
_TURN_EASE = 3.0
"""Deceleration towards a turn [m/s^2]; the original enters turns at full speed, where a car would slide."""


class Switches(NamedTuple):
    """Switches for the deficiencies of the paper's table."""

    i1: bool = True
    """The vehicle sets off before the driver knows about the stop sign."""
    i2: bool = True
    """The scheduler mistakes a hidden box for the junction."""
    i3: bool = True
    """The scheduler ignores ties: the creation order decides."""
    i4: bool = True
    """The vehicle turns right on red after a time, without regard to other vehicles."""
    i5: bool = True
    """The vehicle yields by an incomplete list, after crossing the line."""


class Pilot(Follower):
    """Driver of a vehicle.

    Args:
        switches: the deficiencies.
        constants: the free constants.
        scheduler: scheduler of the run, shared by all vehicles.
    """

    def __init__(self, switches: Switches, constants: Constants, scheduler: Scheduler) -> None:
        super().__init__()
        self._has = switches
        self._constants = constants
        self._scheduler = scheduler
        self._zone: Guarded | None = None
        self._free = False
        """Whether the vehicle may pass the line."""
        self._decided = False
        """Whether the driver has read the light."""
        self._has_left = False
        """Whether the vehicle has left the zone of the scheduler."""
        self._joined: float | None = None
        """Time at which the vehicle joined the queue [s]."""
        self._stood: float | None = None
        """Time at which the vehicle came to a stand at a light [s]."""
        self._green: float | None = None
        """Time at which the waiting vehicle first observed green [s]."""
        self._since = 0.0
        """Time from which on the vehicle follows a higher target speed [s]."""

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering; an event in this tick takes effect in the next tick."""
        me = seen.me
        free = self._free
        stops = seen.junction.control is not JunctionControl.LIGHTS
        if stops:
            self._attend_sign(seen)
        elif not free:
            self._attend_light(seen)
        distance = seen.itinerary.line - me.station
        # At greater distances the flag would not change the first ticks.
        launching = self._has.i1 and distance <= self._constants.halt and seen.time < self._constants.launch - 1e-9
        if free or launching:
            if not stops and me.turn is Turn.LEFT and not launching and self._yields(seen):
                return self.drive(seen, -math.inf if me.speed < _SLOW else self._pursue(seen, 0.0))
            acceleration = self._pursue(seen, self._cruise(seen))
            if seen.others and me.speed > _SLOW:
                acceleration = min(acceleration, clear_of_bodies(seen, self.track(seen)))
        else:
            target = self._approach(seen, distance)
            if target <= 0.0 and me.speed < STANDING and seen.time >= self._constants.launch:
                return self.drive(seen, -math.inf)
            acceleration = self._pursue(seen, target)
        return self.drive(seen, acceleration)

    def _attend_sign(self, seen: Observation) -> None:
        """Join the queue at the line, go when the scheduler calls, and report to the scheduler after the zone."""
        if self._has_left:
            return
        me = seen.me
        if self._zone is None:
            self._zone = zone_of(seen.junction, self._constants, self._has.i2)
        if self._free:
            gone = me.station - me.length > seen.itinerary.length
            self._has_left = self._scheduler.leaves(me, self._zone, gone)
            return
        if self._joined is None:
            if me.zone is Zone.APPROACH:
                return
            self._joined = seen.time
            self._scheduler.join(seen)
        if seen.time - self._joined >= HOLD - 1e-9 and self._scheduler.calls(seen, self._zone):
            self._release(seen)

    def _attend_light(self, seen: Observation) -> None:
        """Read the light once; if the light is not green, stop and wait for green, or for the waiting time of a right turn."""
        me = seen.me
        colour = seen.lights[me.entrance]
        if not self._decided:
            if seen.itinerary.line - me.station > DECIDE:
                return
            self._decided = True
            if colour is Colour.GREEN:
                self._release(seen)
                return
        if me.zone is Zone.APPROACH:
            return
        if self._stood is None and me.speed < _SLOW:
            self._stood = seen.time
        if colour is Colour.GREEN and self._green is None:
            self._green = seen.time
        if self._may_go(seen, colour):
            self._release(seen)

    def _may_go(self, seen: Observation, colour: Colour) -> bool:
        """Return whether a vehicle that stopped at a light may go: a right turn after a time, other turns a time after green."""
        if seen.me.turn is Turn.RIGHT:
            waited = self._stood is not None and seen.time - self._stood >= seen.wait - 1e-9
            return colour is Colour.GREEN or (waited and (self._has.i4 or not prior_on_red(seen)))
        extra = min(max(seen.wait, TURN_WAIT[0]), TURN_WAIT[1]) if seen.me.turn is Turn.LEFT else 0.0
        return self._green is not None and seen.time - self._green >= extra - 1e-9

    def _release(self, seen: Observation) -> None:
        self._free = True
        self._since = seen.time

    def _yields(self, seen: Observation) -> bool:
        """Return whether a left turn that may pass the line gives way."""
        if self._has.i5:
            return seen.me.zone is Zone.JUNCTION and listed(seen)
        return seen.me.station <= 0.0 and oncoming(seen)

    def _cruise(self, seen: Observation) -> float:
        """Return the target speed of a vehicle that does not have to stop [m/s]."""
        normal, me = self.target_speed(seen), seen.me
        if me.turn is Turn.STRAIGHT or me.station > seen.itinerary.length:
            return normal
        slow = TURN_SHARE * normal
        return min(normal, math.sqrt(slow * slow - 2.0 * _TURN_EASE * min(me.station, 0.0)))

    def _approach(self, seen: Observation, distance: float) -> float:
        """Return the target speed of a vehicle that stops in `distance` [m] [m/s]."""
        halt = self._constants.halt
        if distance <= halt:
            return 0.0
        # The law of the original needs more than the brakes can do; a lower speed keeps within the brakes.
        possible = self.stopping_speed(distance - halt, self._constants.braking * seen.vehicle.brake[seen.aggression - 1])
        return min(seen.speed_limit, possible, seen.speed_limit * distance / SLOW)

    def _pursue(self, seen: Observation, target: float) -> float:
        """Return the acceleration with which the speed follows `target` [m/s^2].

        The speed follows a lower target at the full rate, and a higher target at a growing rate. The share of the drive force is
        the ratio of the resulting acceleration to the greatest acceleration of the original from rest.
        """
        error = target - seen.me.speed
        rate = RATES[seen.aggression - 1]
        if error <= 0.0:
            return rate * error
        rate = ADVANCE + (rate - ADVANCE) * min((seen.time - self._since) / RAMP, 1.0)
        return seen.vehicle.drive * min(rate * error / (ADVANCE * seen.speed_limit), 1.0)


def listed(seen: Observation) -> bool:
    """Return whether a left turn beyond its line yields to a vehicle on its list (I5).

    The list holds only the opposite lane through the junction and the road before this lane. Vehicles that go straight on count
    on the road and in the junction. Vehicles that turn right count only on the road.
    """
    return any(
        (other.zone is Zone.JUNCTION and other.turn is Turn.STRAIGHT and in_the_way(seen, other))
        or (other.zone in (Zone.APPROACH, Zone.ENTRANCE) and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
        if (seen.me.entrance, other.entrance) in seen.junction.opposite
    )


def oncoming(seen: Observation) -> bool:
    """Return whether a left turn has to wait before its line, for vehicles without I5."""
    for other in seen.others:
        if in_the_way(seen, other):
            return True
        if (seen.me.entrance, other.entrance) in seen.junction.opposite and other.turn is not Turn.LEFT and _comes(seen, other):
            return True
    return False


def prior_on_red(seen: Observation) -> bool:
    """Return whether a right turn on red has to wait, for vehicles without I4."""
    for other in seen.others:
        if in_the_way(seen, other):
            return True
        if (seen.me.entrance, other.entrance) in seen.junction.right_of and _comes(seen, other):
            return True
    return False


def _comes(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is about to enter the junction: its light is not red, or the vehicle is not about to stand."""
    if other.zone is not Zone.APPROACH and other.zone is not Zone.ENTRANCE:
        return False
    if seen.lights[other.entrance] is Colour.RED and other.speed < 1.0:
        return False
    return other.station > -NEAR
