"""v(d)max of a closed loop: the greatest speed, d metres before a line, from which an autopilot stops before the line.

In `pytest_rvads.physics.braking`, v(d)max depends on the vehicle alone. Here v(d)max also depends on the autopilot. An autopilot
that brakes late, or drives off before it looks, has a lower v(d)max. The tables of the bundled autopilots are computed on several
processes and cached on disk.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.physics.braking import STANDING, cached, greatest_safe
from pytest_rvads.runs.run import Run
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
