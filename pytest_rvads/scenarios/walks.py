"""Pedestrians that a test asks for, and the pedestrians among these that a scenario can have.

A test asks for walks: combinations of crosswalk, side, behaviour and difference of arrivals. Two scenarios with a pedestrian are
equal up to rotation if a rotation of the junction maps the vehicles of one scenario onto those of the other, and the crosswalk of
its pedestrian onto the other crosswalk. Only rotations that keep the crosswalks count.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

from pytest_rvads.drivers.walking import behaviour
from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.scenarios.configurations import plain
from pytest_rvads.scenarios.orbits import Directions, Orbits, rotate
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.support.errors import ScenarioError, suggest

DIFFERENCES = tuple(half / 2 for half in range(-8, 9))
"""Differences of arrivals unless a test names others [s]: every half second from 4 s early to 4 s late."""
_FIELDS: dict[str, tuple[Any, ...]] = {
    "crossing": (None,),
    "side": tuple(Side),
    "behaviour": ("steady",),
    "difference": DIFFERENCES,
}
"""Default values per field of a pedestrian; a crosswalk of None stands for every crosswalk that a vehicle drives over."""


class Walk(NamedTuple):
    """A pedestrian that a test asks for."""

    pedestrian: Pedestrian
    everywhere: bool = False
    """Whether the pedestrian walks at every crosswalk in turn, whatever the number of its crosswalk."""


def walks_of(value: object) -> tuple[Walk, ...]:
    """Return the walks of the argument ``pedestrians=`` of a mark.

    It is the name of a behaviour, a `Pedestrian`, a dict of the fields of a `Pedestrian` with a value or several values each, or
    several of these; None for no pedestrians.
    """
    if value is None:
        return ()
    entries = [value] if isinstance(value, str | Mapping) or not isinstance(value, Iterable) else list(value)
    if not entries:
        raise ScenarioError("pedestrians is empty: name a behaviour, such as 'steady', or leave it out")
    walks: dict[Walk, None] = {}
    for entry in entries:
        if isinstance(entry, Pedestrian):
            walks[Walk(entry)] = None
            continue
        if not isinstance(entry, str | Mapping):
            raise ScenarioError(
                "pedestrians takes names of behaviours, rvads.Pedestrian(...) or dicts of its fields, one or several, got "
                f"{entry!r:.100}"
            )
        given: Mapping[str, Any] = {"behaviour": entry} if isinstance(entry, str) else entry
        for name in given:
            if name not in _FIELDS:
                raise ScenarioError(f"pedestrians have {', '.join(_FIELDS)}, got {name!r}{suggest(str(name), _FIELDS)}")
        lists = [plain(given.get(name, default)) for name, default in _FIELDS.items()]
        lists = [list(values) if isinstance(values, list | tuple) else [values] for values in lists]
        if not all(lists):
            raise ScenarioError(f"pedestrians are given by values or lists of at least one value, got {dict(given)!r}")
        for crossing, side, manner, difference in product(*lists):
            # Behind parked vehicles pedestrians walk from the near side alone.
            if not (behaviour(manner).parked and side == Side.FAR and Side.NEAR in lists[1]):
                pedestrian = Pedestrian(0 if crossing is None else crossing, side, manner, difference)
                walks[Walk(pedestrian, crossing is None)] = None
    return tuple(walks)


def choices(place: Junction, ways: Collection[Key], walks: Iterable[Walk]) -> Iterator[Pedestrian]:
    """Yield the pedestrians among `walks` who can meet a vehicle, crosswalk by crosswalk."""
    for number in sorted({number for number, key in place.covers if key in ways}):
        for pedestrian, everywhere in walks:
            if everywhere:
                yield replace(pedestrian, crossing=number)
            elif pedestrian.crossing == number:
                yield pedestrian


def least(place: Junction, placed: Directions, seat: int | None, crossing: int) -> tuple[Directions, int, int]:
    """Return the least image of a scenario with a pedestrian, equal for scenarios that differ by rotation."""
    count = len(placed)
    return min(
        (rotate(placed, row), -1 if seat is None else (seat + row) % count, images[crossing]) for row, images in turns(place)
    )


@lru_cache(maxsize=256)
def turns(place: Junction) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Return the rotations of a junction that keep lanes, movements, signs and crosswalks, the identity first.

    A rotation comes with the numbers of the crosswalks onto which it moves the crosswalks.
    """
    below = [{key for number, key in place.covers if number == k} for k in range(len(place.crossings))]
    groups, rotations = place.phase_groups, []
    for arms, row in zip(place.rotations, Orbits.at(place).rows, strict=True):
        lanes = place.image(arms)
        if lanes is None:
            continue
        entrances, exits = lanes
        images: list[int] = []
        for crosswalk, keys in zip(place.crossings, below, strict=True):
            moved = {(entrances[start], exits[end]) for start, end in keys}
            green = None if crosswalk.phase is None else frozenset(entrances[entrance] for entrance in groups[crosswalk.phase])
            for number, other in enumerate(place.crossings):
                same_green = green is None if other.phase is None else green == groups[other.phase]
                same_arm = other.arm == (crosswalk.arm + arms) % place.ways
                if number not in images and same_arm and same_green and below[number] == moved:
                    images.append(number)
                    break
        if len(images) == len(place.crossings):
            rotations.append((row, tuple(images)))
    return tuple(rotations)
