"""The scheduler of a junction with stop signs, the zone that the scheduler guards, and the constants of the LGSVL-like autopilot.

The scheduler has one queue for all vehicles: first in, first out.

Some constants are facts about the controller of the LGSVL simulator, the "original". The free constants (`Constants`) stand for
unknown values and were fitted. No code of the original was copied. ``docs/replication.md`` lists the free constants, the data to
which they were fitted, and their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import VehicleState, Zone
from pytest_rvads.support.errors import AutopilotError

RATES = (4.0, 6.0, 8.0)
"""Acceleration per difference between target speed and speed, by aggression [1/s]; the full rate."""
ADVANCE = 1.0
"""This rate when the vehicle begins to accelerate to a higher target speed [1/s]."""
RAMP = 5.0
"""Time in which the rate grows from `ADVANCE` to the full rate [s]."""
TURN_SHARE = 0.5
"""Speed in turns as a share of the speed on straight roads."""
SLOW = 15.0
"""Within this distance before the line, the target speed of a vehicle that has to stop is proportional to the distance [m]."""
DECIDE = 15.0
"""Distance to the line at which the driver looks at the light once [m]."""
HOLD = 1.0
"""Least time in the queue at a stop sign [s]."""
RED_WAIT = (0.0, 4.0)
"""Range of the time that a vehicle stands at red before it turns right [s]; 0 to 3 s on the faster vehicles of the original."""
TURN_WAIT = (1.0, 2.0)
"""Range of the time that a vehicle waits after its light has turned green before it turns left [s]."""


@dataclass(frozen=True, slots=True)
class ZoneBox:
    """The zone that the scheduler mistakes for the junction: a box around a point beside the centre (deficiency I2).

    The sides of the box are parallel to the axes x and y of the junction. In a junction of four arms (X), x leads to arm 1 and y
    to arm 2. In a junction of three arms (T), x leads along the stem away from the centre, and y points to the left of x.
    """

    x: float
    """Centre of the box along x [m]."""
    y: float
    """Centre of the box along y [m]."""
    half_x: float
    """Half of the extent along x [m]."""
    half_y: float
    """Half of the extent along y [m]."""

    def __post_init__(self) -> None:
        numbers = [getattr(self, item.name) for item in fields(self)]
        if not all(math.isfinite(number) for number in numbers) or min(self.half_x, self.half_y) <= 0:
            raise AutopilotError(f"a zone needs a finite place and positive extents, got {numbers}")


@dataclass(frozen=True, slots=True)
class Constants:
    """The free constants of the LGSVL-like autopilot, whose values were fitted to the paper's tables."""

    zone4: ZoneBox = ZoneBox(0.8, -0.8, 7.5, 7.5)
    """Zone of a junction of four arms."""
    zone3: ZoneBox = ZoneBox(2.0, 0.3, 4.6, 4.6)
    """Zone of a junction of three arms."""
    launch: float = 0.21
    """Time for which a vehicle accelerates at the start before its driver knows of the stop sign (deficiency I1) [s]."""
    halt: float = 1.0
    """Distance to the line at which the target speed becomes zero [m]; vehicles stop at about three quarters of this distance."""
    braking: float = 0.75
    """Share of the service brake with which a vehicle slows down before a stop; the original brakes harder than any car can."""


class _Waiting(NamedTuple):
    name: str
    entrance: int
    since: float
    """Time at which the vehicle joined the queue [s]."""


class Scheduler:
    """Lets vehicles of a roster into the junction one after another.

    Vehicles join the queue in the order in which they were created. So of two vehicles that arrive in the same tick, the vehicle
    that was created first goes first. This is deficiency I3 (`ties_ignored`). Without it, of vehicles that arrive together, a
    vehicle without a vehicle to its right goes first.
    """

    def __init__(self, roster: Iterable[str], ties_ignored: bool) -> None:
        self._roster = frozenset(roster)
        self._ties_ignored = ties_ignored
        self._queue: list[_Waiting] = []
        self._called: str | None = None
        self._inside = False

    def join(self, seen: Observation) -> None:
        """Add the observing vehicle to the queue."""
        self._queue.append(_Waiting(seen.me.name, seen.me.entrance, seen.time))

    def calls(self, seen: Observation, zone: Guarded) -> bool:
        """Return whether the observing vehicle is called into the junction.

        It is called if it is first in the queue and no vehicle that was called before is still on its way through the zone.
        """
        if self._called is not None or self.next_vehicle(seen) != seen.me.name:
            return False
        # Vehicles that are not in the roster don't obey the scheduler, so the zone is checked for them.
        if any(state.name not in self._roster and zone.holds(state) for state in seen.others):
            return False
        self._called = seen.me.name
        self._inside = False
        return True

    def leaves(self, state: VehicleState, zone: Guarded, gone: bool) -> bool:
        """Return whether the called vehicle has completely left the guarded area, so that another vehicle can be called."""
        inside = zone.holds(state)
        self._inside = self._inside or inside
        if inside or not (self._inside or gone):
            return False
        self._queue = [entry for entry in self._queue if entry.name != state.name]
        self._called = None
        return True

    def next_vehicle(self, seen: Observation) -> str:
        """Return the name of the vehicle that is called next; mutants choose another one."""
        head = self._queue[0]
        if self._ties_ignored:
            return head.name
        tied = [entry for entry in self._queue if entry.since == head.since]
        right_of, entrances = seen.junction.right_of, [entry.entrance for entry in tied]
        return next((e.name for e in tied if not any((other, e.entrance) in right_of for other in entrances)), head.name)


class Guarded(Protocol):
    """An area of the junction that the scheduler opens to one vehicle at a time."""

    def holds(self, state: VehicleState) -> bool:
        """Return whether a part of the vehicle is in this area of the junction."""


class Box:
    """The box that a scheduler with deficiency I2 guards instead of the junction, in the frame `origin`, see `frame`."""

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
        # x, y: the front bumper in the frame of the box.
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
    """The whole junction, from the entrance vertices to the exit vertices, which a scheduler without deficiency I2 guards."""

    def __init__(self, junction: Junction) -> None:
        self._length = {(m.entrance, m.turn): m.length for m in junction.movements.values()}

    def holds(self, state: VehicleState) -> bool:
        """Return whether a part of the body is in the junction."""
        end = self._length[state.entrance, state.turn]
        return state.zone is Zone.JUNCTION or (state.zone is Zone.EXIT and state.station - state.length < end)


def zone_of(junction: Junction, constants: Constants, hidden: bool) -> Box | Whole:
    """Return the area that the scheduler guards."""
    both = all(arm.entrances and arm.exits for arm in junction.arms)
    if not (hidden and both and junction.ways in (3, 4) and junction.drivable):
        return Whole(junction)
    return Box(constants.zone4 if junction.ways == 4 else constants.zone3, frame(junction))


def frame(junction: Junction) -> Pose:
    """Return the frame of a junction's box: as a pose, the point where the arms meet and the direction of the x axis."""
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
    # x leads along the stem of a T, from which no movement leads straight on, or along arm 1 of an X.
    stem = next((i for i in range(junction.ways) if i not in straight), 1)
    return Pose((yy * bx - xy * by) / scale, (xx * by - xy * bx) / scale, headings[stem])
