"""Writing the elements of OpenDRIVE files: roads, lanes with marks, signs, lights and stop lines."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pytest_rvads.geometry.control import Sign

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
