"""From the lanes of one road to edges: chains of lanes that go on one to one from section to section.

Travel is along the reference line iff (lane id < 0) xor left-hand traffic (xor a reversed lane, since 1.8).
"""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import pairwise

import numpy as np

from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Draft, Edge
from pytest_rvads.opendrive.lanes import LaneLine, lane_lines
from pytest_rvads.opendrive.records import Road

__all__ = ["GAP_WARNING", "add_edges", "is_forward"]

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
        if any(lane.drivable for section in road.sections for lane in section.lanes.values()):
            what = "no plan-view geometry" if not road.shapes else "no length"
            draft.warn(Doubt.LENGTH, f"road {road.id!r} has lanes but {what}; it was left out", road.id)
            draft.left_out.add(road.id)
        return
    lines = lane_lines(road, draft.warnings)
    links = _section_links(road, lines, left_hand)
    follow: dict[_Node, list[_Node]] = defaultdict(list)
    lead: dict[_Node, list[_Node]] = defaultdict(list)
    for one, two in links:
        follow[one].append(two)
        lead[two].append(one)
    owner: dict[_Node, str] = {}
    for node in ((i, lane) for i, table in enumerate(lines) for lane in table):
        before = lead[node]
        if len(before) == 1 and len(follow[before[0]]) == 1:
            continue
        chain = [node]
        while len(follow[chain[-1]]) == 1 and len(lead[follow[chain[-1]][0]]) == 1 and follow[chain[-1]][0] != node:
            chain.append(follow[chain[-1]][0])
        edge = _edge(road, chain, lines, is_forward(road, *node, left_hand=left_hand), draft.warnings)
        if edge is not None:
            draft.edges[edge.id] = edge
            owner.update(dict.fromkeys(chain, edge.id))
    for one, two in links:
        if one in owner and two in owner and owner[one] != owner[two]:
            draft.join(owner[one], owner[two])
    last = len(lines) - 1
    for (i, lane), id in owner.items():
        forward = draft.edges[id].forward
        if i == 0:
            (draft.departing if forward else draft.arriving)[road.id, "start", lane] = id
        if i == last:
            (draft.arriving if forward else draft.departing)[road.id, "end", lane] = id


def is_forward(road: Road, section: int, lane: int, *, left_hand: bool) -> bool:
    """Tell whether traffic on a lane runs along the reference line."""
    return ((lane < 0) != left_hand) != road.sections[section].lanes[lane].reversed


def _section_links(road: Road, lines: list[dict[int, LaneLine]], left_hand: bool) -> list[tuple[_Node, _Node]]:
    """Return the links between lanes of consecutive sections, in the direction of travel, without repetition."""
    found: dict[tuple[_Node, _Node], None] = {}
    for i in range(len(lines) - 1):
        one, two = road.sections[i].lanes, road.sections[i + 1].lanes
        pairs = [(a, b) for a in lines[i] for b in one[a].successors]
        pairs += [(a, b) for b in lines[i + 1] for a in two[b].predecessors]
        for a, b in pairs:
            if a not in lines[i] or b not in lines[i + 1]:
                continue
            forward = is_forward(road, i, a, left_hand=left_hand)
            if forward == is_forward(road, i + 1, b, left_hand=left_hand):
                found[((i, a), (i + 1, b)) if forward else ((i + 1, b), (i, a))] = None
    return list(found)


def _edge(
    road: Road, chain: list[_Node], lines: list[dict[int, LaneLine]], forward: bool, warnings: list[MapWarning]
) -> Edge | None:
    parts = [lines[i][lane] for i, lane in chain]
    step = 1 if forward else -1
    points = np.vstack([part.points[::step] for part in parts])
    s = np.concatenate([part.s[::step] for part in parts])
    steps = np.hypot(*np.diff(points, axis=0).T)
    jump = float(steps.max())
    keep = np.concatenate(([True], steps > _MERGE))
    points, s = points[keep], s[keep]
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = float(steps.sum())
    name = f"{road.id}.{chain[0][0]}.{chain[0][1]}"
    if len(points) < 2 or length < _MERGE or not steps.all():
        warnings.append(MapWarning(Doubt.LINK, f"lane {name} has no length and was left out", road.id))
        return None
    if len(parts) > 1 and jump > GAP_WARNING and (where := _jump(parts, step)) > GAP_WARNING:
        warnings.append(MapWarning(Doubt.GAP, f"lane {name} jumps by {where:.2f} m between two lane sections", road.id))
    turning = step * sum(part.turning for part in parts)
    width = parts[len(parts) // 2].width
    return Edge(name, road.id, road.junction, forward, tuple(chain), points, s, turning, width, length)


def _jump(parts: list[LaneLine], step: int) -> float:
    ordered = [part.points[::step] for part in parts]
    return max(math.dist(one[-1], two[0]) for one, two in pairwise(ordered))
