"""Map files moved or mirrored: the same junction elsewhere, or with traffic on the other side."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element, ElementTree

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.builtin import LAYOUTS, path_of
from pytest_rvads.junctions.finder import find
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.opendrive.xmlfile import load

__all__ = ["Motion", "mirrored", "moved"]

Motion = tuple[float, float, float]
"""Translation x, y [m] and rotation [rad], rotation first."""
_COEFFICIENTS = "abcd"
_SIDE = {
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": tuple(_COEFFICIENTS),
    "paramPoly3": tuple(f"{c}V" for c in _COEFFICIENTS),
    "laneOffset": tuple(_COEFFICIENTS),
    "signal": ("t", "hOffset"),
    "signalReference": ("t",),
    "object": ("t", "hdg"),
    "geometry": ("y", "hdg"),
    "lane": ("id",),
    "laneLink": ("from", "to"),
    "validity": ("fromLane", "toLane"),
}
"""Attributes that change sign in a mirror."""


def moved(junction: Junction, motion: Motion) -> Junction:
    """Return a junction on its map, translated and rotated; written and read once per process.

    Raises:
        MapError: it is from no map, or one that can't be read.
    """
    return find(junction.id, _rewritten(_source(junction), motion))


def mirrored(junction: Junction) -> Junction:
    """Return a junction on its map seen in a mirror, y to -y, so that traffic keeps to the other side.

    Raises:
        MapError: it is from no map, or one that can't be read.
    """
    return find(junction.id, _rewritten(_source(junction), None))


def _source(junction: Junction) -> Path:
    if junction.map is None and junction.name in LAYOUTS:
        return path_of(junction.name)
    if junction.map is None:
        raise MapError(f"junction {junction.name!r} is from no map file, so it can't be moved")
    return Path(junction.map)


_FOLDER = TemporaryDirectory(prefix="rvads-", ignore_cleanup_errors=True)


@lru_cache
def _rewritten(source: Path, motion: Motion | None) -> Path:
    root = load(source)
    for element in root.iter():
        if motion is None:
            _mirror(element)
        elif element.tag == "geometry":
            _move(element, *motion)
    number = len(list(Path(_FOLDER.name).iterdir()))
    folder = Path(_FOLDER.name) / str(number)
    folder.mkdir()
    target = folder / f"{source.stem}{'-mirrored' if motion is None else '-moved'}.xodr"
    ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def _move(geometry: Element, x: float, y: float, angle: float) -> None:
    px, py = float(geometry.get("x", "0")), float(geometry.get("y", "0"))
    cos, sin = math.cos(angle), math.sin(angle)
    geometry.set("x", repr(cos * px - sin * py + x))
    geometry.set("y", repr(sin * px + cos * py + y))
    geometry.set("hdg", repr(float(geometry.get("hdg", "0")) + angle))


def _mirror(element: Element) -> None:
    for name in _SIDE.get(element.tag, ()):
        value = element.get(name)
        if value is not None:
            element.set(name, value[1:] if value.startswith("-") else f"-{value}" if value.strip("0.") else value)
    if element.tag == "road":
        element.set("rule", "RHT" if element.get("rule") == "LHT" else "LHT")
    elif element.tag == "lane":
        for link in element.iter():
            if link.tag in ("predecessor", "successor") and link.get("id"):
                link.set("id", str(-int(link.get("id", "0"))))
    elif element.tag == "laneSection":
        left, right = element.find("left"), element.find("right")
        for side, tag in ((left, "right"), (right, "left")):
            if side is not None:
                side.tag = tag
                side[:] = list(side)[::-1]
        # The schema wants left, center, right.
        element[:] = sorted(
            element, key=lambda part: ("left", "center", "right").index(part.tag) if part.tag != "userData" else 3
        )
