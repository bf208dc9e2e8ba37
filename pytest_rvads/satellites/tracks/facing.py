"""Compares the headings of a log with the direction of motion, and drops headings that say nothing while a vehicle stands.

The heading of a vehicle is the direction of its body. Some logs also, or only, have the direction in which the centre of the
vehicle moves. While the vehicle stands, this direction is noise, or zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice

import numpy as np

from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.matching import STEP, Line, directions
from pytest_rvads.satellites.tracks.samples import Log, Samples
from pytest_rvads.support.errors import RunError

_COMPARED = 100
"""Largest number of vehicles of a log whose headings are compared with their direction of motion."""
_SHORTEST_DRIVE = 10.0
"""Headings in motion are compared of vehicles that drive at least this distance, because noise hides the direction of a shorter
drive [m]."""
LEAST_AGREEMENT = 0.92
"""Least cosine of the angle between heading and direction of motion, averaged over a track, at which both agree. With noise or
slipping, the cosine is larger. If a log states headings in degrees, and 90 degrees are read as 90 rad, the cosine is 0.89."""
_NEAR = 0.5
"""Ways whose distances from a vehicle differ by less than this are equally near [m]."""
_SLOW, _AROUND = 0.5, 0.25
"""A vehicle counts as standing if its mean speed from `_AROUND` [s] before a sample to `_AROUND` after it is less than `_SLOW`
[m/s], and as moving from twice that speed on: noise of 5 cm hides smaller speeds."""


def agreement(log: Log) -> tuple[float, float]:
    """Return the mean cosine of the angle between heading and direction of motion: of moving, and of standing vehicles.

    Both are medians over vehicles, and 1 without such vehicles. For a standing vehicle, its directions before and after count.
    """
    moving, standing = [1.0], [1.0]
    # The headings of pedestrians are not used.
    headed = (vehicle for vehicle in log.vehicles if vehicle.heading is not None and vehicle.kind is not Kind.PEDESTRIAN)
    reaches = ((vehicle, float(np.hypot(*(vehicle.points - vehicle.points[0]).T).max())) for vehicle in headed)
    for vehicle, reach in islice(((vehicle, reach) for vehicle, reach in reaches if reach >= STEP), _COMPARED):
        cosines = np.cos(np.asarray(vehicle.heading) - directions(vehicle.points))
        times = vehicle.times
        early, late = (np.clip(times + by, times[0], times[-1]) for by in (-_AROUND, _AROUND))
        x, y = (np.interp(late, times, values) - np.interp(early, times, values) for values in vehicle.points.T)
        speeds = np.hypot(x, y) / (late - early)
        moves, stands = speeds >= 2 * _SLOW, speeds < _SLOW
        moving += [float(cosines[moves].mean())] if reach >= _SHORTEST_DRIVE and moves.any() else []
        standing += [float(cosines[stands].mean())] if stands.any() else []
    return float(np.median(moving[1:] or moving)), float(np.median(standing[1:] or standing))


def with_headings(log: Log) -> Log:
    """Return the log, without its headings if they say nothing while vehicles stand; matching then derives headings."""
    moving, standing = agreement(log)
    if moving < LEAST_AGREEMENT:
        raise RunError(
            f"{log.where}: the heading of most vehicles differs from the direction of motion, expected radians counter-clockwise "
            "from east, and y pointing north: name degrees by --columns heading=COLUMN:deg, degrees of a compass by "
            "heading=COLUMN:north"
        )
    if standing >= LEAST_AGREEMENT:
        return log
    note = (
        f"{log.where}: headings change while vehicles stand, so they are no directions of bodies, and headings are derived "
        "from positions: if another column has the directions of bodies, name it by --columns heading=COLUMN"
    )
    return replace(log, vehicles=tuple(replace(vehicle, heading=None) for vehicle in log.vehicles), notes=(*log.notes, note))


def faced(vehicle: Samples, lines: Sequence[Line], offset: tuple[float, float]) -> Samples:
    """Return a vehicle that never moves with the heading of the nearest way, if its own headings are those of no way there."""
    if np.hypot(*(vehicle.points - vehicle.points[0]).T).max() >= STEP:
        return vehicle
    point = vehicle.points.mean(axis=0, keepdims=True) + offset
    places = sorted((abs(float(aside[0])), k, at) for k, (at, aside) in enumerate(line.project(point) for line in lines))
    aheads = [lines[k].way.centre(at)[1][0] for apart, k, at in places if apart <= places[0][0] + _NEAR]
    headings = [math.atan2(*ahead[::-1]) for ahead in aheads]
    if vehicle.heading is not None and any(np.cos(vehicle.heading - ahead).mean() >= LEAST_AGREEMENT for ahead in headings):
        return vehicle
    return replace(vehicle, heading=np.full(len(vehicle.times), headings[0]))
