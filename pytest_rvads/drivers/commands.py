"""The check of the commands of autopilots: numbers of the right type, finite, in range."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from numbers import Real
from typing import Any, get_args

from pytest_rvads.drivers.interface import Acceleration, Command, Control, TargetSpeed, Trajectory, Waypoint

__all__ = ["UnfitCommand", "plain"]

MAX_ACCELERATION = 20.0
"""Greatest acceleration of a command [m/s^2]; a greater value is a mistake of units."""
MAX_SPEED = 70.0
"""Greatest speed of a command [m/s]; a greater value is a mistake of units."""
TOLERANCE = 1e-6
"""Rounding error by which throttle and brake may leave 0..1; throttle and brake are clamped."""
POINTS = 10_000
"""Most points of a trajectory, which bounds endless generators."""


class UnfitCommand(Exception):
    """A command of an autopilot is invalid. The text of the error continues the word "returned".

    The text contains no repr of a value, because a repr may contain an address and the text is part of the hash of a run.
    """


def plain(answer: Any) -> Command:
    """Return the answer of an autopilot as a command of plain floats; throttle and brake are in 0..1.

    Raises:
        UnfitCommand: the answer is no command, or its numbers are not finite or not in range.
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
        waypoint = Waypoint(*(_quantity(value, f"trajectory whose point {number} has {name}") for name, value in values))
        if waypoint.time <= before:
            raise UnfitCommand(f"a trajectory whose point {number} comes at {waypoint.time:g} s, not after the one before it")
        before = waypoint.time
        yield waypoint
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
