"""States of agents and lights (paper, section 4.2), and the signal plan of a junction with lights.

A `VehicleState` is made hundreds of times per simulated second; it is a named tuple because a frozen dataclass costs three
times as much to build.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import lru_cache
from typing import NamedTuple

from pytest_rvads.geometry.conflicts import Way
from pytest_rvads.geometry.segment import Turn

__all__ = [
    "ABSENT",
    "APPROACH",
    "AXLE",
    "ENTRANCE",
    "EXIT",
    "GONE",
    "JUNCTION",
    "STEADY",
    "Agent",
    "Colour",
    "Kind",
    "SignalPlan",
    "VehicleState",
    "Zone",
]


AXLE = 0.8
"""The rear axle of a car, as a share of its length behind the front bumper."""


class Zone(IntEnum):
    """Which part of its itinerary the reference point of an agent is on; the parts touch, none overlap."""

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
    """Not in the recording, before its first or after its last sample: nothing is known of it, and its numbers are NaN."""


APPROACH, ENTRANCE, JUNCTION, EXIT, GONE, ABSENT = Zone
"""The members of `Zone` as names of the module, for inner loops: reading a member from its class takes 20 times as long."""


class Colour(IntEnum):
    """Colour of the light that controls an entrance; NONE where no light does."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


class Kind(StrEnum):
    """What kind of road user an agent is."""

    CAR = "car"
    TRUCK = "truck"
    CYCLIST = "cyclist"
    PEDESTRIAN = "pedestrian"


@dataclass(frozen=True, slots=True)
class Agent:
    """The part of a road user's state that does not change during a run."""

    name: str
    """``a0`` is the first at the entrance of arm 0, ``a0.1`` on its lane 1 where it has several, ``a0+1`` the next behind."""
    way: Way
    """Its way through the junction: a `Movement`, for a vehicle."""
    kind: Kind = Kind.CAR
    size: tuple[float, float] | None = None
    """Length and width [m]; None if not recorded."""

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
        """Turn type of its way."""
        return self.way.turn

    @property
    def route(self) -> Way:
        """The former name of `way`."""
        warnings.warn("Agent.route is called Agent.way", DeprecationWarning, stacklevel=2)
        return self.way


class VehicleState(NamedTuple):
    """The state of a vehicle that other vehicles can see."""

    name: str
    entrance: int
    """Number of the entrance from which the vehicle came or at which it stands."""
    turn: Turn
    """The indicator: the turn that the vehicle is about to make or makes."""
    zone: Zone
    station: float
    """Reference point (centre of the front bumper) along its itinerary, 0 at the entrance vertex, negative before [m]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    speed: float
    """Forward speed [m/s]."""
    acceleration: float
    """Forward acceleration over the last step [m/s^2]."""
    length: float
    """Body from the reference point backwards [m]."""
    width: float
    """Body width [m]."""
    kind: Kind = Kind.CAR


GREEN, YELLOW, CLEARANCE = 15.0, 3.0, 2.0
"""Durations [s] of the recorded junctions: green, yellow, all red before the next group."""
STEADY = 1.0
"""Colours change at whole multiples of this and at no other time [s]."""
_SLOT = GREEN + YELLOW + CLEARANCE
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
    """Group that has green at t = 0."""

    def colours(self, time: float, entrances: int) -> tuple[Colour, ...]:
        """Return the colour at each entrance at `time` [s]; NONE for an entrance in no group.

        Args:
            time: time since the run began [s].
            entrances: number of entrances of the junction.
        """
        if not self.groups:
            return (_NONE,) * entrances
        # Times are sums of steps of 0.01 s; rounding keeps a phase change on its tick.
        turn, within = divmod(round(time, 6), _SLOT)
        phase = 0 if within < GREEN else 1 if within < GREEN + YELLOW else 2
        return _colours_of_phases(self.groups, entrances)[(int(turn) + self.first) % len(self.groups)][phase]


@lru_cache(maxsize=256)  # asked for in every step, and changes every few seconds
def _colours_of_phases(groups: tuple[frozenset[int], ...], entrances: int) -> list[list[tuple[Colour, ...]]]:
    """Return, per group and phase of the group (green, yellow, red), the colour at each entrance."""
    lit = frozenset[int]().union(*groups)
    return [
        [tuple(phase if i in group else Colour.RED if i in lit else Colour.NONE for i in range(entrances)) for phase in _PHASES]
        for group in groups
    ]
