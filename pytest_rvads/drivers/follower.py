"""A base class for autopilots: it steers along the itinerary, and the autopilot decides only how fast to drive.

Steering is pure pursuit on the rear axle (Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992). A
proportional controller that compensates the resistance of tyres and air keeps the speed.

The itinerary is a `Track`: a table with a row per metre, with points and the highest speed that bends allow. In a narrow bend,
where the rear axle must leave the centre line, a driver steers the rear axle along a planned path. The speed on this path is
limited by the rate at which the front wheels can turn.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pytest_rvads.drivers.interface import Autopilot, Control, Observation
from pytest_rvads.geometry.segment import SPEED_LIMIT, Piece, Pose, Segment
from pytest_rvads.geometry.sweep import STEP, Course, Plan, plan, with_roads
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import GRAVITY, Vehicle, VehicleState

QUICK = 0.7
"""Largest share of the vehicle's steering rate that a planned path uses."""
CALM = 0.7
"""Largest lateral acceleration on a planned path [m/s^2]: at 2.5 m/s^2, tyres slip and the rear axle leaves the path by 4 cm."""


class Pace(NamedTuple):
    """The highest speed at a place of a planned path."""

    station: float
    """Station of the rear axle on the itinerary [m]."""
    speed: float
    """Highest speed [m/s]."""


class AxlePath(NamedTuple):
    """The planned path of a rear axle that leaves the centre line of the itinerary."""

    path: Segment
    headings: tuple[float, ...]
    """Heading at every point of the path, without jumps [rad]."""
    bends: tuple[float, ...]
    """Curvature at every point [1/m]."""
    pace: tuple[Pace, ...]
    poses: tuple[Pose, ...]
    """Poses of the rear axle at the stations of `pace`."""

    def at(self, along: float) -> tuple[float, float]:
        """Return heading [rad] and curvature [1/m] of the path at the distance `along` from its start [m]."""
        table = self.path.stations
        k = min(max(bisect_right(table, along), 1), len(table) - 1)
        share = (along - table[k - 1]) / (table[k] - table[k - 1])
        (heading, next_heading), (bend, next_bend) = self.headings[k - 1 : k + 1], self.bends[k - 1 : k + 1]
        return float(heading + share * (next_heading - heading)), float(bend + share * (next_bend - bend))


@lru_cache(maxsize=256)
def axle_path(itinerary: Itinerary, vehicle: Vehicle, lane_width: float, start: float = -math.inf) -> AxlePath | None:
    """Return a path of the rear axle, from the front at `start` on [m], on which the body of a vehicle stays in its lane.

    The path is None if the body stays in the lane while the rear axle follows the centre line.
    """
    course = itinerary.course(lane_width, start)
    if start <= 0.0:
        course = with_roads(course, start, vehicle.body)
    planned = plan(course, vehicle.body)
    if planned is None:
        return None
    path = Segment(f"{course.path.id} rear axle", planned.points, course.path.turn)
    along = np.gradient(path.points, axis=0)
    headings = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    bends = np.gradient(headings, path.stations)
    poses = tuple(path.pose(along) for along in path.stations.tolist())
    return AxlePath(path, tuple(headings.tolist()), tuple(bends.tolist()), _pace(planned, vehicle), poses)


def _pace(planned: Plan, vehicle: Vehicle) -> tuple[Pace, ...]:
    change = np.abs(np.diff(planned.bend, append=0.0)) / STEP
    turning = QUICK * vehicle.steering_rate / (vehicle.wheelbase * np.maximum(change, 1e-3))
    pace = np.minimum(turning, np.sqrt(CALM / np.maximum(np.abs(planned.bend), 1e-3)))
    return tuple(map(Pace, planned.stations.tolist(), pace.tolist()))


BEND = 2.5
"""Lateral acceleration with which bends are driven [m/s^2]."""
EASE = 2.0
"""Deceleration with which a vehicle slows down before a bend or a lower speed limit [m/s^2]."""
_BEFORE = 60.0
"""Largest distance before the junction at which a table begins if no limit is above `SPEED_LIMIT` [m]."""


