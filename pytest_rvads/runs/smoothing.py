"""Estimation of stations, speeds and their accuracy from the noisy samples of a vehicle.

The station of a vehicle is estimated from the samples around, by a polynomial over the longest window that agrees with all
shorter windows (intersection of confidence intervals, Goldenshluger and Nemirovski 1997). If speeds were measured, only the
difference between the stations and the integral of the speeds is estimated. With measured speeds the window can be longer and the
station is more accurate, especially on a straight stretch. A vehicle that stands gets a single station.

Noisy speeds are smoothed in the same way. All samples of a window decide whether a vehicle stands or rolls: a stand is proven,
excluded, or neither.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_Values = NDArray[np.float64]

SURE = 3.0
"""Standard deviations within which an estimate lies: 99.7 % of the time for normal errors."""
AGREE = 2.0
"""Two estimates agree if their difference is at most this multiple of the sum of their standard deviations."""
REACHES = (0.15, 0.25, 0.4, 0.6, 0.9, 1.3, 2.0, 3.0, 5.0, 8.0, 12.0)
"""Half lengths of the windows around a sample [s]; the longest window that agrees with all shorter windows is used."""
BENT = 2.0
"""Greatest half length of a window on bent stretches [s]. Only on straight stretches the speeds integrate to the stations."""
HARD = 5.0
"""Change of acceleration of drivers between two samples [m/s^2], which causes an error of the integral of the speeds."""
LATEST = 0.1
"""Greatest delay of speeds against stations [s]; some simulators record the speed of the step before or after."""
FAR = 2.0
"""Greatest half length of a window with measured speeds [m]: over a longer way the effect of a bend on the way of the bumper
changes."""
LONG = 0.6
"""Greatest half length of a window without measured speeds [s]; in longer windows, drivers begin and end to brake."""
DERIVED = HARD * LONG / 2 / SURE
"""Standard deviation of speeds that are derived from stations [m/s]: a vehicle that brakes and sets off at `HARD` and stops only
for a moment has an average speed over `LONG` of up to three times this value."""
SHORT = 0.4
"""Half length up to which a window is always used [s], so that speeds are averages over at least such a window."""
ALLOWED = 0.012
"""Error of polynomials against the motion of vehicles [m], measured in simulated traffic."""
SETTLED = 0.2
"""Time at the beginning and end of a stand that can belong to braking or setting off, and does not count as stand [s]."""
QUIET = 0.02
"""Greatest noise of speeds that count as exact [m/s]."""
STAND = 0.8
"""Shortest time in one place that proves a stand [s]; full stops are rarely shorter."""
PACE = 0.1
"""Largest speed of a standing vehicle [m/s], see `pytest_rvads.logic.conduct.standing.STANDSTILL`."""
ROLL = 0.2
"""Least speed of rolling that a stand is told from [m/s]: twice the largest speed of a standing vehicle."""
CERTAIN = 11.0
"""Logarithm of the ratio of the likelihoods of standing and rolling that proves a stand."""
BRIEF = 0.1
"""Shortest stop that is looked for [s]."""
LINKED = 0.8
"""Time after which the errors of two samples count as independent [s]."""
_FEW = 8
"""Shortest stretch from which the delay of speeds is estimated [samples]."""
_MOST_SAMPLES = 200
"""Most samples of a window; a longer window is shortened. With so many samples, a station is ten times as exact as a sample."""


def roughness(times: _Values, values: _Values, stride: int = 1) -> float:
    """Return the standard deviation of the noise in samples of a smooth quantity; 0 for too few samples.

    The estimate is the scaled median of third differences, to which polynomials of second degree contribute nothing. The median
    is robust against the large differences at the begin and end of braking. Smooth driving at 10 Hz contributes a few
    millimetres. Differences over gaps between the increasing `times` of the samples [s] are left out.
    """
    steps = times[stride:] - times[:-stride]
    if len(values) < 8 * stride or not (steps > 0).all():
        return 0.0
    even = np.abs(steps / np.median(steps) - 1.0) < 0.2
    whole = even[: -2 * stride] & even[stride:-stride] & even[2 * stride :]
    third = values
    for _ in range(3):
        third = third[stride:] - third[:-stride]
    third = third[whole] / np.sqrt(20.0)  # 1, 3, 3, 1 squared add up to 20
    return float(np.median(np.abs(third)) / 0.6745) if len(third) >= 5 else 0.0


def linkage(times: _Values, values: _Values) -> float:
    """Return the factor by which `roughness` is too small for means of several lateral offsets; 1 for independent errors.

    A tracker makes the errors of successive samples alike. Such errors look small in `roughness`, and hardly vanish in a mean.
    They are taken as autoregressive noise, whose correlation follows from the roughness over `LINKED` and over a single step.
    The motion of vehicles adds to the former, see `ALLOWED`.
    """
    stride = round(LINKED / float(np.median(np.diff(times)))) if len(times) > 1 else 0
    near = roughness(times, values)
    if stride < 2 or near <= 0.0:
        return 1.0
    link = np.linspace(0.0, 0.99, 100)
    seen = [1.0 - 1.5 * x + 0.6 * x**2 - 0.1 * x**3 for x in (link, link**stride)]  # of the variance, in third differences
    factor = np.sqrt((1.0 + link) / (1.0 - link) / seen[0])
    far = max(roughness(times, values, stride) ** 2 - (ALLOWED / SURE) ** 2, 0.0)
    return float(np.interp(far / near**2, seen[1] / seen[0], factor))


def beside(accuracy: float, apart: float) -> float:
    """Return the standard deviation of a smoothed position beside the way [m], or of a smoothed speed [m/s].

    The value is the deviation of a fitted parabola in the middle of n samples, ``1.5 / sqrt(n)`` of the deviation of a sample,
    which is `accuracy`. The samples are `apart` [s].
    """
    if accuracy <= 0.0:
        return 0.0
    count = 2 * int(SHORT / apart + 1e-9) + 1
    return min(accuracy, 1.5 / float(np.sqrt(count)) * accuracy + ALLOWED / SURE)


def delay(times: _Values, station: _Values, speed: _Values, straight: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the delay of a vehicle's speeds against its stations [s], and the weight of this estimate.

    Some simulators record the speed of the step before or after a position, and sensors filter speeds. The integral of delayed
    speeds differs from the stations in proportion to the speed. Estimates of several vehicles are averaged by their weights.
    """
    residual, weighted, weight = station - _driven(times, speed), 0.0, 0.0
    for begin, end in _parts(straight):
        if end - begin >= _FEW:
            at, fast = times[begin:end] - times[begin:end].mean(), speed[begin:end] - speed[begin:end].mean()
            fast = fast - at * float((at * fast).sum() / (at**2).sum())
            weighted, weight = weighted + float((fast * residual[begin:end]).sum()), weight + float((fast**2).sum())
    return (weighted / weight if weight > 0.0 else 0.0), weight


