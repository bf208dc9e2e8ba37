"""Approaches that overlap, so that vehicles of two entrances would start in the same lane, or inside each other.

Upstream of turn lanes several entrances share a lane, and a turn lane has no width where it begins. On such approaches, two
vehicles at the same distance from their lines would stand inside each other.

`Scenario.starts` refuses, before a run, starts of vehicles inside each other and starts on approaches that are too short.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction

_BESIDE = 2.0
"""Distance of centre lines below which two lanes count as one lane [m]: cars, 1.86 m wide, have no room beside each other."""
_NEAR = 3.0
"""Distance of centre lines from which on bodies do not touch [m].

The law allows vehicles a width of at most 2.6 m (Council Directive 96/53/EC, Annex I).
"""
_SPACING = 0.5
"""Distance of the points at which approaches are compared [m]."""


class Fork(NamedTuple):
    """Two entrances, the lower number first, whose approaches begin on one common lane."""

    entrances: tuple[int, int]
    distances: tuple[float, float]
    """Distances before the two stopping lines at which the lanes part [m]; negative behind the line."""


@lru_cache(maxsize=256)
def forks(place: Junction) -> tuple[Fork, ...]:
    """Return the pairs of entrances whose approaches begin on a common lane; entrances without a known approach are skipped."""
    lines = _approaches(place)
    pairs = []
    for first, second in combinations(lines, 2):
        distances = _parting(lines[first], lines[second])
        if distances is None and (swapped := _parting(lines[second], lines[first])) is not None:
            distances = swapped[1], swapped[0]
        if distances is not None:
            of_first, of_second = distances[0] - place.setbacks[first], distances[1] - place.setbacks[second]
            pairs.append(Fork((first, second), (of_first, of_second)))
    return tuple(pairs)


@lru_cache(maxsize=256)
def near(place: Junction) -> frozenset[tuple[int, int]]:
    """Return the pairs of entrances, the lower number first, on whose approaches vehicles could start inside each other.

    The two approaches begin on a common lane, see `forks`, or converge towards their stopping lines.
    """
    lines = {entrance: points[::-2] for entrance, points in _approaches(place).items()}
    pairs = combinations(lines, 2)
    return frozenset((a, b) for a, b in pairs if min(np.hypot(*(lines[b] - p).T).min() for p in lines[a]) < _NEAR)


def _parting(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the distances before their ends at which two lines part [m]; None if the first line does not begin on the second."""
    last = nearest = -1
    for k, point in enumerate(first):
        gaps = np.hypot(*(second - point).T)
        if gaps.min() >= _BESIDE:
            break
        last, nearest = k, int(gaps.argmin())
    if last < 0:
        return None
    return (len(first) - 1 - last) * _SPACING, (len(second) - 1 - nearest) * _SPACING


def _approaches(place: Junction) -> dict[int, NDArray[np.float64]]:
    """Return, per entrance with a known approach, points of the approach, the last at its end, shape ``(k, 2)`` [m]."""
    points = {}
    for entrance, lane in enumerate(place.entrances):
        if line := lane.approach:
            stations = np.arange(line.length, 0.0, -_SPACING)[::-1]
            points[entrance] = np.column_stack([np.interp(stations, line.stations, axis) for axis in line.points.T])
    return points
