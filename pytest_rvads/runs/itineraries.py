"""Itineraries: the path of one agent along an approach, through the junction on a way, down an exit road.

An itinerary neither begins nor ends in a junction (paper, section 4.2). Stations (distances along an itinerary) are measured from
the entrance vertex: negative on the approach, 0..length on the movement, more on the exit road.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import ADVISED, SPEED_LIMIT, Limits, Pose, Segment, fixed, limit_in
from pytest_rvads.geometry.sweep import BEFORE, Course, through
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import APPROACH, ENTRANCE, EXIT, GONE, JUNCTION, Zone
from pytest_rvads.support.errors import MapError

ENTRANCE_ZONE = 1.0
"""Distance before the stopping line at which the entrance zone begins [m].

The zone ends at the entrance vertex, or at the stopping line if the line lies behind the vertex.
"""
LEAVE = 15.0
"""Distance behind the exit vertex from which on the reference point of a vehicle counts as having left the junction [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Itinerary:
    """The path of one agent: approach, way through the junction and exit road, joined to one line."""

    entrance: int
    """Number of the entrance, or of the start of the way, see `Junction.starts`."""
    exit: int
    """Number of the exit, or of the end of the way, see `Junction.ends`."""
    turn: Turn
    """Turn type of the way through the junction."""
    path: Segment
    """The whole centre line, from the farthest usable point of the approach."""
    origin: float
    """Arc length of the entrance vertex on `path` [m]."""
    length: float
    """Length of the way through the junction [m]."""
    line: float
    """Station of the stopping line; above 0 for a line that is painted behind the entrance vertex [m]."""
    entry: float = field(init=False)
    """Station at which the junction begins: the entrance vertex, or the stopping line behind the vertex [m]."""
    end: float = field(init=False)
    """Station of the end of the itinerary, on the exit road [m]."""
    leave: float = field(init=False)
    """Station from which on the agent counts as having left the junction, see `LEAVE`; at `end`, the agent leaves the run [m]."""
    borders: NDArray[np.float64] = field(init=False)
    """Stations at which the zones after `APPROACH` begin, shape ``(4,)`` [m]."""
    limits: Limits = field(init=False)
    """The speed limits of the map: the station where each begins [m], and the limit [m/s]; empty if the map states none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "entry", min(max(self.line, 0.0), self.length))
        end = self.path.length - self.origin
        object.__setattr__(self, "end", end)
        object.__setattr__(self, "leave", min(self.length + LEAVE, end))
        borders = (self.line - ENTRANCE_ZONE, np.nextafter(self.entry, np.inf), self.length, end)
        object.__setattr__(self, "borders", fixed(np.array(borders)))
        object.__setattr__(self, "limits", tuple((at - self.origin, limit) for at, limit in self.path.limits))

    @classmethod
    def through(cls, junction: Junction, entrance: int, exit: int) -> Itinerary:
        """Build the itinerary of the way of `junction` from the start with number `entrance` to the end with number `exit`.

        Raises:
            MapError: the junction has no geometry, or its pieces do not meet.
        """
        approach, movement = junction.way_in(entrance), junction.way_through(entrance, exit)
        path = through(approach, movement, junction.way_out(exit))
        if path is None:
            raise MapError(f"junction {junction.name!r}: the lanes from entrance {entrance} to exit {exit} do not meet")
        return cls(
            entrance,
            exit,
            junction.every_way[entrance, exit].turn,
            path,
            approach.length,
            movement.length,
            -junction.setbacks[entrance],
        )

    def pose(self, station: float) -> Pose:
        """Return the pose of the centre line at `station` [m]."""
        return self.path.pose(station + self.origin)

    def course(self, lane_width: float, start: float) -> Course:
        """Return the centre line from station `start` on, with the width of the lane [m], to plan a path of the rear axle."""
        begin = max(-self.origin, min(self.line, 0.0) - BEFORE)
        # A path begins on the centre line, and a vehicle that is first seen in the junction need not be on the centre line.
        return Course(self.path, self.origin, self.length, max(start, begin) if start <= 0.0 else begin, lane_width)

    def limit_at(self, station: float) -> float:
        """Return the speed limit to keep at `station` [m], in m/s.

        Where the map states no limit, the limit is 25 mph (11.176 m/s), the limit of the paper. A limit above 130 km/h counts as
        130 km/h, the advised speed of the Autobahn-Richtgeschwindigkeits-Verordnung, section 1.
        """
        return min(limit_in(self.limits, station) or SPEED_LIMIT, ADVISED) if self.limits else SPEED_LIMIT

    def placed(self, station: float, back: float) -> Pose:
        """Return the pose of a vehicle on the centre line, its front at `station` [m], its rear axle `back` [m] behind."""
        front, axle = self.pose(station), self.pose(station - back)
        return Pose(front.x, front.y, math.atan2(front.y - axle.y, front.x - axle.x))

    def centre(self, station: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points of the centre line at stations, and unit vectors along the line, each of shape ``(steps, 2)``."""
        return self.path.centre(station + self.origin)

    def project(self, x: float, y: float, near: float) -> tuple[float, float]:
        """Return station [m] and lateral offset (left positive) [m] of a point (x, y) [m], searched around station `near` [m]."""
        station, offset = self.path.project(x, y, near + self.origin)
        return station - self.origin, offset

    def zone(self, station: float) -> Zone:
        """Return the part of the itinerary that `station` [m] lies in."""
        if station <= self.entry:
            return ENTRANCE if station >= self.line - ENTRANCE_ZONE else APPROACH
        if station < self.length:
            return JUNCTION
        return EXIT if station < self.end else GONE

    def start(self, distance: float) -> float:
        """Return the station `distance` [m] before the stopping line."""
        return self.line - distance


@lru_cache(maxsize=256)
def itinerary(junction: Junction, entrance: int, exit: int) -> Itinerary:
    """Return the itinerary of a vehicle through a junction, built at the first call; see `Itinerary.through` for errors."""
    return Itinerary.through(junction, entrance, exit)
