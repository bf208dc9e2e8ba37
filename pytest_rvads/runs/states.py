"""Agents, their states and the states of lights (paper, section 4.2), signal plans, and the parameters of a vehicle.

A signal plan is the fixed cycle of the lights of a junction. The parameters of a vehicle determine its simulated dynamics, and
autopilots can read the parameters.

A `VehicleState` is made hundreds of times per simulated second; it is a named tuple because a frozen dataclass costs three
times as much to build.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from enum import IntEnum, StrEnum
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter
from typing import NamedTuple, get_type_hints

from pytest_rvads.geometry.sweep import CAR, Body
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Way
from pytest_rvads.support.errors import ScenarioError, require
from pytest_rvads.support.wording import plural

AXLE = 0.8
"""The rear axle of a car, as a share of its length behind the front bumper."""

GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]."""


class Zone(IntEnum):
    """The part of its itinerary on which the reference point of an agent is; neighbouring parts touch, and none overlap."""

    APPROACH = 0
    """On the road, before the entrance zone."""
    ENTRANCE = 1
    """From the entrance zone to the entrance vertex, which is included: ``a@j.en``."""
    JUNCTION = 2
    """On the movement, after the entrance vertex and before the exit vertex: ``a@j``."""
    EXIT = 3
    """On the exit road, from the exit vertex on."""
    GONE = 4
    """Past the end of the itinerary: the vehicle has left the run."""
    ABSENT = -1
    """The agent is not recorded at this time, before its first or after its last sample; its numbers are NaN."""


APPROACH, ENTRANCE, JUNCTION, EXIT, GONE, ABSENT = Zone
"""The members of `Zone` as names of the module, for inner loops: reading a member from its class takes 20 times as long."""


class Colour(IntEnum):
    """Colour of the light that controls an entrance; NONE for an entrance without a light."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


class Kind(StrEnum):
    """The kind of road user that an agent is, such as a car."""

    words: tuple[str, ...]
    """Words for the kind in files of other programs. The first word is the category of such vehicles in OpenSCENARIO."""

    def __new__(cls, value: str, *words: str) -> Kind:
        """Make a kind of agent from its name and the words for the kind in files of other programs."""
        kind = str.__new__(cls, value)
        kind._value_, kind.words = value, words
        return kind

    CAR = "car", "car"
    TRUCK = "truck", "truck", "lorry", "bus", "trailer", "coach"
    CYCLIST = "cyclist", "bicycle", "cyclist", "bike"
    PEDESTRIAN = "pedestrian", "pedestrian", "walker", "person"


@dataclass(frozen=True, slots=True)
class Agent:
    """A road user, described by the properties that do not change during a run."""

    name: str
    """Name: ``a0`` is the first agent at arm 0, ``a0+1`` the agent behind ``a0``, ``a0.1`` the first agent on lane 1 of arm 0."""
    way: Way
    """The way of the agent through the junction: for a vehicle a `Movement`."""
    kind: Kind = Kind.CAR
    """The kind of road user, such as a car or a pedestrian."""
    size: tuple[float, float] | None = None
    """Length and width of the agent [m]; None if not recorded."""
    other_exits: tuple[int, ...] = ()
    """Exits to which a vehicle may also have gone from its entrance, because its recording ends before its way is decided."""

    @property
    def entrance(self) -> int:
        """Number of the entrance, or of the start of the way, see `Junction.starts`."""
        return self.way.entrance

    @property
    def exit(self) -> int:
        """Number of the exit, or of the end of the way, see `Junction.ends`."""
        return self.way.exit

    @property
    def turn(self) -> Turn:
        """Turn type of the agent's way."""
        return self.way.turn


def crowd(agents: Iterable[Agent]) -> str:
    """Return the numbers of vehicles and pedestrians among agents in words."""
    kinds = [agent.kind is Kind.PEDESTRIAN for agent in agents]
    people = f", {plural(sum(kinds), 'pedestrian')}" if any(kinds) else ""
    return f"{plural(len(kinds) - sum(kinds), 'vehicle')}{people}"


