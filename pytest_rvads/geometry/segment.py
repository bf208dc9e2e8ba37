"""Segments: the labels of the edges of a metric graph (paper, section 4.1).

The speed limits of a map lie along centre lines. Segments keep their limits when they are cut and joined, so junctions,
itineraries and run files have the limits. Where the map states no limit, `Facts.speed_limit` applies. `Junction.limited` returns
a copy of a junction with another limit.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.turns import Turn
from pytest_rvads.support.errors import MapError

GAP_LIMIT = 1.0
"""Widest gap between two consecutive segments [m]; writers of maps leave gaps."""
SPEED_LIMIT = 11.176
"""City speed limit of the paper, 25 mph, for roads without a limit in the map [m/s]."""
NO_LIMIT = 999.0
"""Speed limit of a road that the map marks as unlimited [m/s]: a finite number for files, which no vehicle reaches."""
ADVISED = 130 / 3.6
"""Speed to drive at on a road without limit [m/s]: Autobahn-Richtgeschwindigkeits-Verordnung, section 1."""
Limits = tuple[tuple[float, float | None], ...]
"""Speed limits along a line: per limit the station of its begin [m], in ascending order from 0 on, and the limit [m/s], None on a
part without a limit in the map. Empty if the map states no limit for the line."""
_WELD = 0.01

LEAST_RADIUS = 2.7 / math.tan(0.61)
"""Least radius of the circle of a car's rear axle, with the wheels turned to their limit [m].

The radius is the wheelbase, 2.7 m, divided by the tangent of the largest steering angle, 0.61 rad: 3.9 m.
"""
_CHORD = 4.0
"""Length of centre line over which the radius of a bend is measured [m], about the length of the arc of a right turn.

