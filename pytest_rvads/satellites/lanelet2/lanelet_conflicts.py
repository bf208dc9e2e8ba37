"""Conflicts between lanelets: pairs that cross, merge or part, and the stretches of lanelets where conflicts lie."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import networkx as nx
import numpy as np

from pytest_rvads.satellites.lanelet2.lanelets import Array, Lanelet
from pytest_rvads.support.errors import MapError

__all__ = ["Conflicts", "conflicts_of", "free_ends", "intersections"]

_ANGLE = math.sin(math.radians(7.0))
"""Sine of the least angle at which two centre lines cross."""
_NEAR = 3.0
"""Distance between centre lines below which two lanelets are in each other's way [m]; less than the width of a lane."""
_CHUNK = 16
"""Number of pieces of a chunk of a centre line."""
_MOST_TESTS = 1_000_000
"""Most pairs of chunks that are compared; a town has 10,000."""

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Conflicts:
    """Pairs of lanelets in conflict."""

    crossing: tuple[Pair, ...]
    """Pairs whose centre lines cross."""
    touching: tuple[Pair, ...]
    """Pairs with a common successor or a common predecessor."""

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All pairs."""
        return self.crossing + self.touching


def conflicts_of(lanes: Mapping[str, Lanelet], links: nx.DiGraph) -> Conflicts:
    """Return the pairs of lanelets that cross, merge or part.

    Raises:
        MapError: so many lanelets overlap that the comparison would take too long.
    """
    touching: dict[Pair, None] = {}
    for id in lanes:
        for neighbours in (links.succ[id], links.pred[id]):
            if len(neighbours) > 100:
                raise MapError(f"{len(neighbours)} lanelets meet at one end of lanelet {id!r}, expected at most 100")
            for pair in combinations(sorted(neighbours), 2):
                if lanes[pair[0]].source != lanes[pair[1]].source:
                    touching[pair] = None
    return Conflicts(tuple(_crossing(lanes, links)), tuple(touching))


def _crossing(lanes: Mapping[str, Lanelet], links: nx.DiGraph) -> Iterator[Pair]:
    """Yield the pairs of lanelets whose centre lines cross between their ends; linked lanelets are no pair."""
    items = list(lanes.values())
    ends = np.array([len(lane.points) - 1 for lane in items])
    # Centre lines are compared in chunks, because boxes around whole lines overlap too often.
    owner = np.repeat(np.arange(len(items)), -(-ends // _CHUNK))
    start = np.concatenate([np.arange(0, end, _CHUNK) for end in ends])
    steps = np.arange(_CHUNK + 1)
    chunks = np.array([items[i].points[np.minimum(first + steps, ends[i])] for i, first in zip(owner, start, strict=True)])
    low, high = chunks.min(axis=1), chunks.max(axis=1)
    pairs: set[tuple[int, int]] = set()
    tests = 0
    for k, (i, first) in enumerate(zip(owner, start, strict=True)):
        near = ((low[k + 1 :] <= high[k]) & (high[k + 1 :] >= low[k])).all(axis=1) & (owner[k + 1 :] != i)
        others = np.flatnonzero(near) + k + 1
        tests += len(others)
        if tests > _MOST_TESTS:
            raise MapError("too many of its lanelets overlap to compare them all; cut the map into pieces")
        along, other_along = intersections(chunks[k], chunks[others], _ANGLE)
        inner = (along + first > 1e-6) & (along + first < ends[i] - 1e-6)
        other_along += start[others, None, None]
        inner &= (other_along > 1e-6) & (other_along < ends[owner[others], None, None] - 1e-6)
        pairs.update((int(i), int(owner[other])) for other in others[inner.any(axis=(1, 2))])
    for lane, other in ((items[i], items[k]) for i, k in sorted(pairs)):
        if lane.source != other.source and not links.has_edge(lane.id, other.id) and not links.has_edge(other.id, lane.id):
            yield lane.id, other.id


def intersections(line: Array, other: Array, angle: float = 1e-9) -> tuple[Array, Array]:
    """Return the places where a line intersects another line, or each of several lines.

    Args:
        line: points of a line, shape ``(k, 2)`` [m].
        other: points of other lines, shape ``(..., m, 2)`` [m].
        angle: sine of the least angle of an intersection.

    Returns:
        Per piece of the line and piece of the other line, the place on either line as the number of a point plus the fraction up
        to the next point, shape ``(..., k - 1, m - 1)`` each; NaN where the pieces do not meet.
    """
    steps, other_steps = (line[1:] - line[:-1])[:, None], (other[..., 1:, :] - other[..., :-1, :])[..., None, :, :]
    apart = other[..., None, :-1, :] - line[:-1, None]
    turn = _product(steps, other_steps)
    steep = np.abs(turn) > angle * np.hypot(steps[..., 0], steps[..., 1]) * np.hypot(other_steps[..., 0], other_steps[..., 1])
    turn = np.where(steep, turn, np.inf)
    along, other_along = _product(apart, other_steps) / turn, _product(apart, steps) / turn
    meet = steep & (along >= 0) & (along <= 1) & (other_along >= 0) & (other_along <= 1)
    numbers, other_numbers = np.arange(len(line) - 1)[:, None], np.arange(other.shape[-2] - 1)
    return np.where(meet, along + numbers, np.nan), np.where(meet, other_along + other_numbers, np.nan)


def _product(one: Array, two: Array) -> Array:
    return np.asarray(one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0])


def free_ends(lanes: Mapping[str, Lanelet], pairs: Iterable[Pair], members: Collection[str]) -> dict[str, tuple[float, float]]:
    """Return how long the first and the last part of lanelets are that are in nobody's way [m].

    Args:
        lanes: the lanelets by id.
        pairs: the pairs in conflict.
        members: ids of the lanelets of one junction; only conflicts among these count.
    """
    near: defaultdict[str, list[float]] = defaultdict(list)
    for lane, other in ((lanes[a], lanes[b]) for a, b in pairs if a in members and b in members):
        distance = np.hypot(*np.moveaxis(lane.points[:, None] - other.points[None], -1, 0))
        near[lane.id] += lane.stations[distance.min(axis=1) < _NEAR].tolist()
        near[other.id] += other.stations[distance.min(axis=0) < _NEAR].tolist()
    return {id: (min(stations), lanes[id].length - max(stations)) for id, stations in near.items() if stations}
