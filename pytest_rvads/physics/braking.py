"""The braking envelope v(d)max: the greatest speed, d metres before a line, from which a vehicle stops before the line.

v(d)max is found by repeated tests with the vehicle dynamics of the simulations (paper, section 5.3), with the full service
brake from the first step on. The grids of scenarios stay within v(d)max. So if a controller does not stop in time, it brakes too
late.

Speeds that are found by tests are cached on disk. The cache saves time and changes no result. The key of an entry contains
everything that its value depends on: the parameters, the code of this package, and the versions of the libraries. So an entry of
the cache never becomes wrong. Every entry is a file, which several processes can write at the same time. A file that is damaged,
not regular, or can't be read or written counts as absent.

The import of platformdirs takes some 10 ms, and happens only if ``RVADS_CACHE`` names no folder. Tests switch the cache off.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.physics.body import Dynamics, Motion
from pytest_rvads.physics.engines import Engine, usual
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.support.errors import RunError, ScenarioError
from pytest_rvads.support.installed import code, versions
from pytest_rvads.support.storage import read_file, write_file

FASTEST = 30.0
"""Greatest tested speed [m/s]; most roads with junctions allow at most 65 mph."""
RESOLUTION = 0.01
"""Resolution of the tested speeds [m/s]."""
STANDING = 0.001
"""A vehicle slower than this has stopped [m/s]."""
_LONGEST = 60.0
"""Longest test; a vehicle that drives on after this time counts as never stopping [s]."""

VARIABLE = "RVADS_CACHE"
"""Environment variable with the folder of the cache; an empty value switches the cache off."""
_MOST_BYTES = 2**16
"""Greatest size of an entry; usual entries have some 2,000 bytes [bytes]."""


def vmax(
    distance: float, aggression: int = 1, vehicle: Vehicle | None = None, engine: Engine | None = None, limit: float = SPEED_LIMIT
) -> float | None:
    """Return the greatest safe speed `distance` [m] before a line, up to `limit` and `FASTEST` [m/s]; None if 0 is not safe."""
    check_start(distance, aggression)
    return _vmax(float(distance), aggression, vehicle or Vehicle(), engine or usual(), min(limit, FASTEST))


def check_start(distance: float, aggression: int) -> None:
    """Raise a `ScenarioError` for a distance [m] that is negative or not finite, or an unknown aggression."""
    if not (math.isfinite(distance) and distance >= 0):
        raise ScenarioError(f"the distance to the stopping line must be 0 m or more, got {distance!r}")
    if aggression not in (1, 2, 3):
        raise ScenarioError(f"aggression must be 1, 2 or 3, got {aggression!r}")


def envelope(
    distances: Sequence[float], limit: Callable[[float, int], float | None] = vmax
) -> dict[int, tuple[float | None, ...]]:
    """Return v(d)max [m/s] over `distances` [m] for every aggression, after checking that v(d)max never decreases."""
    table = {level: tuple(limit(d, level) for d in distances) for level in (1, 2, 3)}
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
    """Return the greatest speed up to `limit` [m/s] that is safe, to `RESOLUTION`; None if 0 m/s is not safe."""
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
    """Return the distance [m] in which full service brake stops a vehicle from a speed [m/s]; inf if it never stops."""
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


def cached(key: Mapping[str, Any], compute: Callable[[], float | None], *libraries: str) -> float | None:
    """Return the number cached on disk under a key; a number that is not in the cache is computed and stored."""
    where = folder()
    if where is None:
        return compute()
    name = json.dumps([dict(key), code(), versions(*libraries), platform.platform()], sort_keys=True)
    path = where / f"{sha256(name.encode()).hexdigest()}.json"
    with contextlib.suppress(OSError, ValueError, LookupError, TypeError, RecursionError):  # no entry, or a damaged one
        text = read_file(path, _MOST_BYTES).decode()
        entry: float | None = json.loads(text.split("\n", 1)[1])["value"]
        finite = entry is None or (type(entry) is float and math.isfinite(entry))
        if finite and text == _entry(name, entry):
            return entry
    value = compute()
    with contextlib.suppress(OSError):  # a folder that can't be written to is no error
        if path.is_symlink() or not path.is_file():
            path.unlink(missing_ok=True)  # a link or pipe would lead the text elsewhere
        write_file(path, _entry(name, value).encode())
    return value


def folder() -> Path | None:
    """Return the folder of the cache: the value of `VARIABLE`, by default a folder of the user; None if the value is empty."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    from platformdirs import user_cache_path  # not imported if the cache is off, as in tests

    try:
        path = user_cache_path("pytest-rvads", appauthor=False, opinion=False)
    except RuntimeError:  # the user has no home folder; older versions of platformdirs return a relative path
        return None
    return path if path.is_absolute() else None


def _entry(name: str, value: float | None) -> str:
    """Return the text of an entry: a checksum, and a line with key and value."""
    body = json.dumps({"key": name, "value": value})
    return f"{sha256(body.encode()).hexdigest()}\n{body}"
