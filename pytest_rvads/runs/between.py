"""Where a vehicle was, and how fast, between two samples of it.

Times [s], stations [m], speeds [m/s] and spread [m] of the samples have the shape ``(samples,)``, what is asked for in between
has the shape ``(steps,)``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.periods import NEAR
from pytest_rvads.runs.smoothing import PACE

__all__ = ["speeds", "stations", "unseen_stand"]

_Values = NDArray[np.float64]

_APART = 0.15
"""Longest time between samples for which the speed is interpolated in a straight line [s], see `speeds`."""
_AROUND = 4
"""Number of consecutive samples that show a stop between the two middle samples."""
_AGREE = 0.1
"""Largest relative difference between speed times time and the distance driven between two samples for a trusted speed."""


def stations(times: _Values, station: _Values, speed: _Values, at: _Values) -> _Values:
    """Return the stations at times between samples: a cubic where the speeds agree with the way made, else a straight line."""
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    long = np.diff(times)[piece]
    begin, end, v0, v1 = station[piece], station[piece + 1], speed[piece], speed[piece + 1]
    part = (at - times[piece]) / long
    straight = begin + part * (end - begin)
    bend = part * (1 - part) * long
    curved = straight + bend * ((1 - part) * (v0 - (end - begin) / long) - part * (v1 - (end - begin) / long))
    smooth = np.abs((v0 + v1) / 2 * long - (end - begin)) <= _AGREE * np.abs(end - begin)
    found: _Values = np.where(smooth, curved, straight)
    return found


def speeds(times: _Values, station: _Values, speed: _Values, spread: _Values | None, at: _Values) -> _Values:
    """Return the speeds of a vehicle at times between its samples.

    The speed is interpolated in a straight line, except where the vehicle brakes before two samples and accelerates after them.
    There the braking is continued and the acceleration is extended backwards, if that agrees better with the distance driven.
    Otherwise a short stop between two samples would be lost.
    """
    found: _Values = np.interp(at, times, speed)
    if len(times) < _AROUND:
        return found
    long, made = np.diff(times), np.diff(station)
    slopes = np.diff(speed) / long
    before, after, here = slopes[:-2], slopes[2:], long[1:-1]
    v0, v1 = speed[1:-2], speed[2:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = (v1 - after * here - v0) / (before - after)
        lowest = v0 + before * turn
        # Who comes to rest before it would set off again stands in between.
        stands = lowest < 0.0
        way = np.where(
            stands,
            (v1**2 / after - v0**2 / before) / 2,
            (v0 + lowest) / 2 * turn + (lowest + v1) / 2 * (here - turn),
        )
    dips = (before < 0.0) & (after > 0.0) & (v0 > 0.0) & (v1 > 0.0) & (turn > 0.0) & (turn < here)
    known = 0.0 if spread is None else (spread[1:-2] + spread[2:-1]) / 2
    dips &= np.abs(way - made[1:-1]) <= np.abs((v0 + v1) / 2 * here - made[1:-1]) + known
    for k in (np.flatnonzero(dips) + 1).tolist():
        inside = slice(*np.searchsorted(at, times[[k, k + 1]]))
        braking = speed[k] + slopes[k - 1] * (at[inside] - times[k])
        leaving = speed[k + 1] + slopes[k + 1] * (at[inside] - times[k + 1])
        found[inside] = np.maximum(np.maximum(braking, leaving), 0.0)
    return found


def unseen_stand(times: _Values, station: _Values, speed: _Values, at: _Values, found: _Values) -> float:
    """Return how much slower than its speeds say a vehicle was, if it stood between two samples before the line unseen [m/s].

    Who brakes to a standstill and sets off again is, on average, at most half as fast as the higher of its two speeds.

    Args:
        times: of the samples.
        station: then.
        speed: then.
        at: times in between.
        found: what is taken for its speeds then.
    """
    long, made = np.diff(times), np.diff(station)
    higher = np.maximum(speed[:-1], speed[1:])
    near = (station[1:] >= -NEAR) & (station[:-1] <= 0.0)
    may = np.flatnonzero(near & (long > _APART) & (made <= (higher + PACE) * long / 2))
    bounds = np.searchsorted(at, times)
    lowest = [float(found[bounds[k] : bounds[k + 1]].min(initial=np.inf)) for k in may if bounds[k] < bounds[k + 1]]
    return max((slow for slow in lowest if slow > PACE), default=0.0)
