"""Conflicts between the ways of a junction: the stretches on which two ways are too near for two agents at the same time."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.ways import Key, Way
from pytest_rvads.support.errors import MapError

_SPACING = 0.5
"""Distance between two points of a centre line that are compared [m]."""
_PART = 128
"""Number of points of a part of a line; only parts with boxes near each other are compared point by point."""
_MOST_PARTS = 20_000
"""Most pairs of parts of two lines that are compared; two lines of 100 km side by side have 5,000."""


class JunctionKind(StrEnum):
    """The kind of a junction: whether some of its movements cross, movements only merge, or no two movements meet."""

    CROSSING = "crossing"
    """Some movements cross, or come nearer to each other than `CONFLICT_WIDTH`, although they have different exits."""
    MERGING = "merging"
    """Movements meet only if they lead into the same exit."""
    CONFLICT_FREE = "conflict-free"
    """No two movements from different entrances meet."""

    @classmethod
    def of(cls, meetings: Iterable[Shared]) -> JunctionKind:
        """Return the kind of a junction whose movements share the given stretches."""
        merges = {shared.merges for shared in meetings}
        return cls.CONFLICT_FREE if not merges else cls.CROSSING if False in merges else cls.MERGING


class Stretch(NamedTuple):
    """A part of a way, given by two distances along the way from its start."""

    start: float
    """First station [m]."""
    end: float
    """Last station [m]."""


class Shared(NamedTuple):
    """The stretches on which two ways are in conflict."""

    mine: Stretch
    """The stretch of the first way."""
    yours: Stretch
    """The stretch of the second way."""
    merges: bool
    """Whether both ways lead into the same exit, where two vehicles have room behind each other."""


class Line(NamedTuple):
    """A centre line along which an agent moves on a way."""

    path: Segment
    width: float
    """Width of the way [m]."""
    origin: float = 0.0
    """Distance from the beginning of the line to the start of the way [m]."""


def conflicts_of(
    ways: Mapping[Key, Way], movements: Collection[Key], courses: Mapping[Key, Line]
) -> Mapping[tuple[Key, Key], Shared] | None:
    """Return, per ordered pair of ways from different starts, the stretches of conflict; None without centre lines."""
    lines = {key: Line(way.path, way.width) for key, way in ways.items() if way.path is not None}
    if len(lines) < len(ways):
        return None
    shared = _stretches({key: lines[key] for key in movements})
    if len(movements) < len(ways):
        beside = _stretches({**lines, **courses})
        shared |= {pair: both for pair, both in beside.items() if sum(key in movements for key in pair) == 1}
    return MappingProxyType(shared)


def _stretches(ways: Mapping[Key, Line]) -> dict[tuple[Key, Key], Shared]:
    """Return, per ordered pair of ways, the stretches on which the two are nearer than half the sum of their widths.

    Pairs of ways from the same start are left out, because vehicles of an entrance follow each other.
    """
    keys = list(ways)
    lines = []
    for line in ways.values():
        segment = line.path
        stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
        samples = np.column_stack([np.interp(stations, segment.stations, segment.points[:, axis]) for axis in (0, 1)])
        lines.append((stations - line.origin, samples))
    widths = np.array([line.width for line in ways.values()])
    boxes = np.array([(*points.min(axis=0), *points.max(axis=0)) for _, points in lines]).reshape(-1, 4)
    shared = {}
    for i, (key, (along, own_points)) in enumerate(zip(keys, lines, strict=True)):
        # Most ways of a junction with many lanes are far apart; comparing their boxes is cheaper than comparing their lines.
        reach = (widths[i] + widths) / 2
        near_boxes = np.all(
            (boxes[:, :2] < boxes[i, 2:] + reach[:, None]) & (boxes[:, 2:] > boxes[i, :2] - reach[:, None]), axis=1
        )
        for k in near_boxes.nonzero()[0]:
            other_key, (across, other_points) = keys[k], lines[k]
            if key[0] >= other_key[0]:
                continue
            near, other_near = close(own_points, other_points, float(reach[k]))
            own_stations, other_stations = along[near], across[other_near]
            if len(own_stations):
                mine, yours = (
                    Stretch(float(own_stations[0]), float(own_stations[-1])),
                    Stretch(float(other_stations[0]), float(other_stations[-1])),
                )
                merges = key[1] == other_key[1]
                shared[key, other_key], shared[other_key, key] = Shared(mine, yours, merges), Shared(yours, mine, merges)
    return shared


def close(points: NDArray[np.float64], others: NDArray[np.float64], reach: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points of a line lie nearer than `reach` [m] to a point of another line, and which points of the other do."""
    near, other_near = np.zeros(len(points), np.bool_), np.zeros(len(others), np.bool_)
    starts, tests = np.arange(0, len(others), _PART), 0
    low, high = np.minimum.reduceat(others, starts), np.maximum.reduceat(others, starts)
    for first in range(0, len(points), _PART):
        part, margin = points[first : first + _PART], 1.001 * reach
        beside = ((low < part.max(axis=0) + margin) & (high > part.min(axis=0) - margin)).all(axis=1)
        tests += int(beside.sum())
        if tests > _MOST_PARTS:
            raise MapError("two of its lanes lie so close to each other for so long that they cannot be compared; cut the map")
        for start in starts[beside].tolist():
            apart = part[:, None] - others[None, start : start + _PART]
            both = np.einsum("ijk,ijk->ij", apart, apart) < reach**2
            near[first : first + _PART] |= both.any(axis=1)
            other_near[start : start + _PART] |= both.any(axis=0)
    return near, other_near
