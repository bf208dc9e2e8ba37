"""From the lanes of one road to edges: chains of lanes that go on one to one from section to section."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.opendrive.draft import Chain, Draft
from pytest_rvads.opendrive.lanes import LaneLine, lane_lines
from pytest_rvads.opendrive.records import Road
from pytest_rvads.opendrive.speeds import limits_along

__all__ = ["GAP_WARNING", "add_edges"]

GAP_WARNING = 0.1
"""Gap between linked lanes from which on a warning is given [m]."""
_MERGE = 1e-3
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
    owner: dict[_Node, str] = {}
    for chain in _chains([(i, lane) for i, table in enumerate(lines) for lane in table], links):
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


def _chains(nodes: Sequence[_Node], links: Sequence[tuple[_Node, _Node]]) -> Iterator[list[_Node]]:
    """Yield the longest chains of lanes that go on one to one, each once."""
    follow: dict[_Node, list[_Node]] = defaultdict(list)
    lead: dict[_Node, list[_Node]] = defaultdict(list)
    for one, two in links:
        follow[one].append(two)
        lead[two].append(one)
    for node in nodes:
        if len(lead[node]) == 1 and len(follow[lead[node][0]]) == 1:
            continue
        chain = [node]
        while len(follow[chain[-1]]) == 1 and len(lead[follow[chain[-1]][0]]) == 1:
            chain.append(follow[chain[-1]][0])
        yield chain


def _edge(draft: Draft, road: Road, chain: list[_Node], lines: list[LaneLine], forward: bool) -> Chain | None:
    step = 1 if forward else -1
    parts = [line.points[::step] for line in lines]
    points, s = np.vstack(parts), np.concatenate([line.s[::step] for line in lines])
    steps = np.hypot(*np.diff(points, axis=0).T)
    jump = float(steps.max())
    keep = np.concatenate(([True], steps > _MERGE))
    points, s = points[keep], s[keep]
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = float(steps.sum())
    name = f"{road.id}.{chain[0][0]}.{chain[0][1]}"
    if len(points) < 2 or length < _MERGE or not steps.all():
        draft.warn(Doubt.LINK, f"lane {name} has no length and was left out", road.id)
        return None
    if len(parts) > 1 and jump > GAP_WARNING:
        jump = max(math.dist(one[-1], two[0]) for one, two in pairwise(parts))
        if jump > GAP_WARNING:
            draft.warn(Doubt.GAP, f"lane {name} jumps by {jump:.2f} m between two lane sections", road.id)
    turning = step * math.fsum(line.turning for line in lines)
    width = lines[len(lines) // 2].width
    limits = limits_along(road, chain, np.concatenate(([0.0], np.cumsum(steps))), s)
    return Chain(name, road.id, road.junction, forward, points, turning, width, length, tuple(chain), s, limits=limits)
