"""Repairs of a linked network: lanes that meet without a lane link, links across gaps, lanes that overlap."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from operator import itemgetter

import numpy as np

from pytest_rvads.maps.doubts import Doubt
from pytest_rvads.maps.segment import GAP_LIMIT, limits_between
from pytest_rvads.opendrive.centre_lines import GAP_WARNING, TAPER, continued
from pytest_rvads.opendrive.draft import Chain, Draft, LaneEnd
from pytest_rvads.opendrive.records import Document

__all__ = ["complete", "mend_joints", "turn_links"]

_AHEAD = 0.5
"""Most change of heading from a lane to one that goes on without a lane link [rad]."""
_MOST_NEIGHBOURS = 32
"""Most road ends that are looked at around one; a junction has 16 at most."""
_TURNED_GAP = 0.5
"""Widest gap across which a link is moved to the other end of a road [m]."""
_OTHER = {"start": "end", "end": "start"}
RoadEnd = tuple[str, str]


def turn_links(draft: Draft) -> None:
    """Move lane links that name the wrong end of a road to its other end, where just one lane there goes on from the first lane.

    Links in doubt are those across a gap that nobody can drive across, and those that no traffic passes.
    """
    reach, leave = _by_end(draft.arriving), _by_end(draft.departing)
    doubtful: list[tuple[list[tuple[str, str]], list[tuple[str, str] | None]]] = []
    for one, other in draft.links.edges:
        edge, after = draft.edges[one], draft.edges[other]
        if math.dist(edge.points[-1], after.points[0]) > GAP_LIMIT:
            (road, end), (beyond, there) = edge.head, after.tail
            turned = [(one, id) for id in leave[beyond, _OTHER[there]]] + [(id, other) for id in reach[road, _OTHER[end]]]
            doubtful.append(([(one, other)], [*turned]))
    for (road, end, lane), (beyond, there, target) in draft.idle:
        far = (road, _OTHER[end], lane), (beyond, _OTHER[there], target)
        doubtful.append(([], [draft.pair((road, end, lane), far[1]), draft.pair(far[0], (beyond, there, target))]))
    for wide, pairs in doubtful:
        for one, other in _only(draft, [pair for pair in pairs if pair is not None], _TURNED_GAP):
            if wide or not draft.links.has_edge(one, other):
                draft.links.remove_edges_from(wide)
                draft.links.add_edge(one, other)
                message = f"a link names the wrong end of a road; lane {one} leads to lane {other}"
                draft.warn(Doubt.LINK, message, draft.edges[one].road, draft.edges[one].junction or draft.edges[other].junction)


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
    """Return for each road end the road ends that may join it by road links and tables; both ends of a road if none is stated."""
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


def _only(draft: Draft, pairs: list[tuple[str, str]], gap: float = GAP_WARNING) -> list[tuple[str, str]]:
    """Return the pair of lanes of which one goes on from the other within `gap` [m], if just one does."""
    near = []
    for one, two in ((draft.edges[a], draft.edges[b]) for a, b in pairs):
        turn = math.remainder(two.start_heading - one.end_heading, math.tau)
        if math.dist(one.points[-1], two.points[0]) <= gap and abs(turn) < _AHEAD:
            near.append((one.id, two.id))
    return near if len(near) == 1 else []


def mend_joints(draft: Draft) -> None:
    """Let linked lanes go on from each other; outside junctions undo links that are too wide to drive across."""
    for one, other in list(draft.links.edges):
        edge, after = draft.edges[one], draft.edges[other]
        gap = math.dist(edge.points[-1], after.points[0])
        junction = edge.junction or after.junction
        what = f"lanes {one} and {other} are linked but {gap:.2f} m apart"
        if gap <= GAP_LIMIT:
            repair = _mend(draft, edge, after)
            if repair is None:
                draft.links.remove_edge(one, other)
                what = f"lane {other} lies behind the end of lane {one}, which leads to it; the link was left out"
            elif repair or gap <= GAP_WARNING:
                what = repair
        elif junction is None:
            draft.links.remove_edge(one, other)
            what += "; the link was left out"
        if what:
            draft.warn(Doubt.GAP, what, edge.road, junction)


def _mend(draft: Draft, edge: Chain, after: Chain) -> str | None:
    """Join two linked lanes whose ends do not meet, and return the repair in words; None if `after` begins beyond `edge`.

    The repair moves the lane that has no other link at the joint; if both lanes have, the lane inside a junction.
    """
    ends = [
        (draft.links.in_degree(after.id), after.junction is None, after, edge, 1, edge.end_heading),
        (draft.links.out_degree(edge.id), edge.junction is None, edge, after, -1, after.start_heading + math.pi),
    ]
    for _, _, lane, fixed, step, heading in sorted(ends, key=itemgetter(0, 1)):
        rows = np.column_stack((lane.points, lane.s))[::step]
        repaired = continued(rows, fixed.points[::step][-1], heading)
        if repaired is not None:
            line, cut, aside = repaired
            if not cut and not aside:
                return ""
            line = line[::step]
            length = float(np.hypot(*np.diff(line[:, :2], axis=0).T).sum())
            limits = limits_between(lane.limits, cut if step > 0 else 0.0, length + cut)
            draft.edges[lane.id] = replace(lane, points=line[:, :2], s=line[:, 2], length=length, limits=limits)
            overlap = f"overlaps lane {fixed.id} by {cut:.2f} m and was cut" if cut else ""
            beside = (
                f"lies {aside:.2f} m beside lane {fixed.id} and was blended over up to {TAPER * aside:.1f} m" if aside else ""
            )
            return f"lane {lane.id} {overlap}{', and ' * bool(cut and aside)}{beside}"
    return None
