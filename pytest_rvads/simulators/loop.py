"""The simulation loop, which makes the run of a case, and the simulators ``bullet`` and ``mujoco``, which use it.

Both simulators have planar vehicle dynamics in a physics engine. Verdicts agree between the two, but runs are bit-identical
within one engine only.

In every step the loop samples the state, asks every autopilot for a command on this state, and advances the world by one step.
So a run is deterministic, bit for bit.

A collision, or a vehicle off its route, ends a run without a fault, because rules say nothing about the motion after such an
event. A rule with an obligation that is still open at this end gets the verdict OPEN, and the vehicle that ended the run is to
blame. A vehicle past the end of its itinerary leaves the run (`Zone.GONE`).

The recorder collects plain numbers, because tens of thousands of objects would slow down Python's garbage collector.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict
from operator import itemgetter
from typing import Any

import numpy as np

from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.drivers.reference import by_zones
from pytest_rvads.drivers.walking import STRIDE, Approaching, Sight, behaviour
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.logic.conduct.bodies import Box, gap, strikes, touch
from pytest_rvads.logic.conduct.room import room
from pytest_rvads.physics import braking, engines
from pytest_rvads.physics.body import Body, World, WorldMaker, start
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import ARRAYS, DT, LATE, PARTS, RAISED, Collision, Facts, Fault, Halt, Run
from pytest_rvads.runs.states import GONE, NUMBERS, STEADY, Agent, Colour, Kind, Vehicle, VehicleState, Zone, usual_body
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.pedestrians import Setting
from pytest_rvads.simulators.patience import TooLate, Watch
from pytest_rvads.simulators.seat import Seat, crew
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.installed import versions

_RECORDED = [(array, number) for array in ARRAYS for number in PARTS.get(array, (array,)) if number in NUMBERS]
"""The numbers of a `VehicleState` that a run holds, each with its array."""
_recorded = itemgetter(*(VehicleState._fields.index(number) for _, number in _RECORDED))
_IDLE = Control()
"""The controls of a body that no driver controls."""
_STEADY = round(STEADY / DT)
"""Number of steps between two updates of the lights."""


class Loop:
    """The state of a simulation; columns are the agents, in the order of the run.

    Args:
        case: the simulated case.
        name: the simulator's name.
        make: makes the world in which the vehicles move. A `Halt` that the world raises during the run ends the run by a fault.
        versions: versions of the simulator and its libraries, for the provenance.
        elsewhere: columns of vehicles that the world drives itself; no driver is asked for their controls.
        controlled: whether the world has its own vehicle dynamics. A step of such a world takes throttle, brake and steering of
            every vehicle instead of forces; the controls of a vehicle that has left are 0.
        watch: enforces the limits of real time; with None there are no limits.

    Raises:
        MapError: the positions of the lanes of the junction are unknown.
        ScenarioError: a vehicle does not fit on its approach, or two vehicles start inside each other.
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
        watch: Watch | None = None,
    ) -> None:
        scenario = case.scenario
        self.case, self.scenario, self.junction = case, scenario, scenario.place
        self._name, self._versions, self._elsewhere = name, versions, frozenset(elsewhere)
        self._controlled, self._watch = controlled, watch or Watch()
        self.collisions: list[Collision] = []
        self.fault: Fault | None = None
        self.end = "duration"
        """The reason why the run ended: left, duration, collision, route, fault or late."""
        self.strayed: tuple[str, ...] = ()
        self._seats: dict[int, Seat] = {}
        self._signals = scenario.signals()
        self._agents = case.vehicles()
        self._vehicles = [case.fleet.of(agent.name) for agent in self._agents]
        self._bodies: list[Body] = []
        starts = []
        rows = zip(self._agents, scenario.itineraries(), self._vehicles, case.starts(), strict=True)
        for agent, way, vehicle, (distance, speed) in rows:
            station = way.start(distance)
            self._bodies.append(Body(agent, way, station, vehicle, scenario.aggression))
            starts.append(start(way, station, speed, vehicle))
        ways = [body.itinerary for body in self._bodies]
        self._walkers = [Walker(self.junction, setting, ways) for setting in scenario.walkers(case.fleet.of)]
        if not by_zones(self.junction):
            room(self.junction)  # the reference driver asks for it; computed now, it does not delay the driver's first answer
        self._standing = [_IDLE] * len(self._walkers)
        """The controls of pedestrians and parked vehicles, which have none."""
        self.recorder = Recorder([*self._agents, *(walker.agent for walker in self._walkers)])
        created = scenario.creation.index  # sorting is stable: followers stay behind the first vehicle
        self._active = sorted(range(len(self._agents)), key=lambda column: created(self._agents[column].entrance))
        """Vehicles still in the run, in creation order."""
        self._lights: tuple[Colour, ...] = ()
        self._step = 0
        self.world: World = make(self._vehicles, starts)
        try:
            self._motions = self.world.motions()
            if overlaps := self.world.contacts():
                first, second = (self._agents[column].name for column in overlaps[0])
                raise ScenarioError(
                    f"{first} and {second} start inside each other in {scenario.name}: give one of them another distance"
                )
        except BaseException:
            self.world.close()
            raise

    def drive(self) -> Run:
        """Return the run, after simulating the case until the run ends."""
        case, scenario = self.case, self.scenario
        last = round(scenario.duration / DT)
        try:
            self._sample()
            order = [self._agents[column] for column in self._active]
            key = f"{self.junction.name} {scenario.placed} {scenario.configuration}"
            seats = crew(order, case.driver, case.traffic, scenario.under_test, scenario.senses, key, self.junction, self._watch)
            self._seats = dict(zip(self._active, seats, strict=True))
            while self._step < last and not self._over():
                self._advance(self._decide())
                self._sample()
            self._over()
        except TooLate:
            if not (late := self._watch.late):
                raise  # the limit of an outer run, within which this run is simulated
            self._halted(Halt(self._agents[0].name, f"{self._name} simulating {scenario.name}: {late}", end=LATE))
        except Halt as halt:
            self._halted(halt)
        finally:
            self.world.close()
        return self._result()

    def _result(self) -> Run:
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
            timing = {seat.agent.name: times for seat in self._seats.values() if (times := seat.timing())}
        except Halt as halt:
            provenance["late"] = halt.reason
        else:
            provenance |= {"timing": timing} if timing else {}
        seats = [seat for seat in self._seats.values() if seat.excess]
        excesses = {seat.agent.name: dict(zip(("requests", "largest"), seat.excess or (), strict=True)) for seat in seats}
        provenance |= {"excess": excesses} if excesses else {}
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
        RAISED.update(reason=halt.reason, error=halt.__cause__)

    def _over(self) -> bool:
        """Return whether the run is over before the end of its duration, and note the reason."""
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
        states = [body.state for body in bodies]
        if self._walkers:
            states += [walker.sample() for walker in self._walkers]
        self.recorder.state(states, self._lights)

    def _decide(self) -> list[Control]:
        """Return the controls of all autopilots, by column; vehicles that the world drives get idle controls."""
        bodies, scenario, step, lights, junction = self._bodies, self.scenario, self._step, self._lights, self.junction
        controls = [_IDLE] * len(bodies)
        time = step * DT
        seen = tuple([bodies[column].state for column in self._active])
        walkers = tuple([walker.state for walker in self._walkers if walker.state.zone is not GONE])
        for i, column in enumerate(self._active):
            if column in self._elsewhere:
                continue
            view = Observation(
                time,
                seen[i],
                seen[:i] + seen[i + 1 :] + walkers if walkers else seen[:i] + seen[i + 1 :],
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
        self.recorder.control(controls + self._standing)
        return controls

    def _advance(self, controls: list[Control]) -> None:
        """Advance the world by one step, move the pedestrians, and note collisions and touched pedestrians or parked vehicles."""
        forces: list[float] = []
        for body, motion, control in zip(self._bodies, self._motions, controls, strict=True):
            if self._controlled or body.state.zone is GONE:
                forces += control
            else:
                _, _, _, vx, vy, rate = motion
                throttle, brake, steering = control
                forces += body.dynamics.forces(body.cos, body.sin, vx, vy, rate, throttle, brake, steering)
        self.world.step(forces)
        states = [body.state for body in self._bodies] if self._walkers else []
        for walker in self._walkers:
            for state in states:
                if walker.touches(state):
                    me = walker.state
                    apart = cmath.rect(state.speed, state.heading) - cmath.rect(me.speed, me.heading)
                    self.collisions.append(Collision(self._step * DT, (state.name, walker.agent.name), abs(apart)))
            walker.walk(self._step * DT, self._lights, states)
        for pair in self.world.contacts():
            first, second = (self._motions[column] for column in pair)
            names = self._agents[pair[0]].name, self._agents[pair[1]].name
            # The engine detects contacts at the start of the step and resolves them within the step.
            self.collisions.append(Collision(self._step * DT, names, math.hypot(first.vx - second.vx, first.vy - second.vy)))
        self._motions = self.world.motions()
        self._step += 1


class Walker:
    """A pedestrian, or a parked vehicle, in a run with vehicles on their itineraries."""

    state: VehicleState

    def __init__(self, junction: Junction, setting: Setting, itineraries: Sequence[Itinerary]) -> None:
        agent = setting.agent
        self.agent, self.itinerary = agent, itinerary(junction, *agent.way.key)
        self._station, self._delay, self._behind = setting.station, setting.delay, setting.behind
        self._pace = None if math.isinf(setting.delay) else behaviour(setting.behaviour).pace()
        self._speed = setting.speed
        stretches = junction.stretches or {}
        shared = [(column, stretches.get(((way.entrance, way.exit), agent.way.key))) for column, way in enumerate(itineraries)]
        self._crossed = [(column, both.mine) for column, both in shared if both]
        """Columns of the vehicles that drive over the way of the pedestrian, and the stretches on which they do."""
        self.state = self._state(0.0)

    def sample(self) -> VehicleState:
        """Return the next state in the run, one step after the last sample."""
        if self._station != self.state.station or self._speed != self.state.speed or self.state.acceleration:
            self.state = self._state((self._speed - self.state.speed) / DT)
        return self.state

    def walk(self, time: float, lights: Sequence[Colour], vehicles: Sequence[VehicleState]) -> None:
        """Take the next step, from what the pedestrian sees at `time` [s]."""
        if self._pace is None or self.state.zone is GONE or time < self._delay:
            return
        coming = (
            Approaching(stretch.start - state.station, state.speed)
            for column, stretch in self._crossed
            if (state := vehicles[column]).zone is not GONE and state.station - state.length < stretch.end
        )
        light = lights[self.agent.entrance]
        # Who walks behind others stops behind them when the first of the group is at the kerb.
        station = self._station if self._station > 0.0 else min(self._station + self._behind, 0.0)
        wanted = self._pace(Sight(time - self._delay, station, self.agent.way.length, light, coming))
        if wanted < 0.0 and self._station + wanted * abs(wanted) / (2.0 * STRIDE) <= -self.itinerary.origin:
            wanted = 0.0  # back at the end of the sidewalk
        before, most = self._speed, STRIDE * DT
        self._speed = before + min(max(wanted - before, -most), most)
        self._station += (before + self._speed) / 2.0 * DT

    def touches(self, vehicle: VehicleState) -> bool:
        """Return whether the body overlaps the body of a vehicle."""
        me = self.state
        if me.zone is GONE or vehicle.zone is GONE:
            return False
        far = me.length + vehicle.length + vehicle.width
        if abs(me.x - vehicle.x) > far or abs(me.y - vehicle.y) > far:
            return False
        # Where a gap is between the rectangles around both bodies, as in most steps, no exact test is needed.
        if gap(*(Box(s.x, s.y, s.heading, s.length, s.width) for s in (vehicle, me))) > 0.0:
            return False
        bodies = [(np.array([[s.x, s.y, s.heading]]), (s.length, s.width)) for s in (vehicle, me)]
        return bool((strikes(bodies) if me.kind is Kind.PEDESTRIAN else touch(bodies))[0])

    def _state(self, acceleration: float) -> VehicleState:
        agent, station = self.agent, self._station
        length, width = agent.size or (0.0, 0.0)
        x, y, heading = self.itinerary.pose(station)
        zone = self.itinerary.zone(station)
        moves = self._speed, acceleration
        return VehicleState(
            agent.name, agent.entrance, agent.turn, zone, station, x, y, heading, *moves, length, width, agent.kind
        )


class Recorder:
    """Collects the states and controls of a run, one column per agent."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._zones: list[Zone] = []
        self._motions: list[Any] = []
        self._lights: list[tuple[Colour, ...]] = []
        self._controls: list[float] = []

    def state(self, states: Sequence[VehicleState], lights: tuple[Colour, ...]) -> None:
        """Add a state: one `VehicleState` per agent, one colour per start of a way."""
        zones, motions = self._zones, self._motions
        for state in states:
            zones.append(state.zone)
            motions += _recorded(state)
        self._lights.append(lights)

    def control(self, controls: Sequence[Control]) -> None:
        """Add the controls of the step after the last state, one per agent."""
        for control in controls:
            self._controls += control

    def run(
        self,
        label: str,
        junction: Junction,
        collisions: tuple[Collision, ...],
        fault: Fault | None,
        facts: Facts,
        provenance: Mapping[str, Any],
    ) -> Run:
        """Return the run; the controls of its last state are the controls of the step before, because no step follows."""
        steps, count = len(self._lights), len(self._agents)
        motion = np.fromiter(self._motions, dtype=np.float64).reshape(steps, count, len(_RECORDED))
        columns: dict[str, list[int]] = {}
        for column, (array, _) in enumerate(_RECORDED):
            columns.setdefault(array, []).append(column)
        arrays: dict[str, Any] = {name: motion[:, :, k if name in PARTS else k[0]] for name, k in columns.items()}
        numbers = 3 * count
        controls = self._controls + (self._controls[-numbers:] or [0.0] * numbers)
        return Run(
            label=label,
            junction=junction,
            agents=self._agents,
            zone=np.frombuffer(bytes(self._zones), dtype=np.int8).reshape(steps, count),
            lights=np.frombuffer(b"".join(map(bytes, self._lights)), dtype=np.int8).reshape(steps, len(junction.starts)),
            **arrays,
            controls=np.fromiter(controls[: steps * numbers], dtype=np.float64).reshape(steps, count, 3),
            collisions=collisions,
            fault=fault,
            facts=facts,
            provenance=provenance,
        )


class Planar:
    """A simulator of vehicles on a flat road, whose bodies move and touch in a physics engine: pybullet or MuJoCo.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.name = engine.name
        self.libraries = (engine.library,)

    def __call__(self, case: Case, watch: Watch | None = None) -> Run:
        """Return the run of a case, see `pytest_rvads.simulators.simulator.simulate`."""
        return Loop(case, self.name, self.engine.world, versions(self.engine.library), watch=watch).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest safe speed `distance` metres before the stopping line, see `pytest_rvads.physics.braking.vmax`."""
        return braking.vmax(distance, aggression, vehicle, self.engine, braking.FASTEST)

    def __repr__(self) -> str:
        return f"rvads.{self.name}"


bullet: Planar = Planar(BULLET)
mujoco: Planar = Planar(MUJOCO)


def usual() -> Planar:
    """Return the default simulator, see `pytest_rvads.physics.engines.usual`."""
    return bullet if engines.usual() is BULLET else mujoco
