"""Where the movements of a junction get in each other's way, and who then gives way to whom."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.maps.segment import Segment

__all__ = ["CONFLICT_WIDTH", "JunctionKind", "Key", "Shared", "Stretch", "stretches"]

CONFLICT_WIDTH = 2.6
"""Two movements whose centre lines come nearer than this are in conflict [m]: the width of a car and what its body sweeps
in a bend."""
_SPACING = 0.5

Key = tuple[int, int]
"""A movement: numbers of its entrance and its exit."""


class JunctionKind(StrEnum):
    """How the ways through a junction meet."""

    CROSSING = "crossing"
    """Some movements cross, or come too near to each other."""
    MERGING = "merging"
    """Movements meet only where they lead into one exit."""
    CONFLICT_FREE = "conflict-free"
    """No two movements from different entrances meet."""


class Stretch(NamedTuple):
    """Part of a movement, after the entrance vertex."""

    start: float
    """[m]."""
    end: float
    """[m]."""


class Shared(NamedTuple):
    """Where two movements get in each other's way."""

    mine: Stretch
    """On the first movement."""
    yours: Stretch
    """On the second one."""
    merges: bool
    """Whether both lead into the same exit: behind each other there is then room for both."""


def stretches(paths: Mapping[Key, Segment]) -> dict[tuple[Key, Key], Shared]:
    """Return what pairs of movements share, in both orders.

    Movements from one entrance don't count: there one vehicle follows the other.

    Args:
        paths: the centre line of every movement.
    """
    keys = list(paths)
    lines = [_sample(paths[key]) for key in keys]
    boxes = np.array([(*points.min(axis=0), *points.max(axis=0)) for _, points in lines]).reshape(-1, 4)
    found = {}
    for i, (one, (along, first)) in enumerate(zip(keys, lines, strict=True)):
        # Most of many lanes keep apart; their boxes tell that without looking at the lines.
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
