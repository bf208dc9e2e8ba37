"""From noisy samples of one vehicle to where it was, how fast, and how exactly that is known.

Where a vehicle was is estimated from the samples around, by a polynomial through as long a time as agrees with all shorter ones
(the intersection of confidence intervals, Goldenshluger and Nemirovski 1997). Where speeds were measured they say what it did in
between, and only what they add up to too much or too little is estimated; so the time can be longer, and the place is known
better, on a straight stretch by far. A vehicle that stands is in one place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DERIVED", "QUIET", "beside", "delay", "roughness", "smoothed"]

_Values = NDArray[np.float64]

SURE = 3.0
"""An estimate is within so many of its standard deviations: 99.7 % of the time where errors are normal."""
AGREE = 2.0
"""Two estimates agree if they differ by at most so many standard deviations, those of both added up."""
REACHES = (0.15, 0.25, 0.4, 0.6, 0.9, 1.3, 2.0, 3.0, 5.0, 8.0, 12.0)
"""How far before and after a sample others are looked at [s]; the longest that agrees counts."""
BENT = 2.0
"""But no farther, unless on a straight stretch, where measured speeds are all that there is to the way [s]."""
HARD = 5.0
"""Drivers begin and end to brake as hard as this, between two samples [m/s^2]: then speeds add up to a little more or less."""
LATEST = 0.1
"""Speeds are measured at most so long before or after stations [s]; a simulator's are those of the step before or behind."""
FAR = 2.0
"""Over a longer way samples say nothing about the place of one between them [m], where speeds are measured: what a bend adds to
the way of a bumper has changed by then."""
LONG = 0.6
"""Nor over a longer time, where they are not [s]: drivers begin and end to brake."""
DERIVED = HARD * LONG / 2 / SURE
"""Standard deviation of speeds that are worked out from stations, where none were measured [m/s]: whoever brakes and sets off as
hard as that and stops for a moment only is, averaged over `LONG`, up to three times as fast as this."""
SHORT = 0.4
"""But over this time they always do [s]; speeds are those over at least as long."""
ALLOWED = 0.012
"""What polynomials miss of how vehicles drive [m], measured in simulated traffic."""
SETTLED = 0.2
"""The first and the last samples of a stand may belong to braking or setting off [s]."""
QUIET = 0.02
"""Noise of speeds below this is none [m/s]."""
STAND = 0.8
"""Shortest time in one place that proves a stand [s]; full stops are rarely shorter."""
PACE = 0.1
"""Largest speed of a standing vehicle [m/s], see `standing.STANDSTILL`."""
_FEW = 8
"""Shortest stretch from which the delay of speeds is estimated [samples]."""
_MOST_SAMPLES = 200
"""Of a window; where there are more, it is shorter: then the place is known to a tenth of what a sample is."""


def roughness(times: _Values, values: _Values) -> float:
    """Return the standard deviation of the noise in samples of something smooth, 0 where there is none.

    It is that of third differences, which no polynomial of second degree adds to. Those of a vehicle that begins or ends to
    brake stand out; a robust estimate leaves them aside, and smooth driving at 10 Hz stays below a few millimetres.

    Args:
        times: of the samples, increasing [s]; differences over gaps are left out.
        values: measured.
    """
    steps = np.diff(times)
    if len(values) < 8 or not (steps > 0).all():
        return 0.0
    even = np.abs(steps / np.median(steps) - 1.0) < 0.2
    whole = even[:-2] & even[1:-1] & even[2:]
    third = np.diff(values, n=3)[whole] / np.sqrt(20.0)  # 1, 3, 3, 1 squared add up to 20
    return float(np.median(np.abs(third)) / 0.6745) if len(third) >= 5 else 0.0


def beside(accuracy: float, apart: float) -> float:
    """Return the standard deviation of a smoothed position beside the way [m], or of a smoothed speed [m/s].

    It is that of a parabola in the middle of the samples that always count: ``1.5 / sqrt(n)`` of one sample's.

    Args:
        accuracy: standard deviation of a coordinate [m] or speed [m/s] of a sample.
        apart: time between samples [s].
    """
    if accuracy <= 0.0:
        return 0.0
    several = 2 * int(SHORT / apart + 1e-9) + 1
    return min(accuracy, 1.5 / float(np.sqrt(several)) * accuracy + ALLOWED / SURE)


