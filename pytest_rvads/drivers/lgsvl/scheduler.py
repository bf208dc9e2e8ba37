"""The scheduler of a junction with stop signs, and the zone that the scheduler guards.

The scheduler has one queue for all vehicles: first in, first out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple, Protocol

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.lgsvl.constants import Constants, ZoneBox
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose, Turn
from pytest_rvads.runs.states import VehicleState, Zone

__all__ = ["Box", "Guarded", "Scheduler", "Whole", "frame", "zone_of"]


class _Waiting(NamedTuple):
    name: str
    entrance: int
    since: float
    """Time at which the vehicle joined the queue [s]."""


class Scheduler:
    """Lets vehicles into the junction one after another.

    Vehicles call the scheduler in creation order. So of two vehicles that arrive in the same tick the vehicle that was created
    first is first in the queue: that is deficiency I3.

    Args:
        roster: names of the vehicles of the scheduler.
        ties_ignored: deficiency I3; if False, among vehicles that arrive together a vehicle without a vehicle to its right goes
            first.
    """

    def __init__(self, roster: Iterable[str], ties_ignored: bool) -> None:
        self._roster = frozenset(roster)
        self._ties_ignored = ties_ignored
        self._queue: list[_Waiting] = []
        self._called: str | None = None
        self._inside = False

    def join(self, seen: Observation) -> None:
        """Add a vehicle to the queue."""
        self._queue.append(_Waiting(seen.me.name, seen.me.entrance, seen.time))

    def calls(self, seen: Observation, zone: Guarded) -> bool:
        """Return whether a vehicle may go: the vehicle is first in the queue, and no vehicle is on the way through the zone."""
        if self._called is not None or self._next_vehicle(seen) != seen.me.name:
            return False
        # Vehicles outside of the roster do not obey the scheduler.
        if any(state.name not in self._roster and zone.holds(state) for state in seen.others):
            return False
        self._called = seen.me.name
        self._inside = False
        return True

    def leaves(self, state: VehicleState, zone: Guarded, gone: bool) -> bool:
        """Return whether the called vehicle has left the zone with its whole body; then the next vehicle may go.

        Args:
            state: state of the vehicle.
            zone: the guarded area.
            gone: whether the body is out of the junction; such a vehicle has left, even if the body never touched the zone.
        """
        inside = zone.holds(state)
        self._inside = self._inside or inside
        if inside or not (self._inside or gone):
            return False
        self._queue = [entry for entry in self._queue if entry.name != state.name]
        self._called = None
        return True

    def _next_vehicle(self, seen: Observation) -> str:
        head = self._queue[0]
        if not self._ties_ignored:
            tied = [entry for entry in self._queue if entry.since == head.since]
            for entry in tied:
                if not any((other.entrance, entry.entrance) in seen.junction.right_of for other in tied):
                    return entry.name
        return head.name


class Guarded(Protocol):
    """An area for one vehicle at a time."""

    def holds(self, state: VehicleState) -> bool:
        """Return whether a part of the vehicle is in the area."""


class Box:
    """The hand-placed box of deficiency I2.

    Args:
        box: extent of the box in the frame of the junction.
        origin: frame of the junction on the map.
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
        """Return whether a corner of the body is in the box."""
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
    """The whole junction, from the entrance vertices to the exit vertices; the zone without deficiency I2.

    Args:
        junction: the junction; the lengths of its movements give the extent.
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
        junction: the junction of the scheduler.
        constants: the extents of the boxes.
        hidden: whether the area is a box (I2) instead of the junction.
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
    # The point c nearest to the axes of all arms: sum (I - d d') (p - c) = 0, with the heading d and a point p of each axis.
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
    # x leads along the stem of a T, which has no movement straight on, and along arm 1 of an X.
    stem = next((i for i in range(junction.ways) if i not in straight), 1)
    return Pose((yy * bx - xy * by) / scale, (xx * by - xy * bx) / scale, headings[stem])
