"""Metamorphic relations: from a case to variants that must be judged alike.

A relation that can't be applied yields an `Incomparable` with the reason, so that no relation is skipped in silence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.renaming import renamed
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.orbits import Orbits, rotate
from pytest_rvads.scenarios.scenario import first_green
from pytest_rvads.search.remap import broken_by, mirrored, moved, rotations_of

__all__ = ["RELATIONS", "Incomparable", "Variant"]

MOTION = (137.0, -59.0, 0.3)
"""Motion of a moved map: translation x, y [m] and rotation [rad]."""
LONGER = 20.0
"""Additional length of prolonged approaches [m]."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A case that must be judged like the original case."""

    what: str
    """The change in words, such as ``rotation by 1``."""
    case: Case
    image: tuple[int, ...]
    """The corresponding entrance for each entrance of the original junction."""
    sided: bool = False
    """Whether the scenario is mirrored, so that rules which name left or right don't apply to both scenarios alike."""

    def concerns(self, rule: Rule) -> bool:
        """Return whether a rule requires the same in both scenarios."""
        return not (self.sided and names_sides(rule))


@dataclass(frozen=True, slots=True)
class Incomparable:
    """A change that gives no variant."""

    what: str
    why: str


Relation = Callable[[Case], Iterator[Variant | Incomparable]]


def names_sides(rule: Rule) -> bool:
    """Return whether a rule mentions turns to the left or right."""
    words = (term for atom in f.atoms(rule.formula) for term in atom.terms)
    return any(isinstance(word, f.Value) and word.name in ("left", "right") for word in words)


def rotation(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the members of the structural equivalence class, including the light phase (the relation of the paper)."""
    scenario, junction = case.scenario, case.scenario.place
    symmetries = {symmetry.arms: symmetry for symmetry in rotations_of(junction)}
    for arms in range(1, junction.ways):
        what, match = f"rotation by {arms}", symmetries.get(arms)
        if match is None:
            yield Incomparable(what, f"{junction.name} has other {' and '.join(broken_by(junction, arms))} there")
        elif not _lights_follow(junction, scenario.rotation, match.rows):
            yield Incomparable(what, f"the lights of {junction.name} do not follow the rotation")
        else:
            image = rotate(_identity_image(case), -match.rows)
            yield Variant(what, _changed_case(case, image, rotation=(scenario.rotation + match.rows) % len(image)), image)


def _lights_follow(junction: Junction, rotation: int, rows: int) -> bool:
    """Return whether the order of the light phases rotates with the junction.

    A rotation of a scenario changes the first phase in a fixed way, and a junction may need another change.

    Args:
        junction: the junction.
        rotation: rotation of the original scenario.
        rows: number of entrances by which the rotated scenario moves on.
    """
    groups, count = junction.phase_groups, len(junction.entrances)
    if len(groups) < 2:
        return True
    groups_before, groups_after = (
        rotate(groups, -first_green(junction, rotation)),
        rotate(groups, -first_green(junction, (rotation + rows) % count)),
    )
    return all(
        frozenset((e + rows) % count for e in group) == later_group
        for group, later_group in zip(groups_before, groups_after, strict=True)
    )


def creation(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with the order of creation reversed, which reverses the order of every two vehicles."""
    if len(case.scenario.creation) < 2:
        yield Incomparable("creation order", "there is only one vehicle")
    else:
        yield Variant("creation order reversed", case.but(order=case.scenario.order[::-1]), _identity_image(case))


def renaming(case: Case) -> Iterator[Variant]:
    """Yield the case with other names of the agents, in another alphabetical order."""
    # The suffix of a follower's name stays.
    place = case.scenario.place
    names = {
        agent.name: f"v{len(place.entrances) - agent.entrance}{agent.name.removeprefix(place.vehicle_at(agent.entrance))}"
        for agent in case.agents()
    }
    traffic = case.traffic and renamed(case.traffic, names)
    yield Variant("renaming", replace(case, driver=renamed(case.driver, names), traffic=traffic), _identity_image(case))


def motion(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case on a translated and rotated map."""
    yield _on_other_map("moved map", case, moved(case.scenario.place, MOTION), _motion_of_points(MOTION), sided=False)


def mirror(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case on a mirrored map, with traffic on the other side."""
    yield _on_other_map("mirrored map", case, mirrored(case.scenario.place), lambda x, y: (x, -y), sided=True)


def approach(case: Case) -> Iterator[Variant | Incomparable]:
    """Yield the case with longer approaches, if all vehicles have equal starts and so arrive in the same order, only later."""
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
"""Relations by their name in ``relations=``."""


def _identity_image(case: Case) -> tuple[int, ...]:
    return tuple(range(len(case.scenario.directions)))


def _changed_case(case: Case, image: tuple[int, ...], **changes: Any) -> Case:
    """Return the case with a changed scenario; the seat of the subject and the bodies move with their vehicles."""
    before = case.scenario
    after = before.but(subject=None if before.subject is None else image[before.subject], **changes)
    names = {before.place.vehicle_at(e): after.place.vehicle_at(image_of) for e, image_of in enumerate(image)}
    queue = {name: name.partition("+") for name in case.fleet.others}  # a0+1 follows a0
    others = {"".join((names[queue[name][0]], *queue[name][1:])): vehicle for name, vehicle in case.fleet.others.items()}
    return replace(case, scenario=after, fleet=replace(case.fleet, others=others))


def _motion_of_points(motion_: tuple[float, float, float]) -> Callable[[float, float], tuple[float, float]]:
    x, y, angle = motion_
    cos, sin = np.cos(angle), np.sin(angle)
    return lambda px, py: (float(cos * px - sin * py + x), float(sin * px + cos * py + y))


def _on_other_map(
    what: str, case: Case, after: Junction, place: Callable[[float, float], tuple[float, float]], *, sided: bool
) -> Variant | Incomparable:
    """Return the case at the junction `after` on another map; `place` maps points of the first map to the other map."""
    scenario, before = case.scenario, case.scenario.place
    arms = _matching_arms(before, after, place)
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
    # A rotation changes the phase, and would also move the vehicles: these are rotated back before.
    order = [image[(e + scenario.rotation) % count] for e in scenario.order]
    changed = _changed_case(
        case,
        image,
        place=after,
        directions=rotate(tuple(placed), -row),
        distance=rotate(tuple(d for d, _ in starts), -row),
        speed=rotate(tuple(v for _, v in starts), -row),
        rotation=row,
        order=[(e - row) % count for e in order],
    )
    return Variant(what, changed, image, sided=sided)


def _matching_arms(before: Junction, after: Junction, place: Callable[[float, float], tuple[float, float]]) -> tuple[int, ...]:
    """Return for each arm of `before` the arm of `after` that lies at the position to which `place` maps the first arm."""

    def middles(junction: Junction) -> list[NDArray[np.float64]]:
        ends = [
            [junction.way_in(e).points[-1] for e in arm.entrances] + [junction.way_out(x).points[0] for x in arm.exits]
            for arm in junction.arms
        ]
        return [np.mean(points, axis=0) for points in ends]

    centres = np.array(middles(after))
    return tuple(int(np.argmin(np.hypot(*(centres - place(x, y)).T))) for x, y in middles(before))
