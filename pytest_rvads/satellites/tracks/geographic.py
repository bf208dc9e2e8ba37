"""Projects tracks in degrees of longitude and latitude onto the plane of a map."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from pytest_rvads.geometry.opendrive.xmlfile import load, number
from pytest_rvads.satellites.lanelet2.osm_file import mercator, read_osm
from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.wording import one_line

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
