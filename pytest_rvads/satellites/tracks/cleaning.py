"""From the samples of a matched vehicle to its track: where it was along its way, how fast, and how exactly that is known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.recording import Track
from pytest_rvads.runs.smoothing import QUIET, delay, roughness, smoothed
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.tracks.matching import Matched
from pytest_rvads.satellites.tracks.samples import Samples

__all__ = ["accuracy_of", "delay_of", "noise_of", "track_of"]

_EXACT = 0.005
"""A position that is known better than this counts as exact [m]: files with two decimals are."""


def accuracy_of(found: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the standard deviation of a coordinate, estimated from the tracks [m]; 0 where they are exact.

    Along the way vehicles speed up and slow down, across it they hardly move, but a simulator may hold them on it exactly: noise
    shows in both, so the smaller of the two is taken, and of the vehicles the one in the middle.
    """
    each = []
    for vehicle, match in found:
        times = vehicle.times[match.kept]
        each.append(min(roughness(times, match.station), roughness(times, match.lateral)))
    estimate = float(np.median(each)) if each else 0.0
    return estimate if estimate >= _EXACT else 0.0


def noise_of(found: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the standard deviation of a speed, estimated from the tracks [m/s]; 0 where speeds are exact or not measured."""
    each = [
        roughness(vehicle.times[match.kept], vehicle.speed[match.kept]) for vehicle, match in found if vehicle.speed is not None
    ]
    estimate = float(np.median(each)) if each else 0.0
    return estimate if estimate > QUIET else 0.0


def delay_of(found: Sequence[tuple[Samples, Matched]]) -> float:
    """Return how long after their places the speeds of vehicles are of, estimated from all of them [s]."""
    each = [
        delay(vehicle.times[match.kept], match.station, vehicle.speed[match.kept], _straight(match))
        for vehicle, match in found
        if vehicle.speed is not None
    ]
    weight = math.fsum(weight for _, weight in each)
    return math.fsum(late * weight for late, weight in each) / weight if weight else 0.0


def track_of(  # noqa: PLR0913 - a vehicle as it is, as it was recorded, and how well
    agent: Agent,
    vehicle: Samples,
    match: Matched,
    points: NDArray[np.float64],
    heading: NDArray[np.float64] | None,
    accuracy: float,
    late: float = 0.0,
    noise: float | None = None,
) -> Track:
    """Return the track of a vehicle.

    Args:
        agent: name, kind, body and way of the vehicle.
        vehicle: the vehicle's samples in the log.
        match: the vehicle's way, and the samples that lie on the way.
        points: middle of the front bumper in all samples, shape ``(samples, 2)`` [m].
        heading: heading in all samples, shape ``(samples,)`` [rad]; None if the body is aligned with the way.
        accuracy: standard deviation of a coordinate [m]; 0 leaves the positions unchanged.
        late: delay of the speeds against the positions [s], see `delay_of`.
        noise: standard deviation of a measured speed [m/s]; None to estimate it from the vehicle's speeds.
    """
    times = vehicle.times[match.kept]
    speed = None if vehicle.speed is None else vehicle.speed[match.kept]
    straight = _straight(match) if accuracy > 0.0 else None
    station, fast, spread = smoothed(times, match.station, speed, accuracy, straight, late, noise)
    place, ahead = match.way.centre(station)
    if accuracy > 0.0:
        lateral = smoothed(times, match.lateral, None, accuracy)[0]
        place = place + lateral[:, None] * np.column_stack((-ahead[:, 1], ahead[:, 0]))
    else:
        place = points[match.kept]
    facing = _facing(match, station, agent) if heading is None else heading[match.kept]
    return Track(agent, times, station, fast, np.column_stack((place, facing)), spread, match.offset)


def _facing(match: Matched, station: NDArray[np.float64], agent: Agent) -> NDArray[np.float64]:
    """Return where a body heads whose front and rear are on its way, shape ``(kept,)`` [rad]."""
    length = _BODY if agent.size is None else agent.size[0]
    front, rear = (match.way.centre(station - back)[0] for back in (0.0, length))
    along = front - rear
    found: NDArray[np.float64] = np.arctan2(along[:, 1], along[:, 0])
    return found


def _straight(match: Matched) -> NDArray[np.bool_]:
    """Return which samples are where the way of a vehicle has been straight for its length, shape ``(kept,)``."""
    behind, here = (match.way.centre(match.station - back)[1] for back in (_BODY, 0.0))
    turn = behind[:, 0] * here[:, 1] - behind[:, 1] * here[:, 0]
    found: NDArray[np.bool_] = np.abs(turn) <= _BODY / _WIDE
    return found


_BODY = 5.0
"""As long as a part of the body is in a bend, the bumper makes another way than what speeds are of [m]."""
_WIDE = 200.0
"""A bend with a larger radius is none [m]."""
