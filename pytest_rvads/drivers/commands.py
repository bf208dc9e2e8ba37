"""The commands of autopilots: their check, and the tracking controller, which turns commands into throttle, brake and steering.

The check requires that the numbers of a command are of the right type, finite and in range. The controller executes the commands
that name a target speed, an acceleration or a trajectory.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from itertools import pairwise
from numbers import Real
from typing import Any, get_args

from pytest_rvads.drivers.follower import Follower, lookahead, pursue
from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory, Waypoint

MAX_SPEED = 70.0
"""Greatest speed of a command [m/s]; a greater value is a mistake of units."""
TOLERANCE = 1e-6
"""Throttle and brake outside of 0..1 by at most this rounding error are accepted and clamped."""
POINTS = 10_000
"""Largest number of points of a trajectory, so that a generator without an end is refused."""

PLACE_GAIN, SPEED_GAIN = 1.5, 2.5
"""Acceleration of the controller per metre that a vehicle is behind its target [1/s^2], and per m/s that it is too slow [1/s].
The motion toward the target is critically damped."""
_SHORT = 0.05
"""Least distance between two points of a trajectory at which they determine a direction [m]."""
_STOP = 0.05
"""A vehicle at the end of its trajectory that is slower than this is held [m/s]."""


class UnfitCommand(Exception):
    """A command of an autopilot is invalid. The text of the error follows the word "returned" in a message.

    The text contains no repr of a value, because a repr may contain an address and the text is part of the hash of a run.
    """


def plain(answer: Any) -> Command:
    """Return the command that an autopilot returned, with its numbers as floats, and throttle and brake clamped to 0..1."""
    match answer:
        case Control():
            throttle, brake, steering = (_finite(value, name, "a ") for name, value in zip(Control._fields, answer, strict=True))
            for name, value in (("throttle", throttle), ("brake", brake)):
                if not -TOLERANCE <= value <= 1.0 + TOLERANCE:
                    raise UnfitCommand(f"{name} {value:g}, expected 0..1")
            if abs(steering) > math.pi / 2:
                raise UnfitCommand(f"steering {steering:g}, expected radians within -pi/2..pi/2 (was it in degrees?)")
            return Control(min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0), steering)
        case TargetSpeed(speed):
            return TargetSpeed(_within(speed, "a target speed", 0.0, MAX_SPEED, "m/s"))
        case Acceleration(acceleration, steering):
            half = math.pi / 2
            angle = None if steering is None else _within(steering, "a steering", -half, half, "rad")
            return Acceleration(_quantity(acceleration, "an acceleration"), angle)
        case Trajectory(points):
            return Trajectory(tuple(_waypoints(points)))
    kinds = " or ".join(kind.__name__ for kind in get_args(Command))
    raise UnfitCommand(f"an object of type {type(answer).__name__}, expected a {kinds}")


def _waypoints(points: Any) -> Iterator[Waypoint]:
    if not isinstance(points, Iterable):
        raise UnfitCommand(f"a trajectory of type {type(points).__name__}, expected a sequence of points")
    before, count = -math.inf, 0
    for number, point in enumerate(points):
        count += 1
        if count > POINTS:
            raise UnfitCommand(f"a trajectory of more than {POINTS:,} points, expected no more")
        if not (isinstance(point, tuple | list) and len(point) == 3):
            raise UnfitCommand(f"a trajectory whose point {number} is of type {type(point).__name__}, expected (time, x, y)")
        values = zip(Waypoint._fields, point, strict=True)
        waypoint = Waypoint(*(_quantity(value, f"a trajectory whose point {number} has {name}") for name, value in values))
        if waypoint.time <= before:
            raise UnfitCommand(f"a trajectory whose point {number} comes at {waypoint.time:g} s, not after the one before it")
        before = waypoint.time
        yield waypoint
    if count < 2:
        raise UnfitCommand(f"a trajectory of {count} points, expected at least 2")


def _within(value: Any, name: str, least: float, most: float, unit: str) -> float:
    number = _quantity(value, name)
    if not least <= number <= most:
        raise UnfitCommand(f"{name} {number:g} {unit}, expected {least:g} to {most:g}")
    return number


def _quantity(value: Any, name: str) -> float:
    if isinstance(value, bool):
        raise UnfitCommand(f"{name} of type bool, expected a number")
    return _finite(value, name)


def _finite(value: Any, name: str, article: str = "") -> float:
    if not isinstance(value, Real):
        raise UnfitCommand(f"{article}{name} of type {type(value).__name__}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise UnfitCommand(f"{name} {number}, expected a finite number")
    return number


class Tracker:
    """Turns the last command of an autopilot into throttle, brake and steering, step by step."""

    def __init__(self) -> None:
        self._follower = Follower()
        self._last: Trajectory | None = None
        self._line: _Line | None = None

    def control(self, command: Command, seen: Observation) -> Control:
        """Return throttle, brake and steering for the next step of the simulation."""
        follower = self._follower
        match command:
            case TargetSpeed(speed):
                return follower.drive(seen, follower.towards(seen, float(speed)))
            case Acceleration(acceleration, None):
                return follower.drive(seen, float(acceleration))
            case Acceleration(acceleration, float() as steering):
                return follower.drive(seen, float(acceleration))._replace(steering=steering)
            case Trajectory():
                if command is not self._last or self._line is None:
                    self._last, self._line = command, _Line(command)
                line, me, vehicle, back = self._line, seen.me, seen.vehicle, seen.vehicle.rear_axle_offset
                place, speed = line.at(seen.time)
                station = line.project(me.x, me.y)
                if speed <= _STOP and me.speed < 0.3 and place - station < _STOP:
                    return follower.drive(seen, -math.inf)
                rise = (line.at(seen.time + vehicle.drive_lag)[1] - speed) / vehicle.drive_lag
                wanted = rise + PLACE_GAIN * (place - station) + SPEED_GAIN * (speed - me.speed)
                x, y = line.point(station - back + lookahead(me.speed))
                return follower.drive(seen, wanted)._replace(steering=pursue(me, back, vehicle.wheelbase, x, y))
        return Control(*command)


class _Line:
    """A trajectory as a polyline with times, which continues straight beyond its ends."""

    def __init__(self, trajectory: Trajectory) -> None:
        points = [tuple(map(float, p)) for p in trajectory.points]
        self._times = [p[0] for p in points]
        self._arcs = [0.0]
        for (_, ax, ay), (_, bx, by) in pairwise(points):
            self._arcs.append(self._arcs[-1] + math.hypot(bx - ax, by - ay))
        # Points that are at least `_SHORT` apart, so that each pair has a direction, with their arc lengths.
        self._corners = [(self._arcs[0], points[0][1], points[0][2])]
        for arc, (_, x, y) in zip(self._arcs[1:], points[1:], strict=True):
            if arc - self._corners[-1][0] > _SHORT:
                self._corners.append((arc, x, y))

    def at(self, time: float) -> tuple[float, float]:
        """Return arc length [m] and speed [m/s] of the trajectory at a time [s]; the speed is 0 from the last point on."""
        times, arcs = self._times, self._arcs
        if time >= times[-1]:
            return arcs[-1], 0.0
        k = min(max(bisect_right(times, time) - 1, 0), len(times) - 2)
        speed = (arcs[k + 1] - arcs[k]) / (times[k + 1] - times[k])
        return arcs[k] + speed * (time - times[k]), speed

    def project(self, x: float, y: float) -> float:
        """Return the arc length of the point of the line that is nearest to (x, y) [m]; negative before the start."""
        least_distance, nearest = math.inf, 0.0
        corners = self._corners
        for k, ((a, ax, ay), (b, bx, by)) in enumerate(pairwise(corners)):
            along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / (b - a)
            along = min(along, b - a) if k < len(corners) - 2 else along
            along = max(along, 0.0) if k else along
            share = along / (b - a)
            distance = math.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay))
            if distance < least_distance:
                least_distance, nearest = distance, a + along
        return nearest

    def point(self, arc: float) -> tuple[float, float]:
        """Return the point at an arc length [m], on a straight continuation beyond the ends.

        If all points of the trajectory are closer than `_SHORT`, the result is always the first point.
        """
        corners = self._corners
        if len(corners) == 1:
            return corners[0][1:]
        k = min(max(bisect_right(corners, arc, key=lambda c: c[0]) - 1, 0), len(corners) - 2)
        (a, ax, ay), (b, bx, by) = corners[k], corners[k + 1]
        share = (arc - a) / (b - a)
        return ax + share * (bx - ax), ay + share * (by - ay)
