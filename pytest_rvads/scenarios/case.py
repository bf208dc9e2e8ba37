"""Cases: a scenario, its drivers, and the bodies of its agents. Simulations, searches, caches and records take a case.

A scenario holds its junction, so a case is complete: a simulation, search, cache or record needs no other input.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from pytest_rvads.drivers.interface import Factory, check_factory
from pytest_rvads.drivers.traffic import DEFAULT, POLICIES
from pytest_rvads.runs.states import Agent, Vehicle
from pytest_rvads.scenarios.pedestrians import cast_of
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import ScenarioError, require


@dataclass(frozen=True, slots=True)
class Fleet:
    """The bodies of the agents of a scenario.

    Raises:
        ScenarioError: a body is no `Vehicle`.
    """

    vehicle: Vehicle = field(default_factory=Vehicle)
    """The vehicle of every agent without an entry in `others`."""
    others: Mapping[str, Vehicle] = field(default_factory=dict, hash=False)
    """Bodies of the agents whose body is not `vehicle`, by the name of the agent."""

    def __post_init__(self) -> None:
        require(self.others, Mapping, "others= must be vehicles by the name of the agent, such as {'a0': truck}", ScenarioError)
        for vehicle in (self.vehicle, *self.others.values()):
            require(vehicle, Vehicle, "a fleet, as the fixture rvads_vehicle, needs a rvads.Vehicle(...)", ScenarioError)
        object.__setattr__(self, "others", MappingProxyType(dict(self.others)))

    def of(self, agent: str) -> Vehicle:
        """Return the vehicle of an agent, given by name."""
        return self.others.get(agent, self.vehicle)


@dataclass(frozen=True, slots=True)
class Case:
    """A scenario, its drivers and the bodies of its agents: everything that a run depends on.

    Raises:
        ScenarioError: the scenario or the fleet has a wrong type, the fleet has a body for an agent that the scenario does not
            have, or traffic is given without a subject.
        AutopilotError: `driver` or `traffic` can't be called.
    """

    scenario: Scenario
    """The scenario: where the vehicles start, how fast, and where they go."""
    driver: Factory
    """Makes the autopilots of all vehicles, or of the subject alone: a class or callable without arguments.

    It is called once per vehicle, in creation order, or once for all vehicles if it returns a `TrafficSystem`.
    """
    traffic: Factory | None = None
    """Makes the autopilots of all vehicles but the subject; the reference policy by default. Allowed only with a subject."""
    fleet: Fleet = field(default_factory=Fleet)
    """The bodies of the agents; passenger cars by default."""

    def __post_init__(self) -> None:
        require(self.scenario, Scenario, "a case begins with a rvads.Scenario(rvads.find('stop4'), '1133')", ScenarioError)
        require(self.fleet, Fleet, "fleet= must be a rvads.Fleet(vehicle)", ScenarioError)
        names = [agent.name for agent in self.scenario.agents()] if self.fleet.others else []
        for name in self.fleet.others:
            if name not in names:
                raise ScenarioError(
                    f"the fleet has a body for {name!r}, the agents of {self.scenario.name} are {', '.join(names)}: "
                    "give the body to one of them"
                )
        if self.scenario.subject is not None and self.traffic is None:
            object.__setattr__(self, "traffic", POLICIES[DEFAULT])
        if self.scenario.subject is None and self.traffic is not None:
            raise ScenarioError(
                "traffic= drives the vehicles beside a subject: give the scenario a subject, or leave traffic= out"
            )
        for factory in (self.driver,) if self.traffic is None else (self.driver, self.traffic):
            check_factory(factory)

    def but(self, **changes: Any) -> Case:
        """Return the case with some arguments of its scenario's constructor changed."""
        return replace(self, scenario=self.scenario.but(**changes))

    def starts(self) -> tuple[tuple[float, float], ...]:
        """Return, per vehicle, its distance to the stopping line [m] and its speed [m/s], in the order of `vehicles`.

        Raises:
            ScenarioError: a vehicle has no room at its start, see `Scenario.starts`.
        """
        return self.scenario.starts(self.fleet.of)

    def vehicles(self) -> tuple[Agent, ...]:
        """Return the vehicles with their kinds and sizes, in the order of `Scenario.agents`."""
        bodies = [(agent, self.fleet.of(agent.name)) for agent in self.scenario.agents()]
        return tuple(replace(agent, kind=v.kind, size=(v.length, v.width)) for agent, v in bodies)

    def agents(self) -> tuple[Agent, ...]:
        """Return the vehicles, then the pedestrians and the vehicles parked for them, with their kinds and sizes."""
        return (*self.vehicles(), *cast_of(self.scenario.place, self.scenario.pedestrians))
