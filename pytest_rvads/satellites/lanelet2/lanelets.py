"""Lanelets: lanes between a left and a right bound, with their centre lines, their links, and the conflicts between them.

Two lanelets are in conflict if they cross, merge or part.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import close
from pytest_rvads.geometry.crosswalks import hull
from pytest_rvads.geometry.network import PaintedCrosswalk
from pytest_rvads.geometry.opendrive.builder import MAX_SAMPLES
from pytest_rvads.support.errors import MapError

_STEP = 0.75
"""Distance between the points of centre lines [m]."""
_SHORTEST = 0.05
"""Length up to which a lanelet or a bound is left out [m]."""
_LONGEST = 20_000.0
"""Longest bound of a lanelet [m]."""
_MOST_MEETING = 100
"""Most lanelets that begin at one place, or that meet at one end of a lanelet."""
_GAP, _BEND = 0.6, math.radians(20.0)
"""Widest gap [m] and largest bend [rad] between two lanelets that are linked though they share no nodes."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """A bound of a lanelet in the direction of travel."""

    points: Array
    """Points of the bound, shape ``(k, 2)``, k >= 2 [m]."""
    first: Hashable
    """Name of the place where the bound begins; bounds with equal names meet there."""
    last: Hashable
    ways: tuple[tuple[str, bool], ...] = ()
    """The ways of the bound, each with whether the way runs in the direction of travel."""

    def reversed(self) -> Bound:
        """Return the bound in the other direction."""
        return Bound(self.points[::-1], self.last, self.first, tuple((way, not along) for way, along in self.ways[::-1]))


@dataclass(frozen=True, slots=True, eq=False)
class Lanelet:
    """A lanelet for vehicles in one direction of travel, or a piece of such a lanelet."""

    id: str
    """Id of the edge that the lanelet becomes."""
    source: str
    """Id of the lanelet in the file; both directions and all pieces of a lanelet have the same source."""
    left: Bound
    right: Bound
    limit: float | None = None
    """Speed limit that the file states [m/s]; `NO_LIMIT` for no limit, None if nothing is stated."""
    area: str | None = field(default=None, kw_only=True)
    """Id of the intersection area of the lanelet."""
    turn: str = field(default="", kw_only=True)
    """The turn that the file states: ``left``, ``straight`` or ``right``; empty if nothing is stated."""
    points: Array = field(default_factory=lambda: np.empty((0, 2)), kw_only=True)
    """Points of the centre line, shape ``(k, 2)``, k >= 3 [m]."""
    stations: Array = field(default_factory=lambda: np.empty(0), kw_only=True)
    """Stations of these points along the centre line, shape ``(k,)`` [m]."""
    width: float = field(default=0.0, kw_only=True)
    """Distance between the bounds at mid-length [m]."""

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return float(self.stations[-1])

    @property
    def start(self) -> tuple[Hashable, Hashable]:
        """The places where the left and the right bound begin."""
        return self.left.first, self.right.first

    @property
    def end(self) -> tuple[Hashable, Hashable]:
        """The places where the left and the right bound end."""
        return self.left.last, self.right.last

    @property
    def corners(self) -> tuple[Array, Array, Array, Array]:
        """Points where the left and the right bound begin, and where they end, shape ``(2,)`` each [m]."""
        return self.left.points[0], self.right.points[0], self.left.points[-1], self.right.points[-1]

    def heading(self, at: int) -> float:
        """Return the direction of the centre line at its start (0) or end (-1) [rad]."""
        x, y = self.points[1] - self.points[0] if at == 0 else self.points[-1] - self.points[-2]
        return math.atan2(y, x)


def turned(lanelet: Lanelet) -> Lanelet:
    """Return the lanelet of the other direction of travel on a two-way lanelet."""
    return replace(lanelet, id=f"{lanelet.id}:back", left=lanelet.right.reversed(), right=lanelet.left.reversed())


def crosswalk_of(id: str, bounds: Sequence[Array]) -> PaintedCrosswalk | None:
    """Return the crosswalk between two bounds, which are points of shape ``(k, 2)`` [m]; None if the points have no area."""
    area = hull(np.vstack(bounds))
    return PaintedCrosswalk(id, "", area) if len(area) > 2 else None


def aligned(left: Bound, right: Bound) -> tuple[Bound, Bound]:
    """Return two bounds turned so that the right bound lies on the right of the left bound, as Lanelet2's ``geometry::align``."""
    if _on_left(left.points, _middle(right.points)):
        left = left.reversed()
    if not _on_left(right.points, _middle(left.points)):
        right = right.reversed()
    return left, right