class VehicleState(NamedTuple):
    """The state of a vehicle that other vehicles can see."""

    name: str
    """Name of the vehicle, see `Agent`."""
    entrance: int
    """Number of the entrance from which the vehicle came or at which it stands."""
    turn: Turn
    """The indicator: the turn that the vehicle is about to make or makes."""
    zone: Zone
    """The part of the vehicle's itinerary on which its reference point is."""
    station: float
    """Station of the reference point (centre of the front bumper), 0 at the entrance vertex and negative before it [m]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Heading, counter-clockwise from east [rad]."""
    speed: float
    """Forward speed [m/s]."""
    acceleration: float
    """Forward acceleration over the last step [m/s^2]."""
    length: float
    """Length of the body, from the reference point backwards [m]."""
    width: float
    """Width of the body [m]."""
    kind: Kind = Kind.CAR
    """The kind of road user."""


_OF_STATE = get_type_hints(VehicleState)
NUMBERS = tuple(name for name in VehicleState._fields if _OF_STATE[name] is float)
"""Names of the fields of a `VehicleState` that are measured, from the station to the width of a car."""
numbers = itemgetter(*map(VehicleState._fields.index, NUMBERS))
"""Returns the values of these fields of a `VehicleState`."""


GREEN_TIME, YELLOW_TIME, CLEARANCE = 15.0, 3.0, 2.0
"""Durations [s] of the recorded junctions: green, yellow, all red before the next group."""
CLEARING, WALK = 1.07, 4
"""Pedestrian lights (MUTCD 4E.06): walking speed that flashing DON'T WALK allows for [m/s], least duration of WALK [s]."""
STEADY = 1.0
"""Colours of lights change at whole multiples of this time and at no other time [s]."""
SLOT = GREEN_TIME + YELLOW_TIME + CLEARANCE
"""Time from the green of a group to the green of the next group [s]."""
_NONE, *_PHASES = Colour  # green, yellow, red


@dataclass(frozen=True, slots=True)
class SignalPlan:
    """A fixed-time plan: the phase groups have green in turn.

    With two groups, the first group shows green for 15 s, yellow for 3 s and red for 22 s. The second group shows red for 20 s,
    green for 15 s, yellow for 3 s and red for 2 s.
    """

    groups: tuple[frozenset[int], ...]
    """Entrances per phase group."""
    first: int = 0
    """Group with which the cycle begins."""
    elapsed: float = 0.0
    """Time of the cycle that has passed when the run starts [s]; if 0, the green of group `first` begins with the run."""
    walks: tuple[tuple[int, int, float], ...] = ()
    """Per pedestrian light the number of its start (`Junction.starts`), its phase group, and the length of its crossing [m]."""

    def colours(self, time: float, entrances: int) -> tuple[Colour, ...]:
        """Return the colour at each entrance at `time` since the run began [s]; NONE for an entrance in no group.

        With the number of all starts of ways (`Junction.starts`) as `entrances`, the colours of pedestrian lights follow.

        A pedestrian light shows green (WALK) in the green of its group, yellow (flashing DON'T WALK) for the last part of that
        green, and red else. Yellow is as long as a crossing at `CLEARING` takes, and green is at least `WALK` long (MUTCD 4E.06).
        """
        if not self.groups:
            return (_NONE,) * entrances
        # Times are sums of steps of 0.01 s; rounding keeps a phase change on its tick.
        turn, within = divmod(round(time + self.elapsed, 6), SLOT)
        phase = 0 if within < GREEN_TIME else 1 if within < GREEN_TIME + YELLOW_TIME else 2
        active = (int(turn) + self.first) % len(self.groups)
        colours = _colours_of_phases(self.groups, entrances)[active][phase]
        if not self.walks:
            return colours
        with_walks = list(colours)
        for start, group, length in self.walks:
            walk = max(math.floor(GREEN_TIME - length / CLEARING), WALK)
            flashing = Colour.YELLOW if within < GREEN_TIME else Colour.RED
            if start >= entrances:
                break  # only the lights of vehicles are asked for
            with_walks[start] = Colour.RED if group != active else Colour.GREEN if within < walk else flashing
        return tuple(with_walks)

    def phases(self) -> list[tuple[float, float]]:
        """Return begin and duration [s] of every phase in the first cycle of a run; a phase that runs at t = 0 is cut in two."""
        ends = [turn * SLOT + end for turn in range(len(self.groups)) for end in (GREEN_TIME, GREEN_TIME + YELLOW_TIME, SLOT)]
        cycle = len(self.groups) * SLOT
        changes = sorted({0.0, *((end - self.elapsed) % cycle for end in ends)})
        return [(begin, end - begin) for begin, end in pairwise([*changes, cycle])] if self.groups else []


