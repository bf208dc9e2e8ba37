"""Matching of recorded vehicles to ways through a junction: the way of a vehicle is the way nearest to its whole track.

A track that is equally near to several ways has no way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.satellites.tracks.samples import Samples

__all__ = ["NEVER", "STANDS", "Matched", "Matcher", "directions"]

_Values = NDArray[np.float64]

_FOLLOWED_APPROACH = 150.0
"""Distance before the stopping line from which a vehicle is followed [m]."""
FAR = 3.0
"""Largest distance between a track and its way, root mean square [m]. It is about the width of a lane, because some vehicles
change lanes late."""
_FARTHEST_SAMPLE = 6.0
"""Largest distance between a sample and the way of its vehicle [m]; a farther sample lies on another road."""
_DECISIVE_APPROACH = 50.0
"""Distance before the entrance vertex from which a track decides on the way [m]; vehicles farther away may change lanes."""
_LEAST_DIFFERENCE = 0.5
"""Least difference between the distances of the two nearest ways, root mean square [m]; below it the way is ambiguous."""
_STEP = 2.0
"""Distance between the compared points of a track [m]: equal distances keep a long stand from dominating."""
_GAP = 2.0
"""Longest gap between samples of a vehicle [s]; after a longer gap of more than five usual steps it is another vehicle."""
_LONGEST_GAP = 10.0
"""Longest gap for vehicles with rare samples [s]; during a longer gap the place of the vehicle is not known."""
_AGAINST = -0.3
"""Cosine of the angle between a vehicle and a way; with a smaller cosine, the vehicle drives against the way."""


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """A vehicle on its way through a junction."""

    way: Itinerary
    rows: slice
    """Samples of the vehicle that lie on the way."""
    station: _Values
    """Station of each of these samples, shape ``(rows,)`` [m]."""
    lateral: _Values
    """Distance to the left of the way of each of these samples, shape ``(rows,)`` [m]."""
    offset: float
    """Root mean square of the lateral distance over points at equal distances along the track [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The centre line of a way as straight pieces."""

    way: Itinerary
    start: _Values
    """Start of each piece, shape ``(pieces, 2)`` [m]."""
    ahead: _Values
    """Direction of each piece as a unit vector, shape ``(pieces, 2)``."""
    station: _Values
    """Station of the start of each piece, shape ``(pieces,)`` [m]."""
    long: _Values
    """Length of each piece, shape ``(pieces,)`` [m]."""

    @classmethod
    def of(cls, way: Itinerary) -> _Line:
        points, station = way.path.points, way.path.stations - way.origin
        long = np.diff(station)
        return cls(way, points[:-1], np.diff(points, axis=0) / long[:, None], station[:-1], long)

    def project(self, points: _Values, heading: _Values) -> tuple[_Values, _Values]:
        """Project points onto the nearest piece of the line that does not lead against the heading.

        Args:
            points: positions of a vehicle, shape ``(points, 2)`` [m].
            heading: headings of the vehicle, shape ``(points,)`` [rad].

        Returns:
            Stations and distances to the left, both of shape ``(points,)`` [m]; a distance is infinite if every piece leads
            against the heading.
        """
        facing = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        station, offset = np.empty(len(points)), np.empty(len(points))
        for begin in range(0, len(points), _BATCH):
            block = slice(begin, begin + _BATCH)
            apart = points[block, None, :] - self.start
            along = np.clip((apart * self.ahead).sum(axis=2), 0.0, self.long)
            apart -= along[:, :, None] * self.ahead
            squared = (apart**2).sum(axis=2)
            squared[facing[block] @ self.ahead.T < _AGAINST] = np.inf
            best = squared.argmin(axis=1)
            rows = np.arange(len(best))
            ahead, beside = self.ahead[best], apart[rows, best]
            side = ahead[:, 0] * beside[:, 1] - ahead[:, 1] * beside[:, 0]
            station[block] = self.station[best] + along[rows, best]
            offset[block] = np.copysign(np.sqrt(squared[rows, best]), side)
        return station, offset


_BATCH = 1000
"""Number of points that are projected together."""


class Matcher:
    """Matches vehicles to the ways through a junction."""

    def __init__(self, junction: Junction) -> None:
        self._lines = [_Line.of(Itinerary.through(junction, *key)) for key in sorted(junction.movements)]
        inner = np.vstack([movement.path.points for movement in junction.movements.values() if movement.path is not None])
        self.centre = inner.mean(axis=0)
        self._radius = float(np.hypot(*(inner - self.centre).T).max()) + _DECISIVE_APPROACH

    def match(self, vehicle: Samples, points: _Values, heading: _Values) -> Iterator[Matched | str]:
        """Yield each pass of a vehicle through the junction; instead of a pass that has no way, yield the reason.

        Args:
            vehicle: samples of the vehicle in the log.
            points: middle of the front bumper, shape ``(samples, 2)`` [m].
            heading: heading of the vehicle, shape ``(samples,)`` [rad].
        """
        if float(np.hypot(*(points - self.centre).T).min()) > self._radius:
            yield NEVER
            return
        for piece in _unbroken(vehicle.times):
            yield from self._passes(points[piece], heading[piece], piece.start)

    def _passes(self, points: _Values, heading: _Values, first: int) -> Iterator[Matched | str]:
        """Yield the passes of a track without a gap; `first` is the number of its first sample."""
        picked = evenly_spaced(points)
        if len(picked) < 2:
            yield STANDS
            return
        projections = [line.project(points[picked], heading[picked]) for line in self._lines]
        station, offset = (np.array(values) for values in zip(*projections, strict=True))  # (ways, picked)
        # A point is inside the junction if the nearest place of the nearest way lies between entrance and exit.
        nearest = np.abs(offset).argmin(axis=0)
        column = np.arange(len(picked))
        lengths = np.array([line.way.length for line in self._lines])
        nearest_station = station[nearest, column]
        inside = (
            (np.abs(offset[nearest, column]) <= _FARTHEST_SAMPLE) & (nearest_station > 0.0) & (nearest_station < lengths[nearest])
        )
        cuts = _pass_starts(np.flatnonzero(inside))
        if not cuts and not bool(((np.abs(offset) <= _FARTHEST_SAMPLE) & (station <= 0.0)).any()):
            yield NEVER
            return
        bounds = [0, *(int(picked[cut]) for cut in cuts[1:]), len(points)]
        for begin, end in pairwise(bounds):
            of_pass = (picked >= begin) & (picked < end)
            chosen = self._choose(station[:, of_pass], offset[:, of_pass])
            if isinstance(chosen, str):
                yield chosen
            else:
                yield _match_along(chosen, points[begin:end], heading[begin:end], first + begin)

    def _choose(self, station: _Values, offset: _Values) -> _Line | str:
        """Return the way of a pass, or the reason why the pass has no way.

        Args:
            station: stations of the points of the pass on each way, shape ``(ways, points)`` [m].
            offset: distances of the points to the left of each way, shape ``(ways, points)`` [m].
        """
        ends = np.array([line.way.end for line in self._lines])[:, None]
        starts = np.array([max(-line.way.origin, -_DECISIVE_APPROACH) for line in self._lines])[:, None]
        on_way = (np.abs(offset) <= _FARTHEST_SAMPLE) & (station > starts) & (station < ends)
        near = on_way.any(axis=0)
        apart = np.minimum(np.abs(offset[:, near]), _OFF_DISTANCE)
        cost = np.sqrt((apart**2).sum(axis=1) / max(apart.shape[1], 1))
        order = np.argsort(cost, kind="stable")
        best = int(order[0])
        if not near.any() or cost[best] > FAR:
            return BESIDE
        stations_of_best = station[best][on_way[best]]
        if not len(stations_of_best) or stations_of_best[0] >= 0.0:
            return BEHIND
        if (
            len(order) > 1
            and cost[order[1]] - cost[best] < _LEAST_DIFFERENCE
            and stations_of_best[-1] < self._lines[best].way.length
        ):
            return BEFORE if stations_of_best[-1] <= 0.0 else UNCLEAR
        return self._lines[best]


NEVER = "it never comes near the junction"
STANDS = "it does not move"
BEFORE = "its way is not known: the track ends before the junction"
BEHIND = "its way is not known: the track begins in the junction or behind it"
UNCLEAR = "its way is not known: the track ends in the junction, and several ways are equally near"
BESIDE = f"it is more than {FAR:g} m away from every way through the junction"
_OFF_DISTANCE = 10.0
"""Distance that counts for every point farther away from a way [m]."""


def directions(points: _Values) -> _Values:
    """Return the headings of a vehicle derived from its motion, shape ``(samples,)`` [rad]; a standing vehicle keeps its heading.

    Args:
        points: positions of the vehicle, shape ``(samples, 2)`` [m].
    """
    picked = evenly_spaced(points)
    if len(picked) < 2:
        return np.zeros(len(points))
    along = np.gradient(points[picked], axis=0)
    angle = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    headings: _Values = np.interp(np.arange(len(points)), picked, angle)
    return headings


def evenly_spaced(points: _Values) -> NDArray[np.int64]:
    """Return the numbers of samples at distances of `_STEP` along a track, beginning with the first sample."""
    picked, (x, y) = [0], points[0].tolist()
    for k, (px, py) in enumerate(points.tolist()):
        if (px - x) ** 2 + (py - y) ** 2 >= _STEP**2:
            picked.append(k)
            x, y = px, py
    return np.array(picked)


def _unbroken(times: _Values) -> list[slice]:
    """Return the parts of a track between gaps, given its times [s]."""
    steps = np.diff(times)
    limit = min(max(_GAP, 5.0 * float(np.median(steps))), _LONGEST_GAP) if len(steps) else _GAP
    bounds = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(times)]
    return [slice(begin, end) for begin, end in pairwise(bounds)]


def _pass_starts(inside: NDArray[np.int64]) -> list[int]:
    """Return the numbers of the points at which the passes begin, given the numbers of the points inside the junction."""
    if not len(inside):
        return []
    exits = np.flatnonzero(np.diff(inside) > _SHORTEST_ABSENCE / _STEP)
    return [0, *((inside[exits] + inside[exits + 1]) // 2).tolist()]


_SHORTEST_ABSENCE = 20.0
"""Distance driven outside of the junction between two passes [m]; a shorter distance belongs to the same pass."""


def _match_along(line: _Line, points: _Values, heading: _Values, first: int) -> Matched | str:
    """Return the unbroken part of a pass that lies on its way and contains the crossing of the entrance vertex."""
    way = line.way
    station, lateral = line.project(points, heading)
    low, high = max(-way.origin, way.line - _FOLLOWED_APPROACH), way.end
    on = (np.abs(lateral) <= _FARTHEST_SAMPLE) & (station > low) & (station < high)
    crossed = np.flatnonzero(on & (station > 0.0))
    crossing = int(crossed[0]) if len(crossed) else int(np.flatnonzero(on)[-1])
    off = np.flatnonzero(~on)
    before, after = off[off < crossing], off[off > crossing]
    kept = slice(int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(points))
    station, lateral = station[kept], lateral[kept]
    if len(station) < 2 or station[0] >= 0.0:
        return BEHIND
    picked = evenly_spaced(points[kept])
    offset = float(np.sqrt((lateral[picked] ** 2).mean()))
    return Matched(way, slice(first + kept.start, first + kept.stop), station, lateral, offset)
