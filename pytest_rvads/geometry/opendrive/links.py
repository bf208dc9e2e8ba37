"""Links between the lanes of roads, and their repair.

Links come from the links of roads and from the connection tables of junctions. The links of both sources are kept, because some
writers of files list only half of the movements in each source. A link is dropped if traffic on one of its lanes runs in the
wrong direction to pass the link.

Repairs concern lanes that meet without a lane link, links across gaps, links that name the wrong end of a road, and lanes that
overlap.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice, product
from operator import itemgetter

import numpy as np

from pytest_rvads.geometry.network import Doubt
from pytest_rvads.geometry.opendrive.centre_lines import GAP_WARNING, TAPER, continued
from pytest_rvads.geometry.opendrive.draft import Chain, Draft, LaneEnd
from pytest_rvads.geometry.opendrive.records import Document, Road
from pytest_rvads.geometry.segment import GAP_LIMIT, limits_between

_AHEAD = 0.5
"""Most change of heading between two lanes that are linked without a lane link in the file [rad]."""
_MOST_NEIGHBOURS = 32
"""Most road ends that are considered around a road end; a junction has 16 at most."""
_TURNED_GAP = 0.5
"""Widest gap across which a link is moved to the other end of a road [m]."""
_OPPOSITE = {"start": "end", "end": "start"}
RoadEnd = tuple[str, str]


def link_roads(draft: Draft, road: Road) -> None:
    """Link the lanes of `road` to the lanes of the roads that `road` is linked to."""
    for contact, link in road.contacts:
        if link is None or link.junction or not road.sections:
            continue
        neighbour = draft.document.roads.get(link.element)
        if neighbour is None:
            draft.warn(Doubt.LINK, f"road {road.id!r} is linked to road {link.element!r}, which does not exist", road.id)
            continue
        if link.contact not in ("start", "end"):
            draft.warn(Doubt.LINK, f"the link from road {road.id!r} to road {neighbour.id!r} has no contact point", road.id)
            continue
        for lane in road.lanes_at(contact).values():
            for target in lane.onward(contact):
                ends = (road.id, contact, lane.id), (neighbour.id, link.contact, target)
                pair = draft.pair(*ends)
                if pair is None:
                    draft.idle.append(ends)
                    continue
                draft.links.add_edge(*pair)
                if road.junction is not None and draft.edges[pair[1]].road == road.id:
                    draft.linked[road.junction].add(pair)


def link_table(draft: Draft, id: str) -> None:
    """Add the links of the connection table of junction `id`."""
    junction, roads = draft.document.junctions[id], draft.document.roads
    for row in junction.connections:
        lost = next((name for name in (row.incoming, row.connecting) if name not in roads), None)
        if lost is not None:
            draft.warn(Doubt.LINK, f"junction {id!r} names road {lost!r}, which does not exist", None, id)
            continue
        if row.contact not in ("start", "end"):
            roads_of_row = f"from road {row.incoming!r} to road {row.connecting!r}"
            draft.warn(Doubt.LINK, f"junction {id!r} has a connection {roads_of_row} without contact point", None, id)
            continue
        end = draft.document.touching(id, row)
        if end is None:
            message = f"junction {id!r} names road {row.incoming!r} as incoming, which does not touch it"
            draft.warn(Doubt.TABLE, message, row.incoming, id)
            continue
        for source, target in row.links:
            ends = (row.incoming, end, source), (row.connecting, row.contact, target)
            pair = draft.pair(*ends)
            if pair is None:
                draft.idle.append(ends)
                missing = [(road, at, lane) for road, at, lane in ends if lane not in roads[road].lanes_at(at)]
                if missing and ends[0][:2] != ends[1][:2]:
                    road, at, lane = missing[0]
                    message = (
                        f"a lane link of junction {id!r} names lane {lane} at the {at} of road {road!r}, which does not exist"
                    )
                    draft.warn(Doubt.TABLE, message, road, id)
            elif junction.type == "direct":
                draft.direct[id].append(pair)
            else:
                draft.links.add_edge(*pair)
                if draft.edges[pair[1]].road == row.connecting:
                    draft.listed[id].add(pair)
    only_listed, only_linked = len(draft.listed[id] - draft.linked[id]), len(draft.linked[id] - draft.listed[id])
    if only_listed or only_linked:
        message = (
            f"{only_listed} links into junction {id!r} are only in its table and {only_linked} only in its roads; all were taken"
        )
        draft.warn(Doubt.TABLE, message, None, id)


def turn_links(draft: Draft) -> None:
    """Move each lane link that names the wrong end of a road to the other end of that road.

    A link is in doubt if its lanes are too far apart to drive from lane to lane, or if no traffic can pass the link. The
    candidates for a link in doubt lead from its first lane to a lane at the other end of the second lane's road, or from a lane
    at the other end of the first lane's road to its second lane. The link is moved only if, in exactly one candidate, the second
    lane continues the first lane.
    """
    arriving, departing = _by_end(draft.arriving), _by_end(draft.departing)
    doubtful: list[tuple[list[tuple[str, str]], list[tuple[str, str] | None]]] = []
    for id, next_id in draft.links.edges:
        edge, after = draft.edges[id], draft.edges[next_id]
        if math.dist(edge.points[-1], after.points[0]) > GAP_LIMIT:
            (road, end), (next_road, next_end) = edge.head, after.tail
            turned = [(id, target) for target in departing[next_road, _OPPOSITE[next_end]]]
            turned += [(source, next_id) for source in arriving[road, _OPPOSITE[end]]]
            doubtful.append(([(id, next_id)], [*turned]))
    for source_end, target_end in draft.idle:
        far_source, far_target = ((road, _OPPOSITE[end], lane) for road, end, lane in (source_end, target_end))
        doubtful.append(([], [draft.pair(source_end, far_target), draft.pair(far_source, target_end)]))
    for wide, pairs in doubtful:
        for id, next_id in _only_continuation(draft, [pair for pair in pairs if pair is not None], _TURNED_GAP):
            if wide or not draft.links.has_edge(id, next_id):
                draft.links.remove_edges_from(wide)
                draft.links.add_edge(id, next_id)
                message = f"a link names the wrong end of a road; lane {id} leads to lane {next_id}"
                draft.warn(Doubt.LINK, message, draft.edges[id].road, draft.edges[id].junction or draft.edges[next_id].junction)


def complete(draft: Draft) -> None:
    """Link each lane that has no lane link at one of its ends to the lane that continues it, if exactly one lane does.

    At a road end where no lane has a link, all lanes are linked, because the writer of the file left out lane links. At other
    ends of connecting roads, a lane is linked only if the lane has a link at its opposite end. A lane of a connecting road that
    remains without a link at one of its ends is told in a warning.
    """
    arriving, departing = _by_end(draft.arriving), _by_end(draft.departing)
    after, before = draft.links.succ, draft.links.pred
    bare = {
        end: None
        for end in dict.fromkeys([*arriving, *departing])
        if not any(after[id] for id in arriving[end]) and not any(before[id] for id in departing[end])
    }
    inside = [(road.id, end) for road in draft.document.roads.values() if road.junction is not None for end in ("start", "end")]
    ends = dict.fromkeys([*bare, *inside])
    if all(all(after[id] for id in arriving[end]) and all(before[id] for id in departing[end]) for end in ends):
        return
    near = _neighbours(draft.document)
    for end in ends:
        pairs: list[tuple[str, str]] = []
        stated = list(near.get(end, ()))
        # If a contact point is wrong, the lanes meet at the other end of the road that the link names.
        for places in (stated, [(road, _OPPOSITE[contact]) for road, contact in stated]):
            ending = [id for id in arriving[end] if not after[id] and (end in bare or before[id])]
            starting = [id for id in departing[end] if not before[id] and (end in bare or after[id])]
            options = [[(id, target) for place in places for target in departing[place]] for id in ending]
            options += [[(source, id) for place in places for source in arriving[place]] for id in starting]
            found = [pair for candidates in options for pair in _only_continuation(draft, candidates)]
            draft.links.add_edges_from(found)
            pairs += found
        if pairs:
            road = draft.document.roads[end[0]]
            listed = " and ".join(f"{source} to {target}" for source, target in pairs[:2]) + " and more" * (len(pairs) > 2)
            draft.warn(Doubt.LINK, f"lanes meet without a lane link; they were linked: {listed}", road.id, road.junction)
    inner = (e for e in draft.edges.values() if e.junction is not None and draft.document.junctions[e.junction].made_of_roads)
    for edge, (linked, what) in product(inner, ((before, "comes from"), (after, "leads"))):
        if not linked[edge.id]:
            message = f"lane {edge.id} in junction {edge.junction!r} {what} nowhere, so no movement uses it"
            draft.warn(Doubt.LINK, message, edge.road, edge.junction)


def _by_end(table: dict[LaneEnd, str]) -> defaultdict[RoadEnd, list[str]]:
    ends: defaultdict[RoadEnd, list[str]] = defaultdict(list)
    for (road, end, _), id in table.items():
        ends[road, end].append(id)
    return ends


def _neighbours(document: Document) -> dict[RoadEnd, dict[RoadEnd, None]]:
    """Return, per road end, the road ends that meet it according to the links of roads and the connection tables.

    If the file does not say which end of a road meets the road end, both ends of the road are in the result.
    """
    near: dict[RoadEnd, dict[RoadEnd, None]] = defaultdict(dict)
    around: dict[str, dict[RoadEnd, None]] = defaultdict(dict)
    links = [(road.id, *contact) for road in document.roads.values() for contact in road.contacts]
    for id, end, link in links:
        if link is not None and link.junction:
            around[link.element][id, end] = None
        elif link is not None and link.element in document.roads:
            _connect(near, [(id, end)], _possible_ends(link.element, link.contact))
    for junction, row in document.rows():
        if junction.made_of_roads:
            places = _possible_ends(row.incoming, document.touching(junction.id, row) or "")
            around[junction.id].update(dict.fromkeys(places))
            _connect(near, _possible_ends(row.connecting, row.contact), places)
    for road in document.roads.values():
        if road.junction is not None:
            _connect(near, [place for place in _possible_ends(road.id, "") if not near.get(place)], around[road.junction])
    return near


def _connect(near: dict[RoadEnd, dict[RoadEnd, None]], places: Iterable[RoadEnd], meeting: Iterable[RoadEnd]) -> None:
    """Add, to `near`, that the road ends of two groups meet each other, up to `_MOST_NEIGHBOURS` per road end."""
    for a in places:
        for b in islice(meeting, _MOST_NEIGHBOURS):
            if a != b and len(near[a]) < _MOST_NEIGHBOURS and len(near[b]) < _MOST_NEIGHBOURS:
                near[a][b] = near[b][a] = None


def _possible_ends(road: str, end: str) -> list[RoadEnd]:
    return [(road, end)] if end in ("start", "end") else [(road, "start"), (road, "end")]


def _only_continuation(draft: Draft, pairs: list[tuple[str, str]], gap: float = GAP_WARNING) -> list[tuple[str, str]]:
    """Return the only pair of lanes whose second continues the first within a gap [m]; an empty list if several pairs do."""
    near = []
    for edge, after in ((draft.edges[a], draft.edges[b]) for a, b in pairs):
        turn = math.remainder(after.start_heading - edge.end_heading, math.tau)
        if math.dist(edge.points[-1], after.points[0]) <= gap and abs(turn) < _AHEAD:
            near.append((edge.id, after.id))
    return near if len(near) == 1 else []


def mend_joints(draft: Draft) -> None:
    """Close the gaps between linked lanes. Outside of junctions, remove links across gaps that are too wide to drive across."""
    for id, next_id in list(draft.links.edges):
        edge, after = draft.edges[id], draft.edges[next_id]
        gap = math.dist(edge.points[-1], after.points[0])
        junction = edge.junction or after.junction
        message = f"lanes {id} and {next_id} are linked but {gap:.2f} m apart"
        if gap <= GAP_LIMIT:
            repair = _mend(draft, edge, after)
            if repair is None:
                draft.links.remove_edge(id, next_id)
                message = f"lane {next_id} lies behind the end of lane {id}, which leads to it; the link was left out"
            elif repair or gap <= GAP_WARNING:
                message = repair
        elif junction is None:
            draft.links.remove_edge(id, next_id)
            message += "; the link was left out"
        if message:
            draft.warn(Doubt.GAP, message, edge.road, junction)


def _mend(draft: Draft, edge: Chain, after: Chain) -> str | None:
    """Join two linked lanes whose ends do not meet, and return the repair in words; None if `after` begins beyond `edge`.

    The repair moves the lane that has fewer links at the joint. If both lanes have equally many links, the repair moves the lane
    inside a junction.
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
