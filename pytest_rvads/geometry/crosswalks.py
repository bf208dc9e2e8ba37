"""Crosswalks of a junction, and the ways that a junction has in addition if pedestrians walk there.

A crosswalk lies over one arm. It has two crossings, the ways of pedestrians from kerb to kerb in either direction, and a parking
place beside its near side, before the painted area, where a parked vehicle hides pedestrians. The near side of a crosswalk is the
side of the entrances of its arm: in right-hand traffic, the right side for a driver who comes to the junction on this arm.

The stretch that a movement shares with a crossing surrounds the line on which pedestrians walk. The stretch that a crosswalk
covers is the part of a movement inside the painted area.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise, product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import Line, Stretch
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.segment import Segment, fixed
from pytest_rvads.geometry.sweep import CAR
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Further, Key

PERSON = 0.6
"""Diameter of a pedestrian [m]: a circle of radius 0.3 m, the larger end of the usual 0.25 to 0.3 m."""
MODERATE = 7.0
"""Moderate speed of a vehicle that comes to a crosswalk where a pedestrian stands near it or may be hidden [m/s].

At up to 7.5 m/s, a driver who brakes with 4 m/s^2 can stop before the crosswalk, or has passed, when a pedestrian arrives who
sets out 3 m before the kerb. German courts take about 25 km/h for the moderate speed of StVO, section 26(1); California Vehicle
Code 21950(c) asks a driver to reduce the speed as the safety of pedestrians needs.
"""
SIDEWALK = 3.0
"""Length of the way of a pedestrian before and behind a crosswalk [m]."""
_SPACING, _FINER = 0.1, 101
"""Distance between the points of a line that are compared with an area [m]; number of points that are then compared within this
distance of the first and the last point inside, so that stretches are exact to 1 mm."""


class Side(StrEnum):
    """A side of a crosswalk, from which a pedestrian comes."""

    NEAR = "near"
    """The side of the entrances: the right side for drivers who enter the junction, where traffic keeps right."""
    FAR = "far"
    """The side of the exits."""


@dataclass(frozen=True, slots=True, eq=False)
class Crosswalk:
    """A crosswalk over one arm of a junction."""

    id: str
    arm: int
    area: NDArray[np.float64] = field(repr=False)
    """Corners of the painted area, in order, shape ``(k, 2)`` [m]."""
    path: Segment = field(repr=False)
    """The line on which pedestrians walk, from the kerb of the near side to the kerb of the far side."""
    middle: float
    """Distance along `path` from the near kerb to the middle of the roadway or of its island [m]."""
    island: float = 0.0
    """Width of the island between the entrances and the exits [m]; 0 without an island."""
    phase: int | None = None
    """Number of the phase group of entrances that has green while pedestrians may walk; None without lights."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "area", fixed(np.asarray(self.area, dtype=np.float64)))

    def __reduce__(self) -> tuple[Any, ...]:
        parts = self.id, self.arm, self.area, self.path, self.middle, self.island, self.phase
        return Crosswalk, parts  # the arrays that numpy unpickles are writable


@dataclass(frozen=True, slots=True)
class _Straight:
    """A way that does not turn: the properties that crossings and parking places have in common."""

    entrance: int
    """Number of the start of the way, see `Junction.starts`."""
    exit: int
    """Number of the end of the way, see `Junction.ends`."""
    turn: ClassVar[Turn] = Turn.STRAIGHT

    @property
    def key(self) -> Key:
        """Numbers of the start and the end of the way."""
        return self.entrance, self.exit


@dataclass(frozen=True, slots=True)
class Crossing(_Straight):
    """The way of pedestrians over a crosswalk in one direction."""

    crosswalk: int
    """Number of the crosswalk in `Junction.crossings`."""
    side: Side
    """The side on which the way starts."""
    length: float
    """Length from kerb to kerb [m]."""
    path: Segment | None = field(default=None, compare=False, repr=False)
    """The line from kerb to kerb; None if a recording does not hold the line."""
    kind: ClassVar[str] = "crossing"
    width: ClassVar[float] = PERSON


@dataclass(frozen=True, slots=True)
class Parking(_Straight):
    """A place beside the entrances of an arm, directly before a crosswalk, where a parked vehicle hides pedestrians."""

    length: float
    """Length of the way behind the parking place, along the crosswalk [m]."""
    path: Segment | None = field(default=None, compare=False, repr=False)
    """The line of the way; None if a recording does not hold the line."""
    kind: ClassVar[str] = "parking place"
    width: ClassVar[float] = CAR.width


def half(crosswalk: Crosswalk, way: Crossing, *, first: bool) -> Stretch:
    """Return the half of the roadway, without the island, that pedestrians on a crossing walk over first or last [m]."""
    middle = crosswalk.middle if way.side is Side.NEAR else way.length - crosswalk.middle
    edge = crosswalk.island / 2
    return Stretch(0.0, middle - edge) if first else Stretch(middle + edge, way.length)


