"""The LGSVL-like autopilot: the driver of a vehicle, and the traffic system with the paper's five deficiencies as switches.

"Original" refers to the controller of the LGSVL simulator. Like the original, a driver chooses a target speed, decides whether to
stop at the line, and yields at lights. The original changes the speed toward the target with accelerations up to 19 m/s^2, which
no car reaches. In this package, the rates of the original determine which shares of the drive and brake forces of a car are
applied. At stop signs, the scheduler of a junction has one queue for all vehicles: first in, first out.

Some constants are facts about the original. The free constants (`Constants`) stand for unknown values and were fitted. No code of
the original was copied. ``docs/replication.md`` lists the free constants, the data to which they were fitted, and their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

from pytest_rvads.drivers.crossing import in_the_way
from pytest_rvads.drivers.follower import STANDING, Follower
from pytest_rvads.drivers.interface import Control, Drives, Observation, TrafficSystem
from pytest_rvads.drivers.spacing import clear_of_bodies
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Agent, Colour, VehicleState, Zone
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
NEAR = 45.0
"""Only vehicles that are at most this far from the junction can have priority [m]: about five seconds at full speed."""
_SLOW = 0.05
"""Speed below which a vehicle that creeps to its stop counts as standing [m/s]."""
_TURN_EASE = 3.0
"""Deceleration before a turn [m/s^2]; the original enters turns at full speed, at which a car would slide."""


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

    def calls(self, seen: Observation, zone: Box | Whole) -> bool:
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

    def leaves(self, state: VehicleState, zone: Box | Whole, gone: bool) -> bool:
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


class Switches(NamedTuple):
    """Switches for the five deficiencies of the LGSVL autopilot in the paper's table."""

    i1: bool = True
    """The vehicle sets off before the driver knows about the stop sign."""
    i2: bool = True
    """The scheduler mistakes a hidden box for the junction."""
    i3: bool = True
    """The scheduler ignores ties: the creation order decides."""
    i4: bool = True
    """The vehicle turns right on red after a waiting time, without regard to other vehicles."""
    i5: bool = True
    """On a left turn, the vehicle yields only to some oncoming vehicles, and only after it has crossed the line."""


