"""The choice of several junctions: by name or id, all junctions of a map, the junctions of some kinds, or a sample."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.builtin import path_of
from pytest_rvads.geometry.conflicts import JunctionKind
from pytest_rvads.geometry.finder import Kinds, find, load, name_of, names, offer
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.support.errors import MapError, require
from pytest_rvads.support.stratified import draw

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
