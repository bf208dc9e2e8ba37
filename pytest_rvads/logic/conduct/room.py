"""Computes whether a car that stands before its line leaves enough room for cars that turn past it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.network import Doubt, MapWarning
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.geometry.sweep import BEHIND, CAR, STEP, plan
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.bodies import touch
from pytest_rvads.logic.conduct.standing import STOP_PLACE
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.support.wording import plural

_MARGIN = 0.15
"""Least distance between the moving and the standing body [m]: the reference driver keeps 0.1 m, its rear axle errs by 0.03 m."""
_ASIDE = 1.0
"""Longest distance by which a planned path leaves the centre line [m]; a path is planned only if a standing body is that near."""
PLACES = np.arange(0.0, 10.0, 0.25)
"""Distances before the line at which a standing car is tried [m]; they reach over twice the length of the stop place."""


@lru_cache(maxsize=64)  # one table for all copies of a junction
def room(junction: Junction) -> Mapping[tuple[int, Key], NDArray[np.bool_]]:
    """Return, per entrance and movement, whether a car `PLACES` before the line is in the way of the movement, ``(places,)``.

    A pair that is not a key has no place in the way.
    """
    standing: dict[int, NDArray[np.float64]] = {}  # poses of a car that stands at `PLACES` before its line, shape (places, 3)
    for entrance in sorted({key[0] for key in junction.movements}):
        way = itinerary(junction, *min(key for key in junction.movements if key[0] == entrance))
        standing[entrance] = np.array([way.placed(way.start(back), CAR.axle) for back in PLACES])
    table: dict[tuple[int, Key], NDArray[np.bool_]] = {}
    for key in sorted(junction.movements):
        entrances = [k for k in standing if junction.entrances[k].arm != junction.entrances[key[0]].arm]
        near_entrances = [
            k for k in entrances if _hits(_poses(junction, key, planned=False), standing[k], _MARGIN + _ASIDE).any()
        ]
        if near_entrances:
            swept = _poses(junction, key, planned=True)
            hits = {entrance: _hits(swept, standing[entrance], _MARGIN) for entrance in near_entrances}
            table |= {(entrance, key): places for entrance, places in hits.items() if places.any()}
    return MappingProxyType(table)


@lru_cache(maxsize=1024)
def stand_back(junction: Junction, entrance: int) -> float:
    """Return how far before its line a car must stop, within the stop place, to be in the way of the fewest movements [m]."""
    hits = [places for (lane, _), places in room(junction).items() if lane == entrance]
    return float(PLACES[np.sum(hits, axis=0)[PLACES < STOP_PLACE].argmin()]) if hits else 0.0


@lru_cache(maxsize=4096)
def leaves_room(junction: Junction, entrance: int, key: Key) -> float:
    """Return how far before the line of its entrance a car has to stand to leave room for cars on a movement [m]; or infinity."""
    places = room(junction).get((entrance, key))
    return 0.0 if places is None else float(next(iter(PLACES[~places]), math.inf))


def narrow_lines(road_map: RoadMap) -> list[MapWarning]:
    """Return a warning for every junction of a map at which a car at its line leaves no room for cars on a movement."""
    warnings = []
    for report in road_map.junctions:
        junction = road_map.junction(report.id) if report.usable else None
        pairs = sorted(room(junction)) if junction else []
        if junction and pairs:
            distances = [leaves_room(junction, *pair) for pair in pairs]
            back, (lane, (entrance, exit)) = max(zip(distances, pairs, strict=True))
            where = f"in the last {PLACES[-1]:g} m" if back == math.inf else f"less than {back:g} m"
            more = f"; nor do {plural(len(pairs) - 1, 'more pair')} of line and movement" if len(pairs) > 1 else ""
            warnings.append(
                MapWarning(
                    Doubt.ROOM,
                    f"a usual car that stands {where} before the line of entrance {lane} of junction {report.id!r} leaves no "
                    f"room for the movement from entrance {entrance} to exit {exit}{more}",
                    None,
                    report.id,
                )
            )
    return warnings


def _poses(junction: Junction, key: Key, *, planned: bool) -> NDArray[np.float64]:
    """Return the poses of a car along a movement, shape ``(places, 3)``.

    If `planned`, the rear axle follows a path that keeps the car in its lane; if not, or without such a path, the centre line.
    """
    way = itinerary(junction, *key)
    course = way.course(junction.lane_width, -math.inf)
    path = plan(course, CAR) if planned else None
    points = path.points if path else way.centre(np.arange(course.start - CAR.axle, course.length + BEHIND, STEP))[0]
    along = np.gradient(points, axis=0)
    ahead = along / np.hypot(along[:, 0], along[:, 1])[:, None]
    return np.column_stack((points + CAR.axle * ahead, np.arctan2(ahead[:, 1], ahead[:, 0])))


def _hits(moving: NDArray[np.float64], standing: NDArray[np.float64], margin: float) -> NDArray[np.bool_]:
    """Return whether a moving car comes nearer than a margin [m] to each standing car, shape ``(standing,)``."""
    apart = np.hypot(*(moving[:, None, :2] - standing[None, :, :2]).transpose(2, 0, 1))
    moving_index, standing_index = np.nonzero(apart < 2.0 * (CAR.length + margin))
    if not len(moving_index):
        return np.zeros(len(standing), dtype=np.bool_)
    front = moving[moving_index] + margin * np.column_stack(
        (np.cos(moving[moving_index, 2]), np.sin(moving[moving_index, 2]), np.zeros(len(moving_index)))
    )
    wide = CAR.length + 2.0 * margin, CAR.width + 2.0 * margin
    touching = touch([(front, wide), (standing[standing_index], (CAR.length, CAR.width))])
    return np.bincount(standing_index[touching], minlength=len(standing)) > 0
