"""When a junction is busy, and with whom: recorded traffic is cut where nobody is near.

An instance is judged in one excerpt: the excerpt in which the last of its vehicles to appear is judged. The same holds for
indicators of a pair of vehicles. The other vehicles of an excerpt are context.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_JUDGED", "NEAR", "NEAR_TIME", "Period", "busy_periods"]

NEAR = 15.0
"""A vehicle is near the junction from so far before its stopping line on [m]: it is among the first two of its lane."""
NEAR_TIME = 5.0
"""Time before a vehicle would arrive at its present speed, from which the vehicle is near [s]; not below `priority.DUE`."""
MOST_JUDGED = 24
"""Most vehicles that are judged in one run. Longer periods are cut, because the cost grows with the square of the vehicles."""

Span = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Times [s], stations [m] and speeds [m/s] of a vehicle."""


@dataclass(frozen=True, slots=True)
class Period:
    """A time in which the junction is busy without a break, or a part of it."""

    begin: float
    """When the first of the vehicles that are judged appears [s]; before, if somebody is near then: since it has been."""
    end: float
    """When the last one vanishes [s]."""
    busy: float
    """When the first of them comes near [s]."""
    judged: tuple[int, ...]
    """Numbers of the vehicles that are judged here, each in one period."""
    present: tuple[int, ...]
    """Numbers of all that are there meanwhile, increasing."""


def busy_periods(spans: Sequence[Span], lines: Sequence[float], leave: Sequence[float]) -> tuple[Period, ...]:
    """Return the busy periods, in order.

    Args:
        spans: of every vehicle.
        lines: station of its stopping line [m].
        leave: station from which on it has left [m].
    """
    near = [_near(*span, line, last) for span, line, last in zip(spans, lines, leave, strict=True)]
    order = sorted((times[0], times[1], number) for number, times in enumerate(near) if times is not None)
    groups: list[list[int]] = []
    until = -np.inf
    for begin, end, number in order:
        if begin > until or len(groups[-1]) >= MOST_JUDGED:
            groups.append([])
        groups[-1].append(number)
        until = max(until, end)
    begins, ends = (np.array([span[0][k] for span in spans]) for k in (0, -1))
    found = []
    for group in groups:
        begin, end = float(begins[group].min()), float(ends[group].max())
        # For how long others have been waiting, and who entered before whom, is known only if the run goes back so far.
        begin = min((since for times in near if times is not None and (since := times[0]) < begin <= times[1]), default=begin)
        present = np.flatnonzero((begins <= end) & (ends >= begin))
        busy = min(times[0] for number in group if (times := near[number]) is not None)
        found.append(Period(begin, end, busy, tuple(sorted(group)), tuple(present.tolist())))
    return tuple(found)


def _near(
    times: NDArray[np.float64], station: NDArray[np.float64], speed: NDArray[np.float64], line: float, last: float
) -> tuple[float, float] | None:
    """Return from when to when a vehicle is near the junction [s], None where it never is."""
    reach = np.maximum(NEAR, NEAR_TIME * np.maximum(speed, 0.0))
    there = np.flatnonzero((station >= line - reach) & (station <= last))
    return (float(times[there[0]]), float(times[there[-1]])) if len(there) else None
