"""Checks the arguments of ``@rvads.scenario``: wrong values, and combinations of arguments that exclude each other."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral
from typing import Any

from pytest_rvads.drivers.traffic import DEFAULT, Policy
from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.choosing import EVERY
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.configurations import per_entrance, plain
from pytest_rvads.scenarios.orbits import OCCUPANCIES
from pytest_rvads.scenarios.selection import CHOOSING, COVERS
from pytest_rvads.scenarios.senses import Senses

__all__ = ["SEVERAL", "Values", "policies_of", "refuse", "values_of"]

Values = tuple[float | tuple[float, ...], ...]
"""One after the other, each for all entrances or per entrance."""
SEVERAL: dict[str, tuple[Any, str]] = {
    "junction": (str, "names, ids or types of junctions"),
    "classes": (Integral, "class numbers"),
    "scenarios": (str, "direction strings such as '1133'"),
    "grid": (str, "letters of configurations or names of grids"),
    "rules": ((str, Rule), "rules or names of rules or rulebooks"),
    "followers": (Integral, "numbers of vehicles that queue behind each"),
    "senses": (Senses, "rvads.Senses(...) or a dict of their fields"),
    "requirement": (str, "identifiers of requirements"),
}
"""The arguments that take one value or several: of which type, and how to say it."""
_SINGLE: dict[str, tuple[Callable[[Any], bool], str]] = {
    "limit": (lambda most: most is None or (type(most) is int and most > 0), "a whole number of junctions, 1 or more"),
    "map": (lambda file: file is None or isinstance(file, str | os.PathLike), "the path of an OpenDRIVE file"),
    "cover": (lambda cover: cover in (None, *COVERS), f"one of {', '.join(COVERS)}"),
    "occupancy": (lambda occupancy: occupancy in OCCUPANCIES, f"one of {', '.join(OCCUPANCIES)}"),
    "probe": (lambda probe: isinstance(probe, bool), "True or False"),
    "subject": (lambda subject: subject in (None, "all") or type(subject) is int, "an entrance, counted from 0, or 'all'"),
}
"""The arguments that take one value: whether it is right, and how to say it."""


def refuse(asked: Mapping[str, Any]) -> None:
    """Refuse wrong values of arguments, and combinations of arguments that exclude each other."""
    got = asked["junction"]
    if got is None and asked["junctions"] is None:
        raise ScenarioError(f"name a junction, several, or {EVERY!r} for all of a map, or say by junctions= of which kinds")
    if not isinstance(got, str | Iterable | None):
        raise ScenarioError(f"write @rvads.scenario('stop4', ...) with the name of a junction in quotes, got {got!r}")
    for name, (right, expected) in _SINGLE.items():
        if not right(asked[name]):
            raise ScenarioError(f"{name} must be {expected}, got {asked[name]!r}")
    given = {name for name, value in asked.items() if value is not None}
    if given >= {"classes", "scenarios"}:
        raise ScenarioError("give classes= or scenarios=, not both: a scenario names its class")
    if given & {"classes", "scenarios"} and asked["cover"] in CHOOSING:
        raise ScenarioError(f"cover={asked['cover']!r} chooses scenarios itself: leave classes= and scenarios= out, or the cover")
    if given >= {"grid", "distances"} or given & {"speeds", "distances"} == {"speeds"}:
        raise ScenarioError("give either grid=, or distances= with speeds=")
    if given & {"traffic", "subject"} == {"traffic"}:
        raise ScenarioError("traffic= drives the vehicles beside a subject: say subject=0 or 'all', or leave traffic= out")


def values_of(name: str, axis: Any) -> Values | None:
    """Return distances or speeds, one after the other; how many entrances there are is not known yet."""
    axis = plain(axis)
    entries = list(map(plain, axis)) if isinstance(axis, list) else [] if axis is None else [axis]
    if axis == []:
        raise ScenarioError(f"{name} is an empty list: give at least one value")
    for entry in entries:
        per_entrance(name, entry, len(entry) or 1 if isinstance(entry, Sequence) else 1)
    return tuple(tuple(entry) if isinstance(entry, Sequence) else entry for entry in entries) or None


def policies_of(traffic: Any) -> tuple[Policy, ...]:
    """Return the traffic policies to run among, one after the other."""
    several = isinstance(traffic, Iterable) and not isinstance(traffic, str) and not callable(traffic)
    named = tuple(traffic) if several else (DEFAULT if traffic is None else traffic,)
    if not named:
        raise ScenarioError("traffic is empty: name a policy or an autopilot, or leave it out")
    return tuple(map(Policy.of, named))