def covered(area: NDArray[np.float64], line: Line) -> Stretch | None:
    """Return the first and last station of a line inside an area of corners ``(k, 2)`` [m]; None if it passes the area by."""
    path = line.path
    ends = np.roll(area, -1, axis=0)
    (x0, y0), (x1, y1) = (corners[area[:, 1] != ends[:, 1]].T for corners in (area, ends))

    low, high = area.min(axis=0), area.max(axis=0)

    def inside(stations: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = places = np.array([np.interp(stations, path.stations, path.points[:, axis]) for axis in (0, 1)])
        near = ((low <= places.T) & (high >= places.T)).all(axis=1)
        x, y = x[near, None], y[near, None]
        # A point is inside if a ray to the east crosses an odd number of sides.
        crossed = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        found: NDArray[np.float64] = stations[near][np.logical_xor.reduce(crossed, axis=1)]
        return found

    within = inside(np.append(np.arange(0.0, path.length, _SPACING), path.length))
    if not len(within):
        return None
    first, last = (float(within[k]) for k in (0, -1))
    starts = inside(np.linspace(max(first - _SPACING, 0.0), first, _FINER))
    ends = inside(np.linspace(last, min(last + _SPACING, path.length), _FINER))
    return Stretch(float(starts[0]) - line.origin, float(ends[-1]) - line.origin)


def hull(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of the convex hull of points ``(k, 2)``, counter-clockwise; fewer than three if all lie on a line."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    corners: list[tuple[float, float]] = []
    # Andrew's monotone chain: first the lower side of the hull, then the upper side.
    for chain in (ordered, ordered[::-1]):
        side: list[tuple[float, float]] = []
        for x, y in chain:
            while len(side) > 1:
                (x0, y0), (x1, y1) = side[-2:]
                if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
                    break
                side.pop()
            side.append((x, y))
        corners += side[:-1]
    return np.array(corners).reshape(-1, 2)


_BAY, _OFF = 8.0, 1.2
"""Length of a parking place before a crosswalk, and the distance from the kerb to the middle of the place [m]."""


def walking_ways(crosswalks: Sequence[Crosswalk], entrances: int, exits: int, *, left_hand: bool) -> tuple[Further, ...]:
    """Return the ways in the order that `Junction.walked` describes."""
    further: list[Further] = []
    # The crossings, each with a stretch of sidewalk before and behind the roadway.
    for number, side in product(range(len(crosswalks)), Side):
        crosswalk = crosswalks[number]
        points = crosswalk.path.points if side is Side.NEAR else crosswalk.path.points[::-1]
        path = Segment(f"{crosswalk.id}.{side}", points)
        (x, y, heading), (u, v, direction) = path.pose(0.0), path.pose(path.length)
        back = np.array([SIDEWALK * math.cos(heading), SIDEWALK * math.sin(heading)])
        on = np.array([SIDEWALK * math.cos(direction), SIDEWALK * math.sin(direction)])
        sign = Sign.NONE if crosswalk.phase is None else Sign.LIGHTS
        approach = Segment(f"{path.id}.from", np.array([np.array([x, y]) - back, (x, y)]))
        road = Segment(f"{path.id}.to", np.array([(u, v), np.array([u, v]) + on]))
        crossing = Crossing(entrances + len(further), exits + len(further), number, side, path.length, path)
        start = Entrance(crosswalk.arm, sign=sign, phase=crosswalk.phase, approach=approach)
        further.append(Further(crossing, start, Exit(crosswalk.arm, road=road)))
    # The parking places beside the kerbs of the near sides, in the direction of vehicles that come to the junction. A parked
    # vehicle stands on the approach of such a way.
    for crosswalk in crosswalks:
        x, y, across = crosswalk.path.pose(0.0)
        heading = across + (math.pi / 2 if left_hand else -math.pi / 2)
        ahead = np.array([math.cos(heading), math.sin(heading)])
        kerb = np.array([x - _OFF * math.cos(across), y - _OFF * math.sin(across)])
        along = (crosswalk.area - kerb) @ ahead
        before, after = float(along.min()), float(along.max())
        corners = [kerb + at * ahead for at in (before - _BAY, before, after, after + _BAY)]
        names = ("bay", "beside", "behind")
        place, beside, behind = (
            Segment(f"{crosswalk.id}.{name}", np.array(ends)) for name, ends in zip(names, pairwise(corners), strict=True)
        )
        way = Parking(entrances + len(further), exits + len(further), beside.length, beside)
        further.append(Further(way, Entrance(crosswalk.arm, approach=place), Exit(crosswalk.arm, road=behind)))
    return tuple(further)


def hides(
    eye: tuple[float, float], target: tuple[float, float], front: tuple[float, float, float], size: tuple[float, float]
) -> bool:
    """Return whether the line between two points [m] crosses the rectangle of a body, by the clipping of Liang and Barsky.

    The body is given by the centre of its front, x and y [m] and heading [rad], and by its length and width [m].
    """
    x, y, heading = front
    length, width = size
    cos, sin = math.cos(heading), math.sin(heading)
    begin, end = 0.0, 1.0
    (ax, ay), (bx, by) = ((px - x, py - y) for px, py in (eye, target))
    ends = (
        (ax * cos + ay * sin, bx * cos + by * sin, -length, 0.0),
        (ay * cos - ax * sin, by * cos - bx * sin, -width / 2, width / 2),
    )
    for a, b, low, high in ends:
        if a == b:
            if not low <= a <= high:
                return False
            continue
        enter, leave = sorted(((low - a) / (b - a), (high - a) / (b - a)))
        begin, end = max(begin, enter), min(end, leave)
    return begin <= end