def delay(times: _Values, station: _Values, speed: _Values, straight: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the delay of a vehicle's speeds against its stations [s], and the weight of this estimate.

    A simulator may record the speed of the step before or after a position, and a sensor filters speeds. The integral of delayed
    speeds differs from the stations in proportion to the speed. Estimates of several vehicles are averaged by their weights.

    Args:
        times: increasing times of the samples [s].
        station: measured stations [m].
        speed: measured speeds [m/s].
        straight: which samples lie on a straight part of the way, where the speeds integrate to the stations.
    """
    residual, found, weight = station - _driven(times, speed), 0.0, 0.0
    for begin, end in _parts(straight):
        if end - begin >= _FEW:
            at, fast = times[begin:end] - times[begin:end].mean(), speed[begin:end] - speed[begin:end].mean()
            fast = fast - at * float((at * fast).sum() / (at**2).sum())
            found, weight = found + float((fast * residual[begin:end]).sum()), weight + float((fast**2).sum())
    return (found / weight if weight > 0.0 else 0.0), weight


def smoothed(  # noqa: PLR0913 - the samples, how well they are known, and where the way is straight
    times: _Values,
    station: _Values,
    speed: _Values | None,
    accuracy: float,
    straight: NDArray[np.bool_] | None = None,
    late: float = 0.0,
    noise: float | None = None,
) -> tuple[_Values, _Values, _Values | None]:
    """Return stations [m], speeds [m/s] and spread [m] of one vehicle, each of shape ``(samples,)``.

    Args:
        times: increasing times of the samples [s].
        station: measured stations [m].
        speed: measured speeds [m/s]; None if no speeds were measured. Then speeds are derived from the stations, and are
            exactly 0 where the stations prove a stand.
        accuracy: standard deviation of a station [m]; 0 leaves the stations unchanged and returns None as their spread.
        straight: which samples lie on a straight part of the way, where the speeds integrate to the stations; None if unknown.
        late: delay of the speeds against the stations [s], see `delay`.
        noise: standard deviation of a measured speed [m/s]; None to estimate it from the speeds of this vehicle. Speeds with a
            deviation up to `QUIET` stay unchanged. Noisier speeds are smoothed, and are exactly 0 where a stand is proven.
    """
    if accuracy <= 0.0 or len(times) < 4:
        fast = speed if speed is not None else np.gradient(station, times) if len(times) > 1 else np.zeros(len(times))
        return station, fast, None if accuracy <= 0.0 else np.full(len(times), SURE * accuracy)
    if speed is None:
        found = _fitted(times, station, accuracy, 2, np.full(len(times), LONG))
        return _standing(times, station, accuracy, found)
    driven = _driven(times, speed) + (late * speed if abs(late) <= LATEST else 0.0)
    noise = roughness(times, speed) if noise is None else noise
    reach, wander = np.minimum(FAR / np.maximum(np.abs(speed), PACE), BENT), noise**2 * float(np.median(np.diff(times)))
    found = _fitted(times, station - driven, accuracy, 1, reach, wander)
    if straight is not None:
        found = _along_stretches(times, station - driven, accuracy, straight, found, wander)
    fast = speed if noise <= QUIET else _slowed(times, station, accuracy, speed, noise)
    return found.value + driven, fast, SURE * found.deviation + ALLOWED


def _slowed(times: _Values, station: _Values, accuracy: float, speed: _Values, noise: float) -> _Values:
    """Return noisy speeds smoothed, and exactly 0 where they and the stations prove a stand.

    The magnitude of a noisy speed is never negative, so that its mean is too high for a vehicle that stands. Then the stations
    alone tell whether it does.
    """
    found = _fitted(times, speed, noise, 2, np.full(len(times), LONG)).value
    for reach in (reach for reach in REACHES if reach <= BENT):
        mean = _window(times, speed, reach, noise, 0)
        found[np.abs(mean.value) + AGREE * mean.deviation <= PACE] = 0.0
    for begin, end in _stands(times, station, accuracy):
        here = slice(begin, end)
        at = times[here] - times[here].mean()
        weights = float((at**2).sum()) / accuracy**2, (end - begin) / noise**2 * float(speed[here].min() < 0.0)
        creeps = float((at * station[here]).sum()) / accuracy**2 + weights[1] * float(speed[here].mean())
        if abs(creeps) / sum(weights) + AGREE / float(np.sqrt(sum(weights))) <= PACE:
            found[here] = 0.0
    return found


@dataclass(frozen=True, slots=True)
class _Fit:
    """Estimates per sample, each of shape ``(samples,)``."""

    value: _Values
    slope: _Values
    deviation: _Values
    """Standard deviation of the value."""


def _driven(times: _Values, speed: _Values) -> _Values:
    """Return what speeds add up to, shape ``(samples,)`` [m]."""
    return np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times))))


def _along_stretches(
    times: _Values, residual: _Values, accuracy: float, straight: NDArray[np.bool_], found: _Fit, wander: float
) -> _Fit:
    """Return what is left of the stations without the way that was driven, on straight stretches from all samples there.

    It is the same all along a stretch, unless speeds are measured too high or too low: then it is a line.

    Args:
        times: of the samples [s].
        residual: station less the way that speeds add up to [m].
        accuracy: standard deviation of a station [m].
        straight: which samples are where the way is straight.
        found: estimates that need no stretch.
        wander: variance per second by which noisy speeds make the residual stray.
    """
    value, slope, deviation = found.value.copy(), found.slope.copy(), found.deviation.copy()
    step = float(np.median(np.diff(times)))
    unseen = (HARD * step**2 / 8) ** 2 / 3  # a change of braking at any moment within a step, one per second
    for begin, end in _parts(straight):
        if end - begin < _FEW:
            continue
        here, at = slice(begin, end), times[begin:end] - times[begin:end].mean()
        drift, known = float((at * residual[here]).sum() / (at**2).sum()), accuracy / float(np.sqrt((at**2).sum()))
        degree = 0 if abs(drift) <= AGREE * known else 1
        fit = _fitted(times[here], residual[here], accuracy, degree, np.full(end - begin, np.inf), wander + unseen)
        better = fit.deviation < deviation[here]
        value[here], slope[here], deviation[here] = (
            np.where(better, new, old[here]) for new, old in ((fit.value, value), (fit.slope, slope), (fit.deviation, deviation))
        )
    return _Fit(value, slope, deviation)


def _parts(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first index of every unbroken row of what is true, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], true, [False])).astype(int)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _fitted(
    times: _Values,
    values: _Values,
    accuracy: float,
    degree: int,
    farthest: _Values,
    wander: float = 0.0,
) -> _Fit:
    """Return what polynomials through the samples around every sample say there.

    Args:
        times: of the samples [s].
        values: measured.
        accuracy: standard deviation of a value.
        degree: of the polynomials.
        farthest: how far before and after every sample others are looked at, at most [s], shape ``(samples,)``.
        wander: variance per second by which the values stray on their own.
    """
    count = len(times)
    best = _Fit(values.copy(), np.gradient(values, times), np.full(count, accuracy))
    low, high = values - AGREE * accuracy, values + AGREE * accuracy
    going = np.ones(count, dtype=np.bool_)
    for reach in REACHES:
        if reach > max(float(farthest.max()), SHORT) or not going.any():
            break
        fit = _window(times, values, reach, accuracy, degree)
        deviation = np.hypot(fit.deviation, np.sqrt(wander * reach / 3))
        known = np.isfinite(deviation)
        lower = np.where(known, np.maximum(low, fit.value - AGREE * deviation), low)
        upper = np.where(known, np.minimum(high, fit.value + AGREE * deviation), high)
        going &= (lower <= upper) & ((reach <= farthest) | (reach <= SHORT))
        better = going & known & (deviation < best.deviation)
        low, high = np.where(going, lower, low), np.where(going, upper, high)
        best = _Fit(
            np.where(better, fit.value, best.value),
            np.where(known & (better | (reach <= SHORT)), fit.slope, best.slope),
            np.where(better, deviation, best.deviation),
        )
    return best


def _window(times: _Values, values: _Values, reach: float, accuracy: float, degree: int) -> _Fit:
    """Return the fits through all samples within `reach` of every sample; not a number where they are too few."""
    begin = np.searchsorted(times, times - reach - 1e-9)
    end = np.searchsorted(times, times + reach + 1e-9)
    here = np.arange(len(times))
    begin, end = np.maximum(begin, here - _MOST_SAMPLES // 2), np.minimum(end, here + _MOST_SAMPLES // 2 + 1)
    columns = begin[:, None] + np.arange(int((end - begin).max()))
    inside = columns < end[:, None]
    columns = np.minimum(columns, len(times) - 1)
    along = np.where(inside, (times[columns] - times[:, None]) / reach, 0.0)
    powers = np.stack([inside * along**k for k in range(degree + 1)], axis=-1)
    middle = np.where(inside, values[columns] - values[:, None], 0.0)
    normal = np.einsum("nwi,nwj->nij", powers, powers)
    right = np.einsum("nwi,nw->ni", powers, middle)
    enough = (end - begin > degree + 1) & (np.linalg.cond(normal) < 1e9)
    normal[~enough] = np.eye(degree + 1)
    inverse = np.linalg.inv(normal)
    found = np.einsum("nij,nj->ni", inverse, right)
    deviation = np.where(enough, accuracy * np.sqrt(np.maximum(inverse[:, 0, 0], 0.0)), np.inf)
    slope = found[:, 1] / reach if degree else np.zeros(len(times))
    return _Fit(values + found[:, 0], slope, deviation)


def _standing(times: _Values, station: _Values, accuracy: float, fit: _Fit) -> tuple[_Values, _Values, _Values]:
    """Return stations, speeds and spread, those of a stand from all samples of it."""
    value, speed, spread = fit.value.copy(), fit.slope.copy(), SURE * fit.deviation + ALLOWED
    for begin, end in _stands(times, station, accuracy):
        several, here = end - begin, slice(begin, end)
        value[here] = station[here].mean()
        spread[here] = SURE * accuracy / np.sqrt(several) + ALLOWED
        at = times[here] - times[here].mean()
        creeps = float((at * station[here]).sum() / (at**2).sum())
        known = accuracy / float(np.sqrt((at**2).sum()))
        speed[here] = 0.0 if abs(creeps) + 2 * known <= PACE else np.clip(speed[here], -PACE, PACE)
    return value, speed, spread


def _stands(times: _Values, station: _Values, accuracy: float) -> list[tuple[int, int]]:
    """Return the first sample of every stand, and the one after its last: all samples are as near to their mean as noise is."""
    reach = STAND / 2
    fit = _window(times, station, reach, accuracy, 1)
    # A slope is known to this, as far as samples are spread evenly.
    slow = np.abs(fit.slope) <= np.maximum(AGREE * fit.deviation * np.sqrt(3.0) / reach, PACE)
    found = []
    for begin, end in _parts(slow & np.isfinite(fit.deviation)):
        # From the middle outwards as long as samples belong to one place.
        while end - begin >= 4 and times[end - 1] - times[begin] >= STAND:
            apart = station[begin:end] - station[begin:end].mean()
            third = max((end - begin) // 3, 2)
            ends = apart[:third].mean(), apart[-third:].mean()
            limit = AGREE * accuracy / np.sqrt(third)
            if max(abs(ends[0]), abs(ends[1])) <= limit:
                inner = np.searchsorted(times, (times[begin] + SETTLED, times[end - 1] - SETTLED))
                found.append((int(inner[0]), int(inner[1]) + 1))
                break
            begin, end = (begin + 1, end) if abs(ends[0]) > abs(ends[1]) else (begin, end - 1)
    return found
