"""The road network of SUMO for a junction, made from the value and not from its map file.

An arm is an edge in, ``in0``, and one out, ``out0``, with a lane per entrance and exit. The edge in ends at the stopping line, so
that SUMO's vehicles stop there; a connection with a shape of its own leads from there along the centre line of the movement.

Because the network is made from the `Junction`, junctions of every map format can be driven in SUMO.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from itertools import pairwise
from math import dist, fsum
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

from numpy.typing import NDArray

from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Arm, Junction
from pytest_rvads.junctions.sweep import EXIT_LENGTH
from pytest_rvads.maps.segment import SPEED_LIMIT, Segment, join
from pytest_rvads.physics.braking import FASTEST
from pytest_rvads.runs.lights import SignalPlan
from pytest_rvads.satellites.sumo.netconvert import netconvert
from pytest_rvads.satellites.sumo.right_of_way import check_yields, node_type, priority
from pytest_rvads.satellites.sumo.signal_program import program

__all__ = ["Network", "lane_in", "lane_limit", "lane_out", "network", "straight"]

_SAME = 1e-6
"""Lengths that differ by less are equal [m]."""


@dataclass(frozen=True, slots=True)
class Network:
    """A network as SUMO reads it."""

    text: bytes
    name: str
    """Of a file: equal for equal networks."""


@lru_cache(maxsize=64)
def network(junction: Junction, plan: SignalPlan) -> Network:
    """Return the network of a junction, with what its lights show from time 0 on.

    Raises:
        MapError: it is not known where its lanes lie.
        ScenarioError: SUMO has no such junction.
        RunError: netconvert is not installed, or failed.
    """
    files = _plain(junction)
    root = netconvert(files, left_hand=junction.left_hand)
    node = next(item for item in root.iter("junction") if item.get("id") == "J")
    links = _links(junction, root, node)
    check_yields(junction, node, links)
    _restore(root, files["edge-files"])
    for item in root.findall("tlLogic"):
        root.insert(list(root).index(item), program(junction, plan, links))
        root.remove(item)
    return _made(root)


@lru_cache(maxsize=1)
def straight(length: float) -> Network:
    """Return a network of one straight lane, the edge ``in0``, of that length [m]."""
    nodes, edges = Element("nodes"), Element("edges")
    for name, x in (("start", 0.0), ("end", length)):
        SubElement(nodes, "node", id=name, x=repr(x), y="0")
    SubElement(edges, "edge", {"id": "in0", "from": "start", "to": "end", "numLanes": "1", "speed": repr(FASTEST)})
    return _made(netconvert({"node-files": nodes, "edge-files": edges}, left_hand=False))


def lane_in(junction: Junction, entrance: int) -> tuple[str, int]:
    """Return the edge and the number of the lane that end at the stopping line of an entrance."""
    lane = junction.entrances[entrance]
    return f"in{lane.arm}", lane.lane


def lane_out(junction: Junction, exit: int) -> tuple[str, int]:
    """Return the edge and the number of the lane that begin at an exit."""
    lane = junction.exits[exit]
    return f"out{lane.arm}", lane.lane


def lane_limit(way: Segment, end: int) -> float:
    """Return the speed limit at the junction of a lane that leads in (-1) or out (0): SUMO knows one per lane [m/s]."""
    return way.limits[end][1] or SPEED_LIMIT if way.limits else SPEED_LIMIT


def _plain(junction: Junction) -> dict[str, Element]:
    """Return the files in plain XML (page "Networks/PlainXML")."""
    nodes, edges, connections = Element("nodes"), Element("edges"), Element("connections")
    ends = [junction.way_in(k).points[-1] for k in range(len(junction.entrances))]
    middle = [fsum(float(end[axis]) for end in ends) / len(ends) for axis in (0, 1)]
    SubElement(nodes, "node", id="J", x=repr(middle[0]), y=repr(middle[1]), type=node_type(junction))
    for number, arm in enumerate(junction.arms):
        _add_arm(junction, number, arm, nodes, edges)
    for entrance, exit in sorted(junction.movements):
        (start, lane), (end, other) = lane_in(junction, entrance), lane_out(junction, exit)
        way = junction.way_through(entrance, exit)
        setback = junction.setbacks[entrance]
        if setback and (whole := join((junction.way_in(entrance).tail(setback), way))):
            way = whole
        ways = {"from": start, "to": end, "fromLane": str(lane), "toLane": str(other), "shape": _shape(way.points)}
        SubElement(connections, "connection", ways)
    return {"node-files": nodes, "edge-files": edges, "connection-files": connections}


def _add_arm(junction: Junction, number: int, arm: Arm, nodes: Element, edges: Element) -> None:
    """Add the edges of an arm, and the node at the far end of each."""
    ways_in = [junction.way_in(k) for k in arm.entrances]
    ways_in = [way.head(way.length - junction.setbacks[k]) for way, k in zip(ways_in, arm.entrances, strict=True)]
    ways_out = [junction.way_out(k) for k in arm.exits]
    ways_out = [way.head(min(way.length, EXIT_LENGTH)) for way in ways_out]
    ranks = [priority(junction.entrances[k].sign) for k in arm.entrances]
    for edge, far, lanes, end in (("in", "from", ways_in, 0), ("out", "to", ways_out, -1)):
        if not lanes:
            continue
        x, y = lanes[0].points[end].tolist()
        SubElement(nodes, "node", id=f"{far}{number}", x=repr(x), y=repr(y), type="dead_end")
        ways = ("J", f"{far}{number}") if end else (f"{far}{number}", "J")
        given = {
            "id": f"{edge}{number}",
            "from": ways[0],
            "to": ways[1],
            "numLanes": str(len(lanes)),
            "speed": repr(SPEED_LIMIT),
            "priority": str(max(ranks, default=1)),
            "shape": _shape(lanes[0].points),
        }
        item = SubElement(edges, "edge", given)
        for lane, way in enumerate(lanes):
            part = SubElement(item, "lane", index=str(lane), width=repr(junction.lane_width), shape=_shape(way.points))
            if way.limits:
                part.set("speed", repr(lane_limit(way, -1 - end)))


def _links(junction: Junction, root: Element, node: Element) -> list[Key]:
    """Return the movement of every link of the junction, by the number of the link: by lanes as the node names them."""
    entrances = {lane_in(junction, k): k for k in range(len(junction.entrances))}
    exits = {lane_out(junction, k): k for k in range(len(junction.exits))}
    found: dict[str, list[Key]] = {}
    for item in root.iter("connection"):
        start = item.attrib["from"], int(item.attrib["fromLane"])
        if start in entrances:
            key = entrances[start], exits[item.attrib["to"], int(item.attrib["toLane"])]
            found.setdefault(f"{start[0]}_{start[1]}", []).append(key)
    return [key for lane in node.attrib["incLanes"].split() for key in found.get(lane, ())]


def _restore(root: Element, edges: Element) -> None:
    """Give lanes the shapes and lengths that they shall have.

    Netconvert moves the ends of lanes of one edge that end apart, and gives them one length.
    """
    lanes = {lane.attrib["id"]: lane for lane in root.iter("lane")}
    shapes = {name: lane.attrib["shape"].split() for name, lane in lanes.items()}
    shapes |= {f"{e.attrib['id']}_{lane.attrib['index']}": lane.attrib["shape"].split() for e in edges for lane in e}
    for item in root.iter("connection"):
        start, via = f"{item.attrib['from']}_{item.attrib['fromLane']}", item.get("via")
        if via is None:
            shapes[start][-1] = shapes[f"{item.attrib['to']}_{item.attrib['toLane']}"][0]
        else:
            shapes[via][0] = shapes[start][-1]
    for name, shape in shapes.items():
        points = [tuple(map(float, point.split(",")[:2])) for point in shape]
        length = fsum(dist(one, two) for one, two in pairwise(points))
        lanes[name].set("shape", " ".join(shape))
        if abs(length - float(lanes[name].attrib["length"])) > _SAME:
            lanes[name].set("length", repr(length))


def _shape(points: NDArray[Any]) -> str:
    return " ".join(f"{x!r},{y!r}" for x, y in points.tolist())


def _made(root: Element) -> Network:
    text = tostring(root)
    return Network(text, f"{sha256(text).hexdigest()[:16]}.net.xml")
