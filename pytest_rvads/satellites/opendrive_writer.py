"""Writing the junction of a map in another format as OpenDRIVE, for simulators that read only OpenDRIVE.

The functions `document` to `add_crosswalk` write single elements, and `written` writes a junction. Every lane into the junction,
every lane out of it and every movement is a road of one lane. The reference line of the road is the centre line of the lane, as
cubics through the points of the centre line. So each lane ends where its centre line ends, also if lanes side by side end at
different places. A road outside of the junction runs away from it. For OpenDRIVE a road is an arm, so the road names the first
road of its arm in ``<userData>``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import ARM
from pytest_rvads.geometry.segment import NO_LIMIT, Segment
from pytest_rvads.geometry.ways import Entrance, Exit

_BROKEN_FROM = 30.0
"""Distance from a junction beyond which a centre line is broken, so that overtaking vehicles are allowed to cross it [m]."""
_MARK = 0.12
"""Width of a road mark (Richtlinien fuer die Markierung von Strassen, narrow line on other roads) [m]."""
_SIGNS = {
    Sign.STOP: ("stop sign", "DE", "206", "-1"),
    Sign.YIELD: ("yield sign", "DE", "205", "-1"),
    Sign.PRIORITY: ("priority sign", "DE", "306", "-1"),
    Sign.LIGHTS: ("light", "OpenDRIVE", "1000001", "-1"),
}
"""Name, country, type and subtype: numbers of StVO, annexes 2 and 3, and of the signal catalogue of OpenDRIVE."""
_ARROW = "1000011"
"""Type of a light with an arrow; the subtype is 10 for an arrow to the left, 20 for an arrow to the right."""
_FLAT: dict[str, float] = dict.fromkeys(("height", "hdg", "pitch", "roll"), 0)
"""Height and rotation of what is painted on the road."""
_LINES = {Sign.STOP: "StopLine", Sign.LIGHTS: "StopLine", Sign.YIELD: "HoldingLine"}


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane to write, with the mark on its outer side."""

    id: int
    type: str = "none"
    width: float = 0.0
    mark: str = "none"
    """``solid``, ``broken``, ``none``, or ``centre``: solid near the junction where the road starts, broken farther off."""
    links: tuple[int, int] | None = None
    """Ids of the lane that leads into this lane and of the lane that this lane leads to."""


@dataclass(frozen=True, slots=True)
class Post:
    """A sign or light for lanes of an arm, whose traffic comes against the reference line."""

    id: int
    sign: Sign
    lanes: tuple[int, int]
    """Ids of the first and the last lane that the sign or light regulates."""
    s: float
    """Station of the sign or light [m]."""
    t: float
    """Lateral position of the sign or light, to the left of the reference line [m]."""
    arrow: int | None = None
    """Subtype of the arrow of a light; None for a light for all directions."""


def document(name: str, reach: float) -> Element:
    """Return the root element of a file whose roads lie within `reach` of the origin [m]."""
    root = Element("OpenDRIVE")
    bounds = {"north": reach, "south": -reach, "east": reach, "west": -reach}
    add(root, "header", revMajor=1, revMinor=7, name=name, version="1.00", **bounds, vendor="pytest-rvads")
    return root


def finished(root: Element) -> str:
    """Return the text of an OpenDRIVE file from its root element."""
    indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def add(parent: Element, tag: str, **values: str | float) -> Element:
    """Add an element with attributes; numbers have up to 12 digits."""
    return SubElement(parent, tag, {name: v if isinstance(v, str) else f"{v + 0.0:.12g}" for name, v in values.items()})


def add_road(root: Element, id: int, length: float, *, junction: str = "-1", left_hand: bool = False) -> Element:
    """Add a road whose first child is an empty ``<link>``."""
    road = add(root, "road", id=id, length=length, junction=junction, rule="LHT" if left_hand else "RHT")
    add(road, "link")
    return road


