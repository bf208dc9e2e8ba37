"""The interface between the simulation and a driver: observations, commands, autopilots, traffic systems.

`Observation` and the commands are created hundreds of times per simulated second, so they are named tuples. `Factory` is a type,
so that a type checker refuses an object that is no driver.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from pytest_rvads.drivers.abilities import OF_AUTOPILOTS, OF_SYSTEMS, refuse
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Turn
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
    """All information that an autopilot gets for a decision."""

    time: float
    """Simulated time since the start of the run [s]."""
    me: VehicleState
    others: tuple[VehicleState, ...]
    """The other vehicles still in the run, in creation order."""
    lights: tuple[Colour, ...]
    """Colour of the light per entrance."""
    itinerary: Itinerary
    """Itinerary of the own vehicle; stations as in `VehicleState.station`."""
    junction: Junction
    """Arms, movements, signs and right of way."""
    vehicle: Vehicle
    """Parameters of the own vehicle."""
    speed_limit: float
    """Speed limit at the place of the own vehicle [m/s]; `Itinerary.limit_at` returns the limit at places ahead."""
    aggression: int = 1
    """1, 2 or 3: the number of the deceleration in `Vehicle.brake` that is the full service brake in this run."""
    wait: float = 1.5
    """Random waiting time, which the scenario fixes, for autopilots with a random waiting time [s]."""
    created: int = 0
    """Number of vehicles in `others` that were created before the own vehicle; these come first in `others`."""

    def everybody(self) -> tuple[VehicleState, ...]:
        """Return the own vehicle and the other vehicles in creation order, which a rotation of the scenario rotates."""
        return (*self.others[: self.created], self.me, *self.others[self.created :])

    def limit_of(self, other: VehicleState) -> float:
        """Return the highest speed limit on the ways that `other` may take, at least the own limit [m/s]."""
        return max(self.speed_limit, _top_limit(self.junction, other.entrance, other.turn))


@lru_cache(maxsize=4096)
def _top_limit(junction: Junction, entrance: int, turn: Turn) -> float:
    """Return the highest speed limit on the ways from an entrance with a turn [m/s]; 0 if the map states no limit."""
    ways = (itinerary(junction, *way.key) for way in junction.by_turn[entrance, turn])
    return max((way.limit_at(station) for way in ways for station, _ in way.limits), default=0.0)


class Control(NamedTuple):
    """Throttle, brake and steering."""

    throttle: float = 0.0
    """Throttle as a share of the drive force, 0..1."""
    brake: float = 0.0
    """Brake as a share of the service brake, 0..1."""
    steering: float = 0.0
    """Angle of the front wheels, left positive [rad]."""


class TargetSpeed(NamedTuple):
    """Follow the itinerary at a speed, slower in bends."""

    speed: float
    """Target speed [m/s]; 0 stops and holds the vehicle."""


class Acceleration(NamedTuple):
    """Accelerate or brake."""

    acceleration: float
    """Acceleration [m/s^2]; a negative acceleration brakes."""
    steering: float | None = None
    """Angle of the front wheels, left positive [rad]; None follows the itinerary."""


class Waypoint(NamedTuple):
    """A planned place of the reference point at a time."""

    time: float
    """Time since the start of the run, as in `Observation.time` [s]."""
    x: float
    """East coordinate [m]."""
    y: float
    """North coordinate [m]."""


class Trajectory(NamedTuple):
    """Reach points at their times, and stand at the last point."""

    points: tuple[Waypoint, ...]
    """At least two points in order of time; the steering follows their polyline."""


Command = Control | TargetSpeed | Acceleration | Trajectory
"""The answer of an autopilot, which holds until the next answer. At every step of the simulation the tracking controller drives
all commands other than `Control`."""


class Drives(Protocol):
    """An object of any class that drives a vehicle."""

    def control(self, seen: Observation, /) -> Command:
        """Return the command until the next call."""


class Coordinates(Protocol):
    """An object of any class that creates the autopilots of a run."""

    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of `agents`."""


Factory = Callable[[], Drives | Coordinates]
"""Creates the autopilot of a vehicle, or the traffic system of a run: a class, or a callable without arguments. The attribute
``label`` of a factory is its name in records and reports. The text ``version`` distinguishes the results of versions."""


class Autopilot(ABC):
    """A controller of a vehicle; every vehicle of every run gets a new controller, so nothing survives a run.

    A subclass needs only `control`. The other abilities have defaults. An object of any other class may have the abilities, too.

    Raises:
        AutopilotError: a subclass misspells the name of an ability.
    """

    period: float = DT
    """Time between two calls of `control`, a whole multiple of the step of 0.01 s [s]; the command holds in between."""
    label: str | None = None
    """Name in records and messages; None for the name of the class."""

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        refuse(cls, OF_AUTOPILOTS)

    @abstractmethod
    def control(self, seen: Observation, /) -> Command:
        """Return the command until the next call."""

    def timing(self) -> Mapping[str, Any] | None:
        """Return measurements: names with finite numbers or texts; other values are left out. None without measurements.

        The provenance of the run holds the measurements under ``timing`` and the vehicle, and no verdict depends on them. Reports
        show measurements with ``stack`` (name of the stack), ``decisions``, ``compute`` and ``longest`` [s].
        """
        return None

    def abandon(self) -> str:
        """Release resources outside of the autopilot after its answer ended the run; return details for the message."""
        return ""


class TrafficSystem(ABC):
    """Creates and coordinates the autopilots of a run, as a scheduler does; every run gets a new traffic system.

    Raises:
        AutopilotError: a subclass misspells the name of an ability.
    """

    label: str | None = None
    """Name in records; None for the name of the class."""

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        refuse(cls, OF_SYSTEMS)

    @abstractmethod
    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of `agents`, which is the creation order."""
