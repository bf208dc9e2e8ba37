"""Which way through a junction a recorded vehicle took: the one nearest to its whole track, if its track tells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.satellites.tracks.samples import Samples

__all__ = ["NEVER", "STANDS", "Matched", "Matcher", "directions"]

_Values = NDArray[np.float64]

_REACH = 150.0
"""A vehicle is kept from so far before its stopping line on [m]."""
FAR = 3.0
"""Farthest that a vehicle drives beside its way, root mean square [m]: about a lane, as who changes lanes late does."""
_STRAY = 6.0
"""Farthest that a sample lies beside it [m]; what comes before or after is another road."""
_CLOSE = 50.0
"""Distance before the entrance vertex from which a track decides on the way [m]; vehicles farther away may change lanes."""
_CLEAR = 0.5
"""Least difference between the distances of the two nearest ways, root mean square [m]; below it the way is ambiguous."""
_STEP = 2.0
"""Distance between the compared points of a track [m]: equal distances keep a long stand from dominating."""
_GAP = 2.0
"""Longest gap between samples of a vehicle [s]; after a longer gap of more than five usual steps it is another vehicle."""
_LONGEST_GAP = 10.0
"""However seldom it is usually seen [s]: where it was meanwhile is not known."""
_AGAINST = -0.3
"""Cosine of the angle to a way from which on a vehicle drives against it."""


@dataclass(frozen=True, slots=True, eq=False)
class Matched:
    """A vehicle on its way through a junction."""

    way: Itinerary
    kept: slice
    """Which of its samples are on it."""
    station: _Values
    """Of these, shape ``(kept,)`` [m]."""
    lateral: _Values
    """How far they are to the left, likewise [m]."""
    offset: float
    """Root mean square of that, evenly along the way [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The centre line of a way as pieces, cut off where nobody is followed."""

    way: Itinerary
    start: _Values
    """Where each piece starts, shape ``(pieces, 2)`` [m]."""
    ahead: _Values
    """Its direction, likewise."""
    station: _Values
    """Where it starts, shape ``(pieces,)`` [m]."""
    long: _Values
    """How long it is, likewise [m]."""

    @classmethod
    def of(cls, way: Itinerary) -> _Line:
        points, station = way.path.points, way.path.stations - way.origin
        long = np.diff(station)
        return cls(way, points[:-1], np.diff(points, axis=0) / long[:, None], station[:-1], long)

    def project(self, points: _Values, heading: _Values) -> tuple[_Values, _Values]:
        """Return stations and offsets to the left of the nearest places that lead where a vehicle heads.

        Returns:
            Both of shape ``(points,)`` [m]; the offset is infinite where nothing of the way leads there.
        """
        facing = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        station, offset = np.empty(len(points)), np.empty(len(points))
        for begin in range(0, len(points), _AT_ONCE):
            here = slice(begin, begin + _AT_ONCE)
            apart = points[here, None, :] - self.start
            along = np.clip((apart * self.ahead).sum(axis=2), 0.0, self.long)
            apart -= along[:, :, None] * self.ahead
            squared = (apart**2).sum(axis=2)
            squared[facing[here] @ self.ahead.T < _AGAINST] = np.inf
            best = squared.argmin(axis=1)
            rows = np.arange(len(best))
            ahead, beside = self.ahead[best], apart[rows, best]
            side = ahead[:, 0] * beside[:, 1] - ahead[:, 1] * beside[:, 0]
            station[here] = self.station[best] + along[rows, best]
            offset[here] = np.copysign(np.sqrt(squared[rows, best]), side)
        return station, offset


_AT_ONCE = 1000
"""Points that are projected together."""


class Matcher:
    """Matches vehicles to the ways through one junction."""

    def __init__(self, junction: Junction) -> None:
        self._lines = [_Line.of(Itinerary.through(junction, *key)) for key in sorted(junction.movements)]
        inner = np.vstack([movement.path.points for movement in junction.movements.values() if movement.path is not None])
        self.centre = inner.mean(axis=0)
        self._radius = float(np.hypot(*(inner - self.centre).T).max()) + _CLOSE

    def match(self, vehicle: Samples, points: _Values, heading: _Values) -> Iterator[Matched | str]:
        """Yield each pass of a vehicle through the junction, or why there is none.

        Args:
            vehicle: as the log has it.
            points: the middle of its front bumper, shape ``(samples, 2)`` [m].
            heading: shape ``(samples,)`` [rad].
        """
        if float(np.hypot(*(points - self.centre).T).min()) > self._radius:
            yield NEVER
            return
        for piece in _unbroken(vehicle.times):
            yield from self._passes(points[piece], heading[piece], piece.start)

    def _passes(self, points: _Values, heading: _Values, first: int) -> Iterator[Matched | str]:
        """Yield the passes of an unbroken track, of which `first` is the number of the first sample."""
        picked = evenly(points)
        if len(picked) < 2:
            yield STANDS
            return
        found = [line.project(points[picked], heading[picked]) for line in self._lines]
        station, offset = (np.array(values) for values in zip(*found, strict=True))  # (ways, picked)
        # Inside: nearer to a movement than to any approach or exit road, of those that are near at all.
        nearest = np.abs(offset).argmin(axis=0)
        column = np.arange(len(picked))
        lengths = np.array([line.way.length for line in self._lines])
        there = station[nearest, column]
        inside = (np.abs(offset[nearest, column]) <= _STRAY) & (there > 0.0) & (there < lengths[nearest])
        cuts = _cuts(np.flatnonzero(inside))
        if not cuts and not bool(((np.abs(offset) <= _STRAY) & (station <= 0.0)).any()):
            yield NEVER
            return
        bounds = [0, *(int(picked[cut]) for cut in cuts[1:]), len(points)]
        for begin, end in pairwise(bounds):
            mine = (picked >= begin) & (picked < end)
            chosen = self._choose(station[:, mine], offset[:, mine])
            if isinstance(chosen, str):
                yield chosen
            else:
                yield _followed(chosen, points[begin:end], heading[begin:end], first + begin)

    def _choose(self, station: _Values, offset: _Values) -> _Line | str:
        """Return the way that a pass took, given where it is on and beside each, both of shape ``(ways, picked)``."""
        ends = np.array([line.way.end for line in self._lines])[:, None]
        starts = np.array([max(-line.way.origin, -_CLOSE) for line in self._lines])[:, None]
        on = (np.abs(offset) <= _STRAY) & (station > starts) & (station < ends)
        near = on.any(axis=0)
        apart = np.minimum(np.abs(offset[:, near]), _OFF)
        cost = np.sqrt((apart**2).sum(axis=1) / max(apart.shape[1], 1))
        order = np.argsort(cost, kind="stable")
        best = int(order[0])
        if not near.any() or cost[best] > FAR:
            return BESIDE
        mine = station[best][on[best]]
        if not len(mine) or mine[0] >= 0.0:
            return BEHIND
        if len(order) > 1 and cost[order[1]] - cost[best] < _CLEAR and mine[-1] < self._lines[best].way.length:
            return BEFORE if mine[-1] <= 0.0 else UNCLEAR
        return self._lines[best]


NEVER = "it never comes near the junction"
STANDS = "it does not move"
BEFORE = "its way is not known: the track ends before the junction"
BEHIND = "its way is not known: the track begins in the junction or behind it"
UNCLEAR = "its way is not known: the track ends in the junction, where several ways are still as near"
BESIDE = f"it is more than {FAR:g} m beside every way through the junction"
_OFF = 10.0
"""Lateral distance of a point that lies off a way [m], whatever the true distance."""


def directions(points: _Values) -> _Values:
    """Return where a vehicle heads by the way it makes, shape ``(samples,)`` [rad]; standing, as it came."""
    picked = evenly(points)
    if len(picked) < 2:
        return np.zeros(len(points))
    along = np.gradient(points[picked], axis=0)
    angle = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    found: _Values = np.interp(np.arange(len(points)), picked, angle)
    return found


def evenly(points: _Values) -> NDArray[np.int64]:
    """Return numbers of samples that are `_STEP` apart, the first among them."""
    picked, (x, y) = [0], points[0].tolist()
    for k, (px, py) in enumerate(points.tolist()):
        if (px - x) ** 2 + (py - y) ** 2 >= _STEP**2:
            picked.append(k)
            x, y = px, py
    return np.array(picked)


def _unbroken(times: _Values) -> list[slice]:
    """Return the parts of a track between gaps."""
    steps = np.diff(times)
    limit = min(max(_GAP, 5.0 * float(np.median(steps))), _LONGEST_GAP) if len(steps) else _GAP
    bounds = [0, *(np.flatnonzero(steps > limit) + 1).tolist(), len(times)]
    return [slice(begin, end) for begin, end in pairwise(bounds)]


def _cuts(inside: NDArray[np.int64]) -> list[int]:
    """Return where the track of each pass begins, given which of its places, evenly apart, are in the junction."""
    if not len(inside):
        return []
    left = np.flatnonzero(np.diff(inside) > _OUT / _STEP)
    return [0, *((inside[left] + inside[left + 1]) // 2).tolist()]


_OUT = 20.0
"""Who was out of the junction for so long [m] enters it again."""


def _followed(line: _Line, points: _Values, heading: _Values, first: int) -> Matched | str:
    """Return the part of a pass that is on its way, without a break around the entrance vertex."""
    way = line.way
    station, lateral = line.project(points, heading)
    low, high = max(-way.origin, way.line - _REACH), way.end
    on = (np.abs(lateral) <= _STRAY) & (station > low) & (station < high)
    crossed = np.flatnonzero(on & (station > 0.0))
    crossing = int(crossed[0]) if len(crossed) else int(np.flatnonzero(on)[-1])
    off = np.flatnonzero(~on)
    before, after = off[off < crossing], off[off > crossing]
    kept = slice(int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(points))
    station, lateral = station[kept], lateral[kept]
    if len(station) < 2 or station[0] >= 0.0:
        return BEHIND
    picked = evenly(points[kept])
    offset = float(np.sqrt((lateral[picked] ** 2).mean()))
    return Matched(way, slice(first + kept.start, first + kept.stop), station, lateral, offset)
