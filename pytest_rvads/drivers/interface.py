"""The interface between the simulation and a driver: observations, commands, autopilots, traffic systems.

`Observation` and the commands are made hundreds of times per simulated second, so they are named tuples.

`Factory` is a type, so that a type checker refuses an object that is no driver.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from pytest_rvads.drivers.abilities import OF_AUTOPILOTS, OF_SYSTEMS, refuse
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Agent, Colour, VehicleState
from pytest_rvads.runs.vehicle import Vehicle

__all__ = [
    "Acceleration",
    "Autopilot",
    "Command",
    "Control",
    "Coordinates",
    "Drives",
    "Factory",
    "Observation",
    "TargetSpeed",
    "TrafficSystem",
    "Trajectory",
    "Waypoint",
]


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
    """At the place of the own vehicle [m/s]; `Itinerary.limit_at` tells that of places ahead."""
    aggression: int = 1
    """1, 2 or 3: which deceleration of `Vehicle.brake` is full service brake in this run."""
    wait: float = 1.5
    """The one random draw of autopilots that have one, fixed by the scenario [s]."""
    created: int = 0
    """How many of `others` were created before the own vehicle: they come first among them."""

    def everybody(self) -> tuple[VehicleState, ...]:
        """Return the own vehicle among the others, in creation order: it moves along when a scenario is rotated."""
        return (*self.others[: self.created], self.me, *self.others[self.created :])

    def limit_of(self, other: VehicleState) -> float:
        """Return the highest speed limit [m/s] on the ways that `other` may take, at least the own limit: so fast it may come."""
        return max(self.speed_limit, _top_limit(self.junction, other.entrance, other.turn))


@lru_cache(maxsize=4096)
def _top_limit(junction: Junction, entrance: int, turn: Turn) -> float:
    """Return the highest speed limit on some ways through a junction [m/s]; 0 where the map states none."""
    ways = (itinerary(junction, *way.key) for way in junction.by_turn[entrance, turn])
    return max((way.limit_at(station) for way in ways for station, _ in way.limits), default=0.0)


class Control(NamedTuple):
    """Throttle, brake and steering as they are."""

    throttle: float = 0.0
    """Share of the drive force, 0..1."""
    brake: float = 0.0
    """Share of the service brake, 0..1."""
    steering: float = 0.0
    """Angle of the front wheels, left positive [rad]."""


class TargetSpeed(NamedTuple):
    """Follow the itinerary at this speed, slower in bends."""

    speed: float
    """0 stops and holds the vehicle [m/s]."""


class Acceleration(NamedTuple):
    """Accelerate or brake by this much."""

    acceleration: float
    """Negative brakes [m/s^2]."""
    steering: float | None = None
    """Angle of the front wheels, left positive [rad]; None follows the itinerary."""


class Waypoint(NamedTuple):
    """Where the reference point shall be, and when."""

    time: float
    """As in `Observation.time`: since the start of the run [s]."""
    x: float
    """[m]."""
    y: float
    """[m]."""


class Trajectory(NamedTuple):
    """Be at these points at their times; from the last one on, stand."""

    points: tuple[Waypoint, ...]
    """At least two, in order of time; the steering follows their polyline."""


Command = Control | TargetSpeed | Acceleration | Trajectory
"""What an autopilot answers. It is held until the autopilot is asked again; what is no `Control`, the tracking controller drives
at every step of the simulation."""


class Drives(Protocol):
    """An object that drives one vehicle: it need not derive from anything."""

    def control(self, seen: Observation, /) -> Command:
        """Return what to do until the next call."""


class Coordinates(Protocol):
    """An object that makes the autopilots of a run."""

    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return one autopilot per agent, in the order given."""


Factory = Callable[[], Drives | Coordinates]
"""Makes the autopilot of one vehicle, or what coordinates those of a run: a class, or anything callable without arguments. An
attribute ``label`` of it is the name that records and reports call it by. A text ``version`` tells its results from those of
another version."""


class Autopilot(ABC):
    """A controller of one vehicle; a new one is made for every vehicle and run, so nothing survives a run.

    Only `control` is needed. The other abilities have defaults here, and an object of any class may have them.

    Raises:
        AutopilotError: a class that misspells an ability.
    """

    period: float = DT
    """How often it is asked, a whole multiple of the step of 0.01 s; its answer is held in between [s]."""
    label: str | None = None
    """What records and messages call it; None stands for the name of its class."""

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        refuse(cls, OF_AUTOPILOTS)

    @abstractmethod
    def control(self, seen: Observation, /) -> Command:
        """Return what to do until the next call."""

    def timing(self) -> Mapping[str, Any] | None:
        """Return what it measured: names with finite numbers or texts, others are left out; None where nobody measures.

        It is kept in the provenance of the run, under ``timing`` and the vehicle, and no verdict depends on it. Reports show it
        where it has ``stack`` (its name), ``decisions``, ``compute`` and ``longest`` [s].
        """
        return None

    def abandon(self) -> str:
        """Let go of what runs elsewhere, because an answer of this autopilot ended the run; return what else there is to know."""
        return ""


class TrafficSystem(ABC):
    """Creates and coordinates the autopilots of one run (a scheduler is one); a new one is made for every run.

    Raises:
        AutopilotError: a class that misspells an ability.
    """

    label: str | None = None
    """What records call it; None stands for the name of its class."""

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        refuse(cls, OF_SYSTEMS)

    @abstractmethod
    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return one autopilot per agent, in the order given, which is the creation order."""
