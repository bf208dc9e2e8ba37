"""The Junction Finder: junctions by name, by map and id, by type, or by the nearest point; and the kinds of junctions.

A kind is given by control, number of arms, and length of approaches.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.arms import FEWEST, MOST
from pytest_rvads.geometry.builtin import NAMES, path_of
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.support.errors import MapError, require, suggest

_TYPE = re.compile(
    r"(?P<ways>\d+)-way\s+(?P<control>(all-way\s+)?stops?|(traffic\s+)?lights?|none|uncontrolled|yields?|partial)"
    r"(\s+with\s+(at\s+least\s+)?(?P<approach>\d+(\.\d+)?)\s*m(\s+of\s+approach)?)?",
    re.IGNORECASE,
)
_KEYS = ("control", "arms", "approach")

_PLACE = re.compile(r"nearest(?:\s+to)?\s*\(?\s*(?P<x>[-+.\deE]+)\s*[,\s]\s*(?P<y>[-+.\deE]+)\s*\)?", re.IGNORECASE)
_maps: dict[tuple[str, int, int], RoadMap] = {}
_junctions: dict[tuple[tuple[str, int, int], str, str], Junction] = {}


@dataclass(frozen=True, slots=True)
class Kinds:
    """A condition on the control, the number of arms and the approaches of a junction; each of the three can be left free."""

    control: tuple[JunctionControl, ...] = ()
    """The allowed controls; empty for any control."""
    arms: tuple[int, ...] = ()
    """The allowed numbers of arms; empty for any number."""
    approach: float = 0.0
    """Least length of approaches, from the previous junction to the stopping line [m]."""

    @classmethod
    def of(cls, properties: Mapping[str, Any]) -> Kinds:
        """Return the condition in a mapping such as ``{"control": ["stop", "lights"], "arms": 4, "approach": 40}``."""
        require(properties, Mapping, "kinds of junctions are a dict such as {'control': 'stop', 'arms': (3, 4)}", MapError)
        for key in properties:
            if key not in _KEYS:
                hint = suggest(key, _KEYS) if isinstance(key, str) else ""
                raise MapError(f"kinds of junctions are told by {', '.join(_KEYS)}, got {key!r}{hint}")
        if not properties:
            raise MapError(f"kinds of junctions are empty: tell them by {', '.join(_KEYS)}, or leave them out")
        controls, approach = tuple(JunctionControl), properties.get("approach", 0.0)
        control = _values_of("control", properties, controls, f"one or several of {', '.join(controls)}")
        arms = _values_of("arms", properties, range(FEWEST, MOST + 1), f"numbers from {FEWEST} to {MOST}, one or several")
        if isinstance(approach, bool) or not isinstance(approach, int | float) or not 0 <= approach < math.inf:
            raise MapError(f"approach of kinds of junctions must be a length in metres, 0 or more, got {approach!r}")
        return cls(tuple(map(JunctionControl, control)), tuple(map(int, arms)), float(approach))

    @classmethod
    def parse(cls, text: str) -> Kinds | None:
        """Return the condition in a text such as "4-way stop with 40 m of approach"; None if the text states no condition."""
        match = _TYPE.fullmatch(text.strip())
        if match is None:
            return None
        control_text = match["control"].lower()
        control = next((kind for kind in JunctionControl if kind.value.removesuffix("s") in control_text), JunctionControl.NONE)
        return cls((control,), (int(match["ways"]),), float(match["approach"] or 0.0))

    def match(self, report: JunctionReport) -> bool:
        """Return whether control and number of arms of a junction meet this condition; without entrances, no control does."""
        if self.arms and report.ways not in self.arms:
            return False
        return not self.control or (bool(report.entrances) and report.control in self.control)

    def fit(self, report: JunctionReport) -> bool:
        """Return whether scenarios can use a junction, and the junction and its approaches meet this condition."""
        return report.usable and self.match(report) and report.usable_from >= self.approach

    def __str__(self) -> str:
        parts = [" or ".join(self.control)] if self.control else []
        parts += [f"{' or '.join(map(str, self.arms))} arms"] if self.arms else []
        return ", ".join([*parts, *([f"{self.approach:g} m of approach"] if self.approach else [])])


def _values_of(key: str, properties: Mapping[str, Any], allowed: Iterable[Any], expected: str) -> tuple[Any, ...]:
    """Return the values under a key of a mapping as a tuple; empty if the key is missing."""
    if key not in properties:
        return ()
    value, allowed = properties[key], tuple(allowed)
    values = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (value,)
    if not values or any(isinstance(item, bool) or item not in allowed for item in values):
        raise MapError(f"{key} of kinds of junctions must be {expected}, got {value!r}")
    return values


def names() -> tuple[str, ...]:
    """Return the names of the built-in junctions."""
    return tuple(NAMES)


def find(junction: str, map: str | os.PathLike[str] | None = None) -> Junction:
    """Return a junction; each junction is read once per process.

    Args:
        junction: a built-in name; the id of a ``<junction>`` in `map`; a type such as "4-way all-way stop", "3-way lights",
            "4-way none" or "4-way lights with 40 m of approach", for the first junction of this type in file order; or a place
            such as "nearest to 52, 149" [m], for the usable junction nearest to this point of the map.
        map: a map file (OpenDRIVE, Lanelet2 or CommonRoad), or None for the built-in maps.

    Raises:
        MapError: the junction is unknown or unusable, the map is unreadable, or no junction has this type.
    """
    require(junction, str, "find takes the name, id or type of a junction as a text, such as 'stop4'", MapError)
    kinds = Kinds.parse(junction)
    if map is None:
        return _builtin(junction, kinds)
    road_map, key = _load(map)
    is_id = any(report.id == junction for report in road_map.junctions)
    if not is_id and (place := _PLACE.fullmatch(junction.strip())):
        return nearest(map, _coordinate(place["x"]), _coordinate(place["y"]))
    id = junction
    if kinds and not is_id:
        fitting = next((report.id for report in road_map.junctions if kinds.fit(report)), None)
        if fitting is None:
            raise MapError(f"map file {road_map.path} has no usable junction that fits {junction!r}; {offer(road_map)}")
        id = fitting
    return _junction(road_map, key, id, name_of(map, id))


def nearest(map: str | os.PathLike[str], x: float, y: float) -> Junction:
    """Return the usable junction of `map` whose centre is nearest to the point (`x`, `y`) [m]."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise MapError(f"the point ({x!r}, {y!r}) is no place on a map, expected two finite coordinates in metres")
    road_map, key = _load(map)
    usable = [report for report in road_map.junctions if report.usable]
    if not usable:
        raise MapError(f"map file {map} has no usable junction; {offer(road_map)}")

    def distance(report: JunctionReport) -> float:
        arms = report.arms
        return math.dist((x, y), (math.fsum(a.x for a in arms) / len(arms), math.fsum(a.y for a in arms) / len(arms)))

    id = min(usable, key=distance).id
    return _junction(road_map, key, id, name_of(map, id))


