"""A base class for autopilots: it steers along the itinerary, and the autopilot decides only how fast to drive.

Steering is pure pursuit on the rear axle (Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992). A
proportional controller that compensates the resistance of tyres and air keeps the speed.
"""

from __future__ import annotations

import math

from pytest_rvads.drivers.interface import Autopilot, Control, Observation
from pytest_rvads.drivers.way_ahead import EASE, AxlePath, Track, axle_path, track
from pytest_rvads.geometry.segment import Piece
from pytest_rvads.runs.states import GRAVITY, Vehicle, VehicleState

_GAIN = 4.0
"""Acceleration per difference between target speed and speed [1/s]."""
_FIRM = 3.0
"""Highest deceleration with which the vehicle brakes for a bend [m/s^2]."""
_HOLD = 2.5
"""Deceleration for which the brake is set to end a stop, and to hold the vehicle [m/s^2]."""
_BACK, _BACK_TIME = 0.6, 0.3
"""The rear axle returns to a planned path within about `_BACK` [m] plus the distance driven in `_BACK_TIME` [s].

Measured: with 1.2 m instead of 0.6 m, a car leaves the path by 2.6 cm where the front wheels turn at their highest rate.
"""
_NEAR = 2.0
"""The rear axle is searched on its path within this distance of its position in the step before [m]."""
STANDING = 0.01
"""A vehicle slower than this stands [m/s]."""


class Follower(Autopilot):
    """An autopilot that follows its itinerary at the speed that `target_speed` returns, and more slowly in bends.

    Example:
        >>> class Cruiser(Follower):
        ...     def target_speed(self, seen: Observation) -> float:
        ...         line = seen.itinerary.line - seen.me.station
        ...         return self.stopping_speed(line - 0.5) if line > 0 else 5.0
    """

    # These are attributes of the class, so that the constructor of a subclass need not call a constructor of this class.
    _steering = 0.0
    _track: Track | None = None
    _wheels: tuple[float, float] | None = None
    """Distances from reference point to rear axle and from rear axle to front axle [m]; None until they are needed."""
    _way: AxlePath | None = None
    """The planned path of the rear axle if the itinerary has a narrow bend; None if the rear axle follows the itinerary."""
    _axle = 0.0
    """Distance of the rear axle along its planned path in the step before [m]."""
    _piece = Piece(math.inf, -math.inf, 0.0, 0.0, 0.0, 0.0, 0.0)
    """The piece of the itinerary to which the vehicle steers, kept because the piece stays the same for many steps."""

    def target_speed(self, seen: Observation) -> float:
        """Return the speed to drive on a straight road [m/s]; 0 stops and holds the vehicle.

        The default is the speed limit. Before a lower limit begins, the default decreases in time, so that the vehicle keeps the
        lower limit from its first metre on.
        """
        me, limits, speed = seen.me, seen.itinerary.limits, seen.speed_limit
        if len(limits) > 1:
            begun = me.station + me.speed * (1.0 / _GAIN + seen.vehicle.brake_lag)  # the speed lags behind its target
            for border, _ in limits:
                if border > me.station:
                    slower = math.hypot(seen.itinerary.limit_at(border), self.stopping_speed(border - begun, EASE))
                    speed = min(speed, slower)
        return speed

    def stopping_speed(self, distance: float, deceleration: float = 2.0) -> float:
        """Return the speed [m/s] from which braking at `deceleration` [m/s^2] needs `distance` [m], sqrt(2 a d); 0 if d <= 0."""
        return math.sqrt(2.0 * deceleration * distance) if distance > 0.0 else 0.0

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering for the next step.

        Raises:
            ValueError: `target_speed` returned a negative number, or a number that is not finite.
        """
        target = self.target_speed(seen)
        if not 0.0 <= target < math.inf:
            raise ValueError(f"target_speed returned {target!r}, expected a finite speed of 0 m/s or more")
        return self.drive(seen, self.towards(seen, target))

    def towards(self, seen: Observation, target: float) -> float:
        """Return the acceleration [m/s^2] toward the speed `target` [m/s], or toward a lower speed that a bend requires."""
        speed = seen.me.speed
        if target <= 0.0 and speed < 0.3:
            return -math.inf
        acceleration = _GAIN * (target - speed)
        bend = _GAIN * ((self._track or self.track(seen)).speed(seen.me.station) - speed)
        # Comparisons replace min and max in this class, because they are faster and run for every vehicle in every step.
        firm = bend if bend >= -_FIRM else -_FIRM
        return firm if firm < acceleration else acceleration

    def track(self, seen: Observation) -> Track:
        """Return the points of the itinerary with the highest speed at each point, computed at the first call."""
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
        """Return throttle, brake and steering for `acceleration` [m/s^2] along the itinerary; -inf holds a standing vehicle."""
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
        """Return the angle of the front wheels [rad] that leads the rear axle to the itinerary, or to the planned path."""
        me = seen.me
        if self._wheels is None:
            self.track(seen)
            self._wheels = seen.vehicle.rear_axle_offset, seen.vehicle.wheelbase
        back, wheelbase = self._wheels
        if self._way is not None and self._way.pace[0][0] <= me.station - back <= self._way.pace[-1][0]:
            # In a narrow bend, the station of the front does not determine the position of the rear axle, so the rear axle is
            # projected onto its path. The angle follows the curvature of the path, and corrects offset and heading without
            # overshooting.
            x, y = me.x - back * math.cos(me.heading), me.y - back * math.sin(me.heading)
            self._axle, offset = self._way.path.project(x, y, self._axle, _NEAR)
            heading, bend = self._way.at(self._axle)
            within = _BACK + _BACK_TIME * me.speed
            bend -= (2.0 * math.sin(me.heading - heading) + offset / within) / within
            self._steering = math.atan(wheelbase * bend)
            return self._steering
        path, aim = seen.itinerary.path, me.station - back + lookahead(me.speed) + seen.itinerary.origin
        piece = self._piece
        if not piece.start <= aim < piece.end:
            self._piece = piece = path.piece(aim)
        aim -= piece.start
        self._steering = steering = pursue(me, back, wheelbase, piece.x + aim * piece.ux, piece.y + aim * piece.uy)
        return steering


def resistance(vehicle: Vehicle, speed: float) -> float:
    """Return the deceleration that tyres and air cause at `speed` [m/s] without braking [m/s^2]."""
    return vehicle.rolling * GRAVITY + vehicle.drag * speed * speed / vehicle.mass


def lookahead(speed: float) -> float:
    """Return the distance [m] along the itinerary from the rear axle to the point that the driver steers to at `speed` [m/s]."""
    ahead = 0.35 * speed + 1.5
    return ahead if ahead > 2.5 else 2.5


def pursue(me: VehicleState, back: float, wheelbase: float, x: float, y: float) -> float:
    """Return the angle of the front wheels [rad] at which the rear axle, `back` behind the front [m], circles to (x, y) [m]."""
    heading = me.heading
    cos, sin = math.cos(heading), math.sin(heading)
    dx = x - me.x + back * cos
    dy = y - me.y + back * sin
    offset = dy * cos - dx * sin
    return math.atan2(2.0 * wheelbase * offset, dx * dx + dy * dy)
