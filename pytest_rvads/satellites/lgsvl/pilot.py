"""The LGSVL-like autopilot: the driver of a vehicle, and the traffic system with the paper's five deficiencies as switches.

"Original" refers to the controller of the LGSVL simulator. Like the original, a driver chooses a target speed, decides whether to
stop at the line, and yields at lights. The original changes the speed toward the target with accelerations up to 19 m/s^2, which
no car reaches. In this package, the rates of the original determine which shares of the drive and brake forces of a car are
applied.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.interface import Control, Drives, Observation, TrafficSystem
from pytest_rvads.drivers.spacing import clear_of_bodies
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Agent, Colour, VehicleState, Zone
from pytest_rvads.satellites.lgsvl.scheduler import (
    ADVANCE,
    DECIDE,
    HOLD,
    RAMP,
    RATES,
    SLOW,
    TURN_SHARE,
    TURN_WAIT,
    Constants,
    Guarded,
    Scheduler,
    zone_of,
)

NEAR = 45.0
"""Only vehicles that are at most this far from the junction can have priority [m]: about five seconds at full speed."""
_SLOW = 0.05
"""Speed below which a vehicle that creeps to its stop counts as standing [m/s]."""
_TURN_EASE = 3.0
"""Deceleration before a turn [m/s^2]; the original enters turns at full speed, at which a car would slide."""


class Switches(NamedTuple):
    """Switches for the five deficiencies of the LGSVL autopilot in the paper's table."""

    i1: bool = True
    """The vehicle sets off before the driver knows about the stop sign."""
    i2: bool = True
    """The scheduler mistakes a hidden box for the junction."""
    i3: bool = True
    """The scheduler ignores ties: the creation order decides."""
    i4: bool = True
    """The vehicle turns right on red after a waiting time, without regard to other vehicles."""
    i5: bool = True
    """On a left turn, the vehicle yields only to some oncoming vehicles, and only after it has crossed the line."""


