"""Many junctions at once: by name or id, all of a map, those of some kinds, or a sample of them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from pytest_rvads.errors import MapError, require
from pytest_rvads.junctions.analysis import JunctionReport
from pytest_rvads.junctions.builtin import path_of
from pytest_rvads.junctions.conflicts import JunctionKind
from pytest_rvads.junctions.finder import find, load, name_of, names, offer
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.junctions.kinds import Kinds
from pytest_rvads.stratified import draw

__all__ = ["EVERY", "Choice", "Kinds", "Refused", "choose", "choose_among", "some"]

EVERY = "*"
"""All junctions of a map."""
_FREE = "no two of its movements meet, so nobody has to give way there: ask for it by its id to drive there all the same"
Map = str | os.PathLike[str] | None


@dataclass(frozen=True, slots=True)
class Refused:
    """A junction that was asked for among others, and can't be used, or where no ways meet."""

    junction: str
    """Its id."""
    map: str | None
    ways: int
    """Number of arms."""
    control: str
    """What regulates it; empty where nobody enters it."""
    reason: str

    @property
    def name(self) -> str:
        """What ids would call it."""
        return name_of(self.map, self.junction) if self.map else self.junction


@dataclass(frozen=True, slots=True)
class Choice:
    """Junctions, and what became of the others that were asked for."""

    junctions: tuple[Junction, ...]
    """As they were named; of a map in the order of its file."""
    refused: tuple[Refused, ...]
    passed_over: int
    """How many more would do, but for a limit."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A junction that would do, not yet cut from its map."""

    map: Map
    id: str
    """In the map, or the name of a built-in one."""
    report: JunctionReport
    alone: bool
    """Whether it was named, and not one of several that were meant."""


def choose(
    wanted: str | Iterable[str], map: Map = None, *, kinds: Kinds | None = None, limit: int | None = None, seed: int = 0
) -> Choice:
    """Return the junctions of a map that are asked for.

    Args:
        wanted: one or several of these: an id in `map`; ``"*"`` for all of `map`; a type such as "4-way stop" or "3-way lights
            with 40 m of approach" for all that fit; a place such as "nearest to 52, 149" [m]. Without a map: built-in names,
            ``"*"`` for all of these; a type is the first that fits, as for `find`, since built-in ones come in variants.
        map: an OpenDRIVE file, or None for the built-in maps.
        kinds: take only these of them.
        limit: most junctions; more are drawn by `seed`, as evenly as possible from every kind (control and number of arms).
        seed: other seeds draw others.

    Raises:
        MapError: an unreadable map, an id that is unknown or unusable, or nothing usable that fits.
    """
    return choose_among(((one, map) for one in _texts(wanted)), kinds=kinds, limit=limit, seed=seed)


def choose_among(
    wanted: Iterable[tuple[str, Map]], *, kinds: Kinds | None = None, limit: int | None = None, seed: int = 0
) -> Choice:
    """Return the junctions that are asked for, each in a map of its own; for the rest see `choose`."""
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int) or limit < 1):
        raise MapError(f"limit must be a whole number of junctions, 1 or more, got {limit!r}")
    asked = list(wanted)
    if not asked:
        raise MapError(f"no junction was asked for: name some, or take {EVERY!r} for all of a map")
    found: dict[tuple[Map, str], _Candidate] = {}
    refused: dict[tuple[Map, str], Refused] = {}
    for text, map in asked:
        for one in _named(text, map, kinds, refused):
            found.setdefault((one.map, one.id), one)
    if not found:
        raise MapError(f"none of {', '.join(repr(text) for text, _ in asked)} is of the kinds asked for ({kinds}): name others")
    junctions = []
    for one in found.values():
        try:
            junctions.append(_offered(one))
        except MapError as error:
            if one.alone:
                raise
            refused[one.map, one.id] = _refused(one, str(error))
    if not junctions:
        raise MapError(f"no junction asked for can be used, the first of them: {next(iter(refused.values())).reason}")
    drawn = some(junctions, limit, seed)
    return Choice(drawn, tuple(refused.values()), len(junctions) - len(drawn))


def some(junctions: Sequence[Junction], limit: int | None, seed: int = 0) -> tuple[Junction, ...]:
    """Return at most so many junctions, in their order, as evenly as possible from every kind: control and number of arms."""
    if limit is None:
        return tuple(junctions)
    return tuple(draw(junctions, limit, seed, _kind, lambda junction: junction.name))


def _texts(wanted: str | Iterable[str]) -> tuple[str, ...]:
    texts = (wanted,) if isinstance(wanted, str) or not isinstance(wanted, Iterable) else tuple(wanted)
    for text in texts:
        require(text, str, "choose takes names, ids or types of junctions as texts, such as '*' or '4-way stop'", MapError)
    return texts


def _refused(one: _Candidate, reason: str) -> Refused:
    control = one.report.control.value if one.report.entrances else ""
    return Refused(one.id, None if one.map is None else os.fspath(one.map), one.report.ways, control, reason)


def _offered(one: _Candidate) -> Junction:
    """Return a junction that was named, or where ways meet.

    Raises:
        MapError: its roads can't be joined, which is not known before, or no ways meet.
    """
    place = find(one.id, one.map)
    if place.kind is JunctionKind.CONFLICT_FREE and not one.alone:
        raise MapError(_FREE)
    return place


def _kind(junction: Junction) -> tuple[str, ...]:
    return (f"{junction.ways}-way {junction.control.value}",)


def _named(text: str, map: Map, kinds: Kinds | None, refused: dict[tuple[Map, str], Refused]) -> Iterator[_Candidate]:
    """Yield what a text means, of these kinds; `refused` takes what it means and is unusable."""
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
    both, some = [type, *([kinds] if kinds else [])], False
    for report in road_map.junctions:
        one = _Candidate(map, report.id, report, alone=False)
        if all(kind.fit(report) for kind in both):
            some = True
            yield one
        elif report.reason is not None and all(kind.match(report) for kind in both):
            refused[map, report.id] = _refused(one, report.reason)
    if not some:
        told = f"{text!r}{f' and is of the kinds asked for ({kinds})' if kinds else ''}"
        raise MapError(f"map file {map} has no usable junction that fits {told}; {offer(road_map)}")
