"""How one LGSVL-like vehicle drives: a target speed, and the decision to stop at the line or not.

Only decisions are taken over. The motion law of the original, a first-order pursuit of the target at up to 19 m/s^2, is
no car's; here its rates ask the drive and the brake of a real one for their share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.lgsvl.constants import ADVANCE, DECIDE, HOLD, RAMP, RATES, SLOW, TURN_SHARE, TURN_WAIT, Constants
from pytest_rvads.drivers.lgsvl.courtesy import listed, oncoming, prior_on_red
from pytest_rvads.drivers.lgsvl.scheduler import Scheduler
from pytest_rvads.drivers.lgsvl.zone import Guarded, zone_of
from pytest_rvads.drivers.spacing import clear_of_bodies
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["Pilot", "Switches"]

_SLOW = 0.05
"""Slower than this a vehicle counts as standing while it creeps to its stop [m/s]."""
_TURN_EASE = 3.0
"""Deceleration towards a turn [m/s^2]; the original enters turns at full speed, where a car would slide."""


class Switches(NamedTuple):
    """The deficiencies of the paper's table, each on or off."""

    i1: bool = True
    """Sets off before the driver knows about the stop sign."""
    i2: bool = True
    """Takes a hidden box for the junction."""
    i3: bool = True
    """Ignores ties: creation order decides."""
    i4: bool = True
    """Turns right on red after a time, without looking."""
    i5: bool = True
    """Yields by an incomplete list, after crossing the line."""


class Pilot(Follower):
    """One vehicle.

    Args:
        switches: its deficiencies.
        constants: the free constants.
        scheduler: shared by all vehicles of the run.
    """

    def __init__(self, switches: Switches, constants: Constants, scheduler: Scheduler) -> None:
        super().__init__()
        self._has = switches
        self._constants = constants
        self._scheduler = scheduler
        self._zone: Guarded | None = None
        self._free = False
        """The line no longer holds it."""
        self._decided = False
        self._left = False
        self._joined: float | None = None
        self._stood: float | None = None
        self._green: float | None = None
        self._since = 0.0
        """Since when it follows a higher target than before [s]."""

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering; what is found out in this tick takes effect in the next one."""
        me = seen.me
        free = self._free
        stops = seen.junction.control is not JunctionControl.LIGHTS
        if stops:
            self._attend_sign(seen)
        elif not free:
            self._attend_light(seen)
        distance = seen.itinerary.line - me.station
        # Farther out the flag would not change what the first ticks do.
        launching = self._has.i1 and distance <= self._constants.halt and seen.time < self._constants.launch - 1e-9
        if free or launching:
            if not stops and me.turn is Turn.LEFT and not launching and self._yields(seen):
                return self.drive(seen, -math.inf if me.speed < _SLOW else self._pursue(seen, 0.0))
            wanted = self._pursue(seen, self._cruise(seen))
            if seen.others and me.speed > _SLOW:
                wanted = min(wanted, clear_of_bodies(seen, self.track(seen)))
        else:
            target = self._approach(seen, distance)
            if target <= 0.0 and me.speed < STANDING and seen.time >= self._constants.launch:
                return self.drive(seen, -math.inf)
            wanted = self._pursue(seen, target)
        return self.drive(seen, wanted)

    def _attend_sign(self, seen: Observation) -> None:
        """Join the queue at the line, go when called, and hand over when out of the zone."""
        if self._left:
            return
        me = seen.me
        if self._zone is None:
            self._zone = zone_of(seen.junction, self._constants, self._has.i2)
        if self._free:
            gone = me.station - me.length > seen.itinerary.length
            self._left = self._scheduler.leaves(me, self._zone, gone)
            return
        if self._joined is None:
            if me.zone is Zone.APPROACH:
                return
            self._joined = seen.time
            self._scheduler.join(seen)
        if seen.time - self._joined >= HOLD - 1e-9 and self._scheduler.calls(seen, self._zone):
            self._release(seen)

    def _attend_light(self, seen: Observation) -> None:
        """Look at the light once; when it did not show green, stop and wait for it, or for the time of a right turn."""
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
        if self._waited(seen, colour):
            self._release(seen)

    def _waited(self, seen: Observation, colour: Colour) -> bool:
        """Return whether one that stopped at a light may go: a right turn after a time, the others some time after green."""
        if seen.me.turn is Turn.RIGHT:
            waited = self._stood is not None and seen.time - self._stood >= seen.wait - 1e-9
            return colour is Colour.GREEN or (waited and (self._has.i4 or not prior_on_red(seen)))
        extra = min(max(seen.wait, TURN_WAIT[0]), TURN_WAIT[1]) if seen.me.turn is Turn.LEFT else 0.0
        return self._green is not None and seen.time - self._green >= extra - 1e-9

    def _release(self, seen: Observation) -> None:
        self._free = True
        self._since = seen.time

    def _yields(self, seen: Observation) -> bool:
        """Return whether a left turn that may go gives way."""
        if self._has.i5:
            return seen.me.zone is Zone.JUNCTION and listed(seen)
        return seen.me.station <= 0.0 and oncoming(seen)

    def _cruise(self, seen: Observation) -> float:
        """Return the target speed of a vehicle that need not stop [m/s]."""
        normal, me = self.target_speed(seen), seen.me
        if me.turn is Turn.STRAIGHT or me.station > seen.itinerary.length:
            return normal
        slow = TURN_SHARE * normal
        return min(normal, math.sqrt(slow * slow - 2.0 * _TURN_EASE * min(me.station, 0.0)))

    def _approach(self, seen: Observation, distance: float) -> float:
        """Return the target speed of a vehicle that stops `distance` metres ahead [m/s]."""
        halt = self._constants.halt
        if distance <= halt:
            return 0.0
        # The original's law needs more than the brakes have; this much earlier they manage.
        possible = self.stopping_speed(distance - halt, self._constants.braking * seen.vehicle.brake[seen.aggression - 1])
        return min(seen.speed_limit, possible, seen.speed_limit * distance / SLOW)

    def _pursue(self, seen: Observation, target: float) -> float:
        """Return the acceleration with which the speed follows `target` [m/s^2].

        A lower target is followed at the full rate. A higher one at a rate that grows; the drive is asked for the share
        of its force that this is of the original's greatest acceleration from rest.
        """
        error = target - seen.me.speed
        rate = RATES[seen.aggression - 1]
        if error <= 0.0:
            return rate * error
        rate = ADVANCE + (rate - ADVANCE) * min((seen.time - self._since) / RAMP, 1.0)
        return seen.vehicle.drive * min(rate * error / (ADVANCE * seen.speed_limit), 1.0)
