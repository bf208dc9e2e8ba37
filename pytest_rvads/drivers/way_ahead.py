"""What a driver knows of the way ahead: where it goes, and how fast its bends may be taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

from pytest_rvads.drivers.swept import AxlePath, approach_pace
from pytest_rvads.geometry.segment import SPEED_LIMIT, Pose, Segment
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["EASE", "Track", "fastest", "track"]

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
