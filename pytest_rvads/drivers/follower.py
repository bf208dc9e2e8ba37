"""A base class for autopilots: it follows the itinerary, and the autopilot decides only how fast to drive.

Steering is pure pursuit on the rear axle (Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992). Speed is a
proportional controller that knows the resistances of its vehicle.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.interface import Autopilot, Control, Observation
from pytest_rvads.drivers.way_ahead import EASE, AxlePath, Track, axle_path, track
from pytest_rvads.runs.states import VehicleState
from pytest_rvads.runs.vehicle import GRAVITY, Vehicle

__all__ = ["STANDING", "Follower", "lookahead", "pursue", "resistance"]


_GAIN = 4.0
"""Acceleration asked for per speed error [1/s]."""
_FIRM = 3.0
"""Hardest braking for a bend [m/s^2]."""
_HOLD = 2.5
"""Brake that ends a stop and keeps the vehicle standing [m/s^2]."""
_BACK, _BACK_TIME = 0.6, 0.3
"""Within about how far the rear axle comes back to a planned path [m], and at speed [s].

Measured: with 1.2 m instead of 0.6 m a car errs by 2.6 cm where its wheels turn as fast as they can.
"""
_NEAR = 2.0
"""How far along its path the rear axle is looked for, around its last place [m]."""
STANDING = 0.01
"""A vehicle slower than this stands [m/s]."""


class Follower(Autopilot):
    """Follows its itinerary at the speed that `target_speed` returns, slower in bends.

    Example:
        >>> class Cruiser(Follower):
        ...     def target_speed(self, seen: Observation) -> float:
        ...         line = seen.itinerary.line - seen.me.station
        ...         return self.stopping_speed(line - 0.5) if line > 0 else 5.0
    """

    # Defaults of the class, so that a subclass with a constructor of its own need not call this one.
    _steering = 0.0
    _track: Track | None = None
    _wheels: tuple[float, float] | None = None
    """Distances from reference point to rear axle and from rear axle to front axle [m], looked up once."""
    _way: AxlePath | None = None
    """The path of the rear axle, if a narrow bend makes it differ from the itinerary."""
    _axle = 0.0
    """Last known distance of the rear axle along its path [m]."""
    _piece = (math.inf, -math.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    """The piece of the path at which the vehicle aims; the piece stays the same for many steps."""

    def target_speed(self, seen: Observation) -> float:
        """Return how fast to drive where the road is straight [m/s]; 0 stops and holds the vehicle.

        By default it is the speed limit, less before a lower one, so that the lower limit is kept from its first metre on.
        """
        me, limits, speed = seen.me, seen.itinerary.limits, seen.speed_limit
        if len(limits) > 1:
            begun = me.station + me.speed * (1.0 / _GAIN + seen.vehicle.brake_lag)  # the vehicle is later than its target
            for border, _ in limits:
                if border > me.station:
                    slower = math.hypot(seen.itinerary.limit_at(border), self.stopping_speed(border - begun, EASE))
                    speed = min(speed, slower)
        return speed

    def stopping_speed(self, distance: float, deceleration: float = 2.0) -> float:
        """Return the speed from which braking at `deceleration` [m/s^2] ends after `distance` [m]; 0 from there on."""
        return math.sqrt(2.0 * deceleration * distance) if distance > 0.0 else 0.0

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering.

        Raises:
            ValueError: a target speed that is negative or not finite.
        """
        target = self.target_speed(seen)
        if not 0.0 <= target < math.inf:
            raise ValueError(f"target_speed returned {target!r}, expected a finite speed of 0 m/s or more")
        return self.drive(seen, self.towards(seen, target))

    def towards(self, seen: Observation, target: float) -> float:
        """Return the acceleration [m/s^2] that leads to `target` [m/s], or to what the bend ahead allows."""
        speed = seen.me.speed
        if target <= 0.0 and speed < 0.3:
            return -math.inf
        acceleration = _GAIN * (target - speed)
        bend = _GAIN * ((self._track or self.track(seen)).speed(seen.me.station) - speed)
        # Comparisons instead of min and max here and below: this is asked for every vehicle in every step.
        firm = bend if bend >= -_FIRM else -_FIRM
        return firm if firm < acceleration else acceleration

    def track(self, seen: Observation) -> Track:
        """Return the track of the way ahead, which is computed once."""
        if self._track is None:
            back, way = (
                seen.vehicle.rear_axle_offset,
                axle_path(seen.itinerary, seen.vehicle, seen.junction.lane_width, seen.me.station),
            )
            self._track = track(seen.itinerary, back, way)
            if way:
                self._way, self._axle = way, seen.me.station - back - way.pace[0][0]
        return self._track

    def drive(self, seen: Observation, acceleration: float) -> Control:
        """Return the control that yields `acceleration` [m/s^2] along the itinerary; -inf holds a standing vehicle."""
        vehicle = seen.vehicle
        speed = seen.me.speed
        if acceleration == -math.inf and speed < 0.3:
            brake = _HOLD / vehicle.brake[seen.aggression - 1]
            return Control(0.0, brake if brake < 1.0 else 1.0, self.steer(seen) if speed > STANDING else self._steering)
        needed = acceleration + resistance(vehicle, speed)
        if needed >= 0.0:
            throttle = needed / vehicle.drive
            return Control(throttle if throttle < 1.0 else 1.0, 0.0, self.steer(seen))
        brake = -needed / vehicle.brake[seen.aggression - 1]
        return Control(0.0, brake if brake < 1.0 else 1.0, self.steer(seen))

    def steer(self, seen: Observation) -> float:
        """Return the angle of the front wheels [rad] that leads the rear axle back to the itinerary."""
        me = seen.me
        if self._wheels is None:
            self.track(seen)
            self._wheels = seen.vehicle.rear_axle_offset, seen.vehicle.wheelbase
        back, wheelbase = self._wheels
        if self._way is not None and self._way.pace[0][0] <= me.station - back <= self._way.pace[-1][0]:
            return self._steered(self._way, me, back, wheelbase)
        path, aim = seen.itinerary.path, me.station - back + lookahead(me.speed) + seen.itinerary.origin
        start, end, x, y, ux, uy, _ = self._piece
        if not start <= aim < end:
            self._piece = start, _, x, y, ux, uy, _ = path.piece(aim)
        aim -= start
        self._steering = steering = pursue(me, back, wheelbase, x + aim * ux, y + aim * uy)
        return steering

    def _steered(self, way: AxlePath, me: VehicleState, back: float, wheelbase: float) -> float:
        """Return the angle of the front wheels [rad] that keeps the rear axle on its path.

        In a narrow bend the front swings out and lags behind: its place says nothing of the rear axle's. The curvature is that of
        the path, and what brings offset and heading back without swinging over.
        """
        x, y = me.x - back * math.cos(me.heading), me.y - back * math.sin(me.heading)
        self._axle, offset = way.path.project(x, y, self._axle, _NEAR)
        heading, bend = way.at(self._axle)
        within = _BACK + _BACK_TIME * me.speed
        bend -= (2.0 * math.sin(me.heading - heading) + offset / within) / within
        self._steering = math.atan(wheelbase * bend)
        return self._steering


def resistance(vehicle: Vehicle, speed: float) -> float:
    """Return the deceleration that tyres and air cause at `speed` [m/s] without any brake [m/s^2]."""
    return vehicle.rolling * GRAVITY + vehicle.drag * speed * speed / vehicle.mass


def lookahead(speed: float) -> float:
    """Return how far ahead of the rear axle to aim at `speed` [m/s], along the way [m]."""
    ahead = 0.35 * speed + 1.5
    return ahead if ahead > 2.5 else 2.5


def pursue(me: VehicleState, back: float, wheelbase: float, x: float, y: float) -> float:
    """Return the angle of the front wheels [rad] that leads the rear axle to a point on a circle.

    Args:
        me: the own vehicle.
        back: distance from the reference point to the rear axle [m].
        wheelbase: distance from the rear axle to the front axle [m].
        x: east coordinate of the point [m].
        y: north coordinate of the point [m].
    """
    heading = me.heading
    cos, sin = math.cos(heading), math.sin(heading)
    dx = x - me.x + back * cos
    dy = y - me.y + back * sin
    offset = dy * cos - dx * sin
    return math.atan2(2.0 * wheelbase * offset, dx * dx + dy * dy)
