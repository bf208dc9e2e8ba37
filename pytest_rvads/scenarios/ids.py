"""Reads scenarios from the ids of tests, such as ``stop4-class07-as1133-s0-cfgD.delay00.20.r1-hesitant-p1``.

Ids are a contract: ``--lf`` of pytest, stored durations and dashboards depend on ids. An id consists of ``[A-Za-z0-9_.-]``, its
numbers are padded with zeros, and no release changes it. Its parts, in order:

- junction: the built-in name, or ``stem.id`` for a junction of a file, with ``_`` in place of other characters.
- class: the number of the class, in the order of the lexicographically least rotations of the directions; 00 for a partial
  scenario.
- abstract scenario: a digit per entrance of the map, 0 for an empty entrance. Digit ``j`` leads to the j-th arm after the arm of
  the entrance, counter-clockwise, and to the lane nearest to the kerb of that arm; ``j + n`` and ``j + 2n`` lead to the next
  lanes of that arm; ``n`` is the U-turn, where n is the number of arms. Directions from 10 on are written as letters. If arms
  have several entrances, ``_`` separates arms: ``as13_2_0_31``.
- ``s0``: the entrance of the subject; left out without a subject.
- ``w1n.steady.e0.50``: a pedestrian on crosswalk 1 of the map, from its near side (``f``: far side), with a behaviour, who
  arrives 0.5 s earlier than the vehicle (``l``: later). Several pedestrians are separated by ``_``. Left out if nobody walks.
- configuration, before rotation: a letter A to J; ``S`` and metres for a staggered start; or ``d20.00_00.30v00.00`` for explicit
  distances [m] and speeds [m/s], with one number if all are equal. After the configuration come ``f2`` for two followers per
  vehicle, ``e12`` for 12 s of the cycle of the lights that have passed at the start, the imperfect senses of the vehicle under
  test (``delay00.20``), ``r1`` for row 1 of the class, and ``o`` with an order of creation: ``stop4-class07-as3113-cfgD.r1`` is
  row 1 of class 7.
- traffic policy, if it is not the reference; then the rule.

A configuration gives every vehicle a distance before its line and a speed: 0.01 m and 0 m/s in A and F; 0.3 m and 0 m/s in B and
G; 20 m and 0 m/s in C and H; 20 m and 10 m/s in D and I. In E the vehicles at the first half of the entrances, rounded up, stand
at 0.3 m and the other vehicles at 20 m. In J the vehicles at even entrances stand at 20 m and the vehicles at odd entrances at
0.3 m. In a staggered start, which needs a subject, all vehicles drive 8 m/s. The subject is 36 m before its line at an all-way
stop, and 20 m elsewhere. The label of a staggered start has the metres of the other vehicles; if these differ, counter-clockwise
from the subject: ``S26_56_56``. The label has the same numbers if an approach is so short that vehicles start nearer.

Row r of a class is its rotation by r entrances: directions, distances, speeds and the order of creation move on by r entrances,
and the light phases swap if r is odd. A test of a recording has another kind of id, ``drive17-t0312.4-p1``: the path of the file
after the fixed part of the pattern that selects the file, with ``.`` between folders; the time at which the junction becomes
busy, or the label of the run, if the file has several runs; and the rule. Agents are named by arm: ``a0`` is the first vehicle at
arm 0, ``a0.1`` the first vehicle on lane 1 of arm 0, and ``a0+1`` the vehicle behind ``a0``.

`recalled` reads a scenario from the record of a scenario in a run file or an export.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any, get_type_hints

import msgspec
from msgspec import structs

from pytest_rvads.drivers.traffic import DEFAULT
from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.geometry.finder import called, find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.classes import parse, rotate
from pytest_rvads.scenarios.configurations import configuration, started
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.scenarios.scenario import UNSAID, Scenario
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import ScenarioError, suggest

_ID = re.compile(
    r"(?P<place>[A-Za-z0-9_.]+)-(?P<cls>[A-Za-z0-9_.]+)-as(?P<code>[0-9a-z_]+)(-s(?P<seat>\d+))?(-w(?P<walkers>[0-9a-z._]+))?-cfg(?P<point>[A-Za-z0-9_.]+)(?P<rest>-.*)?"
)
_POINT = re.compile(
    r"(?P<cfg>[A-J]|S[\d_]*\d|d(?P<d>[\d._]*\d)v(?P<v>[\d._]*\d))(\.f(?P<followers>\d))?(\.e(?P<elapsed>\d+))?"
    r"(?P<senses>(\.[a-z_]+(\d+\.\d+|\d+)?)*?)"
    r"(\.r(?P<rotation>\d+))?(\.o(?P<order>(?=[a-z]*\d)[0-9a-z]+))?"
)
"""The parts of a configuration in ids; an order of creation has digits, unlike a sense whose name begins with ``o``."""
_WALKER = re.compile(r"(?P<crossing>\d+)(?P<side>[nf])\.(?P<behaviour>[a-z]+)\.(?P<late>[el])(?P<seconds>\d+\.\d+)")
_SENSE = re.compile(r"\.([a-z_]+)(\d+\.\d+|\d+)?")


def run_id(scenario: Scenario, traffic: str | None) -> str:
    """Return the id of a run: the name of its scenario, and the policy of the traffic if it is not the default policy."""
    return scenario.name if traffic in (None, DEFAULT) else f"{scenario.name}-{traffic}"


def from_id(id: str, map: str | os.PathLike[str] | None = None) -> Scenario:
    """Return the scenario of an id; duration, braking level and random draw, which ids leave out, have their defaults."""
    parts = _ID.fullmatch(id)
    point = parts and _POINT.fullmatch(parts["point"])
    if not (parts and point):
        raise ScenarioError(
            f"{id!r:.200} is no id of a scenario, expected such as 'stop4-class07-as1133-cfgD', with the configuration A to J, "
            "a staggered one such as S21, or its distances and speeds, such as cfgd20.00v10.00"
        )
    place = find(parts["place"]) if map is None else called(parts["place"], map)
    rotation = int(point["rotation"] or 0)
    code = parse(parts["code"])
    if len(code) != len(place.entrances):
        raise ScenarioError(
            f"{id!r:.200}: {parts['code']!r} is for {len(code)} entrances, {place.name!r} has {len(place.entrances)}"
        )
    seat, followers = None if parts["seat"] is None else int(parts["seat"]), int(point["followers"] or 0)
    start: dict[str, Any] = {}
    for name, text in (("distance", point["d"]), ("speed", point["v"])):
        try:
            start[name] = tuple(float(value) for value in (text or "0").split("_"))
        except ValueError:
            raise ScenarioError(f"{text!r:.60} is no list of numbers, expected such as 20.00 or 20.00_00.30") from None
        if len(start[name]) == 1:  # for all entrances
            (start[name],) = start[name]
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
        elapsed=int(point["elapsed"] or 0),
        pedestrians=_walkers(parts["walkers"]),
    )
    if not f"{id}-".startswith(f"{scenario.name}-"):
        raise ScenarioError(f"{id!r:.200} is not the id of the scenario that it describes{suggest(id, [scenario.name])}")
    return scenario


def _walkers(text: str | None) -> tuple[Pedestrian, ...]:
    parts = [_WALKER.fullmatch(part) for part in text.split("_")] if text else []
    if not all(parts):
        raise ScenarioError(f"{text!r:.100} is no label of pedestrians, expected such as 1n.steady.e0.50")
    return tuple(
        Pedestrian(
            int(part["crossing"]),
            Side.NEAR if part["side"] == "n" else Side.FAR,
            part["behaviour"],
            float(part["seconds"]) * (-1 if part["late"] == "e" else 1),
        )
        for part in parts
        if part
    )


def _senses(text: str) -> Senses:
    defaults: dict[str, Any] = {item.name: item.default for item in fields(Senses)}
    values: dict[str, Any] = {}
    for name, number in _SENSE.findall(text):
        if name not in defaults:
            raise ScenarioError(f"senses have {', '.join(defaults)}, got {name!r}{suggest(name, defaults)}")
        kind = type(defaults[name])
        values[name] = True if kind is bool else kind(float(number or 0))
    return Senses(**values)


_Lanes = Annotated[list[int], msgspec.Meta(max_length=100)]


class _Walker(msgspec.Struct, frozen=True):
    """A pedestrian in a record of `Scenario.record`."""

    crossing: int
    side: str
    behaviour: str
    difference: float


_TYPES = get_type_hints(Scenario) | {
    "directions": _Lanes,
    "order": _Lanes,
    "senses": dict[str, float | int | bool],
    "pedestrians": list[_Walker],
}
_NAMES = [item.name for item in fields(Scenario)[1:]]
_Record = msgspec.defstruct("_Record", [(name, _TYPES[name], UNSAID.get(name, msgspec.NODEFAULT)) for name in _NAMES])
"""The fields of a scenario in a record of `Scenario.record`."""


def recalled(record: Mapping[str, Any], place: Junction, where: str) -> Scenario:
    """Return the scenario that a record of `Scenario.record` describes."""
    values = structs.asdict(typed(dict(record), _Record, where, ScenarioError))
    values["distance"], values["speed"] = values.pop("distances"), values.pop("speeds")
    try:
        values["senses"] = Senses(**values["senses"])
        values["pedestrians"] = [Pedestrian(*structs.astuple(walker)) for walker in values["pedestrians"]]
        return Scenario(place, **values)
    except TypeError as error:
        raise ScenarioError(f"{where}: the field 'senses' has a field that senses do not have: {error}") from error
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}") from error
