"""How far vehicles are from touching each other and from leaving their lane: nobody looks again before they have moved so far.

What is found this way is exact: where a distance is too small to be sure of its sign, the functions of whole runs are asked.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

from pytest_rvads.conduct import lane
from pytest_rvads.conduct.bodies import overlap
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.lane import MAX_OFFSET, NEAR
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.junctions.sweep import LANE_TOLERANCE
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.states import JUNCTION

__all__ = ["Bodies", "Box", "Course", "gap"]

_DOUBT = 1e-6
"""Distances smaller than this may have the other sign when they are computed in another order [m]."""
_BEND = 3.0
"""How far beside a bend of a centre line bodies are looked at [m]: there an offset jumps by up to that times its sharpness."""


class Box(NamedTuple):
    """A body: it reaches from its front backwards."""

    x: float
    """Of the middle of its front [m]."""
    y: float
    """[m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    length: float
    """[m]."""
    width: float
    """[m]."""


class Bodies:
    """Whether the bodies of two vehicles touch.

    Args:
        one: a vehicle.
        two: another one.
    """

    __slots__ = ("due", "one", "touch", "two")

    def __init__(self, one: Mover, two: Mover) -> None:
        self.one, self.two = one, two
        self.due = -math.inf
        """Nothing changes before both together have moved so far [m]."""
        self.touch = False
        """`bodies.overlap`, as it was found the last time."""

    def look(self, now: Instant) -> bool:
        """Return whether they touch now."""
        one, two = self.one, self.two
        moved = one.moved + two.moved
        if moved < self.due and one.here and two.here:
            return self.touch
        self.touch, self.due = False, -math.inf
        if one.here and two.here:
            apart = gap(_box(one), _box(two))
            self.touch = bool(overlap(now.run, one.slot, two.slot)[0]) if abs(apart) < _DOUBT else apart < 0.0
            self.due = -math.inf if self.touch else moved + apart - _DOUBT
        return self.touch


def _box(mover: Mover) -> Box:
    return Box(mover.x, mover.y, mover.heading, *(mover.agent.size or (0.0, 0.0)))


def gap(one: Box, two: Box) -> float:
    """Return a distance that two bodies keep at least; at most 0 where they touch [m]."""
    _, _, heading, length, width = one
    _, _, other_heading, other_length, other_width = two
    cos, sin, other_cos, other_sin = math.cos(heading), math.sin(heading), math.cos(other_heading), math.sin(other_heading)
    long, half, other_long, other_half = length / 2, width / 2, other_length / 2, other_width / 2
    x = (two.x - other_long * other_cos) - (one.x - long * cos)
    y = (two.y - other_long * other_sin) - (one.y - long * sin)
    round_gap = math.hypot(x, y) - math.hypot(long, half) - math.hypot(other_long, other_half)
    if round_gap > _DOUBT:
        return round_gap
    along, across = abs(cos * other_cos + sin * other_sin), abs(cos * other_sin - sin * other_cos)
    return max(
        abs(x * cos + y * sin) - long - other_long * along - other_half * across,
        abs(y * cos - x * sin) - half - other_long * across - other_half * along,
        abs(x * other_cos + y * other_sin) - other_long - long * along - half * across,
        abs(y * other_cos - x * other_sin) - other_half - long * across - half * along,
    )


class Course:
    """Whether a vehicle keeps to its lane, and to its route.

    Args:
        now: the instant in which it appears.
        mover: the vehicle.

    Raises:
        RunError: it is not known where the lanes lie.
    """

    __slots__ = ("_half", "_mover", "_off_lane", "_off_route", "_room", "_way", "due_lane", "due_route")

    def __init__(self, now: Instant, mover: Mover) -> None:
        self._mover = mover
        self._way = itinerary(now.junction, *mover.agent.route.key)
        self._half = now.junction.lane_width / 2 + LANE_TOLERANCE
        self._room = 0.05 + _BEND * _sharpest(self._way) ** 2
        self.due_lane = self.due_route = -math.inf
        self._off_lane = self._off_route = False

    def off_lane(self, now: Instant) -> bool:
        """`lane.off_lane`."""
        mover = self._mover
        if mover.moved < self.due_lane:
            return self._off_lane
        if not mover.here:
            return False
        way, half, zone = self._way, self._half, mover.zone
        length, width = mover.agent.size or (0.0, 0.0)
        cos, sin = math.cos(mover.heading), math.sin(mover.heading)
        room = half - abs(_offset(way, mover.x, mover.y, mover.station))
        off, doubt = zone == JUNCTION and room < 0.0, abs(room) < _DOUBT
        for back in (0.0, length):
            for side in (-width / 2, width / 2):
                x, y = mover.x - back * cos - side * sin, mover.y - back * sin + side * cos
                place = _nearest(way, x, y, mover.station - back)
                margin = half - abs(_offset(way, x, y, place))
                if margin < _DOUBT:
                    beyond = max(-place, place - way.length)
                    doubt = doubt or abs(margin) < _DOUBT or abs(beyond) < _DOUBT
                    off = off or beyond >= 0.0
                    margin = -beyond  # nobody asks for a lane inside: it matters again when the corner comes out
                room = min(room, margin)
        if doubt:
            off = bool(lane.off_lane(now.run, mover.slot)[0])
        self._off_lane = off
        self.due_lane = -math.inf if off or doubt else mover.moved + room / 2 - self._room
        return off

    def off_route(self, now: Instant) -> bool:
        """`lane.off_route`."""
        mover = self._mover
        if mover.moved < self.due_route:
            return self._off_route
        if not mover.here:
            return False
        room = MAX_OFFSET - 2 * NEAR - abs(_offset(self._way, mover.x, mover.y, mover.station))
        self._off_route = room < _DOUBT and bool(lane.off_route(now.run, mover.slot)[0])
        self.due_route = -math.inf if room < _DOUBT else mover.moved + room / 2 - self._room
        return self._off_route


@lru_cache(maxsize=1024)
def _sharpest(way: Itinerary) -> float:
    """Return by how much the centre line of a way turns at one point, at most [rad]."""
    headings = [way.path.pose(float(station)).heading for station in way.path.stations[:-1]]
    return max((abs(math.remainder(b - a, math.tau)) for a, b in pairwise(headings)), default=0.0)


def _offset(way: Itinerary, x: float, y: float, station: float) -> float:
    """Return how far a point is to the left of a way where it is at a station [m]."""
    _, _, px, py, ux, uy, _ = way.path.piece(station + way.origin)
    return ux * (y - py) - uy * (x - px)


def _nearest(way: Itinerary, x: float, y: float, station: float) -> float:
    """Return the station of a point, given about where it is [m]."""
    for _ in range(3):
        along = station + way.origin
        start, _, px, py, ux, uy, _ = way.path.piece(along)
        station += (x - px) * ux + (y - py) * uy - (along - start)
    return station
