"""The ways of a junction, and the stretches that two ways share."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import Segment, Turn

__all__ = ["CONFLICT_WIDTH", "JunctionKind", "Key", "Line", "Shared", "Stretch", "Way", "stretches"]

CONFLICT_WIDTH = 2.6
"""Width of a movement: distance of centre lines below which two movements are in conflict [m].

The distance is the width of a car and the width that its body sweeps in a bend.
"""
_SPACING = 0.5

Key = tuple[int, int]
"""A way, as the numbers of its start and its end: for a movement the numbers of its entrance and its exit."""


class Way(Protocol):
    """A path through a junction, for whoever moves along it: a movement, or a further way, see `Junction.further`."""

    @property
    def entrance(self) -> int:
        """Number of its start: of the entrance, for a movement."""

    @property
    def exit(self) -> int:
        """Number of its end: of the exit, for a movement."""

    @property
    def key(self) -> Key:
        """Numbers of start and end."""

    @property
    def kind(self) -> str:
        """The kind of way, a noun."""

    @property
    def turn(self) -> Turn:
        """The side to which the way turns."""

    @property
    def length(self) -> float:
        """Length from the start to the end along the centre line [m]."""

    @property
    def width(self) -> float:
        """Width that bodies on the way take up [m]."""

    @property
    def path(self) -> Segment | None:
        """The centre line; None if it is not known."""


class JunctionKind(StrEnum):
    """The kind of a junction by the meetings of its movements."""

    CROSSING = "crossing"
    """Some movements cross, or come too near to each other."""
    MERGING = "merging"
    """Movements meet only if they lead into the same exit."""
    CONFLICT_FREE = "conflict-free"
    """No two movements from different entrances meet."""


class Stretch(NamedTuple):
    """A part of a way, as stations after its start."""

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


def stretches(ways: Mapping[Key, Line]) -> dict[tuple[Key, Key], Shared]:
    """Return the stretches that pairs of ways share, in both orders: where they are nearer than half the sum of their widths.

    Pairs of ways from the same start are left out, because vehicles of an entrance follow each other.

    Args:
        ways: the line of every way.
    """
    keys = list(ways)
    lines = [_sample(line) for line in ways.values()]
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
            apart = own_points[:, None] - other_points[None]
            near = np.einsum("ijk,ijk->ij", apart, apart) < float(reach[k]) ** 2
            own_stations, other_stations = along[near.any(axis=1)], across[near.any(axis=0)]
            if len(own_stations):
                mine, yours = (
                    Stretch(float(own_stations[0]), float(own_stations[-1])),
                    Stretch(float(other_stations[0]), float(other_stations[-1])),
                )
                merges = key[1] == other_key[1]
                shared[key, other_key], shared[other_key, key] = Shared(mine, yours, merges), Shared(yours, mine, merges)
    return shared


def _sample(line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations, shape ``(k,)``, and points, shape ``(k, 2)``, along a centre line [m]."""
    segment = line.path
    stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
    return stations - line.origin, np.column_stack(
        [np.interp(stations, segment.stations, segment.points[:, axis]) for axis in (0, 1)]
    )
