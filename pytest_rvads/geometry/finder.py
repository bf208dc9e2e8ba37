"""The Junction Finder: one junction by name, by map and id, by type or by the nearest point, and the choice of several junctions.

Several junctions are all of a map, those of some kinds, or a sample. A kind is given by control, number of arms, and length of
approaches.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.arms import FEWEST, MOST
from pytest_rvads.geometry.conflicts import JunctionKind
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import NAMES, path_of
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.support.errors import MapError, require, suggest
from pytest_rvads.support.stratified import draw

_TYPE = re.compile(
    r"(?P<ways>\d+)-way\s+(?P<control>(all-way\s+)?stops?|(traffic\s+)?lights?|none|uncontrolled|yields?|partial)"
    r"(\s+with\s+(at\s+least\s+)?(?P<approach>\d+(\.\d+)?)\s*m(\s+of\s+approach)?)?",
    re.IGNORECASE,
)
_KEYS = ("control", "arms", "approach")

_PLACE = re.compile(r"nearest(?:\s+to)?\s*\(?\s*(?P<x>[-+.\deE]+)\s*[,\s]\s*(?P<y>[-+.\deE]+)\s*\)?", re.IGNORECASE)
_maps: dict[tuple[str, int, int], RoadMap] = {}


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
    road_map = load(map)
    is_id = any(report.id == junction for report in road_map.junctions)
    if not is_id and (place := _PLACE.fullmatch(junction.strip())):
        return nearest(map, _coordinate(place["x"]), _coordinate(place["y"]))
    id = junction
    if kinds and not is_id:
        fitting = next((report.id for report in road_map.junctions if kinds.fit(report)), None)
        if fitting is None:
            raise MapError(f"map file {road_map.path} has no usable junction that fits {junction!r}; {offer(road_map)}")
        id = fitting
    return _junction(road_map, id, name_of(map, id))


def nearest(map: str | os.PathLike[str], x: float, y: float) -> Junction:
    """Return the usable junction of `map` whose centre is nearest to the point (`x`, `y`) [m]."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise MapError(f"the point ({x!r}, {y!r}) is no place on a map, expected two finite coordinates in metres")
    road_map = load(map)
    usable = [report for report in road_map.junctions if report.usable]
    if not usable:
        raise MapError(f"map file {map} has no usable junction; {offer(road_map)}")

    def distance(report: JunctionReport) -> float:
        arms = report.arms
        return math.dist((x, y), (math.fsum(a.x for a in arms) / len(arms), math.fsum(a.y for a in arms) / len(arms)))

    id = min(usable, key=distance).id
    return _junction(road_map, id, name_of(map, id))


def called(name: str, map: str | os.PathLike[str]) -> Junction:
    """Return the junction of `map` with this name (``stem.id``) or this id."""
    ids = {name_of(map, report.id): report.id for report in load(map).junctions}
    return find(ids.get(name, name), map)


def load(map: str | os.PathLike[str]) -> RoadMap:
    """Return the content of a map file. The file is read once per process, and again when the file has changed."""
    try:
        path = Path(map).resolve()
        stat = path.stat()
    except (OSError, ValueError, RuntimeError, TypeError):
        return read_map(map)
    key = str(path), stat.st_mtime_ns, stat.st_size
    if key not in _maps:
        _maps[key] = read_map(map)
    return _maps[key]


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
        road_map = load(path_of(name))
        report = road_map.junctions[0]
        if not kinds or kinds.fit(report):
            return replace(_junction(road_map, report.id, name), map=None)
    raise MapError(
        f"no built-in junction fits {junction!r}: they are {', '.join(NAMES)}, with 120 m of approach; give a map file"
    )


@cache
def _junction(road_map: RoadMap, id: str, name: str) -> Junction:
    return road_map.junction(id, name=name)


