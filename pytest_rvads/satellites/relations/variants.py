"""Metamorphic relations: each relation changes a case into variants that must get the same verdicts as the case.

A relation that can't be applied to a case yields an `Incomparable` with the reason, so that no relation is skipped in silence.
The relation ``renaming`` wraps autopilots; the wrapper changes the names of vehicles in the observations. The relations
``motion`` and ``mirror`` write the map of the junction anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import Element, ElementTree

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.interface import Command, Coordinates, Drives, Factory, Observation
from pytest_rvads.drivers.naming import name_of
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import load
from pytest_rvads.geometry.opendrive.signals import LINE_RANGE
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.states import Agent
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.classes import Orbits, rotate
from pytest_rvads.scenarios.pedestrians import turns
from pytest_rvads.scenarios.scenario import first_green
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
_FOLDER = TemporaryDirectory(prefix="rvads-", ignore_cleanup_errors=True)
MOTION = (137.0, -59.0, 0.3)
"""Translation x, y [m] and rotation [rad] of the map in the relation ``motion``."""
_ALIKE = 0.01
"""Greatest difference between equal starts of pedestrians [m, m/s and s]."""
LONGER = 20.0
"""Distance by which vehicles start farther away in the relation ``approach`` [m]."""


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


@dataclass(frozen=True, slots=True)
class Variant:
    """A variant of a case, which must get the same verdicts as the original case."""

    what: str
    """The change in words, such as ``rotation by 1``."""
    case: Case
    image: tuple[int, ...]
    """Per entrance of the original junction, the corresponding entrance in the variant."""
    sided: bool = False
    """Whether the variant is mirrored, so that rules about left or right turns don't require the same in both scenarios."""

    def concerns(self, rule: Rule) -> bool:
        """Return whether a rule requires the same of the vehicles in the variant and in the original scenario."""
        words = (term for atom in f.atoms(rule.formula) for term in atom.terms)
        return not (self.sided and any(isinstance(word, f.Value) and word.name in ("left", "right") for word in words))


@dataclass(frozen=True, slots=True)
class Incomparable:
    """A change that can't be applied to a case, with the reason."""

    what: str
    why: str


Relation = Callable[[Case], Iterator[Variant | Incomparable]]


