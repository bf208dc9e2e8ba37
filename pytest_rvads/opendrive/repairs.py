"""Repairs of a linked network: lanes that meet without a lane link, and links across gaps."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from itertools import islice

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.segment import GAP_LIMIT
from pytest_rvads.opendrive.chains import GAP_WARNING
from pytest_rvads.opendrive.draft import Draft, LaneEnd
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
    after, before = draft.links.succ, draft.links.pred
    bare = [
        end
        for end in dict.fromkeys([*reach, *leave])
        if not any(after[id] for id in reach[end]) and not any(before[id] for id in leave[end])
    ]
    half = [(road.id, end) for road in draft.document.roads.values() if road.junction is not None for end in ("start", "end")]
    wanted = dict.fromkeys([*bare, *half])
    if all(all(after[id] for id in reach[end]) and all(before[id] for id in leave[end]) for end in wanted):
        return
    near = _neighbours(draft.document)
    known = set(bare)
    for end in wanted:
        ending = [id for id in reach[end] if not after[id] and (end in known or before[id])]
        starting = [id for id in leave[end] if not before[id] and (end in known or after[id])]
        options = [[(id, other) for place in near.get(end, ()) for other in leave[place]] for id in ending]
        options += [[(other, id) for place in near.get(end, ()) for other in reach[place]] for id in starting]
        found = [pair for pairs in options for pair in _only(draft, pairs)]
        draft.links.add_edges_from(found)
        if found:
            road = draft.document.roads[end[0]]
            what = " and ".join(f"{one} to {two}" for one, two in found[:2]) + (" and more" if len(found) > 2 else "")
            draft.warn(Doubt.LINK, f"lanes meet without a lane link; they were linked: {what}", road.id, road.junction)


def _by_end(table: dict[LaneEnd, str]) -> defaultdict[RoadEnd, list[str]]:
    ends: defaultdict[RoadEnd, list[str]] = defaultdict(list)
    for (road, end, _), id in table.items():
        ends[road, end].append(id)
    return ends


def _neighbours(document: Document) -> dict[RoadEnd, dict[RoadEnd, None]]:
    """Return per road end the road ends that may meet it: by road links and tables, both ends where they do not say which."""
    found: dict[RoadEnd, dict[RoadEnd, None]] = defaultdict(dict)
    around: dict[str, dict[RoadEnd, None]] = defaultdict(dict)
    links = [(road.id, *contact) for road in document.roads.values() for contact in road.contacts]
    for id, end, link in links:
        if link is not None and link.junction:
            around[link.element][id, end] = None
        elif link is not None and link.element in document.roads:
            _meet(found, [(id, end)], _ends(link.element, link.contact))
    for junction, row in document.rows():
        if junction.made_of_roads:
            places = _ends(row.incoming, document.touching(junction.id, row) or "")
            around[junction.id].update(dict.fromkeys(places))
            _meet(found, _ends(row.connecting, row.contact), places)
    for road in document.roads.values():
        if road.junction is not None:
            _meet(found, [place for place in _ends(road.id, "") if not found.get(place)], around[road.junction])
    return found


def _meet(found: dict[RoadEnd, dict[RoadEnd, None]], one: Iterable[RoadEnd], two: Iterable[RoadEnd]) -> None:
    """Let two groups of road ends meet in `found`, as long as there is room."""
    for a in one:
        for b in islice(two, _MOST_NEIGHBOURS):
            if a != b and len(found[a]) < _MOST_NEIGHBOURS and len(found[b]) < _MOST_NEIGHBOURS:
                found[a][b] = found[b][a] = None


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
        for id in list(draft.links.succ[edge.id]):
            other = draft.edges[id]
            gap = math.dist(edge.points[-1], other.points[0])
            if gap <= GAP_WARNING:
                continue
            junction = edge.junction or other.junction
            draft.warn(Doubt.GAP, f"lanes {edge.id} and {other.id} are linked but {gap:.2f} m apart", edge.road, junction)
            if gap > GAP_LIMIT and junction is None:
                draft.links.remove_edge(edge.id, id)
