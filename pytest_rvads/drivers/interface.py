"""The interface between the simulation and a driver: observations, commands, autopilots, traffic systems, abilities.

`Observation` and the commands are named tuples, because they are created hundreds of times per simulated second. `Factory` is a
type, so that a type checker refuses an object that is no driver.

A driver need not derive from `rvads.Autopilot`: any object with the methods of `Drives` or `Coordinates` is a driver. An ability
is an attribute or method of a driver that the simulation uses, such as ``period``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Agent, Colour, Vehicle, VehicleState
from pytest_rvads.support.errors import AutopilotError


class Observation(NamedTuple):
    """All information that an autopilot gets for a decision; "own" refers to the vehicle of the autopilot."""

    time: float
    """Simulated time since the start of the run [s]."""
    me: VehicleState
    """The state of the own vehicle."""
    others: tuple[VehicleState, ...]
    """The other vehicles that have not left the run, in the order in which they were created."""
    lights: tuple[Colour, ...]
    """Colour of the traffic light at each entrance, then at the other starts of ways, see `Junction.starts`."""
    itinerary: Itinerary
    """Approach, movement and exit road of the own vehicle; `VehicleState.station` is measured along it."""
    junction: Junction
    """The junction, with its arms, movements, signs and right of way."""
    vehicle: Vehicle
    """Parameters of the own vehicle."""
    speed_limit: float
    """Speed limit at the position of the own vehicle [m/s]; `Itinerary.limit_at` returns the limit at stations ahead."""
    aggression: int = 1
    """1, 2 or 3: selects the deceleration in `Vehicle.brake` that a fully applied service brake has in this run."""
    wait: float = 1.5
    """Waiting time for autopilots that would draw it at random [s]; the scenario fixes it, so that runs can be repeated."""
    created: int = 0
    """Number of vehicles in `others` that were created before the own vehicle; they are the first elements of `others`."""

    def everybody(self) -> tuple[VehicleState, ...]:
        """Return the own vehicle and the others in the order of their creation, which rotates with the scenario."""
        return (*self.others[: self.created], self.me, *self.others[self.created :])

    def on_movements(self) -> Observation:
        """Return the observation without the agents whose ways are no movements, such as pedestrians and parked vehicles."""
        if not self.junction.further:
            return self
        others, entrances = self.others, len(self.junction.entrances)
        count = len(others)  # these agents come after all vehicles
        while count and others[count - 1].entrance >= entrances:
            count -= 1
        return Observation(self.time, self.me, others[:count], *self[3:])

    def limit_of(self, other: VehicleState) -> float:
        """Return the highest speed limit on the ways that `other` can take with its turn, but at least the own limit [m/s]."""
        return max(self.speed_limit, _top_limit(self.junction, other.entrance, other.turn))


@lru_cache(maxsize=4096)
def _top_limit(junction: Junction, entrance: int, turn: Turn) -> float:
    """Return the highest speed limit on the ways from an entrance with a turn [m/s]; 0 if the map states no limit."""
    ways = (itinerary(junction, *way.key) for way in junction.by_turn[entrance, turn])
    return max((way.limit_at(station) for way in ways for station, _ in way.limits), default=0.0)


class Control(NamedTuple):
    """A command that sets throttle, brake and steering."""

    throttle: float = 0.0
    """Throttle as a share of the drive force, 0..1."""
    brake: float = 0.0
    """Brake as a share of the service brake, 0..1."""
    steering: float = 0.0
    """Angle of the front wheels, left positive [rad]."""


class TargetSpeed(NamedTuple):
    """A command to follow the itinerary at a target speed, and more slowly in bends."""

    speed: float
    """Target speed [m/s]; 0 stops and holds the vehicle."""


class Acceleration(NamedTuple):
    """A command to accelerate or brake."""

    acceleration: float
    """Any finite acceleration [m/s^2]; a negative acceleration brakes.

    A vehicle accelerates with at most `Vehicle.drive`, and brakes with at most the `Vehicle.brake` of the aggression of the run.
    Reports count the commands that ask for more.
    """
    steering: float | None = None
    """Angle of the front wheels, left positive [rad]; with None, the vehicle is steered along its itinerary."""


class Waypoint(NamedTuple):
    """A planned position of the vehicle's reference point, with its time."""

    time: float
    """Time since the start of the run, as in `Observation.time` [s]."""
    x: float
    """East coordinate [m]."""
    y: float
    """North coordinate [m]."""


