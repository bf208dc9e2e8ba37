"""From the lanes of one road to edges: chains of lanes that go on one to one from section to section."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Container, Iterator, Sequence
from itertools import pairwise

import numpy as np

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.segment import GAP_LIMIT
from pytest_rvads.opendrive.centre_lines import GAP_WARNING, TAPER, chained, unfolded
from pytest_rvads.opendrive.draft import Chain, Draft
from pytest_rvads.opendrive.lanes import LaneLine, lane_lines
from pytest_rvads.opendrive.records import Road
from pytest_rvads.opendrive.speeds import limits_along

__all__ = ["add_edges"]

_MERGE = 1e-3
_ENDED = 1.0
"""A lane that is narrower than this at its end has ended [m]: every car is wider."""
_Node = tuple[int, int]
"""Section index and lane id."""


def add_edges(draft: Draft, road: Road, *, left_hand: bool) -> None:
    """Make the edges of `road` and link them to each other.

    Raises:
        MapError: coordinates that are not finite.
    """
    if not road.shapes or road.length <= 0:
        if road.drivable:
            what = "no plan-view geometry" if not road.shapes else "no length"
            draft.warn(Doubt.LENGTH, f"road {road.id!r} has lanes but {what}; it was left out", road.id)
            draft.left_out.add(road.id)
        return
    lines = lane_lines(road, draft.warnings)
    links = _section_links(road, lines, left_hand)
    _drop_spikes(draft, road, lines, links)
    nodes = [(i, lane) for i, table in enumerate(lines) for lane in table]
    owner: dict[_Node, str] = {}
    for chain in _chains(nodes, links, {link for link in links if _jump(lines, *link) > GAP_LIMIT + _MERGE}):
        i, lane = chain[0]
        forward = road.sections[i].lanes[lane].forward(left_hand=left_hand)
        edge = _edge(draft, road, chain, [lines[i][lane] for i, lane in chain], forward)
        if edge is not None:
            draft.edges[edge.id] = edge
            draft.links.add_node(edge.id)
            owner.update(dict.fromkeys(chain, edge.id))
    draft.links.add_edges_from(
        (owner[one], owner[two]) for one, two in links if one in owner and two in owner and owner[one] != owner[two]
    )
    for (i, lane), id in owner.items():
        forward = draft.edges[id].forward
        if i == 0:
            (draft.departing if forward else draft.arriving)[road.id, "start", lane] = id
        if i == len(lines) - 1:
            (draft.arriving if forward else draft.departing)[road.id, "end", lane] = id


def _section_links(road: Road, lines: list[dict[int, LaneLine]], left_hand: bool) -> list[tuple[_Node, _Node]]:
    """Return the links between lanes of consecutive sections, in the direction of travel, without repetition."""
    found: dict[tuple[_Node, _Node], None] = {}
    for i, (here, there) in enumerate(pairwise(lines)):
        one, two = road.sections[i].lanes, road.sections[i + 1].lanes
        pairs = [(a, b) for a in here for b in one[a].successors]
        pairs += [(a, b) for b in there for a in two[b].predecessors]
        for a, b in pairs:
            if a not in here or b not in there:
                continue
            forward = one[a].forward(left_hand=left_hand)
            if forward == two[b].forward(left_hand=left_hand):
                found[((i, a), (i + 1, b)) if forward else ((i + 1, b), (i, a))] = None
    return list(found)


def _drop_spikes(draft: Draft, road: Road, lines: list[dict[int, LaneLine]], links: Sequence[tuple[_Node, _Node]]) -> None:
    """Take lanes that jut out in a lane section of no length to the end of a lane that they are linked to."""
    linked: dict[_Node, list[_Node]] = defaultdict(list)
    for one, two in links:
        linked[one].append(two)
        linked[two].append(one)
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


def _jump(lines: list[dict[int, LaneLine]], one: _Node, two: _Node) -> float:
    """Return how far a lane is from the lane that it leads to in the next lane section [m]."""
    (i, a), (k, b) = sorted((one, two))
    return math.dist(lines[i][a].points[-1], lines[k][b].points[0])


def _chains(
    nodes: Sequence[_Node], links: Sequence[tuple[_Node, _Node]], broken: Container[tuple[_Node, _Node]]
) -> Iterator[list[_Node]]:
    """Yield the longest chains of lanes that go on one to one, each once; a chain ends at a broken link."""
    follow: dict[_Node, list[_Node]] = defaultdict(list)
    lead: dict[_Node, list[_Node]] = defaultdict(list)
    for one, two in links:
        follow[one].append(two)
        lead[two].append(one)
    goes_on = {one: two for one, two in links if len(follow[one]) == 1 == len(lead[two]) and (one, two) not in broken}
    inner = set(goes_on.values())
    for node in nodes:
        if node in inner:
            continue
        chain = [node]
        while chain[-1] in goes_on:
            chain.append(goes_on[chain[-1]])
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
