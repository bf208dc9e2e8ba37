"""States of agents and lights (paper, section 4.2), and what an autopilot sees and answers.

`VehicleState`, `Observation` and `Control` are made hundreds of times per simulated second; they are named
tuples because a frozen dataclass costs three times as much to build.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

from pytest_rvads.maps.segment import Turn

if TYPE_CHECKING:
    from pytest_rvads.maps.junction import Junction
    from pytest_rvads.semantics.itinerary import Itinerary
    from pytest_rvads.semantics.vehicle import Vehicle

__all__ = [
    "APPROACH",
    "ENTRANCE",
    "EXIT",
    "GONE",
    "JUNCTION",
    "Agent",
    "Autopilot",
    "Colour",
    "Control",
    "Observation",
    "TrafficSystem",
    "VehicleState",
    "Zone",
]


class Zone(IntEnum):
    """Which part of its itinerary the reference point of a vehicle is on; the parts touch, none overlap."""

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


APPROACH, ENTRANCE, JUNCTION, EXIT, GONE = Zone
"""The zones by themselves, for what asks thousands of times a second: looking one up in its class takes 20 times as long."""


class Colour(IntEnum):
    """Colour of the light that controls an entrance; NONE where no light does."""

    NONE = 0
    GREEN = 1
    YELLOW = 2
    RED = 3


@dataclass(frozen=True, slots=True)
class Agent:
    """What does not change about a vehicle during a run: the abstract part of its state."""

    name: str
    """Named by its entrance: a0 starts at entrance 0."""
    entrance: int
    exit: int
    turn: Turn
    """Turn type of its movement through the junction."""


class VehicleState(NamedTuple):
    """What can be seen of a vehicle from outside."""

    name: str
    entrance: int
    """Entrance it came from or stands at."""
    turn: Turn
    """Its indicator: the turn it is about to make or is making."""
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


class Observation(NamedTuple):
    """All that an autopilot gets to decide on."""

    time: float
    """Simulated time since the start of the run [s]."""
    me: VehicleState
    others: tuple[VehicleState, ...]
    """The other vehicles still in the run, in creation order."""
    lights: tuple[Colour, ...]
    """Per entrance."""
    itinerary: Itinerary
    """Where to go; coordinates as in `VehicleState.station`."""
    junction: Junction
    """Arms, movements, signs and right of way."""
    vehicle: Vehicle
    """Parameters of the own vehicle."""
    speed_limit: float
    """[m/s]."""
    aggression: int = 1
    """1, 2 or 3: which deceleration of `Vehicle.brake` is full service brake in this run."""
    wait: float = 1.5
    """The one random draw of autopilots that have one, fixed by the scenario [s]."""
    created: int = 0
    """How many of `others` were created before the own vehicle: they come first among them."""

    def everybody(self) -> tuple[VehicleState, ...]:
        """Return the own vehicle among the others, in creation order: it moves along when a scenario is rotated."""
        return (*self.others[: self.created], self.me, *self.others[self.created :])


class Control(NamedTuple):
    """What an autopilot answers."""

    throttle: float = 0.0
    """Share of the drive force, 0..1."""
    brake: float = 0.0
    """Share of the service brake, 0..1."""
    steering: float = 0.0
    """Angle of the front wheels, left positive [rad]."""


class Autopilot(Protocol):
    """A controller of one vehicle; a new one is made for every vehicle and run, so nothing survives a run."""

    def control(self, seen: Observation) -> Control:
        """Return throttle, brake and steering to hold until the next call."""


class TrafficSystem(Protocol):
    """Creates and coordinates the autopilots of one run (a scheduler is one); a new one is made for every run."""

    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Autopilot]:
        """Return one autopilot per agent, in the order given, which is the creation order."""
