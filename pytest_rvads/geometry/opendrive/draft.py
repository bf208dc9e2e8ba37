"""The draft of a network, and its edges: chains of lanes that continue one to one from lane section to lane section of a road.

The steps that build a network from the records of an OpenDRIVE file add edges, links and warnings to the draft. The speed
limits of an edge are those of its lanes. Where a lane has no limit, the limit of its road applies.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.network import Doubt, Edge, MapWarning
from pytest_rvads.geometry.opendrive.centre_lines import (
    GAP_WARNING,
    TAPER,
    LaneLine,
    chained,
    lane_lines,
    line_warnings,
    unfolded,
)
from pytest_rvads.geometry.opendrive.records import Document, Road
from pytest_rvads.geometry.segment import GAP_LIMIT, Limits

LaneEnd = tuple[str, str, int]
"""Road id, ``start`` or ``end``, lane id."""
_MERGE = 1e-3
_ENDED = 1.0
"""Width below which the end of a lane counts as the end of its traffic [m]: every car is wider."""
_Node = tuple[int, int]
"""Section index and lane id."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain(Edge):
    """An edge made of lanes of a road that continue one to one. The id of the edge is ``road.section.lane`` of the first lane."""

    lanes: tuple[tuple[int, int], ...]
    """Pairs (section index, lane id) in the order of travel."""
    s: NDArray[np.float64]
    """Road station of each point, shape ``(k,)`` [m]."""

    def station(self, s: float) -> float:
        """Return the arc length in the direction of travel at road station `s` [m]."""
        along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(self.points, axis=0).T))))
        return float(np.interp(s, self.s, along) if self.forward else np.interp(-s, -self.s, along))


class Draft:
    """The edges, links and warnings, collected so far, of a network that is being built."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.warnings: list[MapWarning] = list(document.warnings)
        self.edges: dict[str, Chain] = {}
        self.links = nx.DiGraph()
        """Graph on the ids of all edges: an arc leads from an edge to an edge on which traffic can continue."""
        self.arriving: dict[LaneEnd, str] = {}
        """Per road end and lane, the edge whose traffic arrives at the road end."""
        self.departing: dict[LaneEnd, str] = {}
        """Per road end and lane, the edge whose traffic departs from the road end."""
        self.direct: dict[str, list[tuple[str, str]]] = defaultdict(list)
        """Per direct junction, the pairs of edges that the junction links."""
        self.listed: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into the junction that its connection table states."""
        self.linked: dict[str, set[tuple[str, str]]] = defaultdict(set)
        """Per junction, the links into the junction that its connecting roads state."""
        self.idle: list[tuple[LaneEnd, LaneEnd]] = []
        """Lane links that no traffic passes."""
        self.left_out: set[str] = set()
        """Roads that are left out because they have no geometry or no length."""

    def warn(self, kind: Doubt, message: str, road: str | None = None, junction: str | None = None) -> None:
        """Add a warning about the map file."""
        self.warnings.append(MapWarning(kind, message, road, junction))

    def pair(self, first: LaneEnd, second: LaneEnd) -> tuple[str, str] | None:
        """Return the two edges at two linked lane ends, in the direction of traffic; None if no traffic can pass the link."""
        for source, target in ((first, second), (second, first)):
            if source in self.arriving and target in self.departing:
                return self.arriving[source], self.departing[target]
        return None


def add_edges(draft: Draft, road: Road, *, left_hand: bool) -> None:
    """Add the edges of `road` with the links between these edges."""
    if not road.shapes or road.length <= 0:
        if road.drivable:
            lack = "no plan-view geometry" if not road.shapes else "no length"
            draft.warn(Doubt.LENGTH, f"road {road.id!r} has lanes but {lack}; it was left out", road.id)
            draft.left_out.add(road.id)
        return
    lines = lane_lines(road)
    draft.warnings += line_warnings(road, lines)
    links = _section_links(road, lines, left_hand)
    _drop_spikes(draft, road, lines, links)
    nodes = [(i, lane) for i, table in enumerate(lines) for lane in table]
    owner: dict[_Node, str] = {}
    broken = set()
    for source_node, target_node in links:
        (i, a), (k, b) = sorted((source_node, target_node))
        if math.dist(lines[i][a].points[-1], lines[k][b].points[0]) > GAP_LIMIT + _MERGE:
            broken.add((source_node, target_node))
    for chain in _chains(nodes, links, broken):
        i, lane = chain[0]
        forward = road.sections[i].lanes[lane].forward(left_hand=left_hand)
        edge = _edge(draft, road, chain, [lines[i][lane] for i, lane in chain], forward)
        if edge is not None:
            draft.edges[edge.id] = edge
            draft.links.add_node(edge.id)
            owner.update(dict.fromkeys(chain, edge.id))
    owners = [(owner.get(source), owner.get(target)) for source, target in links]
    draft.links.add_edges_from((source, target) for source, target in owners if source and target and source != target)
    for (i, lane), id in owner.items():
        forward = draft.edges[id].forward
        if i == 0:
            (draft.departing if forward else draft.arriving)[road.id, "start", lane] = id
        if i == len(lines) - 1:
            (draft.arriving if forward else draft.departing)[road.id, "end", lane] = id


