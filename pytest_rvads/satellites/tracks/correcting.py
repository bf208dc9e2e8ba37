"""Brings a log into agreement with its map: coordinates in degrees, headings, and a systematic distance beside the lanes.

Tracks in degrees of longitude and latitude are projected onto the plane of the map.

The heading of a vehicle is the direction of its body. Some logs also, or only, have the direction in which the centre of the
vehicle moves. While the vehicle stands, this direction is noise, or zero, and the headings are dropped.

The lateral distances of all matched vehicles from their ways are explained by one shift and one rotation of all tracks. Where
vehicles drive beside the middle of their lanes for reasons of their own, a shift and rotation explain little.
"""

from __future__ import annotations

import cmath
import math
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from pytest_rvads.geometry.opendrive.map_file import load, number
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.lanelet2.lanelet_map import mercator, read_osm
from pytest_rvads.satellites.tracks.matching import STEP, Line, directions, evenly_spaced
from pytest_rvads.satellites.tracks.samples import Log, Samples
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.wording import one_line

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


_FARTHEST = 6.0
"""Largest distance of a track from the middle meridian, and from the origin of a map [degrees]: the width of a zone of UTM."""


def on_plane(log: Log, map: str | os.PathLike[str] | None) -> Log:
    """Return a log in the coordinates of a map, whose vehicles had degrees of longitude and latitude."""
    if map is not None and Path(map).suffix.lower() == ".osm":
        origin = read_osm(map).origin
        projection, stated = (None if origin is None else (origin, 1.0, (0.0, 0.0))), "no degrees"
    else:
        projection, stated = _stated(map)
    if projection is None:
        raise RunError(
            f"{log.where} has degrees of longitude and latitude, and {map or 'the junction'} has {stated}, expected a transverse "
            "Mercator projection (+proj=tmerc or +proj=utm): give x and y in the metres of the map"
        )
    (latitude, middle), scale, shift = projection
    zero, vehicles = mercator(np.array([[latitude, middle]]), middle), []
    for vehicle in log.vehicles:
        if (np.abs(vehicle.points - (middle, 0.0)) > (_FARTHEST, 89.0)).any():
            raise RunError(f"{log.where}: {vehicle.name} is over {_FARTHEST:g} degrees from the meridian {middle:g} of {map}")
        points = scale * (mercator(vehicle.points[:, ::-1], middle) - zero) + shift
        vehicles.append(replace(vehicle, points=points))
    return replace(log, vehicles=tuple(vehicles), degrees=False)


_Projection = tuple[tuple[float, float], float, tuple[float, float]]
"""Latitude of the origin and longitude of the middle meridian [degrees], scale, and x and y of the origin [m]."""


def _stated(map: str | os.PathLike[str] | None) -> tuple[_Projection | None, str]:
    """Return the projection that an OpenDRIVE file states in the notation of PROJ, and what the file states in words."""
    header = None
    with suppress(MapError):  # a map of another format states none
        header = None if map is None else load(map).find("header")
    text = ("" if header is None else header.findtext("geoReference") or "").strip()
    stated = f"the <geoReference> {one_line(text, 80)!r}" if text else "no <geoReference>"
    words = dict(word.lstrip("+").partition("=")[::2] for word in text.split())
    offset = None if header is None else header.find("offset")
    moved = [0.0 if offset is None else number(offset, name, f"map file {map}", 0.0) for name in ("x", "y")]
    try:
        if words.get("proj") == "utm":
            north = 10_000_000.0 if "south" in words else 0.0
            return ((0.0, 6.0 * int(words["zone"]) - 183.0), 0.9996, (500_000.0 - moved[0], north - moved[1])), stated
        if words.get("proj") == "tmerc":
            latitude, middle, x, y = (float(words.get(name, 0.0)) for name in ("lat_0", "lon_0", "x_0", "y_0"))
            return ((latitude, middle), float(words.get("k_0") or words.get("k") or 1.0), (x - moved[0], y - moved[1])), stated
    except (KeyError, ValueError):
        pass
    return None, stated