def smoothed(
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
        return _standing(times, station, accuracy, _fitted(times, station, accuracy, 2, np.full(len(times), LONG)))
    driven = _driven(times, speed) + (late * speed if abs(late) <= LATEST else 0.0)
    noise = roughness(times, speed) if noise is None else noise
    reach, wander = np.minimum(FAR / np.maximum(np.abs(speed), PACE), BENT), noise**2 * float(np.median(np.diff(times)))
    fit = _fitted(times, station - driven, accuracy, 1, reach, wander)
    if straight is not None:
        fit = _along_stretches(times, station - driven, accuracy, straight, fit, wander)
    spread = SURE * fit.deviation + ALLOWED
    if noise <= QUIET:
        return fit.value + driven, speed, spread
    smooth = np.abs(_fitted(times, speed, noise, 2, np.full(len(times), LONG)).value)
    edge = PACE + SURE * beside(noise, float(np.median(np.diff(times))))
    # The mean speed within half of `BRIEF` of every sample, and its standard deviation.
    begin, end = np.searchsorted(times, times - BRIEF / 2 - 1e-9), np.searchsorted(times, times + BRIEF / 2 + 1e-9)
    total = np.concatenate(([0.0], np.cumsum(np.abs(speed))))
    mean, error = (total[end] - total[begin]) / (end - begin), noise / np.sqrt(end - begin)
    # Where a stop is possible and not proven, the speed is above `PACE` by less than its accuracy; elsewhere by more.
    possible = mean - AGREE * error <= np.maximum(PACE, AGREE * error)
    smooth = np.where(possible, (PACE + edge) / 2, np.maximum(smooth, edge + ALLOWED))
    smooth[possible & _proven(times, station, accuracy, speed, noise)] = 0.0
    return fit.value + driven, smooth, spread


def _proven(times: _Values, station: _Values, accuracy: float, speed: _Values, noise: float) -> NDArray[np.bool_]:
    """Return around which samples a stand is proven: all samples of a window tell it from rolling at `ROLL`.

    The proof is the logarithm of the ratio of the likelihoods. For normal errors, rolling at `ROLL` or faster reaches a logarithm
    of `CERTAIN` with a probability of at most ``exp(-CERTAIN)``. A magnitude can't be told from its negative.
    """
    turned = ROLL * speed / noise**2
    told = np.logaddexp(turned, -turned) - np.log(2.0) if speed.min() >= 0.0 else turned
    at, along = times - times[0], station - station[0]
    rows = np.stack((ROLL**2 / noise**2 / 2 - told, np.ones(len(at)), at, at**2, along, at * along))
    sums = np.concatenate((np.zeros((len(rows), 1)), np.cumsum(rows, axis=1)), axis=1)
    proven = np.zeros(len(times), dtype=np.bool_)
    for long in REACHES:
        begin = np.flatnonzero(at <= at[-1] - long)
        end = np.searchsorted(at, at[begin] + long + 1e-9)
        ratio, count, at, squared, place, moment = sums[:, end] - sums[:, begin]
        way, driven = squared - at**2 / count, moment - at * place / count
        sure = ratio + ROLL * (ROLL * way / 2 - driven) / accuracy**2 >= CERTAIN
        proven[(begin + end)[sure] // 2] = True
    return proven


@dataclass(frozen=True, slots=True)
class _Fit:
    """Estimates per sample, each of shape ``(samples,)``."""

    value: _Values
    slope: _Values
    deviation: _Values
    """Standard deviation of the value."""


def _driven(times: _Values, speed: _Values) -> _Values:
    """Return the distance driven at every sample, the integral of the speeds, shape ``(samples,)`` [m]."""
    return np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(times))))


