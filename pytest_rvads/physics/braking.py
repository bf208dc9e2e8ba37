"""The braking envelope v(d)max: the greatest speed, d metres before a line, from which a vehicle stops before the line.

v(d)max is found by repeated tests with the vehicle dynamics of the simulations (paper, section 5.3), with the full service brake
from the first step on. The grids of scenarios stay within v(d)max, so a controller that does not stop in time brakes too late.
Values are cached on disk (`pytest_rvads.physics.cache`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache
from itertools import pairwise

from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.physics.cache import cached
from pytest_rvads.physics.dynamics import Dynamics
from pytest_rvads.physics.engines import Engine, usual
from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.support.errors import RunError, ScenarioError

__all__ = ["FASTEST", "RESOLUTION", "STANDING", "check_start", "envelope", "greatest_safe", "stopping_distance", "vmax"]

FASTEST = 30.0
"""Greatest tested speed [m/s]; most roads with junctions allow at most 65 mph."""
RESOLUTION = 0.01
"""Resolution of the tested speeds [m/s]."""
STANDING = 0.001
"""A vehicle slower than this has stopped [m/s]."""
_LONGEST = 60.0
"""Longest test; a vehicle that drives on after this time counts as never stopping [s]."""


def vmax(
    distance: float, aggression: int = 1, vehicle: Vehicle | None = None, engine: Engine | None = None, limit: float = SPEED_LIMIT
) -> float | None:
    """Return the greatest safe speed `distance` metres before the stopping line.

    Args:
        distance: reference point to stopping line [m].
        aggression: braking level 1, 2 or 3, which selects the service brake.
        vehicle: the vehicle; a passenger car by default.
        engine: the physics engine; the usual engine by default.
        limit: the speed limit, of which at most `FASTEST` counts [m/s].

    Returns:
        The speed, at most the speed limit [m/s]; None if not even a standing vehicle is safe.

    Raises:
        ScenarioError: the distance is negative or not finite, or the aggression is unknown.
        RunError: the stopping distance is not monotone in the speed, so that bisection gives no valid result.
    """
    check_start(distance, aggression)
    return _vmax(float(distance), aggression, vehicle or Vehicle(), engine or usual(), min(limit, FASTEST))


def check_start(distance: float, aggression: int) -> None:
    """Raise a `ScenarioError` for a distance [m] that is negative or not finite, or an unknown aggression."""
    if not (math.isfinite(distance) and distance >= 0):
        raise ScenarioError(f"the distance to the stopping line must be 0 m or more, got {distance!r}")
    if aggression not in (1, 2, 3):
        raise ScenarioError(f"aggression must be 1, 2 or 3, got {aggression!r}")


def envelope(
    distances: Sequence[float],
    vehicle: Vehicle | None = None,
    aggressions: Sequence[int] = (1, 2, 3),
    limit: Callable[..., float | None] | None = None,
) -> dict[int, tuple[float | None, ...]]:
    """Return v(d)max [m/s] over `distances` [m] for every aggression, after checking that it is monotone.

    Args:
        distances: reference point to stopping line [m].
        vehicle: the vehicle; a passenger car by default.
        aggressions: braking levels, some of 1, 2 and 3.
        limit: v(d)max of another simulator; `vmax` by default.

    Raises:
        ScenarioError: a distance is negative or not finite, or an aggression is unknown.
        RunError: v(d)max decreases with the distance, or with the aggression.
    """
    limit = limit or vmax
    table = {level: tuple(limit(d, level, vehicle) for d in distances) for level in aggressions}
    points = [(level, d, -1.0 if v is None else v) for level, row in table.items() for d, v in zip(distances, row, strict=True)]
    for level, d, v in points:
        for harder, farther, speed in points:
            if harder >= level and farther >= d and speed < v:
                raise RunError(
                    f"v(d)max is not monotone: {v:g} m/s at {d:g} m and aggression {level}, but {speed:g} m/s at {farther:g} m "
                    f"and aggression {harder}"
                )
    return table


def greatest_safe(safe: Callable[[float], bool], limit: float, probes: int = 1) -> float | None:
    """Return the greatest speed up to `limit` [m/s] that is safe, to `RESOLUTION`.

    Args:
        safe: tests a speed [m/s].
        limit: greatest speed; returned if all tested speeds are safe [m/s].
        probes: number of evenly spaced speeds up to `limit` that are tested first. More probes find an unsafe speed below a safe
            speed. The result is below the first unsafe probe.

    Returns:
        The speed [m/s]; None if 0 m/s is not safe.
    """
    low, high = 0, math.ceil(limit / RESOLUTION)
    for k in range(1, probes):
        probe = round(k * high / probes)
        if not safe(_speed(probe)):
            high = probe
            break
        low = probe
    else:
        if safe(limit):
            return limit
    if low == 0 and not safe(0.0):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        if safe(_speed(middle)):
            low = middle
        else:
            high = middle
    return _speed(low)


def _speed(steps: int) -> float:
    return round(steps * RESOLUTION, 9)


@lru_cache(maxsize=4096)
def stopping_distance(speed: float, aggression: int, vehicle: Vehicle, engine: Engine | None = None) -> float:
    """Return the stopping distance of a vehicle under full service brake on a straight road [m]; inf if it never stops.

    Args:
        speed: speed at the start [m/s].
        aggression: braking level 1, 2 or 3, which selects the service brake.
        vehicle: the vehicle.
        engine: the physics engine; the usual engine by default.
    """
    dynamics = Dynamics(vehicle, aggression)
    world = (engine or usual()).world([vehicle], [Motion(0.0, 0.0, 0.0, speed, 0.0, 0.0)])
    farthest = 0.0
    try:
        for _ in range(round(_LONGEST / DT)):
            x, _, yaw, vx, vy, rate = world.motions()[0]
            farthest = max(farthest, x)
            if abs(vx) < STANDING:
                return farthest
            world.step(dynamics.forces(math.cos(yaw), math.sin(yaw), vx, vy, rate, 0.0, 1.0, 0.0))
    finally:
        world.close()
    return math.inf


@lru_cache(maxsize=4096)
def _vmax(distance: float, aggression: int, vehicle: Vehicle, engine: Engine, limit: float) -> float | None:
    key = {"what": "plant", "distance": distance, "aggression": aggression, "vehicle": asdict(vehicle)}
    if limit != SPEED_LIMIT:  # cached values for the usual limit stay valid
        key["limit"] = limit
    return cached(key, lambda: _bisected(distance, aggression, vehicle, engine, limit), engine.library)


def _bisected(distance: float, aggression: int, vehicle: Vehicle, engine: Engine, limit: float) -> float | None:
    stops: dict[float, float] = {}

    def safe(speed: float) -> bool:
        # The stopping distance does not depend on the place, so one test of a speed serves all distances.
        stops[speed] = stopping_distance(speed, aggression, vehicle, engine)
        return stops[speed] <= distance

    greatest = greatest_safe(safe, limit)
    speeds = sorted(stops)
    for slow, fast in pairwise(speeds):
        if stops[slow] > stops[fast]:
            raise RunError(
                f"v(d)max can't be bisected at aggression {aggression}: the vehicle needs {stops[slow]:.3f} m to stop from "
                f"{slow:g} m/s, but {stops[fast]:.3f} m from {fast:g} m/s"
            )
    return greatest
