"""What a driver that drives alone can do: its v(d)max, its dynamics, its pedals, and the only just safe starts that follow.

In `pytest_rvads.physics.braking`, v(d)max, the greatest speed d metres before a line from which a vehicle stops before the line,
depends on the vehicle alone. `closed_vmax` also depends on the autopilot. An autopilot that brakes late, or drives off before it
looks, has a lower v(d)max. The tables of the bundled autopilots are computed on several processes and cached on disk.

B(v) is the distance that a lone vehicle needs to stop from a speed v. AV(v, x) and AT(v, x) are the speed after, and the time
for, the first x metres of a lone vehicle on a free road that starts at a speed v. With vl as the speed limit, a vehicle at speed
ve that is B(ve) before a junction can go safely if an arriving vehicle at the speed limit is at least AT(ve, B(ve) + L) vl away,
where L is the length of the junction (arXiv 2405.16914): the first vehicle has left the junction before the second vehicle
arrives. The measured values of bundled drivers are cached on disk.

A driver that somebody else wrote counts on the pedals of another vehicle. Its distances mean something here only if a pedal gives
the acceleration that the pedal gave at home. `calibrated` lets the driver drive alone on straight roads and through a bend, with
a green and with a red light ahead. The lag of the actuators, and the resistance of tyres and air, are taken out of the samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.follower import resistance
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.physics.braking import STANDING, cached, greatest_safe
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import Planar
from pytest_rvads.simulators.simulator import Simulator, named, simulate, vmax
from pytest_rvads.support.errors import RunError, ScenarioError
from pytest_rvads.support.executors import Progress, spread

PROBES = 8
"""Number of speeds that are tried before the bisection, because some autopilots stop from a speed but not from a lower speed."""
RED = 19.9
"""Time for which entrance 1 of the built-in junction with lights has red [s]."""
_Job = tuple[str, float, int, str | None]
"""Autopilot, distance [m], aggression and simulator."""


def closed_vmax(
    distance: float,
    driver: Factory,
    aggression: int = 1,
    vehicle: Vehicle | None = None,
    simulator: Simulator | None = None,
    *,
    place: Junction | None = None,
    movement: tuple[int, int] | None = None,
) -> float | None:
    """Return the greatest speed from which `driver` stops a lone vehicle, whose movement is straight ahead, before a red light.

    With `place` and `movement` the vehicle drives that movement and stops at the stop sign of its entrance. An entrance without a
    stop sign gets a red light for the test, because a lone vehicle gives way to no other vehicle. After the stop the vehicle is
    allowed to continue at a stop sign, and on a turn that crosses no other movement (right on red). The vehicle stopped in every
    test up to this speed, which is at most v(d)max of the vehicle [m/s]; None if it drives over the line even from a standstill.
    """
    vehicle = vehicle or Vehicle()
    code: tuple[int, ...] = (0, 2, 0, 0)
    where = find("light4")
    if place is not None and movement is not None:
        entrance = movement[0]
        directions = [direction for (_, direction), m in place.by_direction.items() if m.key == movement]
        if not directions:
            raise ScenarioError(
                f"junction {place.name!r} has no movement {movement!r}: name entrance and exit of one of "
                f"{sorted(place.movements)}"
            )
        where, code = place, tuple(directions[0] if number == entrance else 0 for number in range(len(place.entrances)))
        if place.entrances[entrance].sign is not Sign.STOP:
            # The phase group with the lower number has green first, so the light of this entrance is red.
            lanes = [replace(e, sign=Sign.LIGHTS, phase=int(number == entrance)) for number, e in enumerate(place.entrances)]
            where = replace(place, entrances=tuple(lanes))
    limit = vmax(distance, aggression, vehicle, simulator, where.top_limit)

    def safe(speed: float) -> bool:
        scenario = Scenario(where, code, distance=distance, speed=speed, aggression=aggression, duration=RED)
        run = simulate(Case(scenario, driver, fleet=Fleet(vehicle)), simulator)
        if run.fault is not None:
            raise RunError(f"no v(d)max at {distance:g} m: {run.fault.reason}")
        return stopped(run)

    return None if limit is None or not safe(0.0) else greatest_safe(safe, limit, PROBES)


def stopped(run: Run) -> bool:
    """Return whether the vehicle stopped before the line.

    A vehicle that is allowed to go on after a stop must stand at any time before the line; every other vehicle must stand at the
    end of the run.
    """
    if run.speed is None:
        return False
    (agent,) = run.agents
    before = run.zone[:, 0] < Zone.JUNCTION
    standing = abs(run.speed[:, 0]) < STANDING
    if run.junction.entrances[agent.entrance].sign is Sign.STOP or run.junction.turns_on_red(agent.entrance, agent.turn):
        return bool(standing[before].any())
    return bool(standing[-1] and before.all())


def closed_envelope(
    name: str,
    distances: Sequence[float],
    aggressions: Sequence[int] = (1, 2, 3),
    *,
    simulator: str | None = None,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> dict[int, tuple[float | None, ...]]:
    """Return v(d)max of the autopilot `name` [m/s] over `distances` [m], by aggression."""
    traffic(name, "autopilot")
    named(simulator)
    jobs: list[_Job] = [(name, float(distance), level, simulator) for level in aggressions for distance in distances]
    speeds = list(spread(_speed_of_job, jobs, executor, progress))
    count = len(distances)
    return {level: tuple(speeds[k * count : (k + 1) * count]) for k, level in enumerate(aggressions)}


def _speed_of_job(job: _Job) -> float | None:
    name, distance, aggression, simulator = job
    vehicle, plant = Vehicle(), named(simulator)

    def compute() -> float | None:
        return closed_vmax(distance, traffic(name), aggression, vehicle, plant)

    if not isinstance(plant, Planar):  # another simulator can change its answers without a change of the cache's key
        return compute()
    key = {"what": name, "distance": distance, "aggression": aggression, "vehicle": asdict(vehicle)}
    return cached(key, compute, plant.engine.library)


LIMIT, LENGTH = 80 / 3.6, 24.0
"""Speed limit [m/s] and length of the junction [m] of Li et al."""
PUBLISHED = {"LGSVL": 39.7, "Apollo": 120.0, "Autoware": 165.0, "CARLA": 72.2}
"""Published distance of the arriving vehicle at a crossing with yield signs, for a vehicle that starts at its line [m]."""
_FAR = 110.0
"""Greatest distance from which a vehicle has to stop [m]; the approaches of the built-in junctions are 120 m long."""
_RESOLUTION = 0.1
"""Resolution of B [m]."""


class DriverDynamics(Protocol):
    """The stopping distance B of a driver, and the speed AV and time AT after a start, as the module's docstring defines them."""

    def braking(self, speed: float) -> float:
        """Return B(speed), the distance to stop from a speed [m]; inf if the vehicle does not stop at all."""

    def driving(self, speed: float, distance: float) -> tuple[float, float]:
        """Return the speed AV [m/s] and the time AT [s] at a distance [m] after a start at a speed [m/s]."""


