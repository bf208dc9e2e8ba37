"""The side of the road on which traffic keeps: the side that the file states, or the side that its lanes prove.

By the standard, a road without the attribute ``rule`` has right-hand traffic. Some writers leave the attribute out of maps
with left-hand traffic, and some write a wrong value on connecting roads. The links and lanes of such a file are
consistent with one of the two sides only. The *direction* of lanes relative to the reference line differs from the
side on which traffic *keeps*: a map of one-way roads that are drawn along their traffic has right-hand lanes, although
its traffic keeps left if the opposite road lies on the right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from pytest_rvads.maps.doubts import Doubt, MapWarning
from pytest_rvads.maps.network import Edge, facing
from pytest_rvads.opendrive.draft import Draft
from pytest_rvads.opendrive.records import Document, Road

__all__ = ["directions", "kept_sides"]

_FEWEST = 2
"""Least number of witnesses for traffic on the left where no road states it."""
_BACK = math.radians(30.0)
_BESIDE = 20.0


def directions(document: Document, warnings: list[MapWarning]) -> dict[str, bool]:
    """Return per road whether its lanes run as where traffic keeps left: lanes with positive ids along the reference line.

    Args:
        document: the records of the map.
        warnings: what is assumed or contradicted is appended here.
    """
    roads = document.roads.values()
    stated = {road.rule for road in roads if road.rule}
    silent = [road.id for road in roads if not road.rule]
    assumed = False
    if stated and silent:
        assumed = stated == {"LHT"}
        if "LHT" in stated:
            how = "left as on the others" if assumed else "right, or as the roads they connect"
            message = f"{len(silent)} roads, {silent[0]!r} first, do not say on which side traffic keeps; {how}"
            warnings.append(MapWarning(Doubt.SIDE, message))
    elif silent:
        votes = list(_table_votes(document))
        assumed = len(votes) >= _FEWEST and all(votes)
        if assumed:
            message = (
                f"no road says on which side traffic keeps, and all {len(votes)} rows of connection tables that tell it "
                "come from lanes that lead into the junction only if traffic keeps left; left was taken"
            )
            warnings.append(MapWarning(Doubt.SIDE, message))
    found = {road.id: (road.rule == "LHT" if road.rule else assumed) for road in roads}
    _turn_connecting_roads(document, found, warnings)
    return found


def _table_votes(document: Document) -> Iterator[bool]:
    """Yield, per row of a connection table about a connecting road of one direction, whether it needs traffic on the left.

    Rows about connecting roads of two directions tell nothing: some writers list them once per end.
    """
    for junction, row in document.rows():
        sections = document.roads[row.connecting].sections
        sides = {lane.id > 0 for part in sections for lane in part.lanes.values() if lane.drivable}
        end = document.touching(junction.id, row)
        if len(sides) == 1 and end is not None and row.links and junction.type != "direct":
            yield (row.links[0][0] < 0) != (end == "end")


def _turn_connecting_roads(document: Document, found: dict[str, bool], warnings: list[MapWarning]) -> None:
    """Turn connecting roads whose lane links all run against the roads they connect, in `found`."""
    turned: dict[str, list[str]] = {}
    for road in document.roads.values():
        if road.junction is None:
            continue
        links = list(_passing(document, road, found))
        if links and not any(links):
            turned.setdefault(road.junction, []).append(road.id)
    for junction, ids in turned.items():
        for id in ids:
            found[id] = not found[id]
        side = "left" if found[ids[0]] else "right"
        message = (
            f"{len(ids)} connecting road(s) of junction {junction!r}, {ids[0]!r} first, imply the wrong side of traffic: "
            f"their lanes lead on only if it keeps {side}, as on the roads they connect; {side} was taken"
        )
        warnings.append(MapWarning(Doubt.SIDE, message, None, junction))


def _passing(document: Document, road: Road, left: Mapping[str, bool]) -> Iterator[bool]:
    """Yield per lane link of a connecting road whether traffic passes it: arriving on one side, departing on the other."""
    for contact, link in road.contacts:
        other = None if link is None or link.junction else document.roads.get(link.element)
        if link is None or other is None or link.contact not in ("start", "end"):
            continue
        there = other.lanes_at(link.contact)
        for lane in road.lanes_at(contact).values():
            for target in lane.onward(contact):
                if lane.drivable and target in there and there[target].drivable:
                    forward = lane.forward(left_hand=left[road.id])
                    onward = there[target].forward(left_hand=left[other.id])
                    yield (forward == (contact == "end")) != (onward == (link.contact == "end"))


def kept_sides(draft: Draft, leftward: Mapping[str, bool]) -> dict[str, bool]:
    """Return per road whether traffic keeps left.

    That is what its lanes say, but where no road of the file states a side, and one-way roads into junctions have
    the road back on their right throughout, traffic keeps left on all of them.

    Args:
        draft: the linked lanes of the map.
        leftward: per road, what `directions` says.
    """
    if any(road.rule for road in draft.document.roads.values()) or any(leftward.values()):
        return dict(leftward)
    votes = list(_pair_votes(draft))
    if len(votes) < _FEWEST or not all(votes):
        return dict(leftward)
    message = (
        f"no road says on which side traffic keeps, and all {len(votes)} pairs of one-way roads at junctions "
        "have the way out on the right of the way in; left was taken"
    )
    draft.warn(Doubt.SIDE, message)
    return dict.fromkeys(leftward, True)


def _pair_votes(draft: Draft) -> Iterator[bool]:
    """Yield, per one-way road into a junction, whether the nearest one-way road back lies on its right."""
    entering: dict[str, dict[str, Edge]] = {}
    leaving: dict[str, dict[str, Edge]] = {}
    for edge in draft.edges.values():
        if edge.junction is None:
            continue
        for ids, table in ((draft.links.pred[edge.id], entering), (draft.links.succ[edge.id], leaving)):
            for beside in map(draft.edges.__getitem__, ids):
                if beside.junction is None:
                    table.setdefault(edge.junction, {})[beside.road] = beside
    for junction, inward in entering.items():
        outward = leaving.get(junction, {})
        ways_out = [edge for road, edge in outward.items() if road not in inward]
        for road, way_in in inward.items():
            lying = [] if road in outward else [facing(way_in, other) for other in ways_out]
            back = [(gap, left) for gap, angle, left in lying if gap <= _BESIDE and angle <= _BACK]
            if back:
                _, left = min(back, key=lambda row: row[0])
                yield not left
