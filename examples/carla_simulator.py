# ruff: noqa: D101, D102, ARG002 - what the methods do is told by the protocols that they are of
"""CARLA as a simulator: a sketch. No CARLA server was there to try it; docs/bring-a-simulator.md says what was tried instead.

CARLA's frame is left-handed: x as on the map, y the other way, yaw clockwise, in degrees. The location of an actor is not its
front bumper: its bounding box has a centre of its own, and the bumper is half a length before that.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import pytest_rvads as rvads
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.braking import FASTEST, STANDING, greatest_safe
from pytest_rvads.runs.run import DT
from pytest_rvads.simulators.loop import Loop
from pytest_rvads.simulators.patience import Watch
from pytest_rvads.support.installed import versions

SAME_SIZE = 0.1
"""How much longer or wider than the vehicle of a case a blueprint may be [m]."""


class Client(Protocol):
    """What is asked of CARLA, in synchronous mode at a fixed step of 0.01 s; behind each call what it is in CARLA's API."""

    def box(self, kind: str) -> tuple[float, float, float]: ...  # bounding_box.location.x, extent.x, extent.y of its blueprint
    def spawn(self, kind: str, x: float, y: float, yaw: float) -> int: ...  # world.spawn_actor: RuntimeError without room
    def push(self, actor: int, vx: float, vy: float) -> None: ...  # actor.set_target_velocity
    def control(self, actor: int, throttle: float, steer: float, brake: float) -> None: ...  # actor.apply_control
    def light(self, entrance: int, state: str) -> None: ...  # traffic_light.set_state, of one that is frozen
    def tick(self) -> None: ...  # world.tick
    def state(self, actor: int) -> tuple[float, float, float, float, float]: ...  # x, y, yaw of get_transform, get_velocity
    def collided(self) -> Sequence[tuple[int, int]]: ...  # what sensor.other.collision told in the last tick
    def destroy(self, actor: int) -> None: ...  # actor.destroy


class Carla:
    """Makes runs of cases in CARLA, on the map that its server has open.

    Args:
        connect: opens a client; called for every run.
        steering: angle of the front wheels at full steer, `WheelPhysicsControl.max_steer_angle` [rad].
        place: the junction of that map where vmax is found, on the way to entrance 0.
    """

    name = "carla"
    unsupported = dict.fromkeys(("bodies", "passing"), "bodies are those of its blueprints, cases with others are refused")

    def __init__(self, connect: Callable[[], Client], steering: float, place: rvads.Junction) -> None:
        self.connect, self.steering, self.place = connect, steering, place
        self.found: dict[tuple[Any, ...], float | None] = {}

    def __call__(self, case: rvads.Case, watch: Watch | None = None) -> rvads.Run:
        def make(_: Sequence[rvads.Vehicle], starts: Sequence[Motion]) -> CarlaWorld:
            return CarlaWorld(self.connect(), case, starts, self.steering)

        return Loop(case, self.name, make, versions("carla"), controlled=True, watch=watch).drive()

    def vmax(self, distance: float, aggression: int = 1, vehicle: rvads.Vehicle | None = None) -> float | None:
        """Brake fully from one speed after another, `distance` before the line, and see where the vehicle stops."""
        if not (math.isfinite(distance) and distance >= 0.0):
            raise rvads.errors.ScenarioError(f"the distance to the stopping line must be 0 m or more, got {distance!r}")
        key = distance, aggression, vehicle or rvads.Vehicle()
        code = [self.place.directions(0)[0], *[0] * (len(self.place.entrances) - 1)]

        def safe(speed: float) -> bool:
            scenario = rvads.Scenario(self.place, code, distance=distance, speed=speed, aggression=aggression, duration=10.0)
            run = self(rvads.Case(scenario, Brakes, fleet=rvads.Fleet(key[-1])))
            stands = abs(run.need("speed")[-1, 0]) < STANDING
            return bool(stands and run.need("station").max() <= -self.place.setbacks[0])

        if key not in self.found:
            self.found[key] = greatest_safe(safe, FASTEST)
        return self.found[key]