class Trajectory(NamedTuple):
    """A command to pass points at their times, and to stop at the last point."""

    points: tuple[Waypoint, ...]
    """At least two points with increasing times; the vehicle is steered along the polyline of the points."""


Command = Control | TargetSpeed | Acceleration | Trajectory
"""What an autopilot returns. The command holds until the autopilot is called again. The tracking controller turns commands other
than `Control` into throttle, brake and steering at every step of the simulation."""


class Drives(Protocol):
    """The protocol of autopilots: an object of any class with this method can drive a vehicle."""

    def control(self, seen: Observation, /) -> Command:
        """Return the command for the vehicle; the command holds until the next call."""


class Coordinates(Protocol):
    """The protocol of traffic systems: an object of any class with this method can create the autopilots of a run."""

    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of `agents`."""


Factory = Callable[[], Drives | Coordinates]
"""A class, or another callable without arguments, that creates the autopilot of a vehicle or the traffic system of a run. The
attribute ``label`` of a factory is its name in records and reports. The text in its attribute ``version`` distinguishes the
results of different versions of a driver."""


class Autopilot(ABC):
    """A base class of autopilots; each vehicle of each run gets a new autopilot, so that no state is carried to another run.

    A subclass needs only the method `control`. All other attributes and methods have defaults. An object of another class with
    such attributes and methods is accepted as an autopilot, too.
    """

    period: float = DT
    """Time between two calls of `control`, a whole multiple of the step of 0.01 s [s]; a command holds until the next call."""
    label: str | None = None
    """Name of the driver in records and messages; None for the name of the class."""

    @abstractmethod
    def control(self, seen: Observation, /) -> Command:
        """Return the command for the vehicle; the command holds until the next call.

        Args:
            seen: the state of the own vehicle and the visible states of all others, with the lights and the junction.

        Returns:
            A `Control`, an `Acceleration`, a `TargetSpeed` or a `Trajectory`.
        """

    def timing(self) -> Mapping[str, Any] | None:
        """Return measurements of the autopilot in this run, as finite numbers or texts by name, or None.

        Values of other types are dropped. The provenance of the run holds the measurements under ``timing`` and the vehicle's
        name. No verdict depends on the measurements. Reports show the measurements ``stack`` (name of the stack), ``decisions``
        (number of decisions), ``compute`` and ``longest`` (times of all decisions together and of the longest decision [s]).
        """
        return None

    def abandon(self) -> str:
        """Release resources, such as processes, and return details for the error message.

        The simulation calls this method if an answer of the autopilot, or a missing answer, ended the run.
        """
        return ""


class TrafficSystem(ABC):
    """A base class of traffic systems, which create and coordinate all autopilots of a run, as a scheduler does.

    Each run gets a new traffic system.
    """

    label: str | None = None
    """Name of the driver in records; None for the name of the class."""

    def prepare(self, junction: Junction, /) -> None:  # noqa: B027 - not abstract, because most systems need no junction
        """Prepare for the junction of the run, such as a plan that all vehicles share; by default, do nothing.

        The simulation calls this method before `autopilots`.
        """

    @abstractmethod
    def autopilots(self, agents: Sequence[Agent], /) -> Sequence[Drives]:
        """Return an autopilot per agent, in the order of `agents`, which is the order in which the vehicles are created."""


def check_factory(factory: Any) -> None:
    """Check that an object is a factory of autopilots."""
    if not callable(factory):
        raise AutopilotError(
            f"an autopilot must be a class or a callable that makes one, got {factory!r}: every vehicle of every run "
            "gets a new one, so pass the class, not an instance"
            + ("; rvads.traffic(name) returns a traffic policy" if isinstance(factory, str) else "")
        )


def wrong_label(driver: Any) -> str:
    """Return an error message about the label of a driver that is no text; an empty text if the label is fine."""
    label = getattr(driver, "label", None)
    fine = label is None or isinstance(label, str) or callable(label)
    return "" if fine else f"its label must be a text, got an object of type {type(label).__name__}"
