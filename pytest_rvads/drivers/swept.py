"""The path that a driver steers its rear axle along in a narrow bend, and how fast the wheels can turn as the path demands."""

from __future__ import annotations

import math
from bisect import bisect_right
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.geometry.sweep import STEP, Course, Plan, plan, with_roads
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["AxlePath", "approach_pace", "axle_path"]

QUICK = 0.7
"""Share of the steering rate that the path may take."""
CALM = 0.7
"""Lateral acceleration on the path [m/s^2]: at 2.5 m/s^2 the tyres slip so much that the rear axle errs by 4 cm."""


Pace = tuple[tuple[float, float], ...]
"""Stations of the rear axle on the itinerary [m], and how fast a path can be followed there [m/s]."""


class AxlePath(NamedTuple):
    """The path of a rear axle beside the itinerary."""

    path: Segment
    headings: tuple[float, ...]
    """At every point of the path, without jumps [rad]."""
    bends: tuple[float, ...]
    """Curvature at every point [1/m]."""
    pace: Pace
    poses: tuple[Pose, ...]
    """Of the rear axle at these stations."""

    def at(self, along: float) -> tuple[float, float]:
        """Return heading [rad] and curvature [1/m] of the path after so many metres of it."""
        table = self.path.stations
        k = min(max(bisect_right(table, along), 1), len(table) - 1)
        share = (along - table[k - 1]) / (table[k] - table[k - 1])
        (one, two), (here, there) = self.headings[k - 1 : k + 1], self.bends[k - 1 : k + 1]
        return float(one + share * (two - one)), float(here + share * (there - here))


@lru_cache(maxsize=256)
def axle_path(itinerary: Itinerary, vehicle: Vehicle, lane_width: float, start: float = -math.inf) -> AxlePath | None:
    """Return the path of the rear axle where it must leave the centre line; None where it can follow the centre line.

    Args:
        itinerary: the way of the front.
        vehicle: whose body is to stay in the lane.
        lane_width: [m].
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
        vehicle: whose body is to stay in the lane.
        lane_width: [m].
    """
    planned = plan(Course(line, line.length, 0.0, start, lane_width, 0.0), vehicle.body)
    return _pace(planned, vehicle) if planned else ()


def _pace(planned: Plan, vehicle: Vehicle) -> Pace:
    change = np.abs(np.diff(planned.bend, append=0.0)) / STEP
    turning = QUICK * vehicle.steering_rate / (vehicle.wheelbase * np.maximum(change, 1e-3))
    pace = np.minimum(turning, np.sqrt(CALM / np.maximum(np.abs(planned.bend), 1e-3)))
    return tuple(zip(planned.stations.tolist(), pace.tolist(), strict=True))