class Track:
    """The table of an itinerary, with a row per metre: points, poses of the rear axle, and the highest speed.

    The rear axle, `axle` behind the reference point [m], leaves a bend later; it follows the planned path `way`, or the
    itinerary.
    """

    def __init__(self, itinerary: Itinerary, axle: float, way: AxlePath | None = None) -> None:
        self._first = -itinerary.origin
        if all(itinerary.limit_at(station) <= SPEED_LIMIT for station, _ in itinerary.limits):
            self._first = max(self._first, -_BEFORE)
        count = max(math.ceil(itinerary.end - self._first), 1)
        poses = [itinerary.pose(self._first + k) for k in range(-3, count + 4)]
        self._places = [(x, y) for x, y, _ in poses[3:-3]]
        limits = _bends(poses, axle)
        self.planned = way is not None
        """Whether the rear axle follows a planned path, so that the body of the vehicle is not centred on the itinerary."""
        self._axles = [itinerary.pose(self._first + k - axle) for k in range(len(limits))]
        for (station, speed), pose in zip(way.pace, way.poses, strict=True) if way else ():
            k = min(max(int(station + axle - self._first), 0), len(limits) - 1)
            limits[k] = min(limits[k], speed)
            self._axles[k] = pose
        for k in range(len(limits) - 2, -1, -1):
            limits[k] = min(limits[k], math.sqrt(limits[k + 1] ** 2 + 2.0 * EASE))
        self._limits = limits

    def speed(self, station: float) -> float:
        """Return the highest speed [m/s] at `station` [m] from which the vehicle can slow down for all bends ahead."""
        k = int(station - self._first)
        limits = self._limits
        return limits[k if 0 <= k < len(limits) else -1 if k > 0 else 0]

    def slowest(self, length: float) -> float:
        """Return the lowest of the highest speeds [m/s] on the movement, given its length [m]."""
        return min(self.speed(float(station)) for station in range(math.ceil(length) + 1))

    def places(self, station: float, reach: float) -> list[tuple[float, float]]:
        """Return the points (x, y) [m] of the itinerary, one per metre, for `reach` metres from `station` [m] on."""
        k = max(int(station - self._first) + 1, 0)
        return self._places[k : k + int(reach)]

    def axles(self, station: float, reach: float) -> list[Pose]:
        """Return the poses of the rear axle for each of the positions of the front that `places` returns."""
        k = max(int(station - self._first) + 1, 0)
        return self._axles[k : k + int(reach)]


def _bends(poses: Sequence[Pose], axle: float) -> list[float]:
    """Return the highest speed in bends [m/s] at each pose but the first three and the last three."""
    # The headings of chords of two metres, four metres apart, are compared, so that neither the corners of a polyline nor the
    # overlap of two lanes at their joint counts as a bend.
    headings = [math.atan2(b.y - a.y, b.x - a.x) for a, b in zip(poses, poses[2:], strict=False)]
    changes = [(b - a + math.pi) % (2 * math.pi) - math.pi for a, b in zip(headings, headings[4:], strict=False)]
    raw = [math.sqrt(BEND * 4.0 / abs(change)) if abs(change) > 1e-3 else math.inf for change in changes]
    trail = math.ceil(axle)
    return [min(raw[max(k - trail, 0) : k + 1]) for k in range(len(raw))]


@lru_cache(maxsize=1024)  # many scenarios have the same starts
def fastest(line: Segment, first: float, last: float, vehicle: Vehicle, lane_width: float) -> float:
    """Return the highest speed [m/s] at which all vehicles of a queue can start so that they can slow down for the bends ahead.

    The queue reaches from station `first` to `last` [m]. If the rear axle has to leave the centre line in a bend, the speed is
    also limited by the planned path.
    """
    axle = vehicle.rear_axle_offset
    trail = math.ceil(axle)
    poses = [line.pose(first + k) for k in range(-trail - 3, math.ceil(line.length - first) + 4)]
    speeds = [*enumerate(_bends(poses, axle)[trail:])]
    planned = plan(Course(line, line.length, 0.0, first - line.length, lane_width, 0.0), vehicle.body)
    for station, speed in _pace(planned, vehicle) if planned else ():
        speeds.append((max(int(station + axle + line.length - first), 0), speed))
    return min(math.sqrt(speed**2 + 2.0 * EASE * max(first + k - last, 0.0)) for k, speed in speeds)


@lru_cache(maxsize=256)  # many runs have the same itineraries
def track(itinerary: Itinerary, axle: float, way: AxlePath | None = None) -> Track:
    """Return the table of an itinerary, from a cache if it was built before; see `Track`."""
    return Track(itinerary, axle, way)


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
                self._way, self._axle = way, seen.me.station - back - way.pace[0].station
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
        if self._way is not None and self._way.pace[0].station <= me.station - back <= self._way.pace[-1].station:
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
