"""The tracking controller, which turns target speeds, accelerations and trajectories into controls."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise

from pytest_rvads.drivers.follower import Follower, lookahead, pursue
from pytest_rvads.drivers.interface import Acceleration, Command, Control, Observation, TargetSpeed, Trajectory

__all__ = ["PLACE_GAIN", "SPEED_GAIN", "Tracker"]

PLACE_GAIN, SPEED_GAIN = 1.5, 2.5
"""Acceleration per metre behind [1/s^2] and per m/s too slow [1/s]: a critically damped pair."""
_SHORT = 0.05
"""Least distance between two points that give a direction [m]."""
_STOP = 0.05
"""A vehicle slower than this at the end of a trajectory stands [m/s]."""


class Tracker:
    """Turns a held command into a control, step by step."""

    def __init__(self) -> None:
        self._follower = Follower()
        self._last: Trajectory | None = None
        self._line: _Line | None = None

    def control(self, command: Command, seen: Observation) -> Control:
        """Return throttle, brake and steering for this step."""
        follower = self._follower
        match command:
            case TargetSpeed(speed):
                return follower.drive(seen, follower.towards(seen, float(speed)))
            case Acceleration(acceleration, None):
                return follower.drive(seen, float(acceleration))
            case Acceleration(acceleration, float() as steering):
                return follower.drive(seen, float(acceleration))._replace(steering=steering)
            case Trajectory():
                return self._track(command, seen)
        return Control(*command)

    def _track(self, command: Trajectory, seen: Observation) -> Control:
        if command is not self._last or self._line is None:
            self._last, self._line = command, _Line(command)
        line, me, vehicle = self._line, seen.me, seen.vehicle
        place, speed = line.at(seen.time)
        station = line.project(me.x, me.y)
        if speed <= _STOP and me.speed < 0.3 and place - station < _STOP:
            return self._follower.drive(seen, -math.inf)
        soon = line.at(seen.time + vehicle.drive_lag)[1]
        acceleration = (soon - speed) / vehicle.drive_lag + PLACE_GAIN * (place - station) + SPEED_GAIN * (speed - me.speed)
        x, y = line.point(station - vehicle.rear_axle_offset + lookahead(me.speed))
        return self._follower.drive(seen, acceleration)._replace(
            steering=pursue(me, vehicle.rear_axle_offset, vehicle.wheelbase, x, y)
        )


class _Line:
    """A trajectory as a polyline with times; straight on beyond its ends."""

    def __init__(self, trajectory: Trajectory) -> None:
        points = [tuple(map(float, p)) for p in trajectory.points]
        self._times = [p[0] for p in points]
        self._arcs = [0.0]
        for (_, ax, ay), (_, bx, by) in pairwise(points):
            self._arcs.append(self._arcs[-1] + math.hypot(bx - ax, by - ay))
        # Corners that are far enough from each other to have a direction, with their arc lengths.
        self._corners = [(self._arcs[0], points[0][1], points[0][2])]
        for arc, (_, x, y) in zip(self._arcs[1:], points[1:], strict=True):
            if arc - self._corners[-1][0] > _SHORT:
                self._corners.append((arc, x, y))

    def at(self, time: float) -> tuple[float, float]:
        """Return arc length [m] and speed [m/s] at a time [s]; the speed is 0 from the last point on."""
        times, arcs = self._times, self._arcs
        if time >= times[-1]:
            return arcs[-1], 0.0
        k = min(max(bisect_right(times, time) - 1, 0), len(times) - 2)
        speed = (arcs[k + 1] - arcs[k]) / (times[k + 1] - times[k])
        return arcs[k] + speed * (time - times[k]), speed

    def project(self, x: float, y: float) -> float:
        """Return the arc length of the nearest point of the polyline, also before its start [m]."""
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
        """Return the point at an arc length [m], straight on beyond the ends; a line without direction has a single point."""
        corners = self._corners
        if len(corners) == 1:
            return corners[0][1:]
        k = min(max(bisect_right(corners, arc, key=lambda c: c[0]) - 1, 0), len(corners) - 2)
        (a, ax, ay), (b, bx, by) = corners[k], corners[k + 1]
        share = (arc - a) / (b - a)
        return ax + share * (bx - ax), ay + share * (by - ay)
