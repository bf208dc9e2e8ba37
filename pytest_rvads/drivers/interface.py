"""What an autopilot sees and answers.

`Observation` and `Control` are made hundreds of times per simulated second, so they are named tuples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.states import Agent, Colour, VehicleState
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["Autopilot", "Control", "Factory", "Observation", "TrafficSystem"]


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


Factory = Callable[[], Any]
"""Makes the autopilot of one vehicle, or the `TrafficSystem` of a run: a class, or anything callable without arguments."""
