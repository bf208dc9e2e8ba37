"""The zone of a junction in the eyes of the scheduler, and whether a vehicle is in it."""

from __future__ import annotations

import math
from typing import Protocol

from pytest_rvads.drivers.lgsvl.constants import Constants, ZoneBox
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.segment import Pose, Turn
from pytest_rvads.runs.states import VehicleState, Zone

__all__ = ["Box", "Guarded", "Whole", "frame", "zone_of"]


class Guarded(Protocol):
    """An area that only one vehicle may be in."""

    def holds(self, state: VehicleState) -> bool:
        """Return whether any part of the vehicle is in the area."""


class Box:
    """The hand-placed box of deficiency I2.

    Args:
        box: its extent, in the frame of the junction.
        origin: that frame on the map.
    """

    def __init__(self, box: ZoneBox, origin: Pose) -> None:
        self.box, self.origin = box, origin
        self._cos, self._sin = math.cos(origin.heading), math.sin(origin.heading)

    def corners(self) -> tuple[tuple[float, float], ...]:
        """Return the corners on the map, counter-clockwise [m]."""
        b, o = self.box, self.origin
        places = [(b.x + i * b.half_x, b.y + k * b.half_y) for i, k in ((1, -1), (1, 1), (-1, 1), (-1, -1))]
        return tuple((o.x + x * self._cos - y * self._sin, o.y + x * self._sin + y * self._cos) for x, y in places)

    def holds(self, state: VehicleState) -> bool:
        """Return whether one of the four corners of the body is in the box."""
        b, o = self.box, self.origin
        dx, dy = state.x - o.x, state.y - o.y
        # The front bumper in the frame of the box.
        x, y = dx * self._cos + dy * self._sin - b.x, dy * self._cos - dx * self._sin - b.y
        turned = state.heading - o.heading
        cos, sin = math.cos(turned), math.sin(turned)
        half = state.width / 2.0
        return any(
            abs(x - back * cos - aside * sin) < b.half_x and abs(y - back * sin + aside * cos) < b.half_y
            for back in (0.0, state.length)
            for aside in (-half, half)
        )


class Whole:
    """The junction itself, from the entrance vertices to the exit vertices: what I2 lacks.

    Args:
        junction: its movements say how far it reaches.
    """

    def __init__(self, junction: Junction) -> None:
        self._length = {(m.entrance, m.turn): m.length for m in junction.movements.values()}

    def holds(self, state: VehicleState) -> bool:
        """Return whether a part of the body is in the junction."""
        end = self._length[state.entrance, state.turn]
        return state.zone is Zone.JUNCTION or (state.zone is Zone.EXIT and state.station - state.length < end)


def zone_of(junction: Junction, constants: Constants, hidden: bool) -> Box | Whole:
    """Return the area that the scheduler guards.

    Args:
        junction: where it is.
        constants: the boxes.
        hidden: whether it is a box (I2) instead of the junction.
    """
    both = all(arm.entrances and arm.exits for arm in junction.arms)
    if not (hidden and both and junction.ways in (3, 4) and junction.drivable):
        return Whole(junction)
    return Box(constants.zone4 if junction.ways == 4 else constants.zone3, frame(junction))


def frame(junction: Junction) -> Pose:
    """Return the frame of a junction's zone: the point where its arms meet, and the direction of its x axis.

    Raises:
        MapError: the junction has no geometry.
    """
    # The point nearest to the axes of all arms: sum (I - d d') (p - c) = 0, with the heading d and a point p of each.
    xx = xy = yy = bx = by = 0.0
    headings = []
    for arm in junction.arms:
        approach = junction.way_in(arm.entrances[0])
        enter, away = approach.pose(approach.length), junction.way_out(arm.exits[0]).pose(0.0)
        x, y = (enter.x + away.x) / 2, (enter.y + away.y) / 2
        c, s = math.cos(enter.heading), math.sin(enter.heading)
        xx, xy, yy = xx + s * s, xy - s * c, yy + c * c
        bx, by = bx + s * s * x - s * c * y, by + c * c * y - s * c * x
        headings.append(enter.heading + math.pi)
    scale = xx * yy - xy * xy
    straight = {junction.entrances[m.entrance].arm for m in junction.movements.values() if m.turn is Turn.STRAIGHT}
    # x leads along the stem of a T, from which nobody goes straight on, and along arm 1 of an X.
    stem = next((i for i in range(junction.ways) if i not in straight), 1)
    return Pose((yy * bx - xy * by) / scale, (xx * by - xy * bx) / scale, headings[stem])
