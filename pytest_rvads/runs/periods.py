"""Busy periods of a junction: recorded traffic is cut at times without a vehicle near the junction.

An excerpt is the part of a recording that one run holds. An instance of a rule (the rule for certain vehicles) is judged in one
excerpt: the excerpt that judges the vehicle of the instance that appeared last. The indicators of two vehicles are computed in
the excerpt that judges the vehicle that appeared later. An excerpt also shows vehicles that it does not judge, as context.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NEAR = 15.0
"""Distance before its stopping line from which on a vehicle is near the junction [m]: two queuing vehicles fit in."""
NEAR_TIME = 5.0
"""A vehicle is also near the junction if it would reach its stopping line within this time at its present speed [s].

The time is not below `pytest_rvads.logic.conduct.rights.DUE`.
"""
MOST_JUDGED = 24
"""Most vehicles that are judged in one run. Longer periods are cut, because the cost grows with the square of the vehicles."""

Span = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Times [s], stations [m] and speeds [m/s] of a vehicle."""


@dataclass(frozen=True, slots=True)
class Period:
    """A time in which vehicles are near the junction without a break, or a part of such a time."""

    begin: float
    """Time at which the first judged vehicle appears [s], or the earlier time at which a vehicle near at that time came near."""
    end: float
    """Time at which the last judged vehicle vanishes [s]."""
    busy: float
    """Time at which the first judged vehicle comes near the junction [s]."""
    judged: tuple[int, ...]
    """Numbers of the judged vehicles; each vehicle is judged in one period."""
    present: tuple[int, ...]
    """Numbers of all vehicles that are present in the period, increasing."""


def busy_periods(spans: Sequence[Span], lines: Sequence[float], leave: Sequence[float]) -> tuple[Period, ...]:
    """Return the busy periods of a junction in order.

    Per vehicle, `lines` has the station of its stopping line, and `leave` the station from which on it has left the junction [m].
    """
    # The first and the last time at which each vehicle is near the junction [s]; None if it never comes near.
    near: list[tuple[float, float] | None] = []
    for (times, station, speed), line, last in zip(spans, lines, leave, strict=True):
        reach = np.maximum(NEAR, NEAR_TIME * np.maximum(speed, 0.0))
        samples = np.flatnonzero((station >= line - reach) & (station <= last))
        near.append((float(times[samples[0]]), float(times[samples[-1]])) if len(samples) else None)
    order = sorted((*both, number) for number, both in enumerate(near) if both is not None)
    groups: list[list[int]] = []
    until = -np.inf
    for begin, end, number in order:
        if begin > until or len(groups[-1]) >= MOST_JUDGED:
            groups.append([])
        groups[-1].append(number)
        until = max(until, end)
    begins, ends = (np.array([span[0][k] for span in spans]) for k in (0, -1))
    periods = []
    for group in groups:
        begin, end = float(begins[group].min()), float(ends[group].max())
        # The run goes back so far that it shows waiting times, and the order in which vehicles entered.
        begin = min((since for since, until in filter(None, near) if since < begin <= until), default=begin)
        present = np.flatnonzero((begins <= end) & (ends >= begin))
        busy = min(both[0] for number in group if (both := near[number]) is not None)
        periods.append(Period(begin, end, busy, tuple(sorted(group)), tuple(present.tolist())))
    return tuple(periods)
