"""The braking envelope v(d)max: how fast a vehicle may be, d metres before a line, and still stop in front of it.

It is found by iterated testing on the plant that drives in the simulations (paper, section 5.3): full service brake from
the first step on, released never. The grids of scenarios keep to it, so a controller that brakes late is a finding.
What was found once is kept on disk (`pytest_rvads.physics.cache`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import lru_cache
from itertools import pairwise

from pytest_rvads.errors import RunError, ScenarioError
from pytest_rvads.maps.segment import SPEED_LIMIT
from pytest_rvads.physics.cache import cached
from pytest_rvads.physics.dynamics import Dynamics
from pytest_rvads.physics.engines import Engine, usual
from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["FASTEST", "RESOLUTION", "STANDING", "check_start", "envelope", "greatest_safe", "stopping_distance", "vmax"]

FASTEST = 30.0
"""Speeds are tested up to this: most roads with junctions allow no more than 65 mph [m/s]."""
RESOLUTION = 0.01
"""Speeds are tested to this resolution [m/s]."""
STANDING = 0.001
"""A vehicle slower than this has stopped [m/s]."""
_LONGEST = 60.0
"""A vehicle that has not stopped by then never will [s]."""


def vmax(
    distance: float, aggression: int = 1, vehicle: Vehicle | None = None, engine: Engine | None = None, limit: float = SPEED_LIMIT
) -> float | None:
    """Return the greatest safe speed `distance` metres before the stopping line.

    Args:
        distance: reference point to stopping line [m].
        aggression: 1, 2 or 3, the scenario's; selects the service brake.
        vehicle: the parameters; a passenger car by default.
        engine: what moves it; the usual one by default.
        limit: the speed limit, at most `FASTEST` counts [m/s].

    Returns:
        The speed, at most the speed limit [m/s]; None where not even a standing vehicle is safe.

    Raises:
        ScenarioError: a distance that is negative or not finite, or an unknown aggression.
        RunError: the plant breaks monotonicity, so no bisection can be trusted.
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
        vehicle: the parameters; a passenger car by default.
        aggressions: of 1, 2 and 3.
        limit: `vmax` of another plant than this one.

    Raises:
        ScenarioError: as for `vmax`.
        RunError: the envelope falls with the distance, or with the aggression.
    """
    limit = limit or vmax
    table = {level: tuple(limit(d, level, vehicle) for d in distances) for level in aggressions}
    points = [(level, d, -1.0 if v is None else v) for level, row in table.items() for d, v in zip(distances, row, strict=True)]
    for level, d, v in points:
        for other, farther, greater in points:
            if other >= level and farther >= d and greater < v:
                raise RunError(
                    f"v(d)max is not monotone: {v:g} m/s at {d:g} m and aggression {level}, but {greater:g} m/s at {farther:g} m "
                    f"and aggression {other}"
                )
    return table


def greatest_safe(safe: Callable[[float], bool], limit: float, probes: int = 1) -> float | None:
    """Return the greatest speed up to `limit` [m/s] that is safe, to `RESOLUTION`.

    Args:
        safe: the test. Where a greater speed may be safe although a lower one is not, more `probes` find that out.
        limit: returned where every speed tried is safe.
        probes: speeds tried up to `limit`, evenly spaced; the answer lies below the first unsafe one.

    Returns:
        None where 0 m/s is not safe.
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
    """Return how far a vehicle gets from `speed` [m/s] under full service brake on a straight [m]; inf if it never stops.

    Args:
        speed: at the start.
        aggression: 1, 2 or 3; selects the service brake.
        vehicle: the parameters.
        engine: what moves it; the usual one by default.
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
    if limit != SPEED_LIMIT:  # what is kept of the usual one stays valid
        key["limit"] = limit
    return cached(key, lambda: _test(distance, aggression, vehicle, engine, limit), engine.library)


def _test(distance: float, aggression: int, vehicle: Vehicle, engine: Engine, limit: float) -> float | None:
    tried: dict[float, float] = {}

    def safe(speed: float) -> bool:
        # The plant does not know where it is: one test of a speed answers for every distance.
        tried[speed] = stopping_distance(speed, aggression, vehicle, engine)
        return tried[speed] <= distance

    found = greatest_safe(safe, limit)
    speeds = sorted(tried)
    for slow, fast in pairwise(speeds):
        if tried[slow] > tried[fast]:
            raise RunError(
                f"v(d)max can't be bisected at aggression {aggression}: the vehicle needs {tried[slow]:.3f} m to stop from "
                f"{slow:g} m/s, but {tried[fast]:.3f} m from {fast:g} m/s"
            )
    return found