def _along_stretches(
    times: _Values, residual: _Values, accuracy: float, straight: NDArray[np.bool_], fit: _Fit, wander: float
) -> _Fit:
    """Return estimates of the residual, the stations minus the integral of the speeds.

    On a straight stretch the residual is estimated from all samples of the stretch. It is constant if the speeds are measured
    without a systematic error, and a straight line if the error of the speeds is constant. `wander` is the variance of the
    residual per second that noisy speeds cause [m^2/s].
    """
    value, slope, deviation = fit.value.copy(), fit.slope.copy(), fit.deviation.copy()
    step = float(np.median(np.diff(times)))
    unseen = (HARD * step**2 / 8) ** 2 / 3  # a change of braking at any moment within a step, one per second
    for begin, end in _parts(straight):
        if end - begin < _FEW:
            continue
        rows, at = slice(begin, end), times[begin:end] - times[begin:end].mean()
        drift, error = float((at * residual[rows]).sum() / (at**2).sum()), accuracy / float(np.sqrt((at**2).sum()))
        degree = 0 if abs(drift) <= AGREE * error else 1
        long = _fitted(times[rows], residual[rows], accuracy, degree, np.full(end - begin, np.inf), wander + unseen)
        better = long.deviation < deviation[rows]
        pairs = (long.value, value), (long.slope, slope), (long.deviation, deviation)
        value[rows], slope[rows], deviation[rows] = (np.where(better, new, old[rows]) for new, old in pairs)
    return _Fit(value, slope, deviation)


