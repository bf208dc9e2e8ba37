"""Projects tracks in degrees of longitude and latitude onto the plane of a map."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.opendrive.xmlfile import load
from pytest_rvads.satellites.lanelet2.osm_file import read_osm, transverse
from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.wording import one_line

__all__ = ["on_plane"]

_Values = NDArray[np.float64]


def on_plane(log: Log, map: str | os.PathLike[str] | None) -> Log:
    """Return a log in the coordinates of a map, whose vehicles had degrees of longitude and latitude.

    Raises:
        RunError: the map does not state a projection, or a projection that is not read.
        MapError: the map can't be read.
    """
    project, stated = _projection(map)
    if project is None:
        raise RunError(
            f"{log.where} has degrees of longitude and latitude, and {map or 'the junction'} has {stated}, expected a transverse "
            "Mercator projection (+proj=tmerc or +proj=utm): give x and y in the metres of the map"
        )
    vehicles = tuple(replace(vehicle, points=project(vehicle.points[:, ::-1])) for vehicle in log.vehicles)
    return replace(log, vehicles=vehicles, degrees=False)


def _projection(map: str | os.PathLike[str] | None) -> tuple[Callable[[_Values], _Values] | None, str]:
    """Return the projection of latitudes and longitudes [degrees] that a map states, and what it states in words."""
    if map is not None and Path(map).suffix.lower() == ".osm":
        origin = read_osm(map).origin
        return (lambda places: transverse(places, origin)) if origin else None, "no nodes with latitudes and longitudes"
    try:
        header = None if map is None else load(map).find("header")
    except MapError:
        header = None  # a map of another format
    text = ("" if header is None else header.findtext("geoReference") or "").strip()
    words = dict(word.lstrip("+").partition("=")[::2] for word in text.split())
    stated = f"the <geoReference> {one_line(text, 80)!r}" if text else "no <geoReference>"
    try:
        number = {name: float(words.get(name) or default) for name, default in _DEFAULTS.items()}
    except ValueError:
        return None, stated
    origin, scale, shift = (
        (number["lat_0"], number["lon_0"]),
        number["k_0"] if "k_0" in words else number["k"],
        (number["x_0"], number["y_0"]),
    )
    if words.get("proj") == "utm":
        origin, scale, shift = (0.0, 6.0 * number["zone"] - 183.0), 0.9996, (500_000.0, 10_000_000.0 if "south" in words else 0.0)
    offset = None if header is None else header.find("offset")
    if offset is not None:  # from the coordinates of the file to the projection
        shift = shift[0] - float(offset.get("x") or 0.0), shift[1] - float(offset.get("y") or 0.0)
    known = words.get("proj") in ("tmerc", "utm")
    return (lambda places: transverse(places, origin, scale) + shift) if known else None, stated


_DEFAULTS = {"lat_0": 0.0, "lon_0": 0.0, "k": 1.0, "k_0": 1.0, "x_0": 0.0, "y_0": 0.0, "zone": 0.0}
"""Parameters of a projection in the notation of PROJ, and their values if a map does not state them."""