def _middle(line: Array) -> Array:
    return np.asarray(line[len(line) // 2] if len(line) > 2 else line.mean(axis=0))


def _on_left(line: Array, point: Array) -> bool:
    """Return whether a point lies on the left of the nearest place of a line."""
    start, step = line[:-1], line[1:] - line[:-1]
    square = np.maximum((step**2).sum(axis=1), 1e-12)
    along = np.clip(((point - start) * step).sum(axis=1) / square, 0.0, 1.0)
    away = point - start - along[:, None] * step
    distance = np.hypot(*away.T)
    nearest = distance <= distance.min() + 1e-9  # at a corner of the line, two pieces are nearest
    side = (step[:, 0] * (point - start)[:, 1] - step[:, 1] * (point - start)[:, 0]) / np.sqrt(square)
    return float(side[nearest][np.abs(side[nearest]).argmax()]) > 0


def stations_of(line: Array) -> Array:
    """Return the stations of the points of a line along the line, shape ``(k,)`` [m]."""
    steps = line[1:] - line[:-1]
    stations = np.zeros(len(line))
    np.cumsum(np.hypot(steps[:, 0], steps[:, 1]), out=stations[1:])
    return stations


def with_centre_lines(lanelets: Iterable[Lanelet]) -> tuple[dict[str, Lanelet], list[str]]:
    """Return the lanelets with centre lines by id, and the ids of lanelets that are left out because they are too short.

    A centre line lies midway between the bounds, which are divided into equal fractions.
    """
    lanes: dict[str, Lanelet] = {}
    short: list[str] = []
    samples = 0
    for lanelet in lanelets:
        bounds = [(bound.points, stations_of(bound.points)) for bound in (lanelet.left, lanelet.right)]
        lengths = [float(stations[-1]) for _, stations in bounds]
        if max(lengths) > _LONGEST:
            raise MapError(
                f"lanelet {lanelet.id!r} is {max(lengths) / 1000:,.1f} km long, expected at most {_LONGEST / 1000:.0f} km; check "
                "the unit of length and the coordinates of its points"
            )
        fractions = np.linspace(0.0, 1.0, max(math.ceil(max(lengths) / _STEP), 2) + 1)
        samples += len(fractions)
        if samples > MAX_SAMPLES:
            raise MapError(f"its lanelets would take more than {MAX_SAMPLES:,} samples; cut the map into pieces")
        sides = np.array([[np.interp(fractions * s[-1], s, line[:, axis]) for axis in (0, 1)] for line, s in bounds])
        points = sides.mean(axis=0).T
        stations = stations_of(points)
        apart = np.concatenate(([True], np.diff(stations) > 1e-6))
        if min(lengths) < _SHORTEST or math.dist(points[0], points[-1]) < _SHORTEST or apart.sum() < 3:
            short.append(lanelet.id)
            continue
        width = float(np.hypot(*(sides[0] - sides[1])[:, len(fractions) // 2]))
        lanes[lanelet.id] = replace(lanelet, points=points[apart], stations=stations[apart], width=width)
    return lanes, short


def link_lanelets(lanes: Mapping[str, Lanelet]) -> nx.DiGraph:
    """Return the links of lanelets: a lanelet follows another lanelet if both its bounds begin where the bounds of the other end.

    Lanelets that share no end points are linked if their centre lines meet within 0.6 m and 20 degrees.
    """
    links = nx.DiGraph()
    links.add_nodes_from(lanes)
    starts: defaultdict[Hashable, list[str]] = defaultdict(list)
    cells: defaultdict[tuple[int, int], list[str]] = defaultdict(list)
    for id, lane in lanes.items():
        starts[lane.start].append(id)
        cells[cell_of(lane.points[0])].append(id)
    for id, lane in lanes.items():
        column, row = cell_of(lane.points[-1])
        near = [after for i in (-1, 0, 1) for k in (-1, 0, 1) for after in cells.get((column + i, row + k), ())]
        if max(len(starts[lane.end]), len(near)) > _MOST_MEETING:
            raise MapError(
                f"more than {_MOST_MEETING} lanelets begin where lanelet {id!r} ends, expected lanelets beside each other"
            )
        links.add_edges_from((id, after) for after in starts[lane.end] if after != id)
        for after in near:
            bend = math.remainder(lanes[after].heading(0) - lane.heading(-1), math.tau)
            meet = math.dist(lane.points[-1], lanes[after].points[0]) <= _GAP and abs(bend) <= _BEND
            if meet and lanes[after].source != lane.source:
                links.add_edge(id, after)
    return links


def turn_odd(lanes: dict[str, Lanelet], links: nx.DiGraph) -> list[str]:
    """Turn and link the lanelets, in `lanes` and `links`, whose left and right bounds are exchanged, and return their ids.

    A chain of one-way lanelets is turned if no lanelet leads to it or follows it, but in the other direction lanelets lead to it
    and follow it, or lanelets that have further links do one of the two.
    """
    loose = []
    for id in (id for id in lanes if not links.pred[id]):
        chain = [id]
        while len(links.succ[chain[-1]]) == 1 and len(links.pred[after := next(iter(links.succ[chain[-1]]))]) == 1:
            chain.append(after)
        if not links.succ[chain[-1]] and not any(f"{lanes[lane].source}:back" in lanes for lane in chain):
            loose.append(chain)
    back, _ = with_centre_lines(turned(lanes[id]) for chain in loose for id in chain)
    both = link_lanelets({**lanes, **back}) if back else links
    used = set(lanes)
    for fewest in (2, 1):
        for chain in (chain for chain in loose if used.issuperset(chain) and all(f"{id}:back" in back for id in chain)):
            if used.isdisjoint((*both.pred[chain[0]], *both.succ[chain[-1]])):
                ends = [used.intersection(both.pred[f"{chain[-1]}:back"]), used.intersection(both.succ[f"{chain[0]}:back"])]
                anchored = not any(used.isdisjoint((*both.pred[id], *both.succ[id])) for id in ends[0] | ends[1])
                if sum(map(bool, ends)) == 2 or (fewest == 1 and any(ends) and anchored):
                    used.symmetric_difference_update(name for id in chain for name in (id, f"{id}:back"))
    odd = [id for id in lanes if id not in used]
    if odd:
        lanes.update((id, replace(back[f"{id}:back"], id=id)) for id in odd)
        links.remove_nodes_from(odd)
        links.add_edges_from(pair for pair in link_lanelets(lanes).edges if not {*odd}.isdisjoint(pair))
        links.add_nodes_from(odd)
    return odd


def cell_of(point: Array) -> tuple[int, int]:
    """Return the square metre in which a point lies."""
    return math.floor(point[0]), math.floor(point[1])


def hand_votes(lanes: Iterable[Lanelet]) -> dict[str, list[str]]:
    """Return the votes for the side on which traffic keeps: the ways that opposite lanelets share as bounds.

    A way that is the left bound of both lanelets is a vote for ``right``, a way that is the right bound of both for ``left``.
    """
    votes = {}
    for hand, side in (("right", "left"), ("left", "right")):
        bounds: Sequence[Bound] = [getattr(lane, side) for lane in lanes]
        directions: defaultdict[str, set[bool]] = defaultdict(set)
        for way, along in (row for bound in bounds for row in bound.ways):
            directions[way].add(along)
        votes[hand] = [way for way, both in directions.items() if len(both) == 2]
    return votes


_ANGLE = math.sin(math.radians(7.0))
"""Sine of the least angle at which two centre lines cross."""
_NEAR = 3.0
"""Distance between centre lines below which two lanelets are in each other's way [m]; less than the width of a lane."""
_CHUNK = 16
"""Number of pieces of a chunk of a centre line."""
_MOST_TESTS = 300_000
"""Most pairs of chunks that are compared, and most pairs of lanelets that meet; a town has 10,000."""
_TOO_MANY = "too many of its lanelets overlap to compare them all; cut the map into pieces"

Pair = tuple[str, str]


def conflicts_of(lanes: Mapping[str, Lanelet], links: nx.DiGraph) -> tuple[list[Pair], list[Pair]]:
    """Return the pairs of lanelets whose centre lines cross, and the pairs with a common successor or predecessor."""
    touching: dict[Pair, None] = {}
    tests = 0
    for id in lanes:
        for neighbours in (links.succ[id], links.pred[id]):
            tests += len(neighbours) ** 2 // 2
            if len(neighbours) > _MOST_MEETING:
                raise MapError(f"{len(neighbours)} lanelets meet at one end of lanelet {id!r}, expected at most {_MOST_MEETING}")
            if tests > _MOST_TESTS:
                raise MapError(_TOO_MANY)
            for pair in combinations(sorted(neighbours), 2):
                if lanes[pair[0]].source != lanes[pair[1]].source:
                    touching[pair] = None
    return list(_crossing(lanes, links)), list(touching)


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
    # Along the axis on which the map is longer, only the chunks between two places can overlap a chunk.
    axis = int(np.ptp(low, axis=0).argmax())
    order = low[:, axis].argsort()
    sorted_low, reach = low[order, axis], (high - low)[:, axis].max() + 1.0
    first_near = np.searchsorted(sorted_low, low[:, axis] - reach)
    last_near = np.searchsorted(sorted_low, high[:, axis], side="right")
    for k, (i, first) in enumerate(zip(owner, start, strict=True)):
        others = order[first_near[k] : last_near[k]]
        others = np.sort(others[others > k])
        others = others[((low[others] <= high[k]) & (high[others] >= low[k])).all(axis=1) & (owner[others] != i)]
        if not len(others):
            continue
        tests += len(others)
        if tests > _MOST_TESTS:
            raise MapError(_TOO_MANY)
        along, other_along = intersections(chunks[k], chunks[others], _ANGLE)
        inner = (along + first > 1e-6) & (along + first < ends[i] - 1e-6)
        other_along += start[others, None, None]
        inner &= (other_along > 1e-6) & (other_along < ends[owner[others], None, None] - 1e-6)
        pairs.update((int(i), int(owner[other])) for other in others[inner.any(axis=(1, 2))])
    for lane, other in ((items[i], items[k]) for i, k in sorted(pairs)):
        if lane.source != other.source and not links.has_edge(lane.id, other.id) and not links.has_edge(other.id, lane.id):
            yield lane.id, other.id


def intersections(line: Array, other: Array, angle: float = 1e-9) -> tuple[Array, Array]:
    """Return the places where a line, shape ``(k, 2)``, intersects another line, or each of several lines, ``(..., m, 2)`` [m].

    Per piece of the line and piece of the other line, the place on either line is the number of a point plus the fraction up to
    the next point, shape ``(..., k - 1, m - 1)`` each; NaN where the pieces do not meet.
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
    """Return how long the first and the last part of lanelets are that are in nobody's way [m]."""
    near: defaultdict[str, list[float]] = defaultdict(list)
    for lane, other in ((lanes[a], lanes[b]) for a, b in pairs if a in members and b in members):
        for one, close_points in zip((lane, other), close(lane.points, other.points, _NEAR), strict=True):
            near[one.id] += one.stations[close_points][[0, -1]].tolist() if close_points.any() else []
    return {id: (min(stations), lanes[id].length - max(stations)) for id, stations in near.items() if stations}
