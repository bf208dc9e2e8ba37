"""What an autopilot may answer instead of a `Control`; the tracking controller then drives at every step.

Each is held, as a `Control` is, until the autopilot is asked again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import Any, NamedTuple

from pytest_rvads.drivers.interface import Control

__all__ = ["Acceleration", "Command", "TargetSpeed", "Trajectory", "Waypoint", "trouble"]

MAX_ACCELERATION = 20.0
"""No vehicle accelerates or brakes harder [m/s^2]; more is a mistake of units."""
MAX_SPEED = 70.0
"""Likewise for speeds [m/s]."""


class TargetSpeed(NamedTuple):
    """Follow the itinerary at this speed, slower in bends."""

    speed: float
    """0 stops and holds the vehicle [m/s]."""


class Acceleration(NamedTuple):
    """Accelerate or brake by this much."""

    acceleration: float
    """Negative brakes [m/s^2]."""
    steering: float | None = None
    """Angle of the front wheels, left positive [rad]; None follows the itinerary."""


class Waypoint(NamedTuple):
    """Where the reference point shall be, and when."""

    time: float
    """As in `Observation.time`: since the start of the run [s]."""
    x: float
    """[m]."""
    y: float
    """[m]."""


class Trajectory(NamedTuple):
    """Be at these points at their times; from the last one on, stand."""

    points: tuple[Waypoint, ...]
    """At least two, in order of time; the steering follows their polyline."""


Command = Control | TargetSpeed | Acceleration | Trajectory


def trouble(command: Any) -> str:
    """Return what is wrong with an answer that is no `Control`, to be read after "returned", or nothing.

    No value is shown by its repr, which may hold an address: the text is part of a run's hash.
    """
    match command:
        case TargetSpeed(speed):
            return _wrong("target speed", speed, 0.0, MAX_SPEED, "m/s")
        case Acceleration(acceleration, steering):
            found = _wrong("acceleration", acceleration, -MAX_ACCELERATION, MAX_ACCELERATION, "m/s^2")
            return found or ("" if steering is None else _wrong("steering", steering, -math.pi / 2, math.pi / 2, "rad"))
        case Trajectory(points):
            return next(_wrong_points(points), "")
    return f"an object of type {type(command).__name__}, expected a Control"


def _wrong_points(points: Any) -> Iterator[str]:
    if not isinstance(points, Iterable):
        yield f"a trajectory of type {type(points).__name__}, expected a sequence of points"
        return
    listed = list(points)
    if len(listed) < 2:
        yield f"a trajectory of {len(listed)} points, expected at least 2"
    before = -math.inf
    for number, point in enumerate(listed):
        if not (isinstance(point, tuple | list) and len(point) == 3):
            yield f"a trajectory whose point {number} is of type {type(point).__name__}, expected (time, x, y)"
            return
        for name, value in zip(Waypoint._fields, point, strict=True):
            yield from filter(None, [_wrong(f"trajectory whose point {number} has {name}", value, -math.inf, math.inf, "")])
        if point[0] <= before:
            yield f"a trajectory whose point {number} comes at {point[0]:g} s, not after the one before it"
        before = point[0]


def _wrong(name: str, value: Any, least: float, most: float, unit: str) -> str:
    article = "an" if name[0] in "aeiou" else "a"
    if not isinstance(value, Real) or isinstance(value, bool):
        return f"{article} {name} of type {type(value).__name__}, expected a number"
    number = float(value)
    if not math.isfinite(number):
        return f"{article} {name} {number}, expected a finite number"
    if not least <= number <= most:
        return f"{article} {name} {number:g} {unit}, expected {least:g} to {most:g}"
    return ""