def _coordinate(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise MapError(f"{text!r} is no coordinate, expected two numbers such as in 'nearest to 52, 149'") from None


EVERY = "*"
"""The text with which a user requests all junctions of a map."""
_FREE = "no two of its movements meet, so nobody has to give way there: ask for it by its id to drive there all the same"
Map = str | os.PathLike[str] | None


@dataclass(frozen=True, slots=True)
class Refused:
    """A requested junction that scenarios can't use, or in which no two ways (paths through the junction) meet."""

    junction: str
    map: str | None
    ways: int
    """Number of arms."""
    control: str
    """Control of the junction; empty if the junction has no entrances."""
    reason: str

    @property
    def name(self) -> str:
        """Name of the junction in the ids of tests."""
        return name_of(self.map, self.junction) if self.map else self.junction


@dataclass(frozen=True, slots=True)
class Choice:
    """The chosen junctions, and the requested junctions that were not chosen."""

    junctions: tuple[Junction, ...]
    """The junctions in the order of the request; those of a map in the order of its file."""
    refused: tuple[Refused, ...]
    passed_over: int
    """Number of suitable junctions that were not chosen because of the limit."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A suitable junction whose geometry is not yet cut from its map."""

    map: Map
    id: str
    """Id in the map, or the name of a built-in junction."""
    report: JunctionReport
    alone: bool
    """Whether the request named the junction itself, rather than several junctions."""


def choose(
    wanted: str | Iterable[str], map: Map = None, *, kinds: Kinds | None = None, limit: int | None = None, seed: int = 0
) -> Choice:
    """Return the requested junctions of a map, or of the built-in maps.

    A text is an id in `map`, ``"*"`` for all junctions, a type such as "4-way stop" or "3-way lights with 40 m of approach" for
    all junctions of this type, or a place such as "nearest to 52, 149" [m]. Without a map, a type gives the first built-in
    junction of this type, as in `find`, because built-in junctions come in variants.
    """
    texts = (wanted,) if isinstance(wanted, str) or not isinstance(wanted, Iterable) else tuple(wanted)
    for text in texts:
        require(text, str, "choose takes names, ids or types of junctions as texts, such as '*' or '4-way stop'", MapError)
    return choose_among([(text, map) for text in texts], kinds=kinds, limit=limit, seed=seed)


def choose_among(
    wanted: Iterable[tuple[str, Map]], *, kinds: Kinds | None = None, limit: int | None = None, seed: int = 0
) -> Choice:
    """Return the requested junctions, given as pairs of text and map; see `choose` for the other arguments."""
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int) or limit < 1):
        raise MapError(f"limit must be a whole number of junctions, 1 or more, got {limit!r}")
    requests = list(wanted)
    if not requests:
        raise MapError(f"no junction was asked for: name some, or take {EVERY!r} for all of a map")
    candidates: dict[tuple[Map, str], _Candidate] = {}
    refused: dict[tuple[Map, str], Refused] = {}
    for text, map in requests:
        for candidate in _candidates_of(text, map, kinds, refused):
            candidates.setdefault((candidate.map, candidate.id), candidate)
    if not candidates:
        raise MapError(
            f"none of {', '.join(repr(text) for text, _ in requests)} is of the kinds asked for ({kinds}): name others"
        )
    junctions = []
    for candidate in candidates.values():
        try:
            place = find(candidate.id, candidate.map)
            if place.kind is JunctionKind.CONFLICT_FREE and not candidate.alone:
                raise MapError(_FREE)
            junctions.append(place)
        except MapError as error:
            if candidate.alone:
                raise
            refused[candidate.map, candidate.id] = _refusal(candidate, str(error))
    if not junctions:
        raise MapError(f"no junction asked for can be used, the first of them: {next(iter(refused.values())).reason}")
    drawn = some(junctions, limit, seed)
    return Choice(drawn, tuple(refused.values()), len(junctions) - len(drawn))


def some(junctions: Sequence[Junction], limit: int | None, seed: int) -> tuple[Junction, ...]:
    """Return at most `limit` junctions, in order, drawn as evenly as possible from every kind: control and number of arms."""
    if limit is None:
        return tuple(junctions)

    def kind(junction: Junction) -> tuple[str, ...]:
        return (f"{junction.ways}-way {junction.control.value}",)

    return tuple(draw(junctions, limit, seed, kind, lambda junction: junction.name))


def _refusal(candidate: _Candidate, reason: str) -> Refused:
    control = candidate.report.control.value if candidate.report.entrances else ""
    return Refused(
        candidate.id, None if candidate.map is None else os.fspath(candidate.map), candidate.report.ways, control, reason
    )


def _candidates_of(text: str, map: Map, kinds: Kinds | None, refused: dict[tuple[Map, str], Refused]) -> Iterator[_Candidate]:
    """Yield the junctions of the given kinds that a text requests, and add the unusable junctions to `refused`."""
    if map is None:
        chosen = names() if text == EVERY else (find(text).name,)
        for name in chosen:
            report = load(path_of(name)).junctions[0]
            if kinds is None or kinds.fit(report):
                yield _Candidate(None, name, report, alone=text != EVERY)
        return
    road_map = load(map)
    type = Kinds() if text == EVERY else Kinds.parse(text)
    if type is None or any(report.id == text for report in road_map.junctions):
        report = road_map.report(find(text, map).id)
        if kinds is None or kinds.fit(report):
            yield _Candidate(map, report.id, report, alone=True)
        return
    all_kinds, any_fits = [type, *([kinds] if kinds else [])], False
    for report in road_map.junctions:
        candidate = _Candidate(map, report.id, report, alone=False)
        if all(kind.fit(report) for kind in all_kinds):
            any_fits = True
            yield candidate
        elif report.reason is not None and all(kind.match(report) for kind in all_kinds):
            refused[map, report.id] = _refusal(candidate, report.reason)
    if not any_fits:
        request = f"{text!r}{f' and is of the kinds asked for ({kinds})' if kinds else ''}"
        raise MapError(f"map file {map} has no usable junction that fits {request}; {offer(road_map)}")