def add_lanes(road: Element, lanes: Iterable[Lane], offset: float = 0.0) -> None:
    """Add lanes with their marks; lane 0 lies `offset` to the left of the reference line [m]."""
    group = add(road, "lanes")
    if offset:
        add(group, "laneOffset", s=0, a=offset, b=0, c=0, d=0)
    section = add(group, "laneSection", s=0)
    ordered = sorted(lanes, key=lambda lane: -lane.id)
    sides = groupby(ordered, lambda lane: "left" if lane.id > 0 else "right" if lane.id < 0 else "center")
    for name, lanes_of_side in sides:
        side = add(section, name)
        for lane in lanes_of_side:
            element = add(side, "lane", id=lane.id, type=lane.type, level="false")
            if lane.links:
                link = add(element, "link")
                add(link, "predecessor", id=lane.links[0])
                add(link, "successor", id=lane.links[1])
            if lane.id:
                add(element, "width", sOffset=0, a=lane.width, b=0, c=0, d=0)
            marks = ((0.0, "solid"), (_BROKEN_FROM, "broken")) if lane.mark == "centre" else ((0.0, lane.mark),)
            for start, type in marks:
                width = {} if type == "none" else {"width": _MARK}
                change = "both" if type == "broken" else "none"
                add(element, "roadMark", sOffset=start, type=type, weight="standard", color="white", laneChange=change, **width)


def add_regulation(road: Element, posts: Iterable[Post], lines: Iterable[tuple[Post, float, float]] = ()) -> None:
    """Add signs, lights and `lines`: per line its sign or light, the lateral position of its middle, and its length [m]."""
    objects = Element("objects")
    for post, t, across in lines:
        if post.sign not in _LINES:
            continue
        line = add(
            objects,
            "object",
            id=f"line{post.id}",
            name=_LINES[post.sign],
            type="roadMark",
            s=post.s,
            t=t,
            zOffset=0,
            orientation="-",
            length=0.3,
            width=across,
            **_FLAT,
        )
        add(line, "validity", fromLane=post.lanes[0], toLane=post.lanes[1])
    if len(objects):
        road.append(objects)
    signals = add(road, "signals")
    for post in posts:
        name, country, type, subtype = _SIGNS[post.sign]
        light = post.sign is Sign.LIGHTS
        element = add(
            signals,
            "signal",
            id=post.id,
            name=name,
            s=post.s,
            t=post.t,
            zOffset=2.5,
            orientation="-",
            dynamic="yes" if light else "no",
            country=country,
            type=type if post.arrow is None else _ARROW,
            subtype=subtype if post.arrow is None else f"{post.arrow}",
            height=0.9,
            width=0.9,
        )
        add(element, "validity", fromLane=post.lanes[0], toLane=post.lanes[1])


def add_crosswalk(
    road: Element, id: str, corners: Sequence[tuple[float, float]], lights: Iterable[tuple[str, float, float]] = ()
) -> None:
    """Add a crosswalk to a road that already has its signs and stop lines.

    The corners of the painted area are pairs (s, t), counter-clockwise [m]; s may lie before the start of the road. A light for
    pedestrians has an id, a station and a lateral position [m].
    """
    objects, signals = road.find("objects"), road.find("signals")
    if objects is None:
        objects = Element("objects")
        road.insert(len(road) if signals is None else list(road).index(signals), objects)
    length, width = (max(along) - min(along) for along in zip(*corners, strict=True))
    place: dict[str, str | float] = {"s": 0.0, "t": 0.0, "zOffset": 0.0, "orientation": "none"}
    crosswalk = add(objects, "object", id=id, name="Crosswalk", type="crosswalk", **place, length=length, width=width, **_FLAT)
    outline = add(add(crosswalk, "outlines"), "outline", id=0, outer="true", closed="true")
    for number, (u, v) in enumerate(corners):
        add(outline, "cornerLocal", id=number, u=u, v=v, z=0, height=0)
    for light, s, t in lights:
        signals = add(road, "signals") if signals is None else signals
        type = {"dynamic": "yes", "country": "OpenDRIVE", "type": "1000002", "subtype": "-1"}
        add(signals, "signal", id=light, name="pedestrian light", s=s, t=t, zOffset=2.5, orientation="none", **type)


