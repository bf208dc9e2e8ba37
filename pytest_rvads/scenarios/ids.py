"""Reads scenarios from the ids of tests, such as ``stop4-class07-as1133-s0-cfgD.delay00.20.r1-hesitant-p1``."""

from __future__ import annotations

import os
import re
from dataclasses import fields
from typing import Any

from pytest_rvads.drivers.traffic import DEFAULT
from pytest_rvads.errors import ScenarioError, suggest
from pytest_rvads.junctions.finder import called, find
from pytest_rvads.scenarios.classes import parse
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.orbits import rotate
from pytest_rvads.scenarios.scenario import Scenario, started
from pytest_rvads.scenarios.senses import Senses

__all__ = ["from_id", "run_id"]

_ID = re.compile(
    r"(?P<place>[A-Za-z0-9_.]+)-(?P<cls>[A-Za-z0-9_.]+)-as(?P<code>[0-9a-z_]+)(-s(?P<seat>\d+))?-cfg(?P<point>[A-Za-z0-9_.]+)(?P<rest>-.*)?"
)
_POINT = re.compile(
    r"(?P<cfg>[A-J]|S[\d_]*\d|d(?P<d>[\d._]*\d)v(?P<v>[\d._]*\d))(\.f(?P<followers>\d))?(?P<senses>(\.[a-z_]+(\d+\.\d+|\d+)?)*?)"
    r"(\.r(?P<rotation>\d+))?(\.o(?P<order>(?=[a-z]*\d)[0-9a-z]+))?"
)
"""An order has digits, unlike a sense that begins with o."""
_SENSE = re.compile(r"\.([a-z_]+)(\d+\.\d+|\d+)?")


def run_id(scenario: Scenario, traffic: str | None) -> str:
    """Return the id of a run, without a rule; the policy of the traffic around a subject is appended if it is not the default."""
    return scenario.name if traffic in (None, DEFAULT) else f"{scenario.name}-{traffic}"


def from_id(id: str, map: str | os.PathLike[str] | None = None) -> Scenario:
    """Return the scenario of an id; duration, braking level and random draw, which ids leave out, have their defaults.

    Args:
        id: the id of a test or a run, with or without the rule.
        map: the OpenDRIVE file of a junction that is not built in.

    Raises:
        ScenarioError: the text is no id, or does not fit the junction; the message says what is expected.
        MapError: no junction has this name.
    """
    said = _ID.fullmatch(id)
    point = said and _POINT.fullmatch(said["point"])
    if not (said and point):
        raise ScenarioError(
            f"{id!r:.200} is no id of a scenario, expected such as 'stop4-class07-as1133-cfgD', with the configuration A to J, "
            "a staggered one such as S21, or its distances and speeds, such as cfgd20.00v10.00"
        )
    place = find(said["place"]) if map is None else called(said["place"], map)
    rotation = int(point["rotation"] or 0)
    code = parse(said["code"])
    if len(code) != len(place.entrances):
        raise ScenarioError(
            f"{id!r:.200}: {said['code']!r} is for {len(code)} entrances, {place.name!r} has {len(place.entrances)}"
        )
    seat, followers = None if said["seat"] is None else int(said["seat"]), int(point["followers"] or 0)
    start: dict[str, Any] = {"distance": _numbers(point["d"]), "speed": _numbers(point["v"])}
    if point["d"] is None:
        start = started(configuration(point["cfg"], len(code), place.control), place, rotation, seat, followers)
    scenario = Scenario(
        place,
        rotate(code, -rotation),
        **start,
        rotation=rotation,
        subject=seat,
        order=None if point["order"] is None else parse(f"{point['order']}"),
        senses=_senses(point["senses"]),
        followers=followers,
    )
    if not f"{id}-".startswith(f"{scenario.name}-"):
        raise ScenarioError(f"{id!r:.200} is not what the scenario is called that it describes{suggest(id, [scenario.name])}")
    return scenario


def _numbers(text: str | None) -> float | tuple[float, ...]:
    """Return the values of a label: one value for all entrances, or one value per entrance."""
    try:
        values = tuple(map(float, (text or "0").split("_")))
    except ValueError:
        raise ScenarioError(f"{text!r:.60} is no list of numbers, expected such as 20.00 or 20.00_00.30") from None
    return values[0] if len(values) == 1 else values


def _senses(text: str) -> Senses:
    known: dict[str, Any] = {item.name: item.default for item in fields(Senses)}
    values: dict[str, Any] = {}
    for name, number in _SENSE.findall(text):
        if name not in known:
            raise ScenarioError(f"senses have {', '.join(known)}, got {name!r}{suggest(name, known)}")
        kind = type(known[name])
        values[name] = True if kind is bool else kind(float(number or 0))
    return Senses(**values)
