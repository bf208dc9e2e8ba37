"""Writing roundabouts as OpenDRIVE 1.7, such as the built-in one.

A roundabout is a ring of one lane with small junctions of three arms. In each junction an arm meets
the ring. A lane leads from the ring to the arm, and a lane of the arm leads past a yield sign onto the ring. The entrance from
the ring has no sign: signs 205 and 215 at the arms give traffic on the ring priority (StVO, section 8(1a)). Traffic keeps right
and goes round counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.satellites.opendrive_writer import (
    Lane,
    Post,
    add,
    add_lanes,
    add_regulation,
    add_road,
    document,
    finished,
)
from pytest_rvads.support.errors import MapError
from tools.crossings import Piece, add_plan, joined

_RING, _CONNECTING = 100, 200
"""Lowest ids of the roads of the ring, and of the roads in its junctions."""


@dataclass(frozen=True, slots=True)
class Roundabout:
    """Shape of a roundabout.

    The default numbers give an inscribed circle of 53.5 m, within the 27 to 55 m of single-lane roundabouts (NCHRP Report 672,
    exhibit 1-9), and 21.8 m of ring between two of the four junctions.

    Raises:
        MapError: the numbers describe no roundabout.
    """

    arms: int = 4
    """Number of arms, 3 to 8; the arms are evenly spaced from the south on."""
    radius: float = 25.0
    """Radius of the centre line of the ring [m]."""
    sector: float = math.radians(20.0)
    """Half the angle of the ring that lies in a junction [rad]; below 22 degrees the movement along the ring is no turn."""
    stop: float = 35.0
    """Distance from the centre of the roundabout to the entrance and exit vertices of its arms [m]."""
    lane_offset: float = 2.75
    """Distance from the axis of an arm to the centre of its lanes [m]; an island fills what exceeds half the lane width."""
    lane_width: float = 3.5
    """Width of the lanes [m]."""
    approach: float = 120.0
    """Length of the arms [m]."""

    def __post_init__(self) -> None:
        numbers = (self.radius, self.sector, self.stop, self.approach, self.lane_width)
        if not (3 <= self.arms <= 8 and all(0 < number < math.inf for number in numbers) and self.radius < self.stop):
            raise MapError(f"a roundabout has 3 to 8 arms and lengths above 0, the arms begin outside the ring, got {self!r}")
        if not self.lane_width / 2 < self.lane_offset < math.inf:
            raise MapError(f"lanes of {self.lane_width:g} m at an offset of {self.lane_offset:g} m leave no island between them")
        if self.ring <= 0:
            raise MapError(f"{self.arms} junctions of {2 * math.degrees(self.sector):g} degrees leave nothing of the ring")

    @property
    def control(self) -> JunctionControl:
        """Control of the junctions: yield signs on the arms."""
        return JunctionControl.YIELD

    @property
    def ways(self) -> int:
        """Number of arms of each junction: a road, the ring before the junction and the ring after the junction."""
        return 3

    @property
    def ring(self) -> float:
        """Length of the ring between two junctions [m]."""
        return self.radius * (math.tau / self.arms - 2 * self.sector)

    def angle(self, arm: int) -> float:
        """Return the direction of an arm from the centre [rad]."""
        return -math.pi / 2 + math.tau * arm / self.arms

    def on_ring(self, angle: float) -> Pose:
        """Return the point of the ring in a direction from the centre, with the direction of travel at this point."""
        return Pose(self.radius * math.cos(angle), self.radius * math.sin(angle), angle + math.pi / 2)


def roundabout(layout: Roundabout, name: str = "roundabout") -> str:
    """Return an OpenDRIVE document with one junction per arm, of ids from 1 on, as text.

    Args:
        layout: shape of the roundabout.
    """
    root = document(name, layout.stop + layout.approach)
    junctions = []
    for arm in range(layout.arms):
        _arm(root, layout, arm)
        _ring(root, layout, arm)
        junctions.append(_junction(root, layout, arm, name))
    root.extend(junctions)
    return finished(root)


def _arm(root: Element, layout: Roundabout, arm: int) -> None:
    """Write the road of an arm, which runs outward from the junction; lane 2 leads in, lane -2 leads out."""
    angle = layout.angle(arm)
    road = add_road(root, arm, layout.approach)
    add(road[0], "predecessor", elementType="junction", elementId=f"{arm + 1}")
    add_plan(road, [Piece(Pose(layout.stop * math.cos(angle), layout.stop * math.sin(angle), angle), layout.approach)])
    island = layout.lane_offset - layout.lane_width / 2
    islands = [Lane(side, "median", island, "solid") for side in (1, -1)]
    add_lanes(road, [Lane(0), *islands, *(Lane(id, "driving", layout.lane_width, "solid") for id in (2, -2))])
    sign = Post(arm, Sign.YIELD, (2, 2), 0.0, layout.lane_offset + layout.lane_width / 2 + 0.8)
    add_regulation(road, [sign], [(sign, layout.lane_offset, layout.lane_width)])


def _ring(root: Element, layout: Roundabout, arm: int) -> None:
    """Write the ring from the junction of an arm to the next junction."""
    road = add_road(root, _RING + arm, layout.ring)
    add(road[0], "predecessor", elementType="junction", elementId=f"{arm + 1}")
    add(road[0], "successor", elementType="junction", elementId=f"{(arm + 1) % layout.arms + 1}")
    add_plan(road, [Piece(layout.on_ring(layout.angle(arm) + layout.sector), layout.ring, 1 / layout.radius)])
    add_lanes(road, [Lane(0, mark="solid"), Lane(-1, "driving", layout.lane_width, "solid")], layout.lane_width / 2)


def _junction(root: Element, layout: Roundabout, arm: int, name: str) -> Element:
    """Write the connecting roads of the junction between the ring and an arm, and return the element of this junction.

    The connecting roads lead along the ring, from the ring to the arm, and from the arm to the ring.
    """
    angle = layout.angle(arm)
    junction = Element("junction", {"id": f"{arm + 1}", "name": f"{name} {arm + 1}"})
    before, after = _RING + (arm - 1) % layout.arms, _RING + arm
    first, last = layout.on_ring(angle - layout.sector), layout.on_ring(angle + layout.sector)
    out, into = (_vertex(layout, angle, side) for side in (-1, 1))
    ways = (
        ((before, "end", -1), (after, "start", -1), (Piece(first, 2 * layout.sector * layout.radius, 1 / layout.radius),)),
        ((before, "end", -1), (arm, "start", -2), joined(first, Pose(*out, angle))),
        ((arm, "start", 2), (after, "start", -1), joined(Pose(*into, angle + math.pi), last)),
    )
    for number, (start, end, pieces) in enumerate(ways):
        id = _CONNECTING + len(ways) * arm + number
        road = add_road(root, id, math.fsum(piece.length for piece in pieces), junction=junction.attrib["id"])
        for tag, (neighbour, point, _) in (("predecessor", start), ("successor", end)):
            add(road[0], tag, elementType="road", elementId=neighbour, contactPoint=point)
        add_plan(road, pieces)
        links = start[2], end[2]
        add_lanes(road, [Lane(0), Lane(-1, "driving", layout.lane_width, links=links)], layout.lane_width / 2)
        row = add(junction, "connection", id=id, incomingRoad=start[0], connectingRoad=id, contactPoint="start")
        add(row, "laneLink", **{"from": start[2]}, to=-1)
    return junction


def _vertex(layout: Roundabout, angle: float, side: int) -> tuple[float, float]:
    """Return the end of a lane of an arm at the junction [m]; side 1 is left of the outward direction."""
    x, y = layout.stop, side * layout.lane_offset
    return x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle)