Array = NDArray[np.float64]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


def written(place: Junction) -> str:
    """Return an OpenDRIVE document with one junction, as text.

    The project's reader of OpenDRIVE does not find a stopping line that lies more than 10 m before the junction.
    """
    id = place.id
    entrances = [(lane, place.way_in(k)) for k, lane in enumerate(place.entrances)]
    exits = [(lane, place.way_out(k)) for k, lane in enumerate(place.exits)]
    movements = {key: place.way_through(*key) for key in place.movements}
    lanes: list[tuple[Entrance | Exit, Segment]] = [*entrances, *exits]
    root = document(id, max(float(np.abs(line.points).max()) for _, line in lanes))
    writer = _Writer(root, place.lane_width, place.left_hand)
    arms = [lane.arm for lane, _ in lanes]
    for number, (lane, line) in enumerate(lanes):
        inbound = isinstance(lane, Entrance)
        road = writer.road(number, line, against=inbound)
        add(road[0], "predecessor", elementType="junction", elementId=id)
        if isinstance(lane, Entrance):
            writer.regulate(road, number, lane)
        start = line.pose(line.length if inbound else 0.0)
        heading = start.heading + (math.pi if inbound else 0.0)
        turn = np.array([(math.cos(heading), -math.sin(heading)), (math.sin(heading), math.cos(heading))])
        for crosswalk in place.crossings if number == arms.index(lane.arm) else ():
            if crosswalk.arm == lane.arm:
                add_crosswalk(road, crosswalk.id, ((crosswalk.area - start[:2]) @ turn).tolist())
        add(road, "userData", code=ARM, value=arms.index(lane.arm))
    junction = Element("junction", {"id": id, "name": id})
    numbers = {key: len(lanes) + k for k, key in enumerate(movements)}
    for key, line in movements.items():
        ends, before, after = (key[0], len(entrances) + key[1]), entrances[key[0]][1], exits[key[1]][1]
        road = writer.road(numbers[key], line, headings=(before.pose(before.length).heading, after.pose(0.0).heading))
        road.set("junction", id)
        writer.mark(road, numbers[key], entrances[key[0]][0])
        for tag, end in zip(("predecessor", "successor"), ends, strict=True):
            add(road[0], tag, elementType="road", elementId=end, contactPoint="start")
        row = add(
            junction, "connection", id=numbers[key], incomingRoad=ends[0], connectingRoad=numbers[key], contactPoint="start"
        )
        add(row, "laneLink", **{"from": -writer.along}, to=writer.along)
    for yielding, prior in sorted(place.stated):
        add(junction, "priority", high=numbers[prior], low=numbers[yielding])
    for phase in sorted({lane.phase for lane, _ in entrances if lane.phase is not None}):
        controller = add(writer.root, "controller", id=phase, name=f"phase {phase}", sequence=phase)
        for number in (k for k, (lane, _) in enumerate(entrances) if lane.phase == phase):
            add(controller, "control", signalId=number, type="vehicle")
        add(junction, "controller", id=phase, type="vehicle", sequence=phase)
    writer.root.append(junction)
    return finished(writer.root)