def called(name: str, map: str | os.PathLike[str]) -> Junction:
    """Return the junction of `map` with this name (``stem.id``) or this id."""
    ids = {name_of(map, report.id): report.id for report in load(map).junctions}
    return find(ids.get(name, name), map)


def load(map: str | os.PathLike[str]) -> RoadMap:
    """Return the content of a map file. The file is read once per process, and again when the file has changed."""
    return _load(map)[0]


def name_of(map: str | os.PathLike[str], id: str) -> str:
    """Return the name of junction `id` of a map in the ids of tests: ``stem.id``, with ``_`` for all but letters and digits."""
    return ".".join(re.sub(r"[^A-Za-z0-9_]", "_", part) for part in (Path(map).stem, id))


def offer(road_map: RoadMap) -> str:
    """Return the end of an error message, which lists the usable junctions of a map by type."""
    table: dict[str, list[JunctionReport]] = {}
    for report in road_map.junctions:
        if report.usable:
            table.setdefault(f"{report.ways}-way {report.control.value}", []).append(report)
    if not table:
        return f"none of its junctions is usable, `rvads map {road_map.path}` says why"
    parts = []
    for type, reports in table.items():
        longest = max(report.usable_from for report in reports)
        parts.append(f"{len(reports)} {type} with up to {longest:.0f} m of approach")
    return f"it offers {'; '.join(parts)}"


@lru_cache
def _builtin(junction: str, kinds: Kinds | None) -> Junction:
    """Return a built-in junction; unlike a user's file, its file is not checked for changes."""
    if kinds is None and junction not in NAMES:
        raise MapError(
            f"unknown junction {junction!r}: the built-in ones are {', '.join(NAMES)}, "
            f"others need a map file{suggest(junction, NAMES)}"
        )
    for name in NAMES if kinds else (junction,):
        road_map, key = _load(path_of(name))
        report = road_map.junctions[0]
        if not kinds or kinds.fit(report):
            return replace(_junction(road_map, key, report.id, name), map=None)
    raise MapError(
        f"no built-in junction fits {junction!r}: they are {', '.join(NAMES)}, with 120 m of approach; give a map file"
    )


def _load(map: str | os.PathLike[str]) -> tuple[RoadMap, tuple[str, int, int]]:
    try:
        path = Path(map).resolve()
        stat = path.stat()
    except (OSError, ValueError, RuntimeError, TypeError):
        return read_map(map), ("", 0, 0)
    key = str(path), stat.st_mtime_ns, stat.st_size
    if key not in _maps:
        _maps[key] = read_map(map)
    return _maps[key], key


def _junction(road_map: RoadMap, key: tuple[str, int, int], id: str, name: str) -> Junction:
    entry = key, id, name
    if entry not in _junctions:
        _junctions[entry] = road_map.junction(id, name=name)
    return _junctions[entry]


def _coordinate(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise MapError(f"{text!r} is no coordinate, expected two numbers such as in 'nearest to 52, 149'") from None
