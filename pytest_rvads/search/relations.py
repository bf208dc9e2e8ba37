"""Metamorphic relations: from a scenario to others in which the same has to come out.

Every relation yields variants, or says why it can't be applied: what is not comparable is told, never skipped in silence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.renaming import renamed
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.orbits import Orbits, rotate
from pytest_rvads.scenarios.scenario import first_green
from pytest_rvads.search.remap import mirrored, moved
from pytest_rvads.search.symmetry import broken_by, rotations_of

__all__ = ["RELATIONS", "Incomparable", "Variant"]

MOTION = (137.0, -59.0, 0.3)
"""Where maps are moved to: x, y [m], angle [rad]."""
LONGER = 20.0
"""By how much approaches are prolonged [m]."""


@dataclass(frozen=True, slots=True)
class Variant:
    """Another case that has to be judged like the first."""

    what: str
    """What was changed, such as ``rotation by 1``."""
    case: Case
    image: tuple[int, ...]
    """Per entrance of the first scenario, as it stands on the map, the entrance that corresponds to it."""
    sided: bool = False
    """Whether the scenario is mirrored, so that rules which name left or right don't apply to both scenarios alike."""

    def concerns(self, rule: Rule) -> bool:
        """Return whether `rule` says the same about both scenarios."""
        return not (self.sided and names_sides(rule))


@dataclass(frozen=True, slots=True)
class Incomparable:
    """A variant that has nothing to be compared with."""

    what: str
    why: str


Relation = Callable[[Case], Iterator[Variant | Incomparable]]


def names_sides(rule: Rule) -> bool:
    """Return whether a rule speaks of turns to the left or right."""
    words = (term for atom in f.atoms(rule.formula) for term in atom.terms)
    return any(isinstance(word, f.Value) and word.name in ("left", "right") for word in words)


def rotation(case: Case) -> Iterator[Variant | Incomparable]:
    """The members of the structural equivalence class, light phase included (the relation of the paper)."""
    scenario, junction = case.scenario, case.scenario.place
    symmetries = {symmetry.arms: symmetry for symmetry in rotations_of(junction)}
    for arms in range(1, junction.ways):
        what, found = f"rotation by {arms}", symmetries.get(arms)
        if found is None:
            yield Incomparable(what, f"{junction.name} has other {' and '.join(broken_by(junction, arms))} there")
        elif not _lights_follow(junction, scenario.rotation, found.rows):
            yield Incomparable(what, f"the lights of {junction.name} do not follow the rotation")
        else:
            image = rotate(_same(case), -found.rows)
            yield Variant(what, _moved(case, image, rotation=(scenario.rotation + found.rows) % len(image)), image)


def _lights_follow(junction: Junction, rotation: int, rows: int) -> bool:
    """Return whether every group has green when the one did that is moved on to it by so many more rows.

    Rows of a class change the phase in a way of their own; a junction may need another one.
    """
    groups, count = junction.phase_groups, len(junction.entrances)
    if len(groups) < 2:
        return True
    now, then = (
        rotate(groups, -first_green(junction, rotation)),
        rotate(groups, -first_green(junction, (rotation + rows) % count)),
    )
    return all(frozenset((e + rows) % count for e in one) == other for one, other in zip(now, then, strict=True))


