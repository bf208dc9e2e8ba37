"""The check of what autopilots answer: numbers of the right kind, finite, in range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import Any, get_args

from pytest_rvads.drivers.interface import Acceleration, Command, Control, TargetSpeed, Trajectory, Waypoint

__all__ = ["UnfitCommand", "plain"]

MAX_ACCELERATION = 20.0
"""No vehicle accelerates or brakes harder [m/s^2]; more is a mistake of units."""
MAX_SPEED = 70.0
"""Likewise for speeds [m/s]."""
TOLERANCE = 1e-6
"""How far throttle and brake may leave 0..1 by rounding; they are clamped."""
POINTS = 10_000
"""No trajectory needs more points; more is a generator without end."""


class UnfitCommand(Exception):
    """What is wrong with an answer, to be read after "returned".

    No value is shown by its repr, which may hold an address: the text is part of a run's hash.
    """


def plain(answer: Any) -> Command:
    """Return what an autopilot answered as a command of plain floats; throttle and brake are in 0..1.

    Raises:
        UnfitCommand: it is no command, or its numbers are not finite or not in range.
    """
    match answer:
        case Control():
            throttle, brake, steering = (_finite(value, name) for name, value in zip(Control._fields, answer, strict=True))
            for name, value in (("throttle", throttle), ("brake", brake)):
                if not -TOLERANCE <= value <= 1.0 + TOLERANCE:
                    raise UnfitCommand(f"{name} {value:g}, expected 0..1")
            if abs(steering) > math.pi / 2:
                raise UnfitCommand(f"steering {steering:g}, expected radians within -pi/2..pi/2 (was it in degrees?)")
            return Control(min(max(throttle, 0.0), 1.0), min(max(brake, 0.0), 1.0), steering)
        case TargetSpeed(speed):
            return TargetSpeed(_within(speed, "target speed", 0.0, MAX_SPEED, "m/s"))
        case Acceleration(acceleration, steering):
            number = _within(acceleration, "acceleration", -MAX_ACCELERATION, MAX_ACCELERATION, "m/s^2")
            half = math.pi / 2
            return Acceleration(number, None if steering is None else _within(steering, "steering", -half, half, "rad"))
        case Trajectory(points):
            return Trajectory(tuple(_waypoints(points)))
    kinds = " or ".join(kind.__name__ for kind in get_args(Command))
    raise UnfitCommand(f"an object of type {type(answer).__name__}, expected a {kinds}")


def _waypoints(points: Any) -> Iterator[Waypoint]:
    if not isinstance(points, Iterable):
        raise UnfitCommand(f"a trajectory of type {type(points).__name__}, expected a sequence of points")
    before, count = -math.inf, 0
    for number, point in enumerate(points):
        count += 1
        if count > POINTS:
            raise UnfitCommand(f"a trajectory of more than {POINTS:,} points, expected no more")
        if not (isinstance(point, tuple | list) and len(point) == 3):
            raise UnfitCommand(f"a trajectory whose point {number} is of type {type(point).__name__}, expected (time, x, y)")
        values = zip(Waypoint._fields, point, strict=True)
        found = Waypoint(*(_quantity(value, f"trajectory whose point {number} has {name}") for name, value in values))
        if found.time <= before:
            raise UnfitCommand(f"a trajectory whose point {number} comes at {found.time:g} s, not after the one before it")
        before = found.time
        yield found
    if count < 2:
        raise UnfitCommand(f"a trajectory of {count} points, expected at least 2")


def _within(value: Any, name: str, least: float, most: float, unit: str) -> float:
    number = _quantity(value, name)
    if not least <= number <= most:
        raise UnfitCommand(f"{_article(name)} {name} {number:g} {unit}, expected {least:g} to {most:g}")
    return number


def _quantity(value: Any, name: str) -> float:
    if isinstance(value, bool):
        raise UnfitCommand(f"{_article(name)} {name} of type bool, expected a number")
    return _finite(value, name, f"{_article(name)} ")


def _finite(value: Any, name: str, article: str = "") -> float:
    if not isinstance(value, Real):
        raise UnfitCommand(f"{article or 'a '}{name} of type {type(value).__name__}, expected a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise UnfitCommand(f"{article}{name} {number}, expected a finite number")
    return number


def _article(name: str) -> str:
    return "an" if name[0] in "aeiou" else "a"