def rotation(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with all vehicles, and the phases of lights, moved on by each number of arms (structural equivalence)."""
    scenario, junction = case.scenario, case.scenario.place
    symmetries = {symmetry.arms: symmetry for symmetry in rotations_of(junction)}
    crosswalks = dict(turns(junction)) if scenario.pedestrians else {}
    for arms in range(1, junction.ways):
        what, match = f"rotation by {arms}", symmetries.get(arms)
        if match is None:
            yield Incomparable(what, f"{junction.name} has other {' and '.join(broken_by(junction, arms))} there")
        elif not _lights_follow(junction, scenario.rotation, match.rows):
            yield Incomparable(what, f"the lights of {junction.name} do not follow the rotation")
        elif scenario.pedestrians and match.rows not in crosswalks:
            yield Incomparable(what, f"{junction.name} has other crosswalks there")
        else:
            image, row = rotate(_identity_image(case), -match.rows), (scenario.rotation + match.rows) % len(junction.entrances)
            yield _variant(what, case, image, crosswalks.get(match.rows, ()), rotation=row)


def _lights_follow(junction: Junction, rotation: int, rows: int) -> bool:
    """Return whether the lights give green to the moved vehicles in the same order as to the vehicles before the rotation.

    Which phase comes first in a rotated scenario is defined by `first_green`, and this phase does not fit every junction.
    """
    groups, count = junction.phase_groups, len(junction.entrances)
    if len(groups) < 2:
        return True
    before = rotate(groups, -first_green(junction, rotation))
    after = rotate(groups, -first_green(junction, (rotation + rows) % count))
    return tuple(frozenset((e + rows) % count for e in group) for group in before) == after


def creation(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with its vehicles created in the reverse order."""
    if len(case.scenario.creation) < 2:
        yield Incomparable("creation order", "there is only one vehicle")
    else:
        yield Variant("creation order reversed", case.but(order=case.scenario.order[::-1]), _identity_image(case))


def renaming(case: Case) -> Iterator[Variant]:
    """Yield the case with autopilots that observe other names of the agents, in another alphabetical order."""
    # The suffix that marks a follower in a queue, such as +1, is kept.
    place = case.scenario.place
    names = {
        agent.name: f"v{len(place.entrances) - agent.entrance}{agent.name.removeprefix(place.vehicle_at(agent.entrance))}"
        for agent in case.agents()
    }
    traffic = case.traffic and renamed(case.traffic, names)
    yield Variant("renaming", replace(case, driver=renamed(case.driver, names), traffic=traffic), _identity_image(case))


def motion(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case on a translated and rotated map."""
    x, y, angle = MOTION
    cos, sin = np.cos(angle), np.sin(angle)

    def move(px: float, py: float) -> tuple[float, float]:
        return float(cos * px - sin * py + x), float(sin * px + cos * py + y)

    yield _on_other_map("moved map", case, moved(case.scenario.place, MOTION), move, sided=False)


def mirror(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case on a mirrored map, with traffic on the other side of the road."""
    yield _on_other_map("mirrored map", case, mirrored(case.scenario.place), lambda x, y: (x, -y), sided=True)


def approach(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with all vehicles starting farther away; equal starts are required, which keep the order of arrivals."""
    what, scenario = f"approach longer by {LONGER:g} m", case.scenario
    starts, junction = {scenario.start(e) for e in scenario.creation}, scenario.place
    if junction.control is JunctionControl.LIGHTS or junction.phase_groups:
        yield Incomparable(what, "the lights would change before the later arrival")
    elif len(starts) > 1:
        yield Incomparable(what, "the vehicles start at different distances or speeds, so their order may change")
    elif any(scenario.start(e)[0] + LONGER > junction.approach(e) for e in scenario.creation):
        yield Incomparable(what, f"the approaches of {junction.name} are too short")
    else:
        yield Variant(what, case.but(distance=[d + LONGER for d in scenario.distances]), _identity_image(case))


RELATIONS: Mapping[str, Relation] = MappingProxyType(
    {
        "rotation": rotation,
        "creation": creation,
        "renaming": renaming,
        "motion": motion,
        "mirror": mirror,
        "approach": approach,
    }
)
"""Relations by their names in the argument `relations` of `equivalent`."""


def _identity_image(case: Case) -> tuple[int, ...]:
    return tuple(range(len(case.scenario.directions)))


def _variant(
    what: str, case: Case, image: tuple[int, ...], crosswalks: Sequence[int], *, sided: bool = False, **changes: Any
) -> Variant | Incomparable:
    """Return a case with a changed scenario, in which each vehicle keeps its role and its parameters at its new entrance.

    `crosswalks` holds the new number of every crosswalk.
    """
    before = case.scenario
    subject = None if before.subject is None else image[before.subject]
    pedestrians = tuple(replace(walker, crossing=crosswalks[walker.crossing]) for walker in before.pedestrians)
    after = before.but(subject=subject, pedestrians=pedestrians, **changes)
    names = {before.place.vehicle_at(e): after.place.vehicle_at(image_of) for e, image_of in enumerate(image)}
    queue = {name: name.partition("+") for name in case.fleet.others}  # a0+1 is the first follower of a0
    others = {"".join((names[queue[name][0]], *queue[name][1:])): vehicle for name, vehicle in case.fleet.others.items()}
    changed = replace(case, scenario=after, fleet=replace(case.fleet, others=others))
    # Without a subject, the arrival of a pedestrian is counted from the first vehicle that drives over the crosswalk, and another
    # vehicle may be the first in the variant.
    starts, other_starts = ([setting[1:4] for setting in c.scenario.walkers(c.fleet.of)] for c in (case, changed))
    if np.allclose(starts, other_starts, rtol=0.0, atol=_ALIKE):
        return Variant(what, changed, image, sided=sided)
    return Incomparable(what, "a pedestrian would meet another vehicle first, so it would start at another time: name a subject")


def _on_other_map(
    what: str, case: Case, after: Junction, place: Callable[[float, float], tuple[float, float]], *, sided: bool
) -> Variant | Incomparable:
    scenario, before = case.scenario, case.scenario.place
    if scenario.pedestrians and len(before.crossings) != len(after.crossings):
        return Incomparable(what, "the other map has other crosswalks")

    def middles(junction: Junction) -> list[NDArray[np.float64]]:
        ends = [
            [junction.way_in(e).points[-1] for e in arm.entrances] + [junction.way_out(x).points[0] for x in arm.exits]
            for arm in junction.arms
        ]
        return [np.mean(points, axis=0) for points in ends]

    arms = _nearest(middles(before), middles(after), place)
    centres, others = ([c.area.mean(axis=0) for c in junction.crossings] for junction in (before, after))
    crosswalks = _nearest(centres, others, place) if scenario.pedestrians else ()
    numbers = {(lane.arm, lane.lane): e for e, lane in enumerate(after.entrances)}
    image = tuple(numbers[arms[lane.arm], lane.lane] for lane in before.entrances)
    count = len(image)
    placed = [0] * count
    exits = {(lane.arm, lane.lane): x for x, lane in enumerate(after.exits)}
    directions = {movement.key: direction for (_, direction), movement in after.by_direction.items()}
    for e, direction in enumerate(scenario.placed):
        if direction:
            exit = before.exits[before.leads(e, direction).exit]
            placed[image[e]] = directions[image[e], exits[arms[exit.arm], exit.lane]]
    row = 0
    if before.phase_groups:
        green = frozenset(image[e] for e in before.phase_groups[scenario.signals().first])
        if green not in after.phase_groups:
            return Incomparable(what, "the lights of the other map have other groups")
        rows = (row for row in Orbits.at(after).rows if after.phase_groups[first_green(after, row)] == green)
        row = next(rows, -1)
        if row < 0:
            return Incomparable(what, "no rotation on the other map begins with the same lights")
    starts = [scenario.start(image.index(e)) for e in range(count)]
    # The rotation `row` is chosen for its first light phase. It also moves the vehicles, so they are rotated by -row here.
    order = [image[(e + scenario.rotation) % count] for e in scenario.order]
    return _variant(
        what,
        case,
        image,
        crosswalks,
        sided=sided,
        place=after,
        directions=rotate(tuple(placed), -row),
        distance=rotate(tuple(d for d, _ in starts), -row),
        speed=rotate(tuple(v for _, v in starts), -row),
        rotation=row,
        order=[(e - row) % count for e in order],
    )


def _nearest(
    points: Sequence[NDArray[np.float64]],
    others: Sequence[NDArray[np.float64]],
    place: Callable[[float, float], tuple[float, float]],
) -> tuple[int, ...]:
    """Return, for each point, the number of the nearest other point to the position to which `place` maps the point."""
    return tuple(int(np.argmin(np.hypot(*(np.array(others) - place(x, y)).T))) for x, y in points)


def renamed(factory: Factory, names: Mapping[str, str]) -> Factory:
    """Return a factory of autopilots, or of a traffic system, that see other names of the vehicles in their observations."""
    return _Renamed(factory, names)


class _Wrapper:
    """A wrapper of an autopilot or traffic system, which has the attributes of the wrapped object, including its label."""

    def __init__(self, inner: Any, names: Mapping[str, str]) -> None:
        self._inner, self._names = inner, names
        self.label = name_of(inner)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # copying and unpickling look for such attributes before `_inner` exists
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self._inner, name)


class _Renamed(_Wrapper):
    def __call__(self) -> Drives | Coordinates:
        driver = self._inner()
        return _System(driver, self._names) if callable(getattr(driver, "autopilots", None)) else _Pilot(driver, self._names)


class _Pilot(_Wrapper):
    def control(self, seen: Observation) -> Command:
        names = self._names
        others = tuple([other._replace(name=names[other.name]) for other in seen.others])
        command: Command = self._inner.control(seen._replace(me=seen.me._replace(name=names[seen.me.name]), others=others))
        return command


class _System(_Wrapper):
    def autopilots(self, agents: Sequence[Agent]) -> Sequence[Drives]:
        renamed_agents = [replace(agent, name=self._names[agent.name]) for agent in agents]
        return [_Pilot(pilot, self._names) for pilot in self._inner.autopilots(renamed_agents)]
