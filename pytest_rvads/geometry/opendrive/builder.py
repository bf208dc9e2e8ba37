"""Building a network from the records of an OpenDRIVE file: an edge per lane and road, links, and crosswalks.

Traffic keeps to the side that the file states, or to the side that the lanes of the file prove.

By the standard, a road without the attribute ``rule`` has right-hand traffic. Some writers leave the attribute out of maps with
left-hand traffic, and some write a wrong value on connecting roads. The links and lanes of a file with such mistakes are
consistent with only one side of traffic. The *direction* of lanes relative to the reference line does not prove the side on which
traffic *keeps*: in a map of one-way roads that are drawn along their traffic, the lanes have the direction of right-hand traffic.
Traffic in such a map keeps left if the road of the opposite direction lies on the right.

A crosswalk is an object of type ``crosswalk``, or the road that a ``<crossPath>`` of a junction names. The painted area is the
convex hull of the corners of the object, or of the lanes of the road. A light for pedestrians belongs to the nearest crosswalk.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import hull
from pytest_rvads.geometry.network import DeclaredJunction, Doubt, Edge, Network, PaintedCrosswalk, facing
from pytest_rvads.geometry.opendrive.centre_lines import borders_at, sample_count
from pytest_rvads.geometry.opendrive.draft import Chain, Draft, add_edges
from pytest_rvads.geometry.opendrive.links import complete, link_roads, link_table, mend_joints, turn_links
from pytest_rvads.geometry.opendrive.reader import read
from pytest_rvads.geometry.opendrive.records import Document, JunctionRecord, Road, pose_at
from pytest_rvads.geometry.opendrive.signals import Attacher, point_of
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
    objects = Attacher(draft, left_hand).attach()
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


_LIGHT_RANGE = 5.0
"""Largest distance of a light for pedestrians from the painted area of its crosswalk [m]."""
_MOST_TESTS = 20_000
"""Most pairs of a light for pedestrians and a crosswalk near it; a town has 1,000."""
_NEAR = 5.0
"""Distance from the painted area to which the shoulders of roads are looked up [m]."""
_BEFORE_KERB = frozenset({"shoulder", "parking", "biking", "border", "stop", "restricted", "bus", "taxi", "hov"})
"""Types, in lower case, of lanes between a lane that vehicles drive on and its kerb."""
_LEAST_AREA, _WIDEST = 0.5, 100.0
"""Least size of a painted area [m^2], and its largest extent to the north or the east [m]."""
_PARTS = 8
"""Number of parts of a crossing road between whose ends its lanes count as straight."""

Array = NDArray[np.float64]


def painted(draft: Draft) -> tuple[PaintedCrosswalk, ...]:
    """Return the crosswalks of a draft with edges; a crosswalk without a usable area is left out, with a warning in the draft."""
    areas = [(id, road, area) for id, road, corners in _corners(draft) if (area := _area(draft, id, road, corners)) is not None]
    if not areas:
        return ()
    lights: list[list[str]] = [[] for _ in areas]
    low, high = (np.array([side(area, axis=0) for _, _, area in areas]) for side in (np.min, np.max))
    tests = 0
    signals = [(road, signal) for road in draft.document.roads.values() if road.shapes for signal in road.signals]
    for at, signal in signals:
        if signal.type.replace(".", "") != "1000002":  # not a light for pedestrians (OpenDRIVE, list of signals)
            continue
        point = np.array(point_of(at, signal))
        near = np.flatnonzero(((low <= point + _LIGHT_RANGE) & (high >= point - _LIGHT_RANGE)).all(axis=1)).tolist()
        tests += len(near)
        if tests > _MOST_TESTS:
            raise MapError(f"too many crosswalks and lights for pedestrians stand around the light {signal.id!r}; leave some out")
        distances = [(_nearest(np.vstack((areas[k][2], areas[k][2][:1])), point)[0], k) for k in near]
        distance, k = min(distances, default=(math.inf, 0))
        if distance <= _LIGHT_RANGE:
            lights[k].append(signal.id)
    edges = list(draft.edges.values())
    boxes = np.array([(*edge.points.min(axis=0), *edge.points.max(axis=0)) for edge in edges]).reshape(-1, 4)
    crosswalks = []
    for (id, road, area), names in zip(areas, lights, strict=True):
        low, high = area.min(axis=0) - _NEAR, area.max(axis=0) + _NEAR
        near = ((boxes[:, :2] <= high) & (boxes[:, 2:] >= low)).all(axis=1).nonzero()[0]
        widths = {edges[k].id: _beside(draft.document.roads[edges[k].road], edges[k], area.mean(axis=0)) for k in near}
        beside = {edge: width for edge, width in widths.items() if width > 0.0}
        crosswalks.append(PaintedCrosswalk(id, road, area, tuple(dict.fromkeys(names)), beside))
    return tuple(crosswalks)


def _corners(draft: Draft) -> Iterator[tuple[str, str, Array]]:
    """Yield the id, the road and the corners of every crosswalk, shape ``(k, 2)`` [m]."""
    roads = draft.document.roads
    for road in roads.values():
        for record in road.crosswalks if road.shapes else ():
            corners = [_point(road, s, t) for s, t in record.corners]
            if record.local:
                x, y = _point(road, record.s, record.t)
                heading = pose_at(road, record.s)[2] + record.heading
                cos, sin = math.cos(heading), math.sin(heading)
                corners = [(x + u * cos - v * sin, y + u * sin + v * cos) for u, v in record.corners]
            yield record.id, road.id, np.array(corners)
    for junction in draft.document.junctions.values():
        for id, name in junction.cross_paths:
            if name not in roads or not roads[name].shapes:
                message = (
                    f"the crossPath {id!r} of junction {junction.id!r} names road {name!r}, which does not exist; it was left out"
                )
                draft.warn(Doubt.CROSSWALK, message, None, junction.id)
                continue
            # Points on the outermost borders of the lanes of the road.
            road = roads[name]
            stations = [road.length * k / _PARTS for k in range(_PARTS + 1)]
            borders = [(s, [t for pair in borders_at(road, s).values() for t in pair] or [0.0]) for s in stations]
            yield id, name, np.array([_point(road, s, t) for s, offsets in borders for t in (min(offsets), max(offsets))])


def _point(road: Road, s: float, t: float) -> tuple[float, float]:
    x, y, heading = pose_at(road, s)
    return x - t * math.sin(heading), y + t * math.cos(heading)


def _area(draft: Draft, id: str, road: str, corners: Array) -> Array | None:
    """Return the convex hull of the corners of a crosswalk; None, with a warning in the draft, if the hull is no crosswalk."""
    area = hull(corners) if np.isfinite(corners).all() else np.zeros((0, 2))
    x, y = area.T
    size = float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    fault = f"has {size:.2f} m^2, expected {_LEAST_AREA:g} m^2 or more"
    if size >= _LEAST_AREA:
        extent = float(np.ptp(area, axis=0).max())
        if extent <= _WIDEST:
            return area
        fault = f"is {extent:.0f} m wide, expected at most {_WIDEST:g} m"
    message = f"the crosswalk {id!r} of road {road!r} was left out: its painted area {fault}"
    draft.warn(Doubt.CROSSWALK, message, road)
    return None


def _nearest(line: Array, point: Array) -> tuple[float, int, float]:
    """Return the distance from a point to a line [m], the nearest piece of the line, and the share of it before the point."""
    starts, pieces = line[:-1], np.diff(line, axis=0)
    along = np.clip(((point - starts) * pieces).sum(axis=1) / (pieces**2).sum(axis=1), 0.0, 1.0)
    distances = np.hypot(*(starts + along[:, None] * pieces - point).T)
    k = int(distances.argmin())
    return float(distances[k]), k, float(along[k])


def _beside(road: Road, edge: Chain, point: Array) -> float:
    """Return the width of the lanes between an edge and its kerb, at the place of the edge nearest to a point [m]."""
    _, k, along = _nearest(edge.points, point)
    s = float(edge.s[k] + along * (edge.s[k + 1] - edge.s[k]))
    section = max((i for i, part in enumerate(road.sections) if part.s <= s), default=0)
    lane = dict(edge.lanes).get(section)
    if lane is None:
        return 0.0
    borders, lanes = borders_at(road, s), road.sections[section].lanes
    step, width = 1 if lane > 0 else -1, 0.0
    while (lane := lane + step) in borders and lanes[lane].type in _BEFORE_KERB:
        width += abs(borders[lane][1] - borders[lane][0])
    return width