def _parts(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first index of every unbroken sequence of true values, and the index after its last index."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], true, [False])).astype(int)))
    return [(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]


def _fitted(times: _Values, values: _Values, accuracy: float, degree: int, farthest: _Values, wander: float = 0.0) -> _Fit:
    """Return estimates from polynomials through the samples up to `farthest` before and after every sample [s]."""
    count = len(times)
    best = _Fit(values.copy(), np.gradient(values, times), np.full(count, accuracy))
    low, high = values - AGREE * accuracy, values + AGREE * accuracy
    going = np.ones(count, dtype=np.bool_)
    for reach in REACHES:
        if reach > max(float(farthest.max()), SHORT) or not going.any():
            break
        fit = _window(times, values, reach, accuracy, degree)
        deviation = np.hypot(fit.deviation, np.sqrt(wander * reach / 3))
        finite = np.isfinite(deviation)
        lower = np.where(finite, np.maximum(low, fit.value - AGREE * deviation), low)
        upper = np.where(finite, np.minimum(high, fit.value + AGREE * deviation), high)
        going &= (lower <= upper) & ((reach <= farthest) | (reach <= SHORT))
        better = going & finite & (deviation < best.deviation)
        low, high = np.where(going, lower, low), np.where(going, upper, high)
        best = _Fit(
            np.where(better, fit.value, best.value),
            np.where(finite & (better | (reach <= SHORT)), fit.slope, best.slope),
            np.where(better, deviation, best.deviation),
        )
    return best


def _window(times: _Values, values: _Values, reach: float, accuracy: float, degree: int) -> _Fit:
    """Return the fits through all samples within `reach` of every sample; the deviation is infinite for too few samples."""
    begin = np.searchsorted(times, times - reach - 1e-9)
    end = np.searchsorted(times, times + reach + 1e-9)
    index = np.arange(len(times))
    begin, end = np.maximum(begin, index - _MOST_SAMPLES // 2), np.minimum(end, index + _MOST_SAMPLES // 2 + 1)
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
    coefficients = np.einsum("nij,nj->ni", inverse, right)
    deviation = np.where(enough, accuracy * np.sqrt(np.maximum(inverse[:, 0, 0], 0.0)), np.inf)
    slope = coefficients[:, 1] / reach if degree else np.zeros(len(times))
    return _Fit(values + coefficients[:, 0], slope, deviation)


def _standing(times: _Values, station: _Values, accuracy: float, fit: _Fit) -> tuple[_Values, _Values, _Values]:
    """Return stations, speeds and spread: while the vehicle stands, estimated from all samples of the stand.

    In a stand, the vehicle does not move: the measured stations differ from their mean only by noise.
    """
    value, speed, spread = fit.value.copy(), fit.slope.copy(), SURE * fit.deviation + ALLOWED
    reach = STAND / 2
    window = _window(times, station, reach, accuracy, 1)
    # The deviation of a slope for evenly spread samples.
    slow = np.abs(window.slope) <= np.maximum(AGREE * window.deviation * np.sqrt(3.0) / reach, PACE)
    for begin, end in _parts(slow & np.isfinite(window.deviation)):
        # Samples at the ends are removed until all samples belong to one place.
        while end - begin >= 4 and times[end - 1] - times[begin] >= STAND:
            apart = station[begin:end] - station[begin:end].mean()
            third = max((end - begin) // 3, 2)
            ends = apart[:third].mean(), apart[-third:].mean()
            if max(abs(ends[0]), abs(ends[1])) <= AGREE * accuracy / np.sqrt(third):
                inner = np.searchsorted(times, (times[begin] + SETTLED, times[end - 1] - SETTLED))
                stand = slice(int(inner[0]), int(inner[1]) + 1)
                at = times[stand] - times[stand].mean()
                creep = float((at * station[stand]).sum() / (at**2).sum())
                error = accuracy / float(np.sqrt((at**2).sum()))
                value[stand] = station[stand].mean()
                spread[stand] = SURE * accuracy / np.sqrt(len(at)) + ALLOWED
                speed[stand] = 0.0 if abs(creep) + 2 * error <= PACE else np.clip(speed[stand], -PACE, PACE)
                break
            begin, end = (begin + 1, end) if abs(ends[0]) > abs(ends[1]) else (begin, end - 1)
    return value, speed, spread
