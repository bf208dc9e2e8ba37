"""Building a network from the records of an OpenDRIVE file: an edge per lane and road, links where traffic can continue.

Traffic keeps to the side that the file states, or to the side that the lanes of the file prove.

By the standard, a road without the attribute ``rule`` has right-hand traffic. Some writers leave the attribute out of maps with
left-hand traffic, and some write a wrong value on connecting roads. The links and lanes of a file with such mistakes are
consistent with only one side of traffic. The *direction* of lanes relative to the reference line does not prove the side on which
traffic *keeps*: in a map of one-way roads that are drawn along their traffic, the lanes have the direction of right-hand traffic.
Traffic in such a map keeps left if the road of the opposite direction lies on the right.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace

from pytest_rvads.geometry.network import DeclaredJunction, Doubt, Edge, Network, facing
from pytest_rvads.geometry.opendrive.centre_lines import sample_count
from pytest_rvads.geometry.opendrive.draft import Draft, add_edges
from pytest_rvads.geometry.opendrive.links import complete, link_roads, link_table, mend_joints, turn_links
from pytest_rvads.geometry.opendrive.painted import painted
from pytest_rvads.geometry.opendrive.reader import read
from pytest_rvads.geometry.opendrive.records import Document, JunctionRecord
from pytest_rvads.geometry.opendrive.signals import attach
from pytest_rvads.support.errors import MapError

MAX_SAMPLES = 1_500_000
"""Most samples of lane centre lines in a map; a town has 70,000."""
MAX_ROAD = 200_000.0
"""Longest road [m]."""
_FEWEST = 2
"""Least number of votes for traffic on the left if no road states a side."""
_BACK = math.radians(30.0)
"""Largest angle between a one-way road out of a junction and the reverse of a road into it, if they are a pair [rad]."""
_BESIDE = 20.0
"""Widest gap between two one-way roads, out of a junction and into the junction, that are a pair [m]."""


def read_network(path: str | os.PathLike[str]) -> Network:
    """Return the network of an OpenDRIVE file."""
    document = read(path)
    try:
        return build(document)
    except MapError as error:
        raise MapError(f"map file {path}: {error}") from None


def build(document: Document) -> Network:
    """Build the network of a document, unless that would take too long."""
    for road in document.roads.values():
        if road.length > MAX_ROAD:
            raise MapError(
                f"road {road.id!r} says it is {road.length / 1000:,.0f} km long, expected at most {MAX_ROAD / 1000:.0f} km"
            )
    samples = sum(map(sample_count, document.roads.values()))
    if samples > MAX_SAMPLES:
        raise MapError(
            f"its lane centre lines would take {samples:,} samples, more than {MAX_SAMPLES:,}; "
            "check the lengths of its roads, or cut the map into pieces"
        )
    draft = Draft(document)
    leftward = _lane_sides(draft)
    for road in document.roads.values():
        add_edges(draft, road, left_hand=leftward[road.id])
    for road in document.roads.values():
        link_roads(draft, road)
    for junction in document.junctions:
        link_table(draft, junction)
    turn_links(draft)
    complete(draft)
    mend_joints(draft)
    left_hand = frozenset(road for road, left in _kept_sides(draft, leftward).items() if left)
    objects = attach(draft, left_hand)
    arms = {road.id: road.arm for road in document.roads.values() if road.arm in document.roads}
    crosswalks = painted(draft)
    return Network(
        {id: replace(edge, road=arms[edge.road]) if edge.road in arms else edge for id, edge in draft.edges.items()},
        draft.links,
        {
            id: DeclaredJunction(junction.type, tuple(draft.direct[id]), _lost_road(draft, junction), junction.priorities)
            for id, junction in document.junctions.items()
        },
        left_hand,
        tuple(objects),
        tuple(document.controllers.values()),
        tuple(draft.warnings),
        motorways=frozenset(road.id for road in document.roads.values() if road.motorway),
        crosswalks=crosswalks,
    )


def _lost_road(draft: Draft, junction: JunctionRecord) -> str | None:
    """Return a road in a junction, or a road that the junction connects, that is left out; None if no such road is left out."""
    for row in junction.connections if draft.left_out else ():
        road = draft.document.roads.get(row.connecting)
        links = () if road is None else (road.predecessor, road.successor)
        for name in (row.incoming, row.connecting, *(link.element for link in links if link is not None and not link.junction)):
            if name in draft.left_out:
                return name
    return None


def _lane_sides(draft: Draft) -> dict[str, bool]:
    """Return per road whether its lanes run as in left-hand traffic: lanes with positive ids along the reference line."""
    document = draft.document
    roads = document.roads.values()
    stated = {road.rule for road in roads if road.rule}
    silent = [road.id for road in roads if not road.rule]
    assumed = False
    if stated and silent:
        assumed = stated == {"LHT"}
        if "LHT" in stated:
            how = "left as on the others" if assumed else "right, or as the roads they connect"
            draft.warn(Doubt.SIDE, f"{len(silent)} roads, {silent[0]!r} first, do not say on which side traffic keeps; {how}")
    elif silent:
        # Per row of a connection table, whether the row requires traffic on the left. Rows about connecting roads with lanes in
        # both directions give no vote: some writers list such a road once per end.
        votes = []
        for junction, row in document.rows():
            sections = document.roads[row.connecting].sections
            lane_sides = {lane.id > 0 for part in sections for lane in part.lanes.values() if lane.drivable}
            end = document.touching(junction.id, row)
            if len(lane_sides) == 1 and end is not None and row.links and junction.type != "direct":
                votes.append((row.links[0][0] < 0) != (end == "end"))
        assumed = len(votes) >= _FEWEST and all(votes)
        if assumed:
            message = (
                f"no road says on which side traffic keeps, and all {len(votes)} rows of connection tables that tell it "
                "come from lanes that lead into the junction only if traffic keeps left; left was taken"
            )
            draft.warn(Doubt.SIDE, message)
    sides = {road.id: (road.rule == "LHT" if road.rule else assumed) for road in roads}
    _turn_connecting_roads(draft, sides)
    return sides


def _turn_connecting_roads(draft: Draft, sides: dict[str, bool]) -> None:
    """Change, in `sides`, the side of connecting roads whose lanes all run against the lanes of the roads they connect."""
    turned: dict[str, list[str]] = {}
    for road in draft.document.roads.values():
        if road.junction is None:
            continue
        # Per lane link, whether traffic arrives on one of the two lanes and departs on the other.
        passable = []
        for contact, link in road.contacts:
            neighbour = None if link is None or link.junction else draft.document.roads.get(link.element)
            if link is None or neighbour is None or link.contact not in ("start", "end"):
                continue
            targets = neighbour.lanes_at(link.contact)
            for lane in road.lanes_at(contact).values():
                for target in lane.onward(contact):
                    if lane.drivable and target in targets and targets[target].drivable:
                        forward = lane.forward(left_hand=sides[road.id])
                        onward = targets[target].forward(left_hand=sides[neighbour.id])
                        passable.append((forward == (contact == "end")) != (onward == (link.contact == "end")))
        if passable and not any(passable):
            turned.setdefault(road.junction, []).append(road.id)
    for junction, ids in turned.items():
        for id in ids:
            sides[id] = not sides[id]
        side = "left" if sides[ids[0]] else "right"
        message = (
            f"{len(ids)} connecting road(s) of junction {junction!r}, {ids[0]!r} first, imply the wrong side of traffic: "
            f"their lanes lead on only if it keeps {side}, as on the roads they connect; {side} was taken"
        )
        draft.warn(Doubt.SIDE, message, None, junction)


def _kept_sides(draft: Draft, leftward: Mapping[str, bool]) -> dict[str, bool]:
    """Return per road whether traffic keeps left, by its lanes or, if no road states a side, by one-way roads at junctions."""
    if any(road.rule for road in draft.document.roads.values()) or any(leftward.values()):
        return dict(leftward)
    entering: dict[str, dict[str, Edge]] = {}
    leaving: dict[str, dict[str, Edge]] = {}
    for edge in draft.edges.values():
        if edge.junction is None:
            continue
        for ids, table in ((draft.links.pred[edge.id], entering), (draft.links.succ[edge.id], leaving)):
            for beside in map(draft.edges.__getitem__, ids):
                if beside.junction is None:
                    table.setdefault(edge.junction, {})[beside.road] = beside
    # Per one-way road into a junction, whether the nearest opposite one-way road lies on the right.
    votes = []
    for junction, inward in entering.items():
        outward = leaving.get(junction, {})
        ways_out = [edge for road, edge in outward.items() if road not in inward]
        for road, way_in in inward.items():
            placed = [] if road in outward else [facing(way_in, way_out) for way_out in ways_out]
            opposite = [(gap, left) for gap, angle, left in placed if gap <= _BESIDE and angle <= _BACK]
            if opposite:
                _, left = min(opposite, key=lambda row: row[0])
                votes.append(not left)
    if len(votes) < _FEWEST or not all(votes):
        return dict(leftward)
    message = (
        f"no road says on which side traffic keeps, and all {len(votes)} pairs of one-way roads at junctions "
        "have the way out on the right of the way in; left was taken"
    )
    draft.warn(Doubt.SIDE, message)
    return dict.fromkeys(leftward, True)
