"""The way ahead of a driver: its places, and how fast its bends may be taken.

In a narrow bend a driver steers its rear axle along a planned path, no faster than its wheels can turn as the path demands.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pytest_rvads.geometry.segment import SPEED_LIMIT, Pose, Segment
from pytest_rvads.geometry.sweep import STEP, Course, Plan, plan, with_roads
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["EASE", "AxlePath", "Track", "approach_pace", "axle_path", "fastest", "track"]


QUICK = 0.7
"""Share of the vehicle's steering rate that a planned path may use."""
CALM = 0.7
"""Lateral acceleration on the path [m/s^2]: at 2.5 m/s^2 the tyres slip so much that the rear axle errs by 4 cm."""


Pace = tuple[tuple[float, float], ...]
"""Stations of the rear axle on the itinerary [m], and how fast a path can be followed there [m/s]."""


class AxlePath(NamedTuple):
    """The path of a rear axle beside the itinerary."""

    path: Segment
    headings: tuple[float, ...]
    """Heading at every point of the path, without jumps [rad]."""
    bends: tuple[float, ...]
    """Curvature at every point [1/m]."""
    pace: Pace
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
    """Return the path of the rear axle where it must leave the centre line; None where it can follow the centre line.

    Args:
        itinerary: the way of the front.
        vehicle: the vehicle, whose body is to stay in the lane.
        lane_width: width of the lane [m].
        start: station of the front from which on the path is planned [m].
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


def approach_pace(line: Segment, start: float, vehicle: Vehicle, lane_width: float) -> Pace:
    """Return how fast the path of the rear axle on an approach can be followed; empty where it can follow the centre line.

    Args:
        line: the approach.
        start: station of the front from which on the path is planned [m], 0 at the end of the approach.
        vehicle: the vehicle, whose body is to stay in the lane.
        lane_width: width of the lane [m].
    """
    planned = plan(Course(line, line.length, 0.0, start, lane_width, 0.0), vehicle.body)
    return _pace(planned, vehicle) if planned else ()


def _pace(planned: Plan, vehicle: Vehicle) -> Pace:
    change = np.abs(np.diff(planned.bend, append=0.0)) / STEP
    turning = QUICK * vehicle.steering_rate / (vehicle.wheelbase * np.maximum(change, 1e-3))
    pace = np.minimum(turning, np.sqrt(CALM / np.maximum(np.abs(planned.bend), 1e-3)))
    return tuple(zip(planned.stations.tolist(), pace.tolist(), strict=True))


BEND = 2.5
"""Lateral acceleration that bends are taken with [m/s^2]."""
EASE = 2.0
"""Deceleration towards a bend or a lower speed limit [m/s^2]."""
_BEFORE = 60.0
"""How far before the junction a track begins, at most, where no limit is above `SPEED_LIMIT` [m]."""


class Track:
    """An itinerary, looked up by the metre.

    Args:
        itinerary: the way.
        axle: reference point to rear axle [m]; the axle is still in a bend when the reference point has left it.
        way: the path of the rear axle, where it is not the itinerary.
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
        """Whether the rear axle follows a planned path, so that the body is not around the centre line."""
        self._axles = [itinerary.pose(self._first + k - axle) for k in range(len(limits))]
        for (station, speed), pose in zip(way.pace, way.poses, strict=True) if way else ():
            k = min(max(int(station + axle - self._first), 0), len(limits) - 1)
            limits[k] = min(limits[k], speed)
            self._axles[k] = pose
        for k in range(len(limits) - 2, -1, -1):
            limits[k] = min(limits[k], math.sqrt(limits[k + 1] ** 2 + 2.0 * EASE))
        self._limits = limits

    def speed(self, station: float) -> float:
        """Return the highest speed [m/s] at `station` [m]."""
        k = int(station - self._first)
        limits = self._limits
        return limits[k if 0 <= k < len(limits) else -1 if k > 0 else 0]

    def slowest(self, length: float) -> float:
        """Return the highest speed [m/s] that the whole of a movement of this length [m] may be taken with."""
        return min(self.speed(float(station)) for station in range(math.ceil(length) + 1))

    def places(self, station: float, reach: float) -> list[tuple[float, float]]:
        """Return the places (x, y) [m] by the metre, beginning less than 1 m after `station`, up to `reach` beyond it [m]."""
        k = max(int(station - self._first) + 1, 0)
        return self._places[k : k + int(reach)]

    def axles(self, station: float, reach: float) -> list[Pose]:
        """Return the poses of the rear axle while the front is at `places`."""
        k = max(int(station - self._first) + 1, 0)
        return self._axles[k : k + int(reach)]


def _bends(poses: Sequence[Pose], axle: float) -> list[float]:
    """Return how fast bends are taken, from poses by the metre [m/s]: at all poses but the first and the last three.

    Args:
        poses: of the reference point.
        axle: reference point to rear axle [m].
    """
    # Chords of two metres, four metres apart: neither the corners of a polyline nor a joint where one lane begins a
    # little before the other ends counts as a bend.
    headings = [math.atan2(b.y - a.y, b.x - a.x) for a, b in zip(poses, poses[2:], strict=False)]
    changes = [(b - a + math.pi) % (2 * math.pi) - math.pi for a, b in zip(headings, headings[4:], strict=False)]
    raw = [math.sqrt(BEND * 4.0 / abs(change)) if abs(change) > 1e-3 else math.inf for change in changes]
    trail = math.ceil(axle)
    return [min(raw[max(k - trail, 0) : k + 1]) for k in range(len(raw))]


@lru_cache(maxsize=1024)  # many scenarios start at the same places
def fastest(line: Segment, first: float, last: float, vehicle: Vehicle, lane_width: float) -> float:
    """Return the highest speed [m/s] that vehicles anywhere between two stations of a line can take its bends ahead from.

    Where a vehicle on the centre line would leave its lane, the speed of the path that is planned there counts as well.

    Args:
        line: the centre line. What comes behind its end is not looked at.
        first: station of the last vehicle [m].
        last: station of the first vehicle [m].
        vehicle: each of the vehicles.
        lane_width: [m].
    """
    axle = vehicle.rear_axle_offset
    trail = math.ceil(axle)
    poses = [line.pose(first + k) for k in range(-trail - 3, math.ceil(line.length - first) + 4)]
    speeds = [*enumerate(_bends(poses, axle)[trail:])]
    for station, speed in approach_pace(line, first - line.length, vehicle, lane_width):
        speeds.append((max(int(station + axle + line.length - first), 0), speed))
    return min(math.sqrt(speed**2 + 2.0 * EASE * max(first + k - last, 0.0)) for k, speed in speeds)


@lru_cache(maxsize=256)  # the same ways are driven again and again
def track(itinerary: Itinerary, axle: float, way: AxlePath | None = None) -> Track:
    """Return an itinerary looked up by the metre, built once; see `Track`."""
    return Track(itinerary, axle, way)
