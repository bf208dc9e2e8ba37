"""Probes: drivers that bring about what a check looks at."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType

from pytest_rvads.drivers.interface import Command, Control, Drives, Observation, TargetSpeed
from pytest_rvads.runs.run import DT

__all__ = ["FAULTY_FROM", "Brakes", "Cast", "Cruises", "Hangs", "NotANumber", "Raises", "Steers", "Witness", "unmade"]

FAULTY_FROM = 3
"""Tick from which drivers with a fault have it."""
_ASLEEP = 30.0
"""Time after which a hanging driver returns if no time limit ends the run before [s]."""


class Brakes:
    """Brakes fully, and never releases."""

    def control(self, _seen: Observation, /) -> Control:
        """Return full service brake."""
        return Control(brake=1.0)


class Cruises:
    """Keeps a speed, whatever happens.

    Args:
        speed: [m/s].
    """

    def __init__(self, speed: float = 8.0) -> None:
        self._speed = speed

    def control(self, _seen: Observation, /) -> TargetSpeed:
        """Return the speed."""
        return TargetSpeed(self._speed)


class Cast:
    """Keeps the speed that is meant for its vehicle, whatever happens; without one it brakes.

    Args:
        speeds: by the name of the agent [m/s].
        since: by the name of the agent when it sets out [s]; at once where nothing is said.
    """

    def __init__(self, speeds: Mapping[str, float], since: Mapping[str, float] = MappingProxyType({})) -> None:
        self._speeds, self._since = speeds, since

    def control(self, seen: Observation) -> Control | TargetSpeed:
        """Return the speed of the own vehicle, or full service brake."""
        speed = self._speeds.get(seen.me.name)
        if speed is None or seen.time < self._since.get(seen.me.name, 0.0):
            return Control(brake=1.0)
        return TargetSpeed(speed)


class Steers:
    """Steers to the left until it has left its route."""

    def control(self, _seen: Observation, /) -> Control:
        """Return some throttle and a large steering angle."""
        return Control(throttle=0.3, steering=0.5)


class Witness:
    """Notes what it is shown, then answers as another driver does.

    Args:
        shown: takes every observation, in the order in which they come.
        driver: makes the other driver.
    """

    def __init__(self, shown: list[Observation], driver: Callable[[], Drives] = Brakes) -> None:
        self._shown = shown
        self._driver = driver()

    def control(self, seen: Observation) -> Command:
        """Note what is seen."""
        self._shown.append(seen)
        return self._driver.control(seen)


def _due(seen: Observation) -> bool:
    return round(seen.time / DT) >= FAULTY_FROM and not seen.created  # the first that was created


class Raises:
    """Raises an error some time after the start."""

    def control(self, seen: Observation) -> Control:
        """Brake, then raise."""
        if _due(seen):
            raise ValueError("raised by the conformance tests")
        return Control(brake=1.0)


class NotANumber:
    """Answers with a control that is not a number some time after the start."""

    def control(self, seen: Observation) -> Control:
        """Brake, then answer NaN."""
        return Control(throttle=math.nan) if _due(seen) else Control(brake=1.0)


class Hangs:
    """Does not answer any more some time after the start."""

    def control(self, seen: Observation) -> Control:
        """Brake, then sleep."""
        begun = time.monotonic()
        while _due(seen) and time.monotonic() - begun < _ASLEEP:
            time.sleep(0.05)
        return Control(brake=1.0)


def unmade() -> Brakes:
    """Raise instead of making a driver."""
    raise ValueError("raised by the conformance tests")
