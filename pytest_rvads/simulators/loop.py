"""The simulation loop: from a case to a run.

In every step the state is sampled, every autopilot decides on that same state, then the world moves on by one step.

So a run is deterministic, bit for bit. A collision, or a vehicle off its route, ends a run without a fault, because what would
follow is no driving. An open obligation is then OPEN, and is held against the vehicle that ended the run. A vehicle past the end
of its itinerary leaves the run (`Zone.GONE`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import asdict

from pytest_rvads.conduct.room import room
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.drivers.reference import by_zones
from pytest_rvads.errors import ScenarioError
from pytest_rvads.maps.segment import SPEED_LIMIT
from pytest_rvads.physics.body import Body, start
from pytest_rvads.physics.world import World, WorldMaker
from pytest_rvads.runs.lights import STEADY
from pytest_rvads.runs.run import DT, LATE, Collision, Facts, Fault, Halt, Run
from pytest_rvads.runs.states import GONE, Colour
from pytest_rvads.runs.vehicle import usual_body
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.patience import TooLate, watch
from pytest_rvads.simulators.recorder import Recorder
from pytest_rvads.simulators.seat import Seat, crew

__all__ = ["Loop"]


class Loop:
    """What changes while a run is simulated; columns are the agents, in the order of the run.

    Args:
        case: the simulated case.
        name: the simulator's name.
        make: makes the world in which the vehicles move. A `Halt` that the world raises during the run ends the run by a fault.
        versions: versions of the simulator and its libraries, for the provenance.
        elsewhere: columns of vehicles that the world drives itself; no driver is asked for their controls.
        controlled: whether the world has its own vehicle dynamics. A step of such a world takes throttle, brake and steering of
            every vehicle instead of forces; the controls of a vehicle that has left are 0.

    Raises:
        MapError: it is not known where the lanes of the junction lie.
        ScenarioError: a vehicle does not fit on its approach, or two start inside each other.
    """

    def __init__(
        self,
        case: Case,
        name: str,
        make: WorldMaker,
        versions: Mapping[str, str],
        elsewhere: Collection[int] = (),
        *,
        controlled: bool = False,
    ) -> None:
        scenario = case.scenario
        self.case, self.scenario, self.junction = case, scenario, scenario.place
        self._name, self._versions, self._elsewhere = name, versions, frozenset(elsewhere)
        self._controlled = controlled
        self.collisions: list[Collision] = []
        self.fault: Fault | None = None
        self.end = "duration"
        """Why the run ended: left, duration, collision, route, fault, late."""
        self.strayed: tuple[str, ...] = ()
        self._seats: dict[int, Seat] = {}
        self._signals = scenario.signals()
        self._agents = case.agents()
        self._vehicles = [case.fleet.of(agent.name) for agent in self._agents]
        self._bodies: list[Body] = []
        starts = []
        rows = zip(self._agents, scenario.itineraries(), self._vehicles, case.starts(), strict=True)
        for agent, itinerary, vehicle, (distance, speed) in rows:
            station = itinerary.start(distance)
            self._bodies.append(Body(agent, itinerary, station, vehicle, scenario.aggression))
            starts.append(start(itinerary, station, speed, vehicle))
        if not by_zones(self.junction):
            room(self.junction)  # the reference needs it, and its first answer would take seconds
        self.recorder = Recorder(self._agents)
        created = scenario.creation.index  # sorting keeps followers behind the first one of their entrance
        self._active = sorted(range(len(self._agents)), key=lambda column: created(self._agents[column].entrance))
        """Vehicles still in the run, in creation order."""
        self._lights: tuple[Colour, ...] = ()
        self._step = 0
        self.world: World = make(self._vehicles, starts)
        try:
            self._motions = self.world.motions()
            if overlaps := self.world.contacts():
                one, two = (self._agents[column].name for column in overlaps[0])
                raise ScenarioError(
                    f"{one} and {two} start inside each other in {scenario.name}: give one of them another distance"
                )
        except BaseException:
            self.world.close()
            raise

    def drive(self) -> Run:
        """Simulate until the run ends, and return it."""
        try:
            self._simulate()
        finally:
            self.world.close()
        return self._result()

    def _simulate(self) -> None:
        case, scenario = self.case, self.scenario
        last = round(scenario.duration / DT)
        try:
            self._sample()
            order = [self._agents[column] for column in self._active]
            key = f"{self.junction.name} {scenario.placed} {scenario.configuration}"
            seats = crew(order, case.driver, case.traffic, scenario.under_test, scenario.senses, key)
            self._seats = dict(zip(self._active, seats, strict=True))
            while self._step < last and not self._over():
                self._advance(self._decide())
                self._sample()
            self._over()
        except TooLate:
            if not (late := watch().late):
                raise  # it is meant for a run that this one is simulated within
            self._halted(Halt(self._agents[0].name, f"{self._name} simulating {scenario.name}: {late}", end=LATE))
        except Halt as halt:
            self._halted(halt)

    def _result(self) -> Run:
        """Return the run as far as it got."""
        case = self.case
        provenance = {
            "scenario": case.scenario.record(),
            "simulator": self._name,
            "autopilot": name_of(case.driver),
            "traffic": None if case.traffic is None else name_of(case.traffic),
            "vehicle": asdict(case.fleet.vehicle),
            "others": {name: asdict(vehicle) for name, vehicle in case.fleet.others.items()},
            "end": self.end,
            "versions": dict(self._versions),
        }
        try:
            timed = {seat.agent.name: told for seat in self._seats.values() if (told := seat.timing())}
        except Halt as halt:
            provenance["late"] = halt.reason
        else:
            provenance |= {"timing": timed} if timed else {}
        bodies = zip((agent.name for agent in self._agents), self._vehicles, strict=True)
        radii = (
            (name, v.turning_radius)
            for name, v in bodies
            if not math.isclose(v.turning_radius, usual_body(v.length, v.width).radius)
        )
        facts = Facts(case.scenario.under_test, SPEED_LIMIT, self.strayed, tuple(radii))
        return self.recorder.run(case.scenario.name, self.junction, tuple(self.collisions), self.fault, facts, provenance)

    def _halted(self, halt: Halt) -> None:
        self.end = halt.end
        self.fault = Fault(self._step * DT, halt.agent, halt.reason, halt.detail)

    def _over(self) -> bool:
        """Tell whether the run is over before its time, and note why."""
        bodies = self._bodies
        if strayed := [column for column in self._active if bodies[column].strayed]:
            self.strayed = tuple(self._agents[column].name for column in sorted(strayed))
            self.end = "route"
        elif self.collisions:
            self.end = "collision"
        else:
            for body in bodies:
                if body.state.station < body.itinerary.leave:
                    return False
            self.end = "left"
        return True

    def _sample(self) -> None:
        """Record the current state of every vehicle; a vehicle that has left keeps its last state."""
        bodies, motions = self._bodies, self._motions
        gone = [column for column in self._active if bodies[column].sample(motions[column]).zone is GONE]
        for column in gone:
            self._active.remove(column)
            self.world.remove(column)
        if self._step % _STEADY == 0:
            self._lights = self._signals.colours(self._step * DT, len(self.junction.starts))
        self.recorder.state([body.state for body in bodies], self._lights)

    def _decide(self) -> list[Control]:
        """Ask every autopilot and return the controls by column; whom the world drives is not asked."""
        bodies, scenario, step, lights, junction = self._bodies, self.scenario, self._step, self._lights, self.junction
        controls = [_IDLE] * len(bodies)
        time = step * DT
        seen = tuple([bodies[column].state for column in self._active])
        for i, column in enumerate(self._active):
            if column in self._elsewhere:
                continue
            view = Observation(
                time,
                seen[i],
                seen[:i] + seen[i + 1 :],
                lights,
                bodies[column].itinerary,
                junction,
                self._vehicles[column],
                bodies[column].itinerary.limit_at(seen[i].station),
                scenario.aggression,
                scenario.wait,
                i,
            )
            controls[column] = self._seats[column].command(step, view)
        self.recorder.control(controls)
        return controls

    def _advance(self, controls: list[Control]) -> None:
        """Move the world on by one step and note who touched whom."""
        forces: list[float] = []
        for body, motion, control in zip(self._bodies, self._motions, controls, strict=True):
            if self._controlled or body.state.zone is GONE:
                forces += control
            else:
                _, _, _, vx, vy, rate = motion
                throttle, brake, steering = control
                forces += body.dynamics.forces(body.cos, body.sin, vx, vy, rate, throttle, brake, steering)
        self.world.step(forces)
        for pair in self.world.contacts():
            one, two = (self._motions[column] for column in pair)
            names = self._agents[pair[0]].name, self._agents[pair[1]].name
            # The contact was there at the start of the step, before the engine resolved it.
            self.collisions.append(Collision(self._step * DT, names, math.hypot(one.vx - two.vx, one.vy - two.vy)))
        self._motions = self.world.motions()
        self._step += 1


_IDLE = Control()
_STEADY = round(STEADY / DT)
"""Lights are looked at every so many steps."""