class Pilot(Follower):
    """The driver of one vehicle in the LGSVL-like traffic system; all vehicles of a run share the scheduler."""

    def __init__(self, switches: Switches, constants: Constants, scheduler: Scheduler) -> None:
        super().__init__()
        self._has = switches
        self._constants = constants
        self._scheduler = scheduler
        self._zone: Box | Whole | None = None
        self._free = False
        """Whether the driver has decided to cross the line."""
        self._decided = False
        """Whether the driver has looked at the light."""
        self._has_left = False
        """Whether the vehicle has left the zone of the scheduler."""
        self._joined: float | None = None
        """Time at which the vehicle joined the queue [s]."""
        self._stood: float | None = None
        """Time at which the vehicle stopped at a light [s]."""
        self._green: float | None = None
        """Time at which the waiting vehicle first observed green [s]."""
        self._since = 0.0
        """Time at which the vehicle began to accelerate to a higher target speed [s]."""

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering; a decision to cross the line takes effect one tick later."""
        everybody, seen = seen, seen.on_movements()
        me = seen.me
        free = self._free
        stops = seen.junction.control is not JunctionControl.LIGHTS
        if stops:
            self._attend_sign(seen)
        elif not free:
            self._attend_light(seen)
        distance = seen.itinerary.line - me.station
        # A vehicle farther from the line would drive in the first ticks with and without deficiency I1.
        launching = self._has.i1 and distance <= self._constants.halt and seen.time < self._constants.launch - 1e-9
        if free or launching:
            if not stops and me.turn is Turn.LEFT and not launching:
                if self._has.i5:
                    yields = me.zone is Zone.JUNCTION and listed(seen)
                else:
                    yields = me.zone <= Zone.ENTRANCE and oncoming(seen)
                if yields:
                    return self.drive(seen, -math.inf if me.speed < _SLOW else self._pursue(seen, 0.0))
            target = self.target_speed(seen)
            if me.turn is not Turn.STRAIGHT and me.station <= seen.itinerary.length:
                slow = TURN_SHARE * target
                target = min(target, math.sqrt(slow * slow - 2.0 * _TURN_EASE * min(me.station, 0.0)))
            acceleration = self._pursue(seen, target)
            if everybody.others and me.speed > _SLOW:
                acceleration = min(acceleration, clear_of_bodies(everybody, self.track(seen)))
        else:
            target, halt = 0.0, self._constants.halt
            if distance > halt:
                # The target speed of the original would need more braking than a car has, so the brakes limit the speed.
                brake = self._constants.braking * seen.vehicle.brake[seen.aggression - 1]
                target = min(seen.speed_limit, self.stopping_speed(distance - halt, brake), seen.speed_limit * distance / SLOW)
            if target <= 0.0 and me.speed < STANDING and seen.time >= self._constants.launch:
                return self.drive(seen, -math.inf)
            acceleration = self._pursue(seen, target)
        return self.drive(seen, acceleration)

    def _attend_sign(self, seen: Observation) -> None:
        """Join the queue at the stop sign, go when the scheduler calls, and tell the scheduler when the vehicle has left."""
        if self._has_left:
            return
        me = seen.me
        if self._zone is None:
            self._zone = zone_of(seen.junction, self._constants, self._has.i2)
        if self._free:
            gone = me.station - me.length > seen.itinerary.length
            self._has_left = self._scheduler.leaves(me, self._zone, gone)
            return
        if self._joined is None:
            if me.zone is Zone.APPROACH:
                return
            self._joined = seen.time
            self._scheduler.join(seen)
        if seen.time - self._joined >= HOLD - 1e-9 and self._scheduler.calls(seen, self._zone):
            self._free, self._since = True, seen.time

    def _attend_light(self, seen: Observation) -> None:
        """Look at the light once, at a distance; if it is not green, stop, and wait for green or to turn right on red."""
        me = seen.me
        colour = seen.lights[me.entrance]
        if not self._decided:
            if seen.itinerary.line - me.station > DECIDE:
                return
            self._decided = True
            if colour is Colour.GREEN:
                self._free, self._since = True, seen.time
                return
        if me.zone is Zone.APPROACH:
            return
        if self._stood is None and me.speed < _SLOW:
            self._stood = seen.time
        if colour is Colour.GREEN and self._green is None:
            self._green = seen.time
        # A right turn goes at green, or at red after a waiting time. A left turn goes a waiting time after green.
        if me.turn is Turn.RIGHT:
            waited = self._stood is not None and seen.time - self._stood >= seen.wait - 1e-9
            goes = colour is Colour.GREEN or (waited and self._has.i4)
            if waited and not goes:
                right_of = seen.junction.right_of
                goes = not any(
                    in_the_way(seen, other) or ((me.entrance, other.entrance) in right_of and _comes(seen, other))
                    for other in seen.others
                )
        else:
            extra = min(max(seen.wait, TURN_WAIT[0]), TURN_WAIT[1]) if me.turn is Turn.LEFT else 0.0
            goes = self._green is not None and seen.time - self._green >= extra - 1e-9
        if goes:
            self._free, self._since = True, seen.time

    def _pursue(self, seen: Observation, target: float) -> float:
        """Return the acceleration toward the speed `target` [m/s^2].

        Speed differences are corrected at the full rate if the target is lower, and at a growing rate if it is higher. The share
        of the drive force is the acceleration of the original divided by its acceleration from rest to the speed limit.
        """
        error = target - seen.me.speed
        rate = RATES[seen.aggression - 1]
        if error <= 0.0:
            return rate * error
        rate = ADVANCE + (rate - ADVANCE) * min((seen.time - self._since) / RAMP, 1.0)
        return seen.vehicle.drive * min(rate * error / (ADVANCE * seen.speed_limit), 1.0)


def listed(seen: Observation) -> bool:
    """Return whether a driver with deficiency I5, on a left turn beyond its line, yields to an oncoming vehicle.

    The driver yields to vehicles on the approach that do not turn left, and to vehicles in the junction that go straight on.
    """
    return any(
        (other.zone is Zone.JUNCTION and other.turn is Turn.STRAIGHT and in_the_way(seen, other))
        or (other.zone in (Zone.APPROACH, Zone.ENTRANCE) and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
        if (seen.me.entrance, other.entrance) in seen.junction.opposite
    )


def oncoming(seen: Observation) -> bool:
    """Return whether a driver without deficiency I5 has to wait on a left turn."""
    me, opposite = seen.me, seen.junction.opposite
    return any(
        in_the_way(seen, other)
        or ((me.entrance, other.entrance) in opposite and other.turn is not Turn.LEFT and _comes(seen, other))
        for other in seen.others
    )


def _comes(seen: Observation, other: VehicleState) -> bool:
    """Return whether `other` is near the junction and about to enter; a vehicle that nearly stands at red is not."""
    if other.zone is not Zone.APPROACH and other.zone is not Zone.ENTRANCE:
        return False
    if seen.lights[other.entrance] is Colour.RED and other.speed < 1.0:
        return False
    return other.station > -NEAR


class LgsvlLike(TrafficSystem):
    """A calibrated surrogate of the controller that the paper examined, on vehicles with real dynamics.

    Args:
        i1: whether a vehicle sets off before its driver knows about the stop sign.
        i2: whether the scheduler mistakes a hidden box for the junction.
        i3: whether the scheduler ignores which vehicle is on the right when two vehicles arrive together.
        i4: whether a vehicle turns right on red after a waiting time, without regard to other vehicles.
        i5: whether a vehicle on a left turn yields only to some oncoming vehicles.
        constants: the constants whose values were fitted.

    Example:
        >>> from functools import partial
        >>> without_hidden_zone = partial(LgsvlLike, i2=False)
    """

    def __init__(
        self,
        *,
        i1: bool = True,
        i2: bool = True,
        i3: bool = True,
        i4: bool = True,
        i5: bool = True,
        constants: Constants | None = None,
    ) -> None:
        self.switches = Switches(i1, i2, i3, i4, i5)
        self.constants = constants or Constants()

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        """Return one autopilot per agent, in the order of `agents`, with a common scheduler."""
        scheduler = Scheduler((agent.name for agent in agents), self.switches.i3)
        return [Pilot(self.switches, self.constants, scheduler) for _ in agents]
