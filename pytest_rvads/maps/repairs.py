"""Repairs of a linked network: lanes that meet without a lane link, and links across gaps."""

from __future__ import annotations

import math
from collections import defaultdict

from pytest_rvads.maps.chains import GAP_WARNING
from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.edges import Draft
from pytest_rvads.maps.records import Road
from pytest_rvads.maps.segment import GAP_LIMIT

__all__ = ["check_gaps", "complete"]

_AHEAD = 0.5
"""Most change of heading from a lane to one that goes on without a lane link [rad]."""


def complete(draft: Draft) -> None:
    """Link lanes of connecting roads that have a link at one end only, where just one lane meets them at the other."""
    reach: dict[tuple[str, str], list[str]] = defaultdict(list)
    leave: dict[tuple[str, str], list[str]] = defaultdict(list)
    for table, ends in ((draft.arriving, reach), (draft.departing, leave)):
        for (owner, end, _), id in table.items():
            ends[owner, end].append(id)
    for road in draft.document.roads.values():
        if road.junction is None:
            continue
        for contact, link in (("start", road.predecessor), ("end", road.successor)):
            if link is None or link.junction:
                continue
            for id in reach[road.id, contact]:
                if draft.edges[id].before and not draft.edges[id].after:
                    _adopt(draft, road, [(id, other) for other in leave[link.element, link.contact]])
            for id in leave[road.id, contact]:
                if draft.edges[id].after and not draft.edges[id].before:
                    _adopt(draft, road, [(other, id) for other in reach[link.element, link.contact]])


def _adopt(draft: Draft, road: Road, pairs: list[tuple[str, str]]) -> None:
    near = []
    for one, two in ((draft.edges[a], draft.edges[b]) for a, b in pairs):
        turn = math.remainder(two.start_heading - one.end_heading, math.tau)
        if math.dist(one.points[-1], two.points[0]) <= GAP_WARNING and abs(turn) < _AHEAD:
            near.append((one.id, two.id))
    if len(near) == 1:
        draft.join(*near[0])
        message = f"lanes {near[0][0]} and {near[0][1]} meet without a lane link; they were linked"
        draft.warn(Doubt.LINK, message, road.id, road.junction)


def check_gaps(draft: Draft) -> None:
    """Warn of linked lanes that do not meet; outside junctions undo links that are too wide to drive across."""
    for edge in draft.edges.values():
        for id in list(edge.after):
            other = draft.edges[id]
            gap = math.dist(edge.points[-1], other.points[0])
            if gap <= GAP_WARNING:
                continue
            junction = edge.junction or other.junction
            draft.warn(Doubt.GAP, f"lanes {edge.id} and {other.id} are linked but {gap:.2f} m apart", edge.road, junction)
            if gap > GAP_LIMIT and junction is None:
                edge.after.remove(id)
                other.before.remove(edge.id)
