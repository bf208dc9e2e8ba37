"""Repairs of a linked network: lanes that meet without a lane link, and links across gaps."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from itertools import islice

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.network import Draft
from pytest_rvads.maps.segment import GAP_LIMIT
from pytest_rvads.opendrive.chains import GAP_WARNING
from pytest_rvads.opendrive.records import Document

__all__ = ["check_gaps", "complete"]

_AHEAD = 0.5
"""Most change of heading from a lane to one that goes on without a lane link [rad]."""
_MOST_NEIGHBOURS = 32
"""Most road ends that are looked at around one; a junction has 16 at most."""
RoadEnd = tuple[str, str]


def complete(draft: Draft) -> None:
    """Link lanes that have no lane link where just one lane goes on from them.

    That is done at the ends of connecting roads for lanes with a link at their other end, and everywhere for road
    ends none of whose lanes is linked: then the writer left lane links out.
    """
    reach, leave = _by_end(draft.arriving), _by_end(draft.departing)
    bare = [end for end in dict.fromkeys([*reach, *leave]) if _unlinked(draft, reach[end], leave[end])]
    half = [(road.id, end) for road in draft.document.roads.values() if road.junction is not None for end in ("start", "end")]
    wanted = dict.fromkeys([*bare, *half])
    if not any(_open(draft, reach[end], leave[end]) for end in wanted):
        return
    near = _neighbours(draft.document)
    known = set(bare)
    for end in wanted:
        others = near.get(end, ())
        found = [
            pair
            for id in reach[end]
            if not draft.edges[id].after and (end in known or draft.edges[id].before)
            for pair in _only(draft, [(id, other) for place in others for other in leave[place]])
        ]
        found += [
            pair
            for id in leave[end]
            if not draft.edges[id].before and (end in known or draft.edges[id].after)
            for pair in _only(draft, [(other, id) for place in others for other in reach[place]])
        ]
        for one, two in found:
            draft.join(one, two)
        if found:
            road = draft.document.roads[end[0]]
            what = " and ".join(f"{one} to {two}" for one, two in found[:2]) + (" and more" if len(found) > 2 else "")
            draft.warn(Doubt.LINK, f"lanes meet without a lane link; they were linked: {what}", road.id, road.junction)


def _by_end(table: dict[tuple[str, str, int], str]) -> defaultdict[RoadEnd, list[str]]:
    ends: defaultdict[RoadEnd, list[str]] = defaultdict(list)
    for (road, end, _), id in table.items():
        ends[road, end].append(id)
    return ends


def _unlinked(draft: Draft, reach: Iterable[str], leave: Iterable[str]) -> bool:
    return not any(draft.edges[id].after for id in reach) and not any(draft.edges[id].before for id in leave)


def _open(draft: Draft, reach: Iterable[str], leave: Iterable[str]) -> bool:
    return any(not draft.edges[id].after for id in reach) or any(not draft.edges[id].before for id in leave)


def _neighbours(document: Document) -> dict[RoadEnd, dict[RoadEnd, None]]:
    """Return per road end the road ends that may meet it: by road links and tables, both ends where they do not say which."""
    found: dict[RoadEnd, dict[RoadEnd, None]] = defaultdict(dict)
    around: dict[str, dict[RoadEnd, None]] = defaultdict(dict)

    def meet(one: Iterable[RoadEnd], two: Iterable[RoadEnd]) -> None:
        for a in one:
            for b in islice(two, _MOST_NEIGHBOURS):
                if a != b and len(found[a]) < _MOST_NEIGHBOURS and len(found[b]) < _MOST_NEIGHBOURS:
                    found[a][b] = found[b][a] = None

    for road in document.roads.values():
        for end, link in (("start", road.predecessor), ("end", road.successor)):
            if link is not None and link.junction:
                around[link.element][road.id, end] = None
            elif link is not None and link.element in document.roads:
                meet([(road.id, end)], _ends(link.element, link.contact))
    for junction in document.junctions.values():
        for row in junction.connections if junction.type in ("default", "") else ():
            if row.incoming in document.roads and row.connecting in document.roads:
                end = document.touching(junction.id, row) or ""
                around[junction.id].update(dict.fromkeys(_ends(row.incoming, end)))
                meet(_ends(row.connecting, row.contact), _ends(row.incoming, end))
    for road in document.roads.values():
        if road.junction is not None:
            meet([place for place in _ends(road.id, "") if not found.get(place)], around[road.junction])
    return found


def _ends(road: str, end: str) -> list[RoadEnd]:
    return [(road, end)] if end in ("start", "end") else [(road, "start"), (road, "end")]


def _only(draft: Draft, pairs: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return the pair of lanes of which one goes on from the other, if just one does."""
    near = []
    for one, two in ((draft.edges[a], draft.edges[b]) for a, b in pairs):
        turn = math.remainder(two.start_heading - one.end_heading, math.tau)
        if math.dist(one.points[-1], two.points[0]) <= GAP_WARNING and abs(turn) < _AHEAD:
            near.append((one.id, two.id))
    return near if len(near) == 1 else []


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
