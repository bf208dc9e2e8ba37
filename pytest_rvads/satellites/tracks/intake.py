"""How a log is taken: which point of a vehicle it tells, where, and how exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from pytest_rvads.errors import RunError, suggest
from pytest_rvads.satellites.tracks.logformats import Point

__all__ = ["Intake"]


@dataclass(frozen=True, slots=True)
class Intake:
    """How a log is taken; see `read_tracks`.

    Raises:
        RunError: a value that can't be.
    """

    point: Point
    size: tuple[float, float] | None = None
    offset: tuple[float, float] = (0.0, 0.0)
    position_accuracy: float | None = None
    speed_accuracy: float | None = None
    speed_limit: float | None = None

    def __post_init__(self) -> None:
        points = get_args(Point)
        if self.point not in points:
            raise RunError(f"point must be {', '.join(points)}, got {self.point!r:.60}{suggest(str(self.point), points)}")
        for name, most in (("position_accuracy", 10.0), ("speed_accuracy", 10.0)):
            value = getattr(self, name)
            if value is not None and not _within(value, 0.0, most):
                raise RunError(f"{name} must be a standard deviation from 0 to {most:g}, got {value!r:.60}")
        if self.size is not None and not (_pair(self.size) and all(_within(value, 0.1, 100.0) for value in self.size)):
            raise RunError(f"size must be a length and a width from 0.1 to 100 m, got {self.size!r:.60}")
        if not (_pair(self.offset) and all(_within(value, -1e9, 1e9) for value in self.offset)):
            raise RunError(f"offset must be two numbers to add to x and y [m], got {self.offset!r:.60}")


def _within(value: object, low: float, high: float) -> bool:
    return isinstance(value, int | float | np.number) and low <= float(value) <= high


def _pair(value: object) -> bool:
    return isinstance(value, tuple | list) and len(value) == 2