TOLERATED = 0.5
"""Largest systematic distance of tracks beside the lanes without a warning [m]: less than the room beside a car in its lane."""
_WEAKEST = 0.05
"""Singular values below this share of the largest are left out: if all vehicles drive on one straight road, their lateral
distances do not show a shift along the road."""


@dataclass(frozen=True, slots=True)
class Misalignment:
    """The shift and the rotation by which tracks lie beside the lanes, estimated by least squares."""

    lateral: float
    """Mean lateral distance of the tracks from their ways, positive to the left [m]."""
    systematic: float
    """Root mean square of the lateral distances that the correction takes away [m]."""
    shift: tuple[float, float]
    """Correction of x and y at `centre` [m]."""
    rotation: float
    """Correction of the headings, counter-clockwise [rad]."""
    centre: tuple[float, float]
    """Mean of the compared points, about which the tracks are rotated [m]."""

    def in_words(self) -> str:
        """Return the sizes of the misalignment and of the correction in words."""
        return (
            f"lie {self.systematic:.2f} m beside the lanes (mean {self.lateral:+.2f} m, left is positive); a shift by "
            f"({self.shift[0]:.2f}, {self.shift[1]:.2f}) m and a turn by {math.degrees(self.rotation):.2f} degrees about "
            f"({self.centre[0]:.0f}, {self.centre[1]:.0f}) would bring them onto the lanes"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return {
            "lateral": round(self.lateral, 4),
            "systematic": round(self.systematic, 4),
            "shift": [round(number, 4) for number in self.shift],
            "rotation": round(self.rotation, 6),
            "centre": [round(number, 4) for number in self.centre],
        }

    def similarity(self, offset: tuple[float, float]) -> tuple[complex, complex]:
        """Return the correction as arguments of `Log.moved`, for a log to whose positions `offset` [m] is added later."""
        turn, centre, later = cmath.rect(1.0, self.rotation), complex(*self.centre), complex(*offset)
        return turn, turn * (later - centre) + centre + complex(*self.shift) - later


def misalignment_of(recordings: Sequence[Recording]) -> Misalignment:
    """Return by how much the tracks of recordings of one log lie beside the lanes.

    A small shift ``d`` and rotation ``r`` about the centre ``c`` change the lateral distance of a point ``p`` of a track by
    ``n . (d + r J (p - c))``, where ``n`` points to the left of the way and ``J`` turns by 90 degrees. The returned correction
    has the least sum of squares of the lateral distances of points at equal distances along the tracks.
    """
    points, lefts, laterals = [], [], []
    for recording in recordings:
        for track in recording.vehicles:
            picked = evenly_spaced(track.pose[:, :2])
            way = Itinerary.through(recording.junction, track.agent.way.entrance, track.agent.way.exit)
            middle, ahead = way.centre(track.station[picked])
            left = np.column_stack((-ahead[:, 1], ahead[:, 0]))
            points.append(track.pose[picked, :2])
            lefts.append(left)
            laterals.append(((track.pose[picked, :2] - middle) * left).sum(axis=1))
    place, left, lateral = np.vstack(points), np.vstack(lefts), np.concatenate(laterals)
    centre = place.mean(axis=0)
    apart = place - centre
    radius = max(float(np.sqrt((apart**2).sum(axis=1).mean())), 1.0)
    turning = (left * np.column_stack((-apart[:, 1], apart[:, 0]))).sum(axis=1) / radius
    effect = np.column_stack((left, turning))
    x, y, turned = np.linalg.lstsq(effect, -lateral, rcond=_WEAKEST)[0].tolist()
    systematic = math.sqrt(float(((effect @ [x, y, turned]) ** 2).mean()))
    return Misalignment(float(lateral.mean()), systematic, (x, y), turned / radius, (float(centre[0]), float(centre[1])))
