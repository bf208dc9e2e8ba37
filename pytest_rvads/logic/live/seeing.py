"""The inputs and the answers of live monitors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import RunError

__all__ = ["Decided", "Seen", "row_of", "sizes_of"]


class Seen(NamedTuple):
    """The state of a vehicle at an instant; see `RuleMonitor.see`."""

    agent: Agent
    """Name, way and size of the vehicle, the same in every state; no other vehicle present has the same name."""
    station: float
    """Station of the reference point along the itinerary, 0 at the entrance vertex [m]."""
    speed: float
    """Forward speed [m/s]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    spread: float = 0.0
    """Three standard deviations of the measured station [m]."""


@dataclass(frozen=True, slots=True)
class Decided:
    """The final verdict of an instance of a rule."""

    rule: str
    binding: Mapping[str, str]
    """Variables of the rule, and the names of the elements that the variables stand for."""
    verdict: Truth
    """``F``: violated in this state; ``T``: no continuation violates it; ``?``: a vehicle left before a violation."""
    time: float
    """Time of the decision since the first state [s]."""


def sizes_of(given: tuple[float, float] | Sequence[tuple[float, float]], count: int) -> tuple[tuple[float, float], ...]:
    """Return length and width of every vehicle [m], given one pair for all vehicles or one pair per vehicle.

    Raises:
        RunError: the sizes have another shape, or are not finite and positive.
    """
    sizes = np.asarray(given, dtype=np.float64)
    if sizes.shape not in ((2,), (count, 2)) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise RunError(f"vehicle_size must be a length and width [m], for all {count} vehicles or for each, got {given!r:.60}")
    return tuple((float(length), float(width)) for length, width in np.broadcast_to(sizes, (count, 2)))


def row_of(name: str, values: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    """Return the numbers of a state as lists.

    Raises:
        RunError: the numbers have another shape than `shape`, or are not finite; the message gives their `name`.
    """
    row = np.asarray(values, dtype=np.float64)
    if row.shape != shape or not all(map(math.isfinite, row.ravel().tolist())):
        what = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
        raise RunError(f"{name} of a state must be {what}, got {values!r:.60}")
    found: list[Any] = row.tolist()
    return found