def _section_links(road: Road, lines: list[dict[int, LaneLine]], left_hand: bool) -> list[tuple[_Node, _Node]]:
    """Return the links between lanes of consecutive sections, in the direction of travel, without repetition."""
    links: dict[tuple[_Node, _Node], None] = {}
    for i, (lines_before, lines_after) in enumerate(pairwise(lines)):
        before, after = road.sections[i].lanes, road.sections[i + 1].lanes
        pairs = [(a, b) for a in lines_before for b in before[a].successors]
        pairs += [(a, b) for b in lines_after for a in after[b].predecessors]
        for a, b in pairs:
            if a not in lines_before or b not in lines_after:
                continue
            forward = before[a].forward(left_hand=left_hand)
            if forward == after[b].forward(left_hand=left_hand):
                links[((i, a), (i + 1, b)) if forward else ((i + 1, b), (i, a))] = None
    return list(links)


def _drop_spikes(draft: Draft, road: Road, lines: list[dict[int, LaneLine]], links: Sequence[tuple[_Node, _Node]]) -> None:
    """Move, in lane sections without length, each lane that juts out sideways to the end of a lane linked to it."""
    linked: dict[_Node, list[_Node]] = defaultdict(list)
    for source, target in links:
        linked[source].append(target)
        linked[target].append(source)
    for i, table in enumerate(lines):
        widest = 0.0
        for lane, line in table.items():
            if line.s[-1] - line.s[0] < _MERGE and (i, lane) in linked:
                k, id = min(linked[i, lane])
                point = lines[k][id].points[-1 if k < i else 0]
                out = math.dist(line.points[0], point)
                if out > GAP_WARNING:
                    widest = max(widest, out)
                    table[lane] = line._replace(points=np.vstack((point, point)), s=line.s[[0, -1]])
        if widest:
            message = f"a lane section of road {road.id!r} has no length and its lanes jut out by {widest:.2f} m; it was left out"
            draft.warn(Doubt.GAP, message, road.id, road.junction)


def _chains(
    nodes: Sequence[_Node], links: Sequence[tuple[_Node, _Node]], broken: Container[tuple[_Node, _Node]]
) -> Iterator[list[_Node]]:
    """Yield the longest chains of lanes that continue one to one; a chain ends at a broken link."""
    follow: dict[_Node, list[_Node]] = defaultdict(list)
    lead: dict[_Node, list[_Node]] = defaultdict(list)
    for source, target in links:
        follow[source].append(target)
        lead[target].append(source)
    successor = {a: b for a, b in links if len(follow[a]) == 1 == len(lead[b]) and (a, b) not in broken}
    inner = set(successor.values())
    for node in nodes:
        if node in inner:
            continue
        chain = [node]
        while chain[-1] in successor:
            chain.append(successor[chain[-1]])
        yield chain


def _edge(draft: Draft, road: Road, chain: list[_Node], lines: list[LaneLine], forward: bool) -> Chain | None:
    step = 1 if forward else -1
    line, widest = chained([np.column_stack((line.points, line.s))[::step] for line in lines])
    steps = np.hypot(*np.diff(line[:, :2], axis=0).T)
    line, cut = unfolded(line[np.concatenate(([True], steps > _MERGE))])
    points, s = line[:, :2], line[:, 2]
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = float(steps.sum())
    name = f"{road.id}.{chain[0][0]}.{chain[0][1]}"
    if len(points) < 2 or length < _MERGE or not steps.all():
        draft.warn(Doubt.LINK, f"lane {name} has no length and was left out", road.id)
        return None
    if widest:
        message = (
            f"lane {name} jumps by {widest:.2f} m between two lane sections; it was blended over up to {TAPER * widest:.1f} m"
        )
        draft.warn(Doubt.GAP, message, road.id)
    if cut:
        draft.warn(Doubt.KINK, f"lane {name} runs backwards in a fold; {cut:.3f} m of it were cut", road.id)
    turning = step * math.fsum(line.turning for line in lines)
    width = lines[len(lines) // 2].width
    section, lane = chain[-1]
    joins = road.sections[section].lanes[lane].ramp or lines[-1].ends[forward] < _ENDED
    limits = limits_along(road, chain, np.concatenate(([0.0], np.cumsum(steps))), s)
    return Chain(
        name, road.id, road.junction, forward, points, turning, width, length, tuple(chain), s, limits=limits, joins=joins
    )


def limits_along(road: Road, chain: Iterable[tuple[int, int]], stations: NDArray[np.float64], s: NDArray[np.float64]) -> Limits:
    """Return the speed limits along an edge with arc lengths `stations` at the road stations `s`, which rise or fall [m]."""
    parts = []
    for i, lane in chain:
        first, last = [*(section.s for section in road.sections), road.length][i : i + 2]
        lane_limits = tuple((first + at, limit) for at, limit in road.sections[i].lanes[lane].limits)
        cuts = sorted({first, *(at for at, _ in (*road.limits, *lane_limits) if first < at < last)})
        parts += [(a, b, _limit_at(lane_limits, a) or _limit_at(road.limits, a)) for a, b in pairwise((*cuts, last))]
    sign = 1.0 if s[-1] >= s[0] else -1.0
    rows = sorted(((min(sign * start, sign * end), limit) for start, end, limit in parts), key=itemgetter(0))
    borders = np.interp([start for start, _ in rows], sign * s, stations).tolist()
    limits = [limit for _, limit in rows]
    changes = ((at, limit) for at, limit, before in zip(borders, limits, [0.0, *limits], strict=False) if limit != before)
    return tuple(changes) if any(limits) else ()


def _limit_at(limits: Limits, s: float) -> float | None:
    k = bisect_right(limits, s, key=itemgetter(0))
    return limits[k - 1][1] if k else None
