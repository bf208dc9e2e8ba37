"""The bounds of the scenarios that a search explores, and the check of these bounds."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from numbers import Real
from typing import Any, TypedDict

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.scenario import check_numbers
from pytest_rvads.support.errors import ScenarioError, suggest

NEAREST, FARTHEST = 0.3, 30.0
"""Least and greatest distance of a vehicle at its start to the stopping line, by default [m]."""


class Space(TypedDict, total=False):
    """Bounds of the scenarios of a search; `strategies.scenarios` explains the bounds and has their defaults."""

    map: str | None
    subject: int | None
    partial: bool
    near: float
    far: float
    pace: float
    wait: tuple[float, float]
    aggression: int
    duration: float | None


def explored(junction: str | Junction, space: Space) -> Junction:
    """Check the bounds of the scenarios of a search, and return the junction."""
    names = Space.__annotations__
    for name, value in space.items():
        if name not in names:
            raise ScenarioError(f"a bound of a search must be {', '.join(names)}, got {name!r}{suggest(name, names)}")
        if name in _CHECKS and not _CHECKS[name][0](value):
            raise ScenarioError(f"{name} must be {_CHECKS[name][1]}, got {value!r}")
    if not isinstance(junction, str | Junction):
        raise ScenarioError(f"junction must be a name in quotes or what rvads.find returns, got {junction!r:.60}")
    check_numbers(space.get("duration"), space.get("aggression", 1), wait=0.0)
    if isinstance(junction, Junction) and space.get("map") is not None:
        raise ScenarioError(
            f"map= names the map of a junction given by id, got map= with junction {junction.name!r}: leave it out"
        )
    place = junction if isinstance(junction, Junction) else find(junction, space.get("map"))
    near, far = space.get("near", NEAREST), space.get("far", FARTHEST)
    if not near < far:
        raise ScenarioError(f"near must be less than far, got {near!r} and {far!r} m: vehicles start between them")
    room, entrance = min((place.approach(e), e) for e in range(len(place.entrances)))
    if not near < room:
        raise ScenarioError(
            f"near must be less than the shortest approach of {place.name!r}, {room:.1f} m at entrance {entrance}, got {near!r} m"
        )
    subject, ways = space.get("subject"), len(place.entrances)
    if subject is not None and not (type(subject) is int and 0 <= subject < ways):
        raise ScenarioError(f"subject must be an entrance of {place.name!r}, 0 to {ways - 1}, got {subject!r}")
    return place


def _number(value: Any, least: float, most: float) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and least <= float(value) <= most and float(value) < math.inf


def _range(value: Any) -> bool:
    return (
        isinstance(value, tuple | list)
        and len(value) == 2
        and all(_number(end, 0, math.inf) for end in value)
        and value[0] <= value[1]
    )


_CHECKS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "map": (lambda file: file is None or isinstance(file, str | os.PathLike), "the path of a map file"),
    "partial": (lambda partial: isinstance(partial, bool), "True or False"),
    "near": (lambda near: _number(near, 0, math.inf), "a distance of 0 m or more"),
    "far": (lambda far: _number(far, 0, math.inf), "a distance of 0 m or more"),
    "pace": (lambda pace: _number(pace, 0, 1), "a share of v(d)max, from 0 to 1"),
    "wait": (_range, "the least and the greatest number of seconds, such as (0, 4)"),
}
"""By name of a bound that can be checked without the junction, the check and the expected value in words."""
