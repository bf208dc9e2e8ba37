"""The simulation loop: from a scenario and an autopilot to a run.

In every step the state is sampled, every autopilot decides on that same state, then the world moves on by one step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.errors import ScenarioError
from pytest_rvads.physics.body import Body, start
from pytest_rvads.physics.world import BulletWorld, World
from pytest_rvads.runs.run import DT, Collision, Facts, Fault, Halt, Run
from pytest_rvads.runs.states import GONE, Colour, VehicleState
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.scenario import SPEED_LIMIT, Scenario
from pytest_rvads.simulators.recorder import Recorder
from pytest_rvads.simulators.seat import Factory, Seat, crew, name_of
from pytest_rvads.versions import versions

__all__ = ["simulate"]


def simulate(scenario: Scenario, autopilot: Factory, *, vehicle: Vehicle | None = None, traffic: Factory | None = None) -> Run:
    """Simulate `scenario` and return its run.

    The run ends when every vehicle has left, or at the scenario's duration; also when two vehicles collide or one leaves its
    route, because what follows is no driving. It ends with `Run.fault` set when an autopilot raises or answers with something
    that is not a command, or when the plant fails. The states up to the end are kept.

    What ``timing()`` of an autopilot returns, a mapping with ``stack``, ``decisions``, ``compute`` and ``longest`` [s], is kept
    under ``timing`` in `Run.meta`, which is not part of the run's hash.

    Args:
        scenario: where the vehicles start and go.
        autopilot: a class or callable without arguments; called once per vehicle, in creation order, or once for all
            when it makes a `TrafficSystem`. With a subject it drives the subject alone.
        vehicle: parameters of all vehicles; a passenger car by default.
        traffic: likewise for the other vehicles of a scenario with a subject, and only there.

    Raises:
        MapError: the junction is unknown, unusable, or has no geometry.
        ScenarioError: a vehicle does not fit on its approach, two start inside each other, or subject and traffic do
            not go together.
        AutopilotError: `autopilot` or `traffic` is not callable.
    """
    vehicle = vehicle or Vehicle()
    scenario.fit()
    loop = _Loop(scenario, vehicle, BulletWorld)
    try:
        loop.run(autopilot, traffic)
    finally:
        loop.world.close()
    meta = {
        "scenario": scenario.record(),
        "autopilot": name_of(autopilot),
        "traffic": None if traffic is None else name_of(traffic),
        "vehicle": asdict(vehicle),
        "end": loop.end,
        "versions": versions(),
    }
    timed = {seat.agent.name: told for seat in loop.seats if (told := seat.timing()) is not None}
    if timed:
        meta["timing"] = timed
    return loop.recorder.run(scenario.name, loop.junction, tuple(loop.collisions), loop.fault, loop.facts(), meta)


class _Loop:
    """What changes while a run is simulated; columns are agents by entrance."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, world: Callable[..., World]) -> None:
        self.scenario = scenario
        self.junction = scenario.find()
        self.collisions: list[Collision] = []
        self.fault: Fault | None = None
        self.end = "duration"
        """Why the run ended: left, duration, collision, route, fault."""
        self.strayed: tuple[str, ...] = ()
        self.seats: tuple[Seat, ...] = ()
        self._vehicle = vehicle
        self._size = vehicle.length, vehicle.width
        self._signals = scenario.signals()
        self._agents = scenario.agents()
        self._bodies: list[Body] = []
        starts = []
        for agent, itinerary in zip(self._agents, scenario.itineraries(), strict=True):
            distance, speed = scenario.start(agent.entrance)
            station = itinerary.start(distance)
            self._bodies.append(Body(agent, itinerary, station, vehicle, scenario.aggression))
            starts.append(start(itinerary, station, speed, vehicle))
        self.recorder = Recorder(self._agents)
        columns = {agent.entrance: column for column, agent in enumerate(self._agents)}
        self._active = [columns[entrance] for entrance in scenario.creation]
        """Vehicles still in the run, in creation order."""
        self._states: dict[int, VehicleState] = {}
        self._lights: tuple[Colour, ...] = ()
        self._step = 0
        self.world = world(vehicle, starts)
        self._motions = self.world.motions()
        overlaps = self.world.contacts()
        if overlaps:
            self.world.close()
            one, two = (self._agents[column].name for column in overlaps[0])
            raise ScenarioError(f"{one} and {two} start inside each other in {scenario.name}: give one of them another distance")

    def run(self, autopilot: Factory, traffic: Factory | None) -> None:
        """Simulate until the run ends."""
        scenario = self.scenario
        last = round(scenario.duration / DT)
        try:
            self._sample()
            order = [self._agents[column] for column in self._active]
            key = f"{scenario.junction} {scenario.placed} {scenario.configuration}"
            crewed = crew(order, autopilot, traffic, self._subject(), scenario.senses, key)
            seats = dict(zip(self._active, crewed, strict=True))
            self.seats = tuple(seats.values())
            while self._step < last and not self._over():
                self._advance(self._decide(seats))
                self._sample()
            self._over()
        except Halt as halt:
            self.end = "fault"
            self.fault = Fault(self._step * DT, halt.agent, halt.reason, halt.detail)

    def facts(self) -> Facts:
        """Return what verdicts can depend on beside the states."""
        return Facts(self._subject(), (self._size,) * len(self._agents), SPEED_LIMIT, self.strayed)

    def _subject(self) -> str | None:
        return next((agent.name for agent in self._agents if agent.entrance == self.scenario.subject), None)

    def _over(self) -> bool:
        """Tell whether the run is over before its time, and note why."""
        self.strayed = tuple(self._agents[column].name for column in sorted(self._active) if self._bodies[column].strayed)
        if self.strayed:
            self.end = "route"
        elif self.collisions:
            self.end = "collision"
        elif all(self._states[i].station >= body.itinerary.leave for i, body in enumerate(self._bodies)):
            self.end = "left"
        return self.end != "duration"

    def _sample(self) -> None:
        """Take and record the current state of every vehicle; one that is gone stays as it was last seen."""
        states = self._states
        gone = []
        for column in self._active:
            state = states[column] = self._bodies[column].sample(self._motions[column])
            if state.zone is GONE:
                gone.append(column)
        for column in gone:
            self._active.remove(column)
            self.world.remove(column)
        self._lights = self._signals.colours(self._step * DT, self.junction.ways)
        self.recorder.state([states[column] for column in range(len(states))], self._lights)

    def _decide(self, seats: dict[int, Seat]) -> list[Control]:
        """Ask every autopilot and return the controls by column."""
        states = self._states
        controls = [_IDLE] * len(states)
        time = self._step * DT
        scenario = self.scenario
        seen = tuple([states[column] for column in self._active])
        for i, column in enumerate(self._active):
            view = Observation(
                time,
                seen[i],
                seen[:i] + seen[i + 1 :],
                self._lights,
                self._bodies[column].itinerary,
                self.junction,
                self._vehicle,
                SPEED_LIMIT,
                scenario.aggression,
                scenario.wait,
                i,
            )
            controls[column] = seats[column].command(self._step, view)
        self.recorder.control(controls)
        return controls

    def _advance(self, controls: list[Control]) -> None:
        """Move the world on by one step and note who touched whom."""
        forces = [0.0] * (3 * len(controls))
        for column in self._active:
            body = self._bodies[column]
            _, _, _, vx, vy, rate = self._motions[column]
            forces[3 * column : 3 * column + 3] = body.dynamics.forces(body.cos, body.sin, vx, vy, rate, *controls[column])
        self.world.step(forces)
        for pair in self.world.contacts():
            one, two = (self._motions[column] for column in pair)
            names = self._agents[pair[0]].name, self._agents[pair[1]].name
            # The contact was there at the start of the step, before the engine resolved it.
            self.collisions.append(Collision(self._step * DT, names, math.hypot(one.vx - two.vx, one.vy - two.vy)))
        self._motions = self.world.motions()
        self._step += 1


_IDLE = Control()