class Brakes:
    def control(self, seen: rvads.Observation) -> rvads.Control:
        return rvads.Control(brake=1.0)


class CarlaWorld:
    """The vehicles of one run, which move by CARLA's own dynamics; a `pytest_rvads.physics.body.World` that takes controls."""

    def __init__(self, client: Client, case: rvads.Case, starts: Sequence[Motion], steering: float) -> None:
        scenario, vehicles = case.scenario, [case.fleet.of(agent.name) for agent in case.vehicles()]
        self.client, self.scenario, self.plan, self.ticks = client, scenario, scenario.signals(), 0
        self.brakes = [vehicle.brake[scenario.aggression - 1] / vehicle.brake[-1] for vehicle in vehicles]  # full pedal: hardest
        self.steering, self.now, self.ahead = steering, list(starts), [self.fit(vehicle) for vehicle in vehicles]
        self.actors: dict[int, int] = {}  # by column: those that are not gone
        try:
            for column, vehicle in enumerate(vehicles):
                x, y, yaw = starts[column][:3]
                x, y = x - self.ahead[column] * math.cos(yaw), y - self.ahead[column] * math.sin(yaw)
                self.actors[column] = client.spawn(vehicle.kind, x, -y, -math.degrees(yaw))
        except RuntimeError as error:
            self.close()
            raise rvads.errors.ScenarioError(f"no room for vehicle {column} of {scenario.name} in CARLA: {error}") from error
        self.tick()  # an actor has a place from its first tick on; nobody moves in that one
        for column, actor in self.actors.items():
            client.push(actor, starts[column].vx, -starts[column].vy)

    def fit(self, vehicle: rvads.Vehicle) -> float:
        """Return how far before the location of an actor its centre of gravity is [m]."""
        centre, half, side = self.client.box(vehicle.kind)
        if max(abs(2 * half - vehicle.length), abs(2 * side - vehicle.width)) > SAME_SIZE:
            wanted = f"{vehicle.length:g} x {vehicle.width:g} m"
            raise rvads.errors.ScenarioError(
                f"CARLA's {vehicle.kind} is {2 * half:.2f} x {2 * side:.2f} m, not {wanted}: change the fleet"
            )
        return centre + half - vehicle.gravity_offset

    def tick(self) -> None:
        for entrance, colour in enumerate(self.plan.colours(self.ticks * DT, len(self.scenario.place.entrances))):
            if colour is not rvads.Colour.NONE:
                self.client.light(entrance, colour.name.capitalize())
        self.client.tick()

    def motions(self) -> list[Motion]:
        return self.now

    def step(self, controls: Sequence[float]) -> None:
        for column, actor in self.actors.items():
            throttle, brake, angle = controls[3 * column : 3 * column + 3]
            steer = max(-1.0, min(1.0, -angle / self.steering))  # to the right is positive there
            self.client.control(actor, throttle, steer, brake * self.brakes[column])
        self.ticks += 1
        self.tick()
        self.now = [self.read(column) if column in self.actors else before for column, before in enumerate(self.now)]

    def read(self, column: int) -> Motion:
        x, y, yaw, vx, vy = self.client.state(self.actors[column])
        before, ahead = self.now[column].yaw, self.ahead[column]
        heading = before + math.remainder(math.radians(-yaw) - before, math.tau)  # CARLA's jumps from 180 to -180 degrees
        return Motion(x + ahead * math.cos(heading), -y + ahead * math.sin(heading), heading, vx, -vy, 0.0)

    def contacts(self) -> list[tuple[int, int]]:
        columns = {actor: column for column, actor in self.actors.items()}
        pairs = [(columns[one], columns[two]) for one, two in self.client.collided()]
        return sorted({(min(pair), max(pair)) for pair in pairs})

    def remove(self, body: int) -> None:
        self.client.destroy(self.actors.pop(body))

    def close(self) -> None:
        for column in list(self.actors):
            self.remove(column)
