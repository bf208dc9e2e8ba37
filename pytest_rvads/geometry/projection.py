"""Projects poses on the metric graph: on a known track, or anywhere on a map.

A vehicle is projected on its own track, in a window around its last station. Half of the points inside a junction lie within 0.5
m of another movement, so "the nearest lane" is often the wrong lane there. `Locator` is for first placements and for logs without
itineraries; it returns all candidates, the best first.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pytest_rvads.geometry.graph import Position
from pytest_rvads.geometry.segment import Pose, Segment, join
from pytest_rvads.support.errors import MapError

__all__ = ["Locator", "Place", "Track"]

_CELL = 8.0
_REACH = 6.0
_PER_RADIAN = 2.0


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a pose relative to a line."""

    position: Position
    """Position on the metric graph."""
    station: float
    """Station along the track, or along the segment if there is no track [m]."""
    offset: float
    """Offset to the left of the line [m]."""
    heading_error: float
    """Heading of the pose minus direction of the line, in -pi..pi [rad]."""


class Track:
    """Consecutive segments of a metric graph, such as an itinerary.

    Args:
        segments: at least one segment, each starting where the segment before ends.

    Raises:
        MapError: there is no segment, or two segments are not consecutive.
    """

    def __init__(self, segments: Sequence[Segment]) -> None:
        path = join(segments) if segments else None
        if path is None:
            names = [segment.id for segment in segments]
            raise MapError(f"a track needs segments that follow one another, got {names}")
        self.path = path
        self.segments = tuple(segments)
        self._starts: list[float] = []
        station = 0.0
        for i, segment in enumerate(segments):
            if i:
                station += math.dist(segments[i - 1].points[-1], segment.points[0])
            self._starts.append(station)
            station += segment.length

    def project(self, pose: Pose, near: float, window: float = 5.0) -> Place:
        """Project a pose on the track, in a window around station `near`.

        Args:
            pose: the pose of the vehicle's reference point.
            near: the station in the middle of the window [m].
            window: half the length of the window [m].
        """
        station, offset = self.path.project(pose.x, pose.y, near, window)
        error = math.remainder(pose.heading - self.path.pose(station).heading, math.tau)
        return Place(self.position(station), station, offset, error)

    def position(self, station: float) -> Position:
        """Return the position on the metric graph at `station` [m]; in a gap, the end of the segment before the gap."""
        i = max(bisect_right(self._starts, station) - 1, 0)
        segment = self.segments[i]
        return Position(segment.id, min(max(station - self._starts[i], 0.0), segment.length))


class Locator:
    """Finds the segments that a pose can be on, by a grid of cells over the plane.

    Args:
        segments: the segments of a metric graph.
    """

    def __init__(self, segments: Iterable[Segment]) -> None:
        self._cells: dict[tuple[int, int], list[tuple[Segment, int]]] = {}
        for segment in segments:
            points = segment.points.tolist()
            for i in range(len(points) - 1):
                for cell in _cells_between(points[i], points[i + 1]):
                    self._cells.setdefault(cell, []).append((segment, i))

    def locate(self, pose: Pose, reach: float = 4.0, turn: float = math.pi / 2) -> list[Place]:
        """Return the places of a pose near a line and heading along the line, the best first.

        Args:
            pose: the pose of the vehicle's reference point.
            reach: largest distance from the line [m].
            turn: largest heading error [rad].

        Raises:
            MapError: the pose is not finite, or the reach is beyond 6 m.
        """
        if not all(map(math.isfinite, pose)):
            raise MapError(f"a pose needs finite coordinates and heading, got {tuple(pose)}")
        if not 0 < reach <= _REACH:
            raise MapError(f"reach must lie above 0 and up to {_REACH:g} m, got {reach!r}")
        column, row = math.floor(pose.x / _CELL), math.floor(pose.y / _CELL)
        best: dict[str, tuple[float, Place]] = {}
        for cell in ((column + i, row + k) for i in (-1, 0, 1) for k in (-1, 0, 1)):
            for segment, i in self._cells.get(cell, ()):
                distance, place = _piece(segment, i, pose)
                cost = distance + _PER_RADIAN * abs(place.heading_error)
                if distance <= reach and abs(place.heading_error) <= turn and cost < best.get(segment.id, (math.inf,))[0]:
                    best[segment.id] = cost, place
        return [place for _, place in sorted(best.values(), key=lambda entry: (entry[0], entry[1].position.segment))]


def _cells_between(start: Sequence[float], end: Sequence[float]) -> set[tuple[int, int]]:
    """Return the cells that a straight piece passes, sampled densely enough to include a neighbour of each passed cell."""
    steps = max(1, math.ceil(math.dist(start, end) / (_CELL / 2)))
    return {
        (
            math.floor((start[0] + (end[0] - start[0]) * k / steps) / _CELL),
            math.floor((start[1] + (end[1] - start[1]) * k / steps) / _CELL),
        )
        for k in range(steps + 1)
    }


def _piece(segment: Segment, i: int, pose: Pose) -> tuple[float, Place]:
    """Return distance and place of `pose` at piece `i` of a segment."""
    start = float(segment.stations[i])
    length = float(segment.stations[i + 1]) - start
    (x, y), (u, v) = segment.points[i].tolist(), segment.points[i + 1].tolist()
    ux, uy = (u - x) / length, (v - y) / length
    along = (pose.x - x) * ux + (pose.y - y) * uy
    along = min(max(along, 0.0), length)
    dx, dy = pose.x - x - along * ux, pose.y - y - along * uy
    error = math.remainder(pose.heading - math.atan2(uy, ux), math.tau)
    return math.hypot(dx, dy), Place(Position(segment.id, start + along), start + along, ux * dy - uy * dx, error)
