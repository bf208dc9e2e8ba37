"""Tracks of matched vehicles: the station along the way, the speed, and the accuracy of both, from the samples of a log."""

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
"""Largest standard deviation of a position that counts as exact [m]: files with two decimals have a smaller deviation."""


def accuracy_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the standard deviation of a coordinate, estimated from the roughness of the tracks [m]; 0 if positions are exact.

    Noise makes stations and lateral offsets rough. Stations are rough without noise, too, when a vehicle brakes. Offsets are
    smooth in spite of noise if a simulator holds vehicles on their ways. So the smaller roughness of a vehicle counts, and the
    median of all vehicles.
    """
    estimates = []
    for vehicle, match in matches:
        times = vehicle.times[match.rows]
        estimates.append(min(roughness(times, match.station), roughness(times, match.lateral)))
    estimate = float(np.median(estimates)) if estimates else 0.0
    return estimate if estimate >= _EXACT else 0.0


def noise_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the standard deviation of a speed, estimated from the tracks [m/s]; 0 if speeds are exact or not measured."""
    estimates = [
        roughness(vehicle.times[match.rows], vehicle.speed[match.rows]) for vehicle, match in matches if vehicle.speed is not None
    ]
    estimate = float(np.median(estimates)) if estimates else 0.0
    return estimate if estimate > QUIET else 0.0


def delay_of(matches: Sequence[tuple[Samples, Matched]]) -> float:
    """Return the delay of the recorded speeds against the recorded positions, estimated from all vehicles [s]."""
    delays = [
        delay(vehicle.times[match.rows], match.station, vehicle.speed[match.rows], _straight(match))
        for vehicle, match in matches
        if vehicle.speed is not None
    ]
    weight = math.fsum(weight for _, weight in delays)
    return math.fsum(late * weight for late, weight in delays) / weight if weight else 0.0


def track_of(  # noqa: PLR0913 - the vehicle, its samples, and their accuracy
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
    times = vehicle.times[match.rows]
    speed = None if vehicle.speed is None else vehicle.speed[match.rows]
    straight = _straight(match) if accuracy > 0.0 else None
    station, fast, spread = smoothed(times, match.station, speed, accuracy, straight, late, noise)
    place, ahead = match.way.centre(station)
    if accuracy > 0.0:
        lateral = smoothed(times, match.lateral, None, accuracy)[0]
        place = place + lateral[:, None] * np.column_stack((-ahead[:, 1], ahead[:, 0]))
    else:
        place = points[match.rows]
    facing = _facing(match, station, agent) if heading is None else heading[match.rows]
    return Track(agent, times, station, fast, np.column_stack((place, facing)), spread, match.offset)


def _facing(match: Matched, station: NDArray[np.float64], agent: Agent) -> NDArray[np.float64]:
    """Return the heading of a body with front and rear on its way, shape ``(rows,)`` [rad]."""
    length = _BODY if agent.size is None else agent.size[0]
    front, rear = (match.way.centre(station - back)[0] for back in (0.0, length))
    along = front - rear
    headings: NDArray[np.float64] = np.arctan2(along[:, 1], along[:, 0])
    return headings


def _straight(match: Matched) -> NDArray[np.bool_]:
    """Return for which samples the way below the vehicle is straight, shape ``(rows,)``."""
    behind, ahead = (match.way.centre(match.station - back)[1] for back in (_BODY, 0.0))
    turn = behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0]
    straight: NDArray[np.bool_] = np.abs(turn) <= _BODY / _WIDE
    return straight


_BODY = 5.0
"""Length of a vehicle without a recorded length [m]. While a part of the body is in a bend, the front bumper follows another line
than the point to which recorded speeds refer."""
_WIDE = 200.0
"""Radius from which on a bend counts as straight [m]."""