@dataclass(frozen=True, slots=True)
class Measured:
    """The values B, AV and AT of a driver, measured with a lone vehicle at the built-in junction with lights."""

    driver: Factory
    simulator: Simulator
    name: str = ""
    """Name of a bundled driver, whose values are cached; empty for other drivers."""
    _drives: dict[float, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=dict)
    """By speed at the start, distances [m] and speeds [m/s] of a drive in steps of `DT`."""

    def braking(self, speed: float) -> float:
        """Return the least distance, to 0.1 m, before a red light from which the vehicle stops before the line [m], or inf."""

        def stops(tenths: int) -> bool:
            scenario = Scenario(find("light4"), "0200", distance=tenths * _RESOLUTION, speed=speed, duration=RED)
            return stopped(self._run(scenario))

        def bisected() -> float:
            low, high = 0, round(_FAR / _RESOLUTION)
            if not stops(high):
                return math.inf
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (low, middle) if stops(middle) else (middle, high)
            return round(high * _RESOLUTION, 9)

        return self._cached("B", speed, 0.0, bisected)

    def driving(self, speed: float, distance: float) -> tuple[float, float]:
        """Return the speed AV [m/s] and time AT [s]; the time to a distance that the vehicle does not reach is inf."""
        return (
            self._cached("AV", speed, distance, lambda: self._drive(speed, distance)[0]),
            self._cached("AT", speed, distance, lambda: self._drive(speed, distance)[1]),
        )

    def _cached(self, what: str, speed: float, distance: float, compute: Callable[[], float]) -> float:
        if not (self.name and isinstance(self.simulator, Planar)):
            return compute()
        key = {"what": f"{what} of {self.name}", "speed": speed, "distance": distance, "vehicle": asdict(Vehicle())}
        found = cached(key, lambda: None if math.isinf(value := compute()) else value, self.simulator.engine.library)
        return math.inf if found is None else found

    def _drive(self, speed: float, distance: float) -> tuple[float, float]:
        """Return speed [m/s] and time [s] at a distance of a drive; inf as time beyond the end of the drive."""
        if speed not in self._drives:
            run = self._run(Scenario(find("light4"), "2000", distance=_FAR, speed=speed, duration=RED))
            if run.station is None or run.speed is None:
                raise RunError(f"simulator {self.simulator.name!r} records no positions or no speeds, which B, AV and AT need")
            places, speeds = run.station[:, 0].astype(np.float64), run.speed[:, 0].astype(np.float64)
            self._drives[speed] = places - places[0], speeds
        distances, speeds = self._drives[speed]
        if distance > distances[-1]:
            return float(speeds[-1]), math.inf
        times = np.arange(len(distances), dtype=np.float64) * DT
        return float(np.interp(distance, distances, speeds)), float(np.interp(distance, distances, times))

    def _run(self, scenario: Scenario) -> Run:
        run = simulate(Case(scenario, self.driver), self.simulator)
        if run.fault is not None:
            raise RunError(f"{scenario.name}: {run.fault.reason}")
        return run


