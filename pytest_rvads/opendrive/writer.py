"""Writing junctions as OpenDRIVE 1.7: the built-in maps, and variants of them for tests and experiments.

The arms are straight and meet in one centre. By symmetry every turning movement is a single arc that is tangent
to the lanes it joins, so headings are continuous and there are no gaps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import permutations
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pytest_rvads.errors import MapError
from pytest_rvads.maps.control import JunctionControl, phase_groups
from pytest_rvads.maps.segment import Pose

__all__ = ["Layout", "opendrive"]

_JUNCTION = "1"
_FACING = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class Layout:
    """Shape and control of a junction.

    Raises:
        MapError: numbers that describe no junction.
    """

    ways: int = 4
    """Number of arms, 3 to 8; 3 is a T whose stem lies in the south, others are evenly spaced from the south on."""
    control: JunctionControl = JunctionControl.STOP
    """STOP, LIGHTS or NONE."""
    stop: float = 15.0
    """Centre of the junction to the entrance and exit vertices [m]."""
    lane_offset: float = 1.75
    """Centre of the road to the centre of a lane [m]; more than half the lane width leaves a median."""
    lane_width: float = 3.5
    """[m]."""
    approach: float = 120.0
    """Length of the arms [m]."""
    setback: float = 0.0
    """Stop lines and signs lie this far before the entrance vertices [m]."""
    left_hand: bool = False
    """Whether traffic keeps left."""
    angles: tuple[float, ...] = ()
    """Directions of the arms, counter-clockwise from east, in ascending order [rad]; empty for the usual ones."""

    def __post_init__(self) -> None:
        if not 3 <= self.ways <= 8:
            raise MapError(f"a junction has 3 to 8 ways, got {self.ways!r}")
        if self.control is JunctionControl.PARTIAL:
            raise MapError("a junction is written with control stop, lights or none, got partial")
        numbers = (self.stop, self.lane_offset, self.lane_width, self.approach, self.setback)
        if not all(math.isfinite(value) for value in numbers) or min(numbers[:4]) <= 0 or not 0 <= self.setback < self.approach:
            raise MapError(f"lengths of a junction must be positive and the setback shorter than the approach, got {numbers}")
        if self.lane_offset < self.lane_width / 2:
            raise MapError(
                f"lanes of {self.lane_width:g} m at an offset of {self.lane_offset:g} m overlap, expected half the width or more"
            )
        if self.angles and len(self.angles) != self.ways:
            raise MapError(f"a junction of {self.ways} ways needs {self.ways} angles, got {len(self.angles)}")

    @property
    def directions(self) -> tuple[float, ...]:
        """Directions of the arms from the centre [rad]."""
        if self.angles:
            return self.angles
        if self.ways == 3:
            return (-math.pi / 2, 0.0, math.pi)
        return tuple(-math.pi / 2 + math.tau * i / self.ways for i in range(self.ways))

    @property
    def opposite(self) -> frozenset[tuple[int, int]]:
        """Pairs of arms that face each other."""
        turned = [
            (i, k, math.remainder(b - a - math.pi, math.tau))
            for i, a in enumerate(self.directions)
            for k, b in enumerate(self.directions)
        ]
        return frozenset((i, k) for i, k, off in turned if abs(off) < _FACING)


def opendrive(layout: Layout, name: str = "junction") -> str:
    """Return an OpenDRIVE document with one junction, as text.

    Args:
        layout: shape and control.
        name: of the map.

    Raises:
        MapError: arms too close together for a turn between them.
    """
    root = Element("OpenDRIVE")
    reach = layout.stop + layout.approach
    bounds = {"north": reach, "south": -reach, "east": reach, "west": -reach}
    _add(root, "header", revMajor=1, revMinor=7, name=name, version="1.00", **bounds, vendor="pytest-rvads")
    for arm in range(layout.ways):
        _arm(root, layout, arm)
    junction = Element("junction", {"id": _JUNCTION, "name": name})
    for entrance, exit in permutations(range(layout.ways), 2):
        _movement(root, junction, layout, entrance, exit)
    if layout.control is JunctionControl.LIGHTS:
        for number, group in enumerate(phase_groups(range(layout.ways), layout.opposite)):
            controller = _add(root, "controller", id=number, name=f"phase {number}", sequence=number)
            for arm in sorted(group):
                _add(controller, "control", signalId=arm, type="vehicle")
            _add(junction, "controller", id=number, type="vehicle", sequence=number)
    root.append(junction)
    indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _add(parent: Element, tag: str, **values: str | float) -> Element:
    """Add an element with these attributes; numbers have up to 12 digits."""
    return SubElement(parent, tag, {name: v if isinstance(v, str) else f"{v + 0.0:.12g}" for name, v in values.items()})


def _lane(layout: Layout) -> int:
    """Return the number of the driving lanes, counted from the centre: behind the median where there is one."""
    return 2 if layout.lane_offset > layout.lane_width / 2 + 1e-9 else 1


def _inbound(layout: Layout) -> int:
    return -_lane(layout) if layout.left_hand else _lane(layout)


def _road(root: Element, layout: Layout, id: int, length: float, junction: str) -> Element:
    road = _add(root, "road", id=id, length=length, junction=junction, rule="LHT" if layout.left_hand else "RHT")
    _add(road, "link")
    return road


def _plan(road: Element, start: Pose, length: float, curvature: float = 0.0) -> None:
    geometry = _add(_add(road, "planView"), "geometry", s=0, x=start.x, y=start.y, hdg=start.heading, length=length)
    _add(geometry, "arc", curvature=curvature) if curvature else _add(geometry, "line")


def _add_lane(side: Element, id: int, type: str, width: float, links: tuple[int, int] | None = None) -> None:
    """Write a lane; `links` are the ids of the lanes before and after it."""
    lane = _add(side, "lane", id=id, type=type, level="false")
    if links:
        link = _add(lane, "link")
        _add(link, "predecessor", id=links[0])
        _add(link, "successor", id=links[1])
    if id:
        _add(lane, "width", sOffset=0, a=width, b=0, c=0, d=0)


def _arm(root: Element, layout: Layout, arm: int) -> None:
    """Write one arm: its reference line runs outward from the entrance vertex."""
    angle = layout.directions[arm]
    road = _road(root, layout, arm, layout.approach, "-1")
    _add(road[0], "predecessor", elementType="junction", elementId=_JUNCTION)
    _plan(road, Pose(layout.stop * math.cos(angle), layout.stop * math.sin(angle), angle), layout.approach)
    section = _add(_add(road, "lanes"), "laneSection", s=0)
    outer, median = _lane(layout), layout.lane_offset - layout.lane_width / 2
    for side, ids in (("left", range(outer, 0, -1)), ("center", (0,)), ("right", range(-1, -outer - 1, -1))):
        group = _add(section, side)
        for id in ids:
            driving = abs(id) == outer
            _add_lane(group, id, "driving" if driving else "median" if id else "none", layout.lane_width if driving else median)
    if layout.control is not JunctionControl.NONE:
        _regulate(road, layout, arm)


def _regulate(road: Element, layout: Layout, arm: int) -> None:
    """Write the stop line and the stop sign or light of an entrance; traffic enters against the reference line."""
    inbound = _inbound(layout)
    side = math.copysign(1.0, inbound)
    flat: dict[str, float] = dict.fromkeys(("height", "hdg", "pitch", "roll"), 0)
    line = _add(
        _add(road, "objects"),
        "object",
        id=f"line{arm}",
        name="StopLine",
        type="roadMark",
        s=layout.setback,
        t=side * layout.lane_offset,
        zOffset=0,
        orientation="-",
        length=0.3,
        width=layout.lane_width,
        **flat,
    )
    light = layout.control is JunctionControl.LIGHTS
    sign = _add(
        _add(road, "signals"),
        "signal",
        id=arm,
        name="light" if light else "stop sign",
        s=layout.setback,
        t=side * (layout.lane_offset + layout.lane_width / 2 + 0.8),
        zOffset=2.5,
        orientation="-",
        dynamic="yes" if light else "no",
        country="OpenDRIVE",
        type="1000001" if light else "206",
        subtype="-1",
        height=0.9,
        width=0.9,
    )
    for element in (line, sign):
        _add(element, "validity", fromLane=inbound, toLane=inbound)


def _movement(root: Element, junction: Element, layout: Layout, entrance: int, exit: int) -> None:
    """Write the connecting road of one movement; its reference line is the centre of its lane."""
    side = -1.0 if layout.left_hand else 1.0
    angle, out = layout.directions[entrance], layout.directions[exit]
    x, y = _at(layout, angle, side)
    u, v = _at(layout, out, -side)
    heading = angle + math.pi
    turn = math.remainder(out - heading, math.tau)
    if abs(abs(turn) - math.pi) < 1e-6:
        raise MapError(f"arms {entrance} and {exit} of the junction point in the same direction")
    chord = math.hypot(u - x, v - y)
    ahead = (u - x) * math.cos(heading + turn / 2) + (v - y) * math.sin(heading + turn / 2)
    if ahead < chord - 1e-6:
        raise MapError(
            f"arms {entrance} and {exit} are too close together for a turn; move the stop lines out from {layout.stop:g} m"
        )
    curvature = 0.0 if abs(turn) < 1e-9 else 2 * math.sin(turn / 2) / chord
    length = chord if curvature == 0.0 else turn / curvature
    id = 100 + entrance * layout.ways + exit
    road = _road(root, layout, id, length, _JUNCTION)
    for tag, arm in (("predecessor", entrance), ("successor", exit)):
        _add(road[0], tag, elementType="road", elementId=arm, contactPoint="start")
    _plan(road, Pose(x, y, heading), length, curvature)
    lanes = _add(road, "lanes")
    _add(lanes, "laneOffset", s=0, a=side * layout.lane_width / 2, b=0, c=0, d=0)
    section = _add(lanes, "laneSection", s=0)
    inbound, lane = _inbound(layout), 1 if layout.left_hand else -1
    for name, number in (("left", 1), ("center", 0)) if layout.left_hand else (("center", 0), ("right", -1)):
        links = (inbound, -inbound) if number else None
        _add_lane(_add(section, name), number, "driving" if number else "none", layout.lane_width, links)
    row = _add(junction, "connection", id=id, incomingRoad=entrance, connectingRoad=id, contactPoint="start")
    _add(row, "laneLink", **{"from": inbound}, to=lane)


def _at(layout: Layout, angle: float, side: float) -> tuple[float, float]:
    """Return the lane centre at the vertex of the arm in direction `angle`; side +1 is left of the outward direction."""
    x, y = layout.stop, side * layout.lane_offset
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
