"""Moves and mirrors the map of a junction, and finds the rotations of a junction onto itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree.ElementTree import Element, ElementTree

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import load
from pytest_rvads.geometry.opendrive.signals import LINE_RANGE
from pytest_rvads.support.errors import MapError

Motion = tuple[float, float, float]
"""Translation x, y [m] and rotation [rad]; the rotation is applied first."""
_COEFFICIENTS = "abcd"
_MIRRORED_ATTRIBUTES = {
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": tuple(_COEFFICIENTS),
    "paramPoly3": tuple(f"{c}V" for c in _COEFFICIENTS),
    "laneOffset": tuple(_COEFFICIENTS),
    "signal": ("t", "hOffset"),
    "signalReference": ("t",),
    "object": ("t", "hdg"),
    "cornerRoad": ("t",),
    "cornerLocal": ("v",),
    "geometry": ("y", "hdg"),
    "lane": ("id",),
    "laneLink": ("from", "to"),
    "validity": ("fromLane", "toLane"),
}
"""By element of OpenDRIVE, its attributes whose sign a mirrored map changes."""


def moved(junction: Junction, motion: Motion) -> Junction:
    """Return a junction on its translated and rotated map."""
    return find(junction.id, _rewritten_map(_map_of(junction), motion))


def mirrored(junction: Junction) -> Junction:
    """Return a junction on its mirrored map, with -y instead of y and traffic on the other side."""
    return find(junction.id, _rewritten_map(_map_of(junction), None))


@lru_cache
def _map_of(junction: Junction) -> Path:
    """Return the map file of a junction; for a map in another format than OpenDRIVE, the file of the junction as OpenDRIVE."""
    if junction.map_file is None:
        raise MapError(f"junction {junction.name!r} has no map file, so it can't be moved")
    if junction.map_file.suffix.lower() == ".xodr":
        return junction.map_file
    farthest = max(junction.setbacks)
    if farthest > LINE_RANGE:
        raise MapError(
            f"junction {junction.name!r} has a stopping line {farthest:.1f} m before it, and a map in OpenDRIVE, which can be "
            f"moved, has none beyond {LINE_RANGE:g} m"
        )
    target = _new_folder() / f"{junction.map_file.stem}.xodr"
    target.write_text(junction.opendrive(), encoding="utf-8")
    return target


_FOLDER = TemporaryDirectory(prefix="rvads-", ignore_cleanup_errors=True)


def _new_folder() -> Path:
    folder = Path(_FOLDER.name) / str(len(list(Path(_FOLDER.name).iterdir())))
    folder.mkdir()
    return folder


@lru_cache
def _rewritten_map(source: Path, motion: Motion | None) -> Path:
    root = load(source)
    for element in root.iter():
        if motion is None:
            _mirror(element)
        elif element.tag == "geometry":
            x, y, angle = motion
            px, py = float(element.get("x", "0")), float(element.get("y", "0"))
            cos, sin = math.cos(angle), math.sin(angle)
            element.set("x", repr(cos * px - sin * py + x))
            element.set("y", repr(sin * px + cos * py + y))
            element.set("hdg", repr(float(element.get("hdg", "0")) + angle))
    target = _new_folder() / f"{source.stem}{'-mirrored' if motion is None else '-moved'}.xodr"
    ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def _mirror(element: Element) -> None:
    for name in _MIRRORED_ATTRIBUTES.get(element.tag, ()):
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
        # The schema requires the order left, center, right.
        element[:] = sorted(
            element, key=lambda part: ("left", "center", "right").index(part.tag) if part.tag != "userData" else 3
        )


@dataclass(frozen=True, slots=True)
class Symmetry:
    """A rotation of a junction onto itself."""

    arms: int
    """Number of arms by which the rotation moves every arm, counter-clockwise."""
    rows: int
    """Number of entrances by which the rotation moves every entrance, counter-clockwise."""


@lru_cache(maxsize=64)
def rotations_of(junction: Junction) -> tuple[Symmetry, ...]:
    """Return the rotations of a junction that keep its lanes, signs, turns, relations of entrances and groups of light phases.

    The first is the identity. A symmetric junction of four arms has four rotations, a T-junction has the identity alone.
    """
    symmetries = []
    for arms in range(junction.ways):
        images = junction.image(arms)
        if images and not broken_by(junction, arms):
            symmetries.append(Symmetry(arms, images[0][0]))
    return tuple(symmetries)


def broken_by(junction: Junction, arms: int) -> tuple[str, ...]:
    """Return the names of the properties of a junction that a rotation by `arms` arms does not keep; empty if it keeps all."""
    images = junction.image(arms)
    if images is None:
        return ("lanes",)
    entrances, exits = images

    def pairs(relation: frozenset[tuple[int, int]]) -> frozenset[tuple[int, int]]:
        return frozenset((entrances[a], entrances[b]) for a, b in relation)

    changed = []
    if any(lane.sign is not junction.entrances[entrances[e]].sign for e, lane in enumerate(junction.entrances)):
        changed.append("signs")
    if pairs(junction.right_of) != junction.right_of:
        changed.append("right-of")
    if pairs(junction.opposite) != junction.opposite:
        changed.append("opposite")
    turns = {key: m.turn for key, m in junction.movements.items()}
    if {(entrances[a], exits[b]): turn for (a, b), turn in turns.items()} != turns:
        changed.append("turns")
    groups = frozenset(junction.phase_groups)
    if frozenset(frozenset(entrances[e] for e in group) for group in groups) != groups:
        changed.append("light groups")
    return tuple(changed)
