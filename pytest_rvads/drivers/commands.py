"""The check of what autopilots answer: numbers of the right kind, finite, in range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import Any, get_args

from pytest_rvads.drivers.interface import Acceleration, Command, Control, TargetSpeed, Trajectory, Waypoint

__all__ = ["clamped", "trouble"]

MAX_ACCELERATION = 20.0
"""No vehicle accelerates or brakes harder [m/s^2]; more is a mistake of units."""
MAX_SPEED = 70.0
"""Likewise for speeds [m/s]."""
TOLERANCE = 1e-6
"""How far throttle and brake may leave 0..1 by rounding; they are clamped."""


def trouble(answer: Any) -> str:
    """Return what is wrong with what an autopilot answered, to be read after "returned", or nothing.

    No value is shown by its repr, which may hold an address: the text is part of a run's hash.
    """
    match answer:
        case Control():
            return next(_wrong_control(answer), "")
        case TargetSpeed(speed):
            return _wrong("target speed", speed, 0.0, MAX_SPEED, "m/s")
        case Acceleration(acceleration, steering):
            found = _wrong("acceleration", acceleration, -MAX_ACCELERATION, MAX_ACCELERATION, "m/s^2")
            return found or ("" if steering is None else _wrong("steering", steering, -math.pi / 2, math.pi / 2, "rad"))
        case Trajectory(points):
            return next(_wrong_points(points), "")
    kinds = " or ".join(kind.__name__ for kind in get_args(Command))
    return f"an object of type {type(answer).__name__}, expected a {kinds}"


def clamped(control: Control) -> Control:
    """Return a control as floats, throttle and brake in 0..1."""
    throttle, brake, steering = (float(value) for value in control)
    return Control(min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0), steering)


def _wrong_control(control: Control) -> Iterator[str]:
    for name, value in zip(Control._fields, control, strict=True):
        if not isinstance(value, Real):
            yield f"a {name} of type {type(value).__name__}, expected a number"
        elif not math.isfinite(value):
            yield f"{name} {float(value)}, expected a finite number"
    for name, value in (("throttle", control.throttle), ("brake", control.brake)):
        if not -TOLERANCE <= value <= 1.0 + TOLERANCE:
            yield f"{name} {float(value):g}, expected 0..1"
    if abs(control.steering) > math.pi / 2:
        yield f"steering {float(control.steering):g}, expected radians within -pi/2..pi/2 (was it in degrees?)"


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