def creation(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with the order of creation reversed, which reverses the order of every two vehicles."""
    if len(case.scenario.creation) < 2:
        yield Incomparable("creation order", "there is only one vehicle")
    else:
        yield Variant("creation order reversed", case.but(order=case.scenario.order[::-1]), _same(case))


def renaming(case: Case) -> Iterator[Variant]:
    """Other names of the agents, in another alphabetical order."""
    # What tells those at one entrance apart stays.
    place = case.scenario.place
    names = {
        agent.name: f"v{len(place.entrances) - agent.entrance}{agent.name.removeprefix(place.vehicle_at(agent.entrance))}"
        for agent in case.agents()
    }
    traffic = case.traffic and renamed(case.traffic, names)
    yield Variant("renaming", replace(case, driver=renamed(case.driver, names), traffic=traffic), _same(case))


def motion(case: Case) -> Iterator[Variant | Incomparable]:
    """The map, translated and rotated."""
    yield _elsewhere("moved map", case, moved(case.scenario.place, MOTION), _place(MOTION), sided=False)


def mirror(case: Case) -> Iterator[Variant | Incomparable]:
    """The map in a mirror: traffic keeps to the other side."""
    yield _elsewhere("mirrored map", case, mirrored(case.scenario.place), lambda x, y: (x, -y), sided=True)


def approach(case: Case) -> Iterator[Variant | Incomparable]:
    """Longer approaches for all vehicles: whoever starts alike arrives alike, only later."""
    what, scenario = f"approach longer by {LONGER:g} m", case.scenario
    starts, junction = {scenario.start(e) for e in scenario.creation}, scenario.place
    if junction.control is JunctionControl.LIGHTS or junction.phase_groups:
        yield Incomparable(what, "the lights would have changed meanwhile")
    elif len(starts) > 1:
        yield Incomparable(what, "the vehicles start at different distances or speeds, so their order may change")
    elif any(scenario.start(e)[0] + LONGER > junction.approach(e) for e in scenario.creation):
        yield Incomparable(what, f"the approaches of {junction.name} are too short")
    else:
        yield Variant(what, case.but(distance=[d + LONGER for d in scenario.distances]), _same(case))


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
"""By the name to use in ``relations=``."""


def _same(case: Case) -> tuple[int, ...]:
    return tuple(range(len(case.scenario.directions)))


def _moved(case: Case, image: tuple[int, ...], **changes: Any) -> Case:
    """Return the case with a changed scenario, in which seat and bodies go along with their vehicles."""
    before = case.scenario
    after = before.but(subject=None if before.subject is None else image[before.subject], **changes)
    names = {before.place.vehicle_at(e): after.place.vehicle_at(there) for e, there in enumerate(image)}
    queue = {name: name.partition("+") for name in case.fleet.others}  # a0+1 follows a0
    others = {"".join((names[queue[name][0]], *queue[name][1:])): vehicle for name, vehicle in case.fleet.others.items()}
    return replace(case, scenario=after, fleet=replace(case.fleet, others=others))


def _place(motion_: tuple[float, float, float]) -> Callable[[float, float], tuple[float, float]]:
    x, y, angle = motion_
    cos, sin = np.cos(angle), np.sin(angle)
    return lambda px, py: (float(cos * px - sin * py + x), float(sin * px + cos * py + y))


def _elsewhere(
    what: str, case: Case, after: Junction, place: Callable[[float, float], tuple[float, float]], *, sided: bool
) -> Variant | Incomparable:
    """Return the case at the same junction on another map, entrance by entrance where `place` puts them."""
    scenario, before = case.scenario, case.scenario.place
    arms = _match(before, after, place)
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
            return Incomparable(what, "the lights are grouped in another way there")
        rows = (row for row in Orbits.at(after).rows if after.phase_groups[first_green(after, row)] == green)
        row = next(rows, -1)
        if row < 0:
            return Incomparable(what, "no rotation there begins with the same lights")
    starts = [scenario.start(image.index(e)) for e in range(count)]
    # A row of a class changes the phase; everything else is turned back first, so that it ends where it has to be.
    order = [image[(e + scenario.rotation) % count] for e in scenario.order]
    there = _moved(
        case,
        image,
        place=after,
        directions=rotate(tuple(placed), -row),
        distance=rotate(tuple(d for d, _ in starts), -row),
        speed=rotate(tuple(v for _, v in starts), -row),
        rotation=row,
        order=[(e - row) % count for e in order],
    )
    return Variant(what, there, image, sided=sided)


def _match(before: Junction, after: Junction, place: Callable[[float, float], tuple[float, float]]) -> tuple[int, ...]:
    """Return for each arm of `before` the arm of `after` that lies at the position to which `place` maps the first arm."""

    def middles(junction: Junction) -> list[NDArray[np.float64]]:
        ends = [
            [junction.way_in(e).points[-1] for e in arm.entrances] + [junction.way_out(x).points[0] for x in arm.exits]
            for arm in junction.arms
        ]
        return [np.mean(points, axis=0) for points in ends]

    there = np.array(middles(after))
    return tuple(int(np.argmin(np.hypot(*(there - place(x, y)).T))) for x, y in middles(before))
