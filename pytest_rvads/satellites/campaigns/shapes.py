"""Shapes: classes of congruent junctions, so that a run at one junction of a class counts for every junction of the class.

Makers of maps place the same junction in many places. Two junctions have the same shape if a cyclic renumbering of the arms maps
the lanes, movements, turns, signs, phases and relations of one junction to those of the other, and a rigid motion of the plane
maps the centre lines within a tolerance. Mirror images have different shapes, because traffic keeps to one side.

Roads are compared up to the distance from the junction that vehicles reach in a run. Results are shared only on request, because
a driver that reads coordinates can tell the junctions of a shape apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.runs.states import SignalPlan
from pytest_rvads.scenarios.orbits import Orbits, rotate
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.senses import IDEAL
from pytest_rvads.scenarios.signal_cycle import first_green
from pytest_rvads.support.errors import ScenarioError, require

__all__ = ["REACH", "TOLERANCE", "Member", "Shape", "shapes", "twin"]

REACH = 60.0
"""Length of approaches and exit roads that is compared [m].

Itineraries end at this distance on the exit road (`EXIT_LENGTH`), and the shipped drivers plan from this distance before the
junction. If a vehicle starts farther away, `twin` returns None.
"""
TOLERANCE = 0.1
"""Largest difference between junctions of a shape: between corresponding points, positions of stopping lines, and widths [m]."""
_SPACING = 0.5
"""Distance between compared points [m]."""
_ROOM = 10.0
"""Length of road behind the starting point of a vehicle that is compared, for its body and for the view of drivers [m]."""

_Complex = NDArray[np.complex128]


class _Onto(NamedTuple):
    """A mapping of the arms and lanes of a junction to the arms and lanes of another junction."""

    arms: int
    entrances: tuple[int, ...]
    """Per entrance, its image at the other junction."""
    exits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """A junction of a shape (a class of congruent junctions), with its mapping to the representative, the first junction."""

    junction: Junction
    rotation: int
    """Arm ``i`` corresponds to arm ``i + rotation`` of the representative, modulo the number of arms."""
    entrances: tuple[int, ...]
    """Per entrance, the corresponding entrance of the representative."""
    deviation: float
    """Largest distance between corresponding points after the best rigid motion [m]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A class of congruent junctions: a rigid motion of the plane maps each of them to each other."""

    representative: Junction
    members: tuple[Member, ...]
    """The junctions in the given order; the representative comes first, with rotation and deviation 0."""
    reach: float
    """Compared length of approaches and exit roads [m]."""


def shapes(junctions: Sequence[Junction], reach: float = REACH) -> tuple[Shape, ...]:
    """Return the classes of congruent junctions; each junction is in one class, and the first junction of a class represents it.

    Args:
        junctions: the junctions, with their geometry.
        reach: the compared length of approaches and exit roads [m].

    Raises:
        ScenarioError: an element of `junctions` is no junction, or is a junction without geometry.
    """
    groups_by_signature: dict[object, list[tuple[_Form, list[Member]]]] = {}
    for junction in junctions:
        require(junction, Junction, "junctions have shapes, and rvads.find('stop4') returns a junction", ScenarioError)
        if not junction.drivable:
            raise ScenarioError(
                f"junction {junction.name!r} has no shape because it is not known where its lanes lie: take it from a map"
            )
        form = _Form(junction, reach)
        alike = groups_by_signature.setdefault(form.signature, [])
        for other, members in alike:
            if (member := _as_member(form, other)) is not None:
                members.append(member)
                break
        else:
            identity = tuple(range(len(junction.entrances)))
            alike.append((form, [Member(junction, 0, identity, 0.0)]))
    groups = [(form.junction, tuple(members)) for alike in groups_by_signature.values() for form, members in alike]
    places = {id(junction): number for number, junction in reversed([*enumerate(junctions)])}
    groups.sort(key=lambda group: places[id(group[0])])
    return tuple(Shape(first, members, reach) for first, members in groups)


def twin(scenario: Scenario, member: Member, shape: Shape) -> Scenario | None:
    """Return the scenario at a shape's representative whose run equals the run of `scenario` up to a motion of the plane.

    Args:
        scenario: a scenario at the junction of `member`.
        member: a member of `shape`.
        shape: the shape.

    Returns:
        The scenario; None if a vehicle starts farther away than roads were compared, if a vehicle has no room at its start at the
        representative, if pedestrians walk, because crosswalks were not compared, or if the senses are not ideal, because noise
        depends on the name of the junction.
    """
    place = shape.representative
    if scenario.place is place:
        return scenario
    starts = [distance for distance, _ in scenario.starts()]
    if scenario.senses != IDEAL or scenario.pedestrians or max(starts) + max(scenario.place.setbacks) + _ROOM > shape.reach:
        return None
    count, onto = len(member.entrances), member.entrances
    row = _equal_row(member.junction, scenario.rotation, place, onto)
    if row is None:
        return None

    def moved(values: Sequence[Any]) -> tuple[Any, ...]:
        """Return values per entrance as values per entrance of the representative, numbered as before a rotation by `row`."""
        images: list[Any] = [None] * count
        for entrance, value in enumerate(values):
            images[onto[entrance]] = value
        return rotate(tuple(images), -row)

    map_order = ((first + scenario.rotation) % count for first in scenario.order)
    image = Scenario(
        place,
        moved(scenario.placed),
        distance=moved(rotate(scenario.distances, scenario.rotation)),
        speed=moved(rotate(scenario.speeds, scenario.rotation)),
        rotation=row,
        configuration=scenario.configuration,
        duration=scenario.duration,
        aggression=scenario.aggression,
        wait=scenario.wait,
        subject=None if scenario.subject is None else onto[scenario.subject],
        order=tuple((onto[entrance] - row) % count for entrance in map_order),
        followers=scenario.followers,
        elapsed=scenario.elapsed,
    )
    try:
        image.starts()
    except ScenarioError:
        return None
    return image


@dataclass(frozen=True, eq=False)
class _Form:
    """A junction with the properties by which shapes are compared."""

    junction: Junction
    reach: float

    @cached_property
    def signature(self) -> object:
        """A key that all junctions of a shape share, whichever arm is numbered first; it differs for most other junctions."""
        arms = self.labels
        least = min(arms[k:] + arms[:k] for k in range(len(arms)))
        return self.junction.left_hand, least

    @cached_property
    def labels(self) -> tuple[Any, ...]:
        """Per arm, the signs of its entrances, its number of exits, and its movements, with target arms counted from the arm."""
        place = self.junction
        ways: list[list[tuple[int, int, int, str]]] = [[] for _ in place.arms]
        for movement in place.movements.values():
            start, end = place.entrances[movement.entrance], place.exits[movement.exit]
            ways[start.arm].append((start.lane, (end.arm - start.arm) % place.ways, end.lane, movement.turn.value))
        return tuple(
            (tuple(place.entrances[k].sign.value for k in arm.entrances), len(arm.exits), tuple(sorted(ways[number])))
            for number, arm in enumerate(place.arms)
        )

    @cached_property
    def ins(self) -> tuple[_Complex, ...]:
        """Per entrance, points on its approach, from the entrance vertex against the direction of travel."""
        return tuple(_points(self.junction.way_in(e), self.reach, back=True) for e in range(len(self.junction.entrances)))

    @cached_property
    def outs(self) -> tuple[_Complex, ...]:
        """Per exit, points on its road, from the exit vertex in the direction of travel."""
        return tuple(_points(self.junction.way_out(e), self.reach) for e in range(len(self.junction.exits)))

    @cached_property
    def through(self) -> Mapping[tuple[int, int], _Complex]:
        """Points on the centre line of each movement, by entrance and exit."""
        return {key: _points(self.junction.way_through(*key), np.inf) for key in self.junction.movements}


def _points(line: Segment, reach: float, *, back: bool = False) -> _Complex:
    """Return points of a line as complex numbers, at equal distances from its start and at its end; with `back` from its end."""
    length = min(line.length, reach)
    stations = np.append(np.arange(0.0, length, _SPACING), length)
    if back:
        stations = line.length - stations
    x, y = (np.interp(stations, line.stations, line.points[:, axis]) for axis in (0, 1))
    points: _Complex = x + 1j * y
    return points


def _as_member(form: _Form, other: _Form) -> Member | None:
    """Return a junction as a member of another junction's shape; None if the two junctions have different shapes.

    Of several renumberings of the arms that fit, the least is taken.
    """
    for onto in _rotations(form, other):
        deviation = _deviation(form, other, onto)
        if deviation <= TOLERANCE and _same_relations(form.junction, other.junction, onto):
            return Member(form.junction, onto.arms, onto.entrances, deviation)
    return None


def _rotations(form: _Form, other: _Form) -> Iterator[_Onto]:
    """Yield the cyclic renumberings of arms that map lanes, signs and movements of a junction to those of another junction."""
    labels, other_labels = form.labels, other.labels
    place, other_place = form.junction, other.junction
    entrances = {(lane.arm, lane.lane): number for number, lane in enumerate(other_place.entrances)}
    exits = {(lane.arm, lane.lane): number for number, lane in enumerate(other_place.exits)}
    for arms in range(place.ways):
        if labels == other_labels[arms:] + other_labels[:arms]:
            yield _Onto(
                arms,
                tuple(entrances[(lane.arm + arms) % place.ways, lane.lane] for lane in place.entrances),
                tuple(exits[(lane.arm + arms) % place.ways, lane.lane] for lane in place.exits),
            )


def _deviation(form: _Form, other: _Form, onto: _Onto) -> float:
    """Return the largest distance of corresponding points after the best rigid motion [m]; infinite if lines differ in length."""
    pairs = [(line, other.ins[onto.entrances[k]]) for k, line in enumerate(form.ins)]
    pairs += [(line, other.outs[onto.exits[k]]) for k, line in enumerate(form.outs)]
    pairs += [(line, other.through[onto.entrances[e], onto.exits[x]]) for (e, x), line in form.through.items()]
    # If the lengths of two lines agree within the tolerance, their numbers of points differ by at most one.
    if any(abs(len(own_points) - len(other_points)) > 1 for own_points, other_points in pairs):
        return np.inf
    # The last points of two lines correspond, and so do points at equal distances from the start.
    ours, theirs = (
        np.concatenate([np.append(pair[k][: min(map(len, pair)) - 1], pair[k][-1]) for pair in pairs]) for k in (0, 1)
    )
    own_points, other_points = ours - ours.mean(), theirs - theirs.mean()
    turn = np.vdot(own_points, other_points)  # Kabsch in the plane: the rotation with the least sum of squares
    turn = turn / abs(turn) if abs(turn) else 1.0
    return float(np.abs(turn * own_points - other_points).max())


def _same_relations(place: Junction, other_place: Junction, onto: _Onto) -> bool:
    """Return whether a mapping keeps the stopping lines, phases, and relations of entrances and movements of a junction."""
    entrances = onto.entrances
    rows = Orbits.at(place).rows if place.phase_groups else range(1)
    widths = [(place.lane_width, other_place.lane_width)]
    for number, lane in enumerate(place.entrances):
        image = other_place.entrances[entrances[number]]
        if (lane.sign_setback is None) is not (image.sign_setback is None) or (lane.phase is None) is not (image.phase is None):
            return False
        widths += [(lane.setback, image.setback), (lane.sign_setback or 0.0, image.sign_setback or 0.0)]
        widths.append((lane.beyond or 0.0, image.beyond or 0.0))

    def key(movement: tuple[int, int]) -> tuple[int, int]:
        return entrances[movement[0]], onto.exits[movement[1]]

    return (
        all(abs(own_value - other_value) <= TOLERANCE for own_value, other_value in widths)
        and _mapped_pairs(place.right_of, entrances.__getitem__) == other_place.right_of
        and _mapped_pairs(place.opposite, entrances.__getitem__) == other_place.opposite
        and _mapped_pairs(place.stated, key) == other_place.stated
        and _mapped_pairs(place.conflicts or (), key) == other_place.conflicts
        and {(key(own_value), key(other_value)): why for (own_value, other_value), why in (place.yields or {}).items()}
        == other_place.yields
        and all(_equal_row(place, row, other_place, entrances) is not None for row in rows)
    )


def _mapped_pairs(pairs: Any, image: Callable[[Any], Any]) -> frozenset[tuple[Any, Any]]:
    return frozenset((image(first), image(second)) for first, second in pairs)


def _equal_row(place: Junction, row: int, other_place: Junction, entrances: Sequence[int]) -> int | None:
    """Return the rotation of scenarios at another junction that has the same order of green as rotation `row` at this junction.

    Of several such rotations, a rotation that also creates the vehicles in the same order is preferred.

    Returns:
        Number of entrances by which scenarios are rotated at the other junction; None if no rotation has the same order of green.
    """
    turns = _green_order(place, row, entrances)
    rows = Orbits.at(other_place).rows
    same_order = [other_row for other_row in rows if other_row == entrances[row]]
    return next((other_row for other_row in (*same_order, *rows) if _green_order(other_place, other_row) == turns), None)


def _green_order(place: Junction, row: int, entrances: Sequence[int] | None = None) -> list[frozenset[int]]:
    """Return the groups of entrances that have green together, in the order in which they get green in a rotated scenario.

    Args:
        place: the junction.
        row: number of entrances by which the scenario is rotated.
        entrances: per entrance, its number at another junction; the groups are given in these numbers. None for own numbers.
    """
    plan = SignalPlan(place.phase_groups, first_green(place, row))
    groups = plan.groups[plan.first :] + plan.groups[: plan.first]
    return [group if entrances is None else frozenset(entrances[k] for k in group) for group in groups]
