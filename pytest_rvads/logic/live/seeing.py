"""What live monitors are given and what they answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pytest_rvads.errors import RunError
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.states import Agent

__all__ = ["Decided", "Seen", "row_of", "sizes_of"]


class Seen(NamedTuple):
    """A vehicle as it is seen in one state; see `RuleMonitor.see`."""

    agent: Agent
    """Its name, way and size; the same in every state, and nobody else's name as long as it is there."""
    station: float
    """Reference point along its itinerary, 0 at the entrance vertex [m]."""
    speed: float
    """Forward [m/s]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    spread: float = 0.0
    """How far before or behind its station it may be [m]: three standard deviations of what is measured."""


@dataclass(frozen=True, slots=True)
class Decided:
    """The last word on one instance of a rule."""

    rule: str
    binding: Mapping[str, str]
    """Variables of the rule and the names they stand for."""
    verdict: Truth
    """``F``: violated in this very state; ``T``: nothing can violate it any more; ``?``: a vehicle of the
    instance left before the rule was violated."""
    time: float
    """When that was known, since the first state [s]."""


def sizes_of(given: tuple[float, float] | Sequence[tuple[float, float]], count: int) -> tuple[tuple[float, float], ...]:
    """Return length and width of every vehicle [m], given one pair for all or one for each.

    Raises:
        RunError: what is neither.
    """
    sizes = np.asarray(given, dtype=np.float64)
    if sizes.shape not in ((2,), (count, 2)) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise RunError(f"vehicle_size must be a length and width [m], for all {count} vehicles or for each, got {given!r:.60}")
    return tuple((float(length), float(width)) for length, width in np.broadcast_to(sizes, (count, 2)))


def row_of(name: str, values: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    """Return numbers of a state, given under a name, as lists.

    Raises:
        RunError: they have another shape, or are not finite.
    """
    row = np.asarray(values, dtype=np.float64)
    if row.shape != shape or not np.isfinite(row).all():
        what = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
        raise RunError(f"{name} of a state must be {what}, got {values!r:.60}")
    found: list[Any] = row.tolist()
    return found