Over a much shorter length, a single vertex of a polyline would count as a bend.
"""


class Pose(NamedTuple):
    """A place in the plane with a direction."""

    x: float
    """East coordinate [m]."""
    y: float
    """North coordinate [m]."""
    heading: float
    """Direction of travel, counter-clockwise from east [rad]."""


class Piece(NamedTuple):
    """A straight piece of a line, between two of its points."""

    start: float
    """Station of its start [m]."""
    end: float
    """Station of its end [m]."""
    x: float
    """East coordinate of its start [m]."""
    y: float
    """North coordinate of its start [m]."""
    ux: float
    """East component of the unit vector along it."""
    uy: float
    """North component of this vector."""
    heading: float
    """Its direction, counter-clockwise from east [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A directed piece of lane centre line with its arc length."""

    id: str
    points: NDArray[np.float64]
    """Centre line in the direction of travel, shape ``(k, 2)``, k >= 2 [m]."""
    turn: Turn = Turn.STRAIGHT
    """Turn type; ``STRAIGHT`` on roads, as in the paper."""
    junction: str | None = None
    limits: Limits = ()
    stations: NDArray[np.float64] = field(init=False)
    """Arc length at each point, shape ``(k,)`` [m]."""
    _table: tuple[tuple[float, ...], tuple[Piece, ...]] | None = field(init=False, repr=False, default=None)
    """The stations of the points [m], and the pieces between the points."""

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise MapError(f"segment {self.id!r} needs points of shape (k, 2) with k >= 2, got {points.shape}")
        if not np.isfinite(points).all():
            raise MapError(f"segment {self.id!r} has coordinates that are not finite")
        steps = np.hypot(*np.diff(points, axis=0).T)
        keep = np.concatenate(([True], steps > 1e-9))
        points, steps = points[keep], steps[steps > 1e-9]
        if not len(steps):
            raise MapError(f"segment {self.id!r} has zero length")
        object.__setattr__(self, "points", fixed(points))
        object.__setattr__(self, "stations", fixed(np.concatenate(([0.0], np.cumsum(steps)))))

    def __reduce__(self) -> tuple[Any, ...]:
        parts = self.id, self.points, self.turn, self.junction, self.limits
        return Segment, parts  # the arrays that numpy unpickles are writable

    def _build_table(self) -> tuple[tuple[float, ...], tuple[Piece, ...]]:
        """Build and store the table of stations and pieces in plain floats; most segments of a town need no table."""
        unit = np.diff(self.points, axis=0) / np.diff(self.stations)[:, None]
        rows = zip(pairwise(self.stations.tolist()), self.points[:-1].tolist(), unit.tolist(), strict=True)
        pieces = tuple(Piece(*ends, x, y, ux, uy, math.atan2(uy, ux)) for ends, (x, y), (ux, uy) in rows)
        table = tuple(self.stations.tolist()), pieces
        object.__setattr__(self, "_table", table)
        return table

    @property
    def length(self) -> float:
        """Arc length of the centre line [m]."""
        return float(self.stations[-1])

    def pose(self, station: float) -> Pose:
        """Return the pose at `station` [m]; beyond its ends the line continues straight."""
        start, _, x, y, ux, uy, heading = self.piece(station)
        along = station - start
        return Pose(x + along * ux, y + along * uy, heading)

    def piece(self, station: float) -> Piece:
        """Return the piece at `station` [m]; the first or the last piece beyond the ends of the line."""
        stations, pieces = self._table or self._build_table()
        return pieces[bisect_right(stations, station, 1, len(pieces)) - 1]

    def centre(self, along: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points of the line [m] and unit vectors along it at stations [m], each of shape ``(k, 2)``."""
        points, arc = self.points, self.stations
        piece = np.searchsorted(arc[1:-1], along, side="right")
        ahead = directions(self)[piece]
        return points[piece] + (along - arc[piece])[:, None] * ahead, ahead

    def project(self, x: float, y: float, near: float, window: float = 5.0) -> tuple[float, float]:
        """Return the station and the offset (left positive) of the nearest point of the line within `window` of `near` [m].

        Only this part is searched because lines in a junction cross themselves. Beyond its ends the line continues straight, so
        stations can be negative or exceed the length.
        """
        stations, pieces = self._table or self._build_table()
        last = len(pieces) - 1
        i = bisect_right(stations, near - window, 1, last + 1) - 1
        stop = bisect_right(stations, near + window, i + 1, last + 1) - 1
        best, projection = math.inf, (near, 0.0)
        while i <= stop:
            start, end, px, py, ux, uy, _ = pieces[i]
            dx, dy = x - px, y - py
            along = dx * ux + dy * uy
            if along < 0.0:
                along = 0.0 if i else along
            elif i < last and along > end - start:
                along = end - start
            ex, ey = dx - along * ux, dy - along * uy
            error = ex * ex + ey * ey
            if error < best:
                best, projection = error, (start + along, ux * dy - uy * dx)
            i += 1
        return projection

    def head(self, eta: float) -> Segment:
        """Return the paper's ``s[-, eta]``: the part from the start to `eta` after the start [m]."""
        return self._cut(0.0, eta)

    def tail(self, eta: float) -> Segment:
        """Return the paper's ``s[eta, -]``: the part from `eta` before the end to the end [m]."""
        return self._cut(self.length - eta, self.length)

    def _cut(self, start: float, end: float) -> Segment:
        if not -1e-9 <= start < end <= self.length + 1e-9:
            raise MapError(f"segment {self.id!r} is {self.length:.3f} m long, it has no part from {start:.3f} to {end:.3f} m")
        inner = self.points[(self.stations > start + 1e-9) & (self.stations < end - 1e-9)]
        points = np.vstack((self.pose(start)[:2], inner, self.pose(end)[:2]))
        return Segment(self.id, points, self.turn, self.junction, limits_between(self.limits, start, end))

    def then(self, other: Segment) -> Segment | None:
        """Return the paper's concatenation with another segment; None if that starts beyond `GAP_LIMIT` of this one's end."""
        return join((self, other))


@lru_cache(maxsize=256)
def directions(line: Segment) -> NDArray[np.float64]:
    """Return the unit vector along every piece of a line, shape ``(pieces, 2)``."""
    units: NDArray[np.float64] = np.diff(line.points, axis=0) / np.diff(line.stations)[:, None]
    return units


def fixed(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a copy of an array that cannot be made writable, because autopilots receive centre lines."""
    return np.frombuffer(numbers.tobytes(), dtype=np.float64).reshape(numbers.shape)


def limits_between(limits: Limits, start: float, end: float) -> Limits:
    """Return the speed limits of the part of a line between two stations [m]; the part begins at station 0."""
    later = ((at - start, limit) for at, limit in limits if start < at < end)
    return ((0.0, limit_in(limits, start)), *later) if limits else ()


def limit_in(limits: Limits, station: float) -> float | None:
    """Return the speed limit at a station [m/s], None without a limit; beyond an end of the line the limit at the end."""
    return limits[max(bisect_right(limits, station, key=itemgetter(0)) - 1, 0)][1] if limits else None


def join(segments: Sequence[Segment]) -> Segment | None:
    """Return the concatenation of `segments` in order, None if two neighbours are not consecutive."""
    gaps = [math.dist(before.points[-1], after.points[0]) for before, after in pairwise(segments)]
    if any(gap > GAP_LIMIT for gap in gaps):
        return None
    junctions = {s.junction for s in segments}
    # A gap between two segments belongs to the first segment. In a junction without a limit the limit of the approach continues.
    limits: list[tuple[float, float | None]] = []
    start = 0.0
    for before, segment in pairwise((segments[0], *segments)) if any(segment.limits for segment in segments) else ():
        if limits:
            start += before.length + math.dist(before.points[-1], segment.points[0])
        continues = limits and segment.junction is not None
        for at, limit in segment.limits or (() if continues else ((0.0, None),)):
            if not limits or limits[-1][1] != limit:
                limits.append((start + at, limit))
    # Lanes that meet within a centimetre are joined in one point, because a step of a millimetre can point in any direction.
    parts = [segments[0].points]
    parts += [segment.points[gap < _WELD :] for gap, segment in zip(gaps, segments[1:], strict=True)]
    return Segment(
        "+".join(s.id for s in segments),
        np.vstack(parts),
        next((s.turn for s in segments if s.junction is not None), Turn.STRAIGHT),
        junctions.pop() if len(junctions) == 1 else None,
        tuple(limits),
    )


def least_radius(points: NDArray[np.float64]) -> float:
    """Return the least radius of a line of points over a length of `_CHORD`, or over the whole line if it is shorter [m]."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0.0], lengths[lengths > 0.0]
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = np.cumsum(lengths) - lengths / 2
    chord = min(_CHORD, float(lengths.sum()))
    # The heading of a piece holds at its middle, and changes evenly between two middles.
    turned = np.abs(np.interp(middles + chord, middles, headings) - headings).max()
    return chord / float(turned) if turned > 0.0 else np.inf
