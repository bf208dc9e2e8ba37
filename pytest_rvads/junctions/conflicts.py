"""The shared stretches of the movements of a junction."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.segment import Segment

__all__ = ["CONFLICT_WIDTH", "JunctionKind", "Key", "Shared", "Stretch", "stretches"]

CONFLICT_WIDTH = 2.6
"""Distance of centre lines below which two movements are in conflict [m].

The distance is the width of a car and the width that its body sweeps in a bend.
"""
_SPACING = 0.5

Key = tuple[int, int]
"""A movement, as the numbers of its entrance and its exit."""


class JunctionKind(StrEnum):
    """The kind of a junction by the meetings of its movements."""

    CROSSING = "crossing"
    """Some movements cross, or come too near to each other."""
    MERGING = "merging"
    """Movements meet only if they lead into the same exit."""
    CONFLICT_FREE = "conflict-free"
    """No two movements from different entrances meet."""


class Stretch(NamedTuple):
    """A part of a movement, as stations after the entrance vertex."""

    start: float
    """First station [m]."""
    end: float
    """Last station [m]."""


class Shared(NamedTuple):
    """The stretches on which two movements are in conflict."""

    mine: Stretch
    """The stretch of the first movement."""
    yours: Stretch
    """The stretch of the second movement."""
    merges: bool
    """Whether both movements lead into the same exit, where two vehicles have room behind each other."""


def stretches(paths: Mapping[Key, Segment]) -> dict[tuple[Key, Key], Shared]:
    """Return the stretches that pairs of movements share, in both orders.

    Pairs of movements from the same entrance are left out, because vehicles of an entrance follow each other.

    Args:
        paths: the centre line of every movement.
    """
    keys = list(paths)
    lines = [_sample(paths[key]) for key in keys]
    boxes = np.array([(*points.min(axis=0), *points.max(axis=0)) for _, points in lines]).reshape(-1, 4)
    found = {}
    for i, (one, (along, first)) in enumerate(zip(keys, lines, strict=True)):
        # Most movements of a junction with many lanes are far apart; comparing their boxes is cheaper than comparing their lines.
        near_boxes = np.all(
            (boxes[:, :2] < boxes[i, 2:] + CONFLICT_WIDTH) & (boxes[:, 2:] > boxes[i, :2] - CONFLICT_WIDTH), axis=1
        )
        for k in near_boxes.nonzero()[0]:
            two, (across, second) = keys[k], lines[k]
            if one[0] >= two[0]:
                continue
            apart = first[:, None] - second[None]
            near = np.einsum("ijk,ijk->ij", apart, apart) < CONFLICT_WIDTH**2
            here, there = along[near.any(axis=1)], across[near.any(axis=0)]
            if len(here):
                mine, yours = Stretch(float(here[0]), float(here[-1])), Stretch(float(there[0]), float(there[-1]))
                merges = one[1] == two[1]
                found[one, two], found[two, one] = Shared(mine, yours, merges), Shared(yours, mine, merges)
    return found


def _sample(segment: Segment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations, shape ``(k,)``, and points, shape ``(k, 2)``, along a centre line [m]."""
    stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
    return stations, np.column_stack([np.interp(stations, segment.stations, segment.points[:, axis]) for axis in (0, 1)])