class Pilot(Follower):
    """The driver of one vehicle in the LGSVL-like traffic system; all vehicles of a run share the scheduler."""

    def __init__(self, switches: Switches, constants: Constants, scheduler: Scheduler) -> None:
        super().__init__()
        self._has = switches
        self._constants = constants
        self._scheduler = scheduler
        self._zone: Guarded | None = None
        self._free = False
        """Whether the driver has decided to cross the line."""
        self._decided = False
        """Whether the driver has looked at the light."""
        self._has_left = False
        """Whether the vehicle has left the zone of the scheduler."""
        self._joined: float | None = None
        """Time at which the vehicle joined the queue [s]."""
        self._stood: float | None = None
        """Time at which the vehicle stopped at a light [s]."""
        self._green: float | None = None
        """Time at which the waiting vehicle first observed green [s]."""
        self._since = 0.0
        """Time at which the vehicle began to accelerate to a higher target speed [s]."""

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering; a decision to cross the line takes effect one tick later."""
        everybody, seen = seen, seen.on_movements()
        me = seen.me
        free = self._free
        stops = seen.junction.control is not JunctionControl.LIGHTS
        if stops:
            self._attend_sign(seen)
        elif not free:
            self._attend_light(seen)
        distance = seen.itinerary.line - me.station
        # A vehicle farther from the line would drive in the first ticks with and without deficiency I1.
        launching = self._has.i1 and distance <= self._constants.halt and seen.time < self._constants.launch - 1e-9
        if free or launching:
            if not stops and me.turn is Turn.LEFT and not launching:
                if self._has.i5:
                    yields = me.zone is Zone.JUNCTION and listed(seen)
                else:
                    yields = me.zone <= Zone.ENTRANCE and oncoming(seen)
                if yields:
                    return self.drive(seen, -math.inf if me.speed < _SLOW else self._pursue(seen, 0.0))
            target = self.target_speed(seen)
            if me.turn is not Turn.STRAIGHT and me.station <= seen.itinerary.length:
                slow = TURN_SHARE * target
                target = min(target, math.sqrt(slow * slow - 2.0 * _TURN_EASE * min(me.station, 0.0)))
            acceleration = self._pursue(seen, target)
            if everybody.others and me.speed > _SLOW:
                acceleration = min(acceleration, clear_of_bodies(everybody, self.track(seen)))
        else:
            target, halt = 0.0, self._constants.halt
            if distance > halt:
                # The target speed of the original would need more braking than a car has, so the brakes limit the speed.
                brake = self._constants.braking * seen.vehicle.brake[seen.aggression - 1]
                target = min(seen.speed_limit, self.stopping_speed(distance - halt, brake), seen.speed_limit * distance / SLOW)
            if target <= 0.0 and me.speed < STANDING and seen.time >= self._constants.launch:
                return self.drive(seen, -math.inf)
            acceleration = self._pursue(seen, target)
        return self.drive(seen, acceleration)

    def _attend_sign(self, seen: Observation) -> None:
        """Join the queue at the stop sign, go when the scheduler calls, and tell the scheduler when the vehicle has left."""
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
            self._free, self._since = True, seen.time

    def _attend_light(self, seen: Observation) -> None:
        """Look at the light once, at a distance; if it is not green, stop, and wait for green or to turn right on red."""
        me = seen.me
        colour = seen.lights[me.entrance]
        if not self._decided:
            if seen.itinerary.line - me.station > DECIDE:
                return
            self._decided = True
            if colour is Colour.GREEN:
                self._free, self._since = True, seen.time
                return
        if me.zone is Zone.APPROACH:
            return
        if self._stood is None and me.speed < _SLOW:
            self._stood = seen.time
        if colour is Colour.GREEN and self._green is None:
            self._green = seen.time
        # A right turn goes at green, or at red after a waiting time. A left turn goes a waiting time after green.
        if me.turn is Turn.RIGHT:
            waited = self._stood is not None and seen.time - self._stood >= seen.wait - 1e-9
            goes = colour is Colour.GREEN or (waited and (self._has.i4 or not prior_on_red(seen)))
        else:
            extra = min(max(seen.wait, TURN_WAIT[0]), TURN_WAIT[1]) if me.turn is Turn.LEFT else 0.0
            goes = self._green is not None and seen.time - self._green >= extra - 1e-9
        if goes:
            self._free, self._since = True, seen.time

    def _pursue(self, seen: Observation, target: float) -> float:
        """Return the acceleration toward the speed `target` [m/s^2].

        Speed differences are corrected at the full rate if the target is lower, and at a growing rate if it is higher. The share
        of the drive force is the acceleration of the original divided by its acceleration from rest to the speed limit.
        """
        error = target - seen.me.speed
        rate = RATES[seen.aggression - 1]
        if error <= 0.0:
            return rate * error
        rate = ADVANCE + (rate - ADVANCE) * min((seen.time - self._since) / RAMP, 1.0)
        return seen.vehicle.drive * min(rate * error / (ADVANCE * seen.speed_limit), 1.0)


def listed(seen: Observation) -> bool:
    """Return whether a driver with deficiency I5, on a left turn beyond its line, yields to an oncoming vehicle.

    The driver yields to vehicles on the approach that do not turn left, and to vehicles in the junction that go straight on.
    """
    return any(
        (other.zone is Zone.JUNCTION and other.turn is Turn.STRAIGHT and in_the_way(seen, other))
        or (other.zone in (Zone.APPROACH, Zone.ENTRANCE) and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
        if (seen.me.entrance, other.entrance) in seen.junction.opposite
    )


def oncoming(seen: Observation) -> bool:
    """Return whether a driver without deficiency I5 has to wait on a left turn."""
    me, opposite = seen.me, seen.junction.opposite
    return any(
        in_the_way(seen, other)
        or ((me.entrance, other.entrance) in opposite and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
    )


def prior_on_red(seen: Observation) -> bool:
    """Return whether a driver without deficiency I4 has to wait on a right turn on red."""
    me, right_of = seen.me, seen.junction.right_of
    return any(
        in_the_way(seen, other) or ((me.entrance, other.entrance) in right_of and _comes(seen, other)) for other in seen.others
    )


def _comes(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is near the junction and about to enter; a vehicle that nearly stands at red is not."""
    if other.zone is not Zone.APPROACH and other.zone is not Zone.ENTRANCE:
        return False
    if seen.lights[other.entrance] is Colour.RED and other.speed < 1.0:
        return False
    return other.station > -NEAR


class LgsvlLike(TrafficSystem):
    """A calibrated surrogate of the controller that the paper examined, on vehicles with real dynamics.

    Args:
        i1: whether a vehicle sets off before its driver knows about the stop sign.
        i2: whether the scheduler mistakes a hidden box for the junction.
        i3: whether the scheduler ignores which vehicle is on the right when two vehicles arrive together.
        i4: whether a vehicle turns right on red after a waiting time, without regard to other vehicles.
        i5: whether a vehicle on a left turn yields only to some oncoming vehicles.
        constants: the constants whose values were fitted.

    Example:
        >>> from functools import partial
        >>> without_hidden_zone = partial(LgsvlLike, i2=False)
    """

    def __init__(
        self,
        *,
        i1: bool = True,
        i2: bool = True,
        i3: bool = True,
        i4: bool = True,
        i5: bool = True,
        constants: Constants | None = None,
    ) -> None:
        self.switches = Switches(i1, i2, i3, i4, i5)
        self.constants = constants or Constants()

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return one autopilot per agent, in the order of `agents`, with a common scheduler."""
        scheduler = Scheduler((agent.name for agent in agents), self.switches.i3)
        return [Pilot(self.switches, self.constants, scheduler) for _ in agents]