class _Writer:
    """Adds roads of one lane to the root element of a document."""

    def __init__(self, root: Element, width: float, left_hand: bool) -> None:
        self.root, self.width, self.left_hand = root, width, left_hand
        self.along = 1 if left_hand else -1
        """Id of a lane whose traffic runs along the reference line."""

    def road(self, id: int, line: Segment, *, against: bool = False, headings: tuple[float, float] | None = None) -> Element:
        """Add a road; `headings` are those at the start and the end of a movement [rad], None for other roads."""
        pieces = _cubics(line.points[::-1] if against else line.points, headings)
        road = add_road(self.root, id, math.fsum(place["length"] for place, _ in pieces), left_hand=self.left_hand)
        plan, s = add(road, "planView"), 0.0
        for place, cubic in pieces:
            add(add(plan, "geometry", s=s, **place), "paramPoly3", pRange="normalized", **cubic)
            s += place["length"]
        lane = -self.along if against else self.along
        links = (-self.along, self.along) if headings else None
        add_lanes(road, [Lane(0), Lane(lane, "driving", self.width, "solid", links)], math.copysign(self.width / 2, -lane))
        (element,) = road.findall(f".//lane[@id='{lane}']")
        ends = [*(station for station, _ in line.limits[1:]), line.length]
        spans = [(line.length - end if against else start, limit) for (start, limit), end in zip(line.limits, ends, strict=False)]
        for start, limit in spans[:: -1 if against else 1]:
            most = "undefined" if limit is None else "no limit" if limit >= NO_LIMIT else limit
            add(element, "speed", sOffset=start, max=most, unit="m/s")
        return road

    def regulate(self, road: Element, id: int, lane: Entrance) -> None:
        """Add the sign or light of a lane into the junction, and its stopping line, to the road of the lane."""
        lanes = -self.along, -self.along
        beside = math.copysign(self.width / 2 + 0.8, -self.along)  # [m] from the border of the lane
        setback = lane.setback if lane.sign_setback is None else lane.sign_setback
        posts = [] if lane.sign is Sign.NONE else [Post(id, lane.sign, lanes, setback, beside)]
        add_regulation(road, posts, self._line(id, lane, lane.setback, lanes) if lane.setback > 0.0 else [])

    def mark(self, road: Element, id: int, lane: Entrance) -> None:
        """Add the stopping line of a lane to the road of a movement from the lane, if the line lies behind the vertex."""
        behind = lane.beyond or -lane.setback
        if behind > 0.0:
            add_regulation(road, [], self._line(id, lane, behind, (self.along, self.along)))

    def _line(self, id: int, lane: Entrance, s: float, lanes: tuple[int, int]) -> list[tuple[Post, float, float]]:
        mark = Sign.YIELD if lane.sign in (Sign.NONE, Sign.PRIORITY) else lane.sign  # a line without its sign is a holding line
        return [(Post(id, mark, lanes, s, 0.0), 0.0, self.width)]


def _cubics(points: Array, headings: tuple[float, float] | None) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Return the pieces of a smooth line through points: the place of each piece, and its cubic with a parameter from 0 to 1."""
    steps = np.diff(points, axis=0)
    turns = np.remainder(np.diff(np.arctan2(steps[:, 1], steps[:, 0])) + math.pi, math.tau) - math.pi
    bends = np.concatenate(([True], np.abs(turns) > 1e-6, [True]))  # [rad]
    points = points[bends | np.append(bends[1:], True) | np.append(True, bends[:-1])]  # a straight part keeps its ends
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    units = steps / lengths[:, None]
    # At a point, the direction of the parabola through the point and its neighbours (Bessel's tangents).
    inner = units[:-1] * lengths[1:, None] + units[1:] * lengths[:-1, None]
    tangents = np.vstack((units[:1], inner / np.hypot(*inner.T)[:, None], units[-1:]))
    if headings is not None:
        tangents[[0, -1]] = [(math.cos(heading), math.sin(heading)) for heading in headings]
    pieces = []
    for (x, y), step, length, (start, end) in zip(points, steps, lengths.tolist(), pairwise(tangents), strict=False):
        axes = np.array([start, (-start[1], start[0])])  # the axes u and v of the piece
        (u, v), (end_u, end_v) = (axes @ step).tolist(), (length * axes @ end).tolist()
        cubic = {"aU": 0.0, "bU": length, "cU": 3 * u - 2 * length - end_u, "dU": length + end_u - 2 * u}
        cubic |= {"aV": 0.0, "bV": 0.0, "cV": 3 * v - end_v, "dV": end_v - 2 * v}
        p = (_NODES + 1) / 2
        speed = np.hypot(*(cubic[f"b{axis}"] + p * (2 * cubic[f"c{axis}"] + 3 * p * cubic[f"d{axis}"]) for axis in "UV"))
        place = {"x": float(x), "y": float(y), "hdg": math.atan2(start[1], start[0]), "length": float(speed @ _WEIGHTS) / 2}
        pieces.append((place, cubic))
    return pieces