class VistaSetting(NamedTuple):
    """A start at a vista (a place where a vehicle decides whether to go) in which going is only just safe."""

    vista: str
    before: float | None
    """xe: distance of the vehicle to the junction [m]."""
    free: float | None
    """xf: free distance beyond the junction [m]."""
    arriving: float | None
    """xa: distance of the arriving vehicle, which drives at the speed limit, to the junction [m]."""


def settings(dynamics: DriverDynamics, speed: float, limit: float = LIMIT, length: float = LENGTH) -> tuple[VistaSetting, ...]:
    """Return the starts from which going is only just safe, one per kind of vista of a junction (arXiv 2405.16914).

    The speeds of the vehicle and of the limit are in m/s, the length of the junction in m.
    """
    before = dynamics.braking(speed)
    beyond, across = dynamics.driving(speed, before + length)
    joining, joined = dynamics.driving(speed, before)
    return (
        VistaSetting("crossing with yield signs", before, dynamics.braking(beyond), across * limit),
        VistaSetting("crossing with lights", before, dynamics.braking(beyond), None),
        VistaSetting("merging", before, dynamics.braking(joining), dynamics.braking(limit) + joined * limit),
    )


_PROBES = (("2000", 110.0, 0.0), ("0200", 60.0, 10.0), ("3000", 60.0, 10.0))
"""Directions, distance to the line [m] and speed [m/s] of the starts at the built-in junction with lights: from a standstill and
straight on at green, towards a red light, and a left turn at green."""
_MOVING = 0.5
"""A vehicle slower than this may be held by its brake, so its acceleration says nothing [m/s]."""
_STRAIGHT = 0.02
"""Greatest angle of the front wheels of a sample [rad]: in a bend the tyres slow the vehicle down."""
_PRESSED, _FREE = 0.02, 0.001
"""Least position of a pressed pedal and greatest position of the other pedal."""
_BAND = 0.1


class Used(NamedTuple):
    """A band of positions of a pedal that a driver used."""

    position: float
    """Mean position, 0..1."""
    acceleration: float
    """Mean acceleration by the pedal; negative for a brake [m/s^2]."""
    seconds: float
    """Time for which the pedal was in the band [s]."""


class Pedal(NamedTuple):
    """What a pedal does in a simulation."""

    full: float | None
    """Acceleration by the full pedal, from a line through the samples [m/s^2]; None if the driver never pressed the pedal."""
    largest: float
    """Largest position that the driver used, 0..1."""
    used: tuple[Used, ...]
    """The bands of positions, from the lightest on."""


def calibrated(driver: Factory, simulator: Simulator | None = None, aggression: int = 1) -> tuple[Pedal, Pedal]:
    """Return what throttle and brake do in a simulation with a driver."""
    vehicle = Vehicle()
    lags = np.array([vehicle.drive_lag, vehicle.brake_lag])
    # Effective throttle, effective brake and acceleration without resistance of every run, shape ``(samples, 3)``.
    samples = []
    for directions, distance, start in _PROBES:
        scenario = Scenario(find("light4"), directions, distance=distance, speed=start, aggression=aggression, duration=RED)
        run = simulate(Case(scenario, driver), simulator)
        if run.fault is not None:
            raise RunError(f"no calibration: {run.fault.reason}")
        if run.speed is None or run.controls is None:
            raise RunError(
                f"simulator {run.provenance.get('simulator')!r} records no speeds or no controls, which a calibration needs"
            )
        speeds, controls = run.speed[:, 0].astype(np.float64), run.controls[:-1, 0].astype(np.float64)
        effective, pedals = np.zeros_like(controls[:, :2]), np.zeros(2)
        for step, wanted in enumerate(controls[:, :2]):
            pedals = pedals + (1.0 - np.exp(-DT / lags)) * (wanted - pedals)
            effective[step] = pedals
        free = np.diff(speeds) / DT + np.array([resistance(vehicle, speed) for speed in speeds[:-1]])
        usable = (speeds[1:] > _MOVING) & (np.abs(controls[:, 2]) < _STRAIGHT)
        samples.append(np.column_stack((effective, free))[usable])
    throttle, brake, acceleration = np.concatenate(samples).T
    return _pedal(throttle, acceleration, brake), _pedal(brake, acceleration, throttle)


def _pedal(positions: NDArray[np.float64], acceleration: NDArray[np.float64], other: NDArray[np.float64]) -> Pedal:
    """Return what a pedal does, from the samples in which it is pressed and the other pedal is free."""
    pressed = (positions > _PRESSED) & (other < _FREE)
    if not pressed.any():
        return Pedal(None, 0.0, ())
    position, pushed = positions[pressed], acceleration[pressed]
    bands = np.ceil(position / _BAND)
    used = [
        Used(float(position[bands == band].mean()), float(pushed[bands == band].mean()), float((bands == band).sum() * DT))
        for band in np.unique(bands)
    ]
    return Pedal(math.fsum(position * pushed) / math.fsum(position * position), float(position.max()), tuple(used))
