"""Writing junctions as OpenDRIVE 1.7: the built-in maps, and variants of them for tests and experiments.

The arms are straight and meet in one centre. By symmetry every turning movement is a single arc that is tangent
to the lanes it joins, so headings are continuous and there are no gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.analysis import phase_groups
from pytest_rvads.junctions.junction import JunctionControl

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
    bounds = {side: _text(sign * reach) for side, sign in (("north", 1), ("south", -1), ("east", 1), ("west", -1))}
    SubElement(
        root, "header", {"revMajor": "1", "revMinor": "7", "name": name, "version": "1.00", **bounds, "vendor": "pytest-rvads"}
    )
    for arm in range(layout.ways):
        _arm(root, layout, arm)
    junction = Element("junction", {"id": _JUNCTION, "name": name})
    for entrance in range(layout.ways):
        for exit in range(layout.ways):
            if entrance != exit:
                _movement(root, junction, layout, entrance, exit)
    if layout.control is JunctionControl.LIGHTS:
        for number, group in enumerate(phase_groups(layout.ways, layout.opposite)):
            controller = SubElement(root, "controller", {"id": str(number), "name": f"phase {number}", "sequence": str(number)})
            for arm in sorted(group):
                SubElement(controller, "control", {"signalId": str(arm), "type": "vehicle"})
            SubElement(junction, "controller", {"id": str(number), "type": "vehicle", "sequence": str(number)})
    root.append(junction)
    indent(root, "  ")
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _text(value: float) -> str:
    return f"{value + 0.0:.12g}"


def _lane(layout: Layout) -> int:
    """Return the number of the driving lanes, counted from the centre: behind the median where there is one."""
    return 2 if layout.lane_offset > layout.lane_width / 2 + 1e-9 else 1


def _inbound(layout: Layout) -> int:
    return -_lane(layout) if layout.left_hand else _lane(layout)


def _connecting_id(layout: Layout, entrance: int, exit: int) -> str:
    return str(100 + entrance * layout.ways + exit)


def _road(root: Element, layout: Layout, id: str, length: float, junction: str) -> Element:
    rule = "LHT" if layout.left_hand else "RHT"
    road = SubElement(root, "road", {"id": id, "length": _text(length), "junction": junction, "rule": rule})
    SubElement(road, "link")
    return road


def _plan(road: Element, x: float, y: float, heading: float, length: float, curvature: float = 0.0) -> None:
    plan = SubElement(road, "planView")
    where = {"s": "0", "x": _text(x), "y": _text(y), "hdg": _text(heading), "length": _text(length)}
    geometry = SubElement(plan, "geometry", where)
    if curvature:
        SubElement(geometry, "arc", {"curvature": _text(curvature)})
    else:
        SubElement(geometry, "line")


def _add_lane(
    side: Element, id: int, type: str, width: float, predecessor: int | None = None, successor: int | None = None
) -> None:
    lane = SubElement(side, "lane", {"id": str(id), "type": type, "level": "false"})
    if predecessor is not None or successor is not None:
        link = SubElement(lane, "link")
        for tag, value in (("predecessor", predecessor), ("successor", successor)):
            if value is not None:
                SubElement(link, tag, {"id": str(value)})
    if id:
        SubElement(lane, "width", {"sOffset": "0", "a": _text(width), "b": "0", "c": "0", "d": "0"})


def _arm(root: Element, layout: Layout, arm: int) -> None:
    """Write one arm: its reference line runs outward from the entrance vertex."""
    angle = layout.directions[arm]
    road = _road(root, layout, str(arm), layout.approach, "-1")
    SubElement(road[0], "predecessor", {"elementType": "junction", "elementId": _JUNCTION})
    _plan(road, layout.stop * math.cos(angle), layout.stop * math.sin(angle), angle, layout.approach)
    section = SubElement(SubElement(road, "lanes"), "laneSection", {"s": "0"})
    outer, median = _lane(layout), layout.lane_offset - layout.lane_width / 2
    for side, ids in (("left", range(outer, 0, -1)), ("center", (0,)), ("right", range(-1, -outer - 1, -1))):
        group = SubElement(section, side)
        for id in ids:
            driving = abs(id) == outer
            _add_lane(group, id, "driving" if driving else "median" if id else "none", layout.lane_width if driving else median)
    if layout.control is JunctionControl.NONE:
        return
    _stop_line(road, layout, arm)
    _sign(road, layout, arm)


def _stop_line(road: Element, layout: Layout, arm: int) -> None:
    side = math.copysign(1.0, _inbound(layout))
    line = {
        "id": f"line{arm}",
        "name": "StopLine",
        "type": "roadMark",
        "s": _text(layout.setback),
        "t": _text(side * layout.lane_offset),
        "zOffset": "0",
        "orientation": "-",
        "length": "0.3",
        "width": _text(layout.lane_width),
        "height": "0",
        "hdg": "0",
        "pitch": "0",
        "roll": "0",
    }
    element = SubElement(SubElement(road, "objects"), "object", line)
    lane = str(_inbound(layout))
    SubElement(element, "validity", {"fromLane": lane, "toLane": lane})


def _sign(road: Element, layout: Layout, arm: int) -> None:
    """Write the stop sign or light of the entrance; traffic towards the junction runs against the reference line."""
    light = layout.control is JunctionControl.LIGHTS
    side = math.copysign(1.0, _inbound(layout))
    sign = {
        "id": str(arm),
        "name": "light" if light else "stop sign",
        "s": _text(layout.setback),
        "t": _text(side * (layout.lane_offset + layout.lane_width / 2 + 0.8)),
        "zOffset": "2.5",
        "orientation": "-",
        "dynamic": "yes" if light else "no",
        "country": "OpenDRIVE",
        "type": "1000001" if light else "206",
        "subtype": "-1",
        "height": "0.9",
        "width": "0.9",
    }
    element = SubElement(SubElement(road, "signals"), "signal", sign)
    lane = str(_inbound(layout))
    SubElement(element, "validity", {"fromLane": lane, "toLane": lane})


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
    id = _connecting_id(layout, entrance, exit)
    road = _road(root, layout, id, length, _JUNCTION)
    for tag, arm in (("predecessor", entrance), ("successor", exit)):
        SubElement(road[0], tag, {"elementType": "road", "elementId": str(arm), "contactPoint": "start"})
    _plan(road, x, y, heading, length, curvature)
    lanes = SubElement(road, "lanes")
    SubElement(lanes, "laneOffset", {"s": "0", "a": _text(side * layout.lane_width / 2), "b": "0", "c": "0", "d": "0"})
    section = SubElement(lanes, "laneSection", {"s": "0"})
    inbound, lane = _inbound(layout), 1 if layout.left_hand else -1
    groups: Sequence[tuple[str, int]] = (("left", 1), ("center", 0)) if layout.left_hand else (("center", 0), ("right", -1))
    for name, number in groups:
        ends = (inbound, -inbound) if number else (None, None)
        _add_lane(SubElement(section, name), number, "driving" if number else "none", layout.lane_width, *ends)
    row = {"id": id, "incomingRoad": str(entrance), "connectingRoad": id, "contactPoint": "start"}
    SubElement(SubElement(junction, "connection", row), "laneLink", {"from": str(inbound), "to": str(lane)})


def _at(layout: Layout, angle: float, side: float) -> tuple[float, float]:
    """Return the lane centre at the vertex of the arm in direction `angle`; side +1 is left of the outward direction."""
    x, y = layout.stop, side * layout.lane_offset
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