@lru_cache(maxsize=256)  # asked for in every step, and changes every few seconds
def _colours_of_phases(groups: tuple[frozenset[int], ...], entrances: int) -> list[list[tuple[Colour, ...]]]:
    """Return, per group and phase of the group (green, yellow, red), the colour at each entrance."""
    lit = frozenset[int]().union(*groups)
    return [
        [tuple(phase if i in group else Colour.RED if i in lit else Colour.NONE for i in range(entrances)) for phase in _PHASES]
        for group in groups
    ]


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The parameters of a vehicle; by default a passenger car on a dry road, with values that are typical of the class.

    The parameters are those of the dynamic single-track model (Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.3).

    Raises:
        ScenarioError: a parameter is not finite or not positive, the wheelbase is longer than the body, or `kind` is no `Kind`.
    """

    mass: float = 1500.0
    """Mass [kg]."""
    yaw_inertia: float = 2500.0
    """Moment of inertia about the vertical axis [kg m^2]."""
    front_axle: float = 1.2
    """Distance from the centre of gravity to the front axle [m]."""
    rear_axle: float = 1.5
    """Distance from the centre of gravity to the rear axle [m]."""
    gravity_height: float = 0.55
    """Height of the centre of gravity above the road [m]."""
    length: float = 4.6
    """Length of the body, bumper to bumper [m]."""
    width: float = 1.86
    """Width of the body [m]."""
    height: float = 1.4
    """Height of the body [m]."""
    friction: float = 0.9
    """Coefficient of friction between tyre and road."""
    front_stiffness: float = 90e3
    """Cornering stiffness of the front axle [N/rad]."""
    rear_stiffness: float = 100e3
    """Cornering stiffness of the rear axle [N/rad]."""
    drive: float = 3.0
    """Acceleration at full throttle [m/s^2]."""
    drive_lag: float = 0.25
    """Time constant of the drive [s]."""
    brake: tuple[float, float, float] = (4.0, 6.0, 8.0)
    """Deceleration at full service brake by aggression 1, 2, 3 [m/s^2]."""
    brake_lag: float = 0.12
    """Time constant of the brake [s]."""
    drag: float = 0.35
    """Force of the air drag, divided by the square of the speed [N s^2/m^2]."""
    rolling: float = 0.012
    """Force of the rolling resistance, divided by the weight."""
    steering_limit: float = 0.61
    """Largest front wheel angle [rad]."""
    steering_rate: float = 0.8
    """Fastest change of the front wheel angle [rad/s]."""
    kind: Kind = Kind.CAR
    """The kind of road user that other vehicles see; the simulated dynamics do not depend on the kind."""

    def __post_init__(self) -> None:
        *parameters, _ = fields(self)
        for item in parameters:
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                if not (isinstance(number, int | float) and math.isfinite(number) and number > 0):
                    raise ScenarioError(f"vehicle parameter {item.name} must be a positive number, got {value!r}")
        if len(self.brake) != 3:
            raise ScenarioError(f"vehicle parameter brake needs a deceleration for aggression 1, 2 and 3, got {self.brake!r}")
        require(self.kind, Kind, "vehicle parameter kind must be a rvads.Kind, such as rvads.Kind.TRUCK", ScenarioError)
        if self.wheelbase >= self.length:
            raise ScenarioError(f"vehicle wheelbase {self.wheelbase} m does not fit into a body of {self.length} m")

    @property
    def wheelbase(self) -> float:
        """Distance from the front axle to the rear axle [m]."""
        return self.front_axle + self.rear_axle

    @property
    def turning_radius(self) -> float:
        """Radius of the circle on which the rear axle drives at the steering limit, wheelbase / tan(limit) [m]."""
        return self.wheelbase / math.tan(min(self.steering_limit, 1.5))  # at 1.57 rad, the vehicle would turn on the spot

    @property
    def rear_axle_offset(self) -> float:
        """Distance from the reference point (front bumper) to the rear axle [m]; the axles are centred in the body."""
        return (self.length + self.wheelbase) / 2

    @property
    def gravity_offset(self) -> float:
        """Distance from the reference point (front bumper) to the centre of gravity [m]."""
        return self.rear_axle_offset - self.rear_axle

    @property
    def body(self) -> Body:
        """The dimensions that decide where the vehicle can go."""
        return Body(self.length, self.width, self.rear_axle_offset, self.turning_radius)


def usual_body(length: float, width: float) -> Body:
    """Return the body of a usual car scaled to this size [m], for a vehicle whose axles and steering are not known."""
    scale = length / CAR.length
    return Body(length, width, CAR.axle * scale, CAR.radius * scale)
