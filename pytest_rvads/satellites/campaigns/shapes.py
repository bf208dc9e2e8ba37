"""Shapes: classes of junctions that are equal up to a motion of the plane, so that one run stands for a run at each.

Builders of towns place the same junction in many places. Two junctions have the same shape if a rotation of arms maps lanes,
movements, turns, signs, phases and all relations of the first to those of the second, and a rigid motion maps their centre lines,
within a tolerance. Mirror images have different shapes, because traffic keeps to one side.

Junctions are compared as far as runs reach. Results are shared only on request, because a driver that reads coordinates could
tell the junctions of a shape apart.
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
from pytest_rvads.scenarios.scenario import Scenario, first_green
from pytest_rvads.scenarios.senses import IDEAL
from pytest_rvads.support.errors import ScenarioError, require

__all__ = ["REACH", "TOLERANCE", "Member", "Shape", "shapes", "twin"]

REACH = 60.0
"""Compared length of approaches and exit roads [m].

Itineraries end this far down the exit road (`EXIT_LENGTH`), and the shipped drivers plan from this far before the junction. A
vehicle that starts farther out needs more, see `twin`.
"""
TOLERANCE = 0.1
"""Largest distance between corresponding points, and largest difference of stopping lines and widths [m]."""
_SPACING = 0.5
"""Distance between compared points [m]."""
_ROOM = 10.0
"""Length that has to be compared behind the farthest starting point, for a body and for the view of drivers [m]."""

_Complex = NDArray[np.complex128]


class _Onto(NamedTuple):
    """A mapping of the arms, and so of the lanes, of a junction to those of another junction."""

    arms: int
    entrances: tuple[int, ...]
    """The image of every entrance."""
    exits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Member:
    """A junction of a shape."""

    junction: Junction
    rotation: int
    """Arm ``i`` corresponds to arm ``i + rotation`` of the representative, modulo the number of arms."""
    entrances: tuple[int, ...]
    """Per entrance, the corresponding entrance of the representative."""
    deviation: float
    """Largest distance between corresponding points after the best motion [m]."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Junctions that are equal up to a motion of the plane."""

    representative: Junction
    members: tuple[Member, ...]
    """The junctions in the given order; the representative comes first, with rotation and deviation 0."""
    reach: float
    """Compared length of approaches and exit roads [m]."""


def shapes(junctions: Sequence[Junction], reach: float = REACH) -> tuple[Shape, ...]:
    """Return the shapes of junctions; each junction is in exactly one shape, and the first junction of a shape represents it.

    Args:
        junctions: the junctions, with their geometry.
        reach: the compared length of approaches and exit roads [m].

    Raises:
        ScenarioError: an element of `junctions` is no junction, or has no geometry.
    """
    found: dict[object, list[tuple[_Form, list[Member]]]] = {}
    for junction in junctions:
        require(junction, Junction, "shapes are those of junctions, as rvads.find('stop4') returns them", ScenarioError)
        if not junction.drivable:
            raise ScenarioError(
                f"junction {junction.name!r} has no shape because it is not known where its lanes lie: take it from a map"
            )
        form = _Form(junction, reach)
        alike = found.setdefault(form.signature, [])
        for other, members in alike:
            if (member := _laid(form, other)) is not None:
                members.append(member)
                break
        else:
            same = tuple(range(len(junction.entrances)))
            alike.append((form, [Member(junction, 0, same, 0.0)]))
    groups = [(form.junction, tuple(members)) for alike in found.values() for form, members in alike]
    places = {id(junction): number for number, junction in reversed([*enumerate(junctions)])}
    groups.sort(key=lambda group: places[id(group[0])])
    return tuple(Shape(first, members, reach) for first, members in groups)


def twin(scenario: Scenario, member: Member, shape: Shape) -> Scenario | None:
    """Return the scenario at the representative whose run is that of `scenario`, moved to the representative.

    Args:
        scenario: a scenario at the junction of `member`.
        member: a member of `shape`.
        shape: the shape.

    Returns:
        The scenario; None if vehicles start farther out than was compared or have no room at their start, or if the senses are
        not ideal (noise depends on the name of the junction).
    """
    place = shape.representative
    if scenario.place is place:
        return scenario
    starts = [distance for distance, _ in scenario.starts()]
    if scenario.senses != IDEAL or max(starts) + max(scenario.place.setbacks) + _ROOM > shape.reach:
        return None
    count, onto = len(member.entrances), member.entrances
    row = _row(member.junction, scenario.rotation, place, onto)
    if row is None:
        return None

    def moved(values: Sequence[Any]) -> tuple[Any, ...]:
        """Return values per entrance of the map as values per entrance of the representative before its rotation."""
        images: list[Any] = [None] * count
        for entrance, value in enumerate(values):
            images[onto[entrance]] = value
        return rotate(tuple(images), -row)

    made = ((first + scenario.rotation) % count for first in scenario.order)
    other = Scenario(
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
        order=tuple((onto[entrance] - row) % count for entrance in made),
        followers=scenario.followers,
    )
    try:
        other.starts()
    except ScenarioError:
        return None
    return other


@dataclass(frozen=True, eq=False)
class _Form:
    """A junction with its compared properties."""

    junction: Junction
    reach: float

    @cached_property
    def signature(self) -> object:
        """A cheap key, equal for all junctions of a shape, whatever their first arm, and different for most others."""
        arms = self.labels
        least = min(arms[k:] + arms[:k] for k in range(len(arms)))
        return self.junction.left_hand, least

    @cached_property
    def labels(self) -> tuple[Any, ...]:
        """Per arm, its lanes with their signs, and its movements with their targets as numbers of arms onward."""
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
        """Per entrance, points of the approach, from the vertex upstream."""
        return tuple(_points(self.junction.way_in(e), self.reach, back=True) for e in range(len(self.junction.entrances)))

    @cached_property
    def outs(self) -> tuple[_Complex, ...]:
        """Per exit, points of its road, from the vertex on."""
        return tuple(_points(self.junction.way_out(e), self.reach) for e in range(len(self.junction.exits)))

    @cached_property
    def through(self) -> Mapping[tuple[int, int], _Complex]:
        """Points of the movements."""
        return {key: _points(self.junction.way_through(*key), np.inf) for key in self.junction.movements}


def _points(line: Segment, reach: float, *, back: bool = False) -> _Complex:
    """Return points of a line as complex numbers, from its start or its end on: at equal distances, and the last point."""
    length = min(line.length, reach)
    stations = np.append(np.arange(0.0, length, _SPACING), length)
    if back:
        stations = line.length - stations
    x, y = (np.interp(stations, line.stations, line.points[:, axis]) for axis in (0, 1))
    points: _Complex = x + 1j * y
    return points


def _laid(form: _Form, other: _Form) -> Member | None:
    """Return a junction as a member of another junction's shape, by the least possible rotation of arms; None if impossible."""
    for onto in _rotations(form, other):
        deviation = _deviation(form, other, onto)
        if deviation <= TOLERANCE and _same(form.junction, other.junction, onto):
            return Member(form.junction, onto.arms, onto.entrances, deviation)
    return None


def _rotations(form: _Form, other: _Form) -> Iterator[_Onto]:
    """Yield the rotations of arms that take lanes, signs and movements of one junction to those of another."""
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
    """Return the largest distance of corresponding points after the best motion [m]; infinite for lines of different lengths."""
    pairs = [(line, other.ins[onto.entrances[k]]) for k, line in enumerate(form.ins)]
    pairs += [(line, other.outs[onto.exits[k]]) for k, line in enumerate(form.outs)]
    pairs += [(line, other.through[onto.entrances[e], onto.exits[x]]) for (e, x), line in form.through.items()]
    # The numbers of points of lines within the tolerance differ by at most one, and then the last two points are neighbours.
    if any(abs(len(own_points) - len(other_points)) > 1 for own_points, other_points in pairs):
        return np.inf
    # The last points correspond, and so do the points before at equal distances.
    ours, theirs = (
        np.concatenate([np.append(pair[k][: min(map(len, pair)) - 1], pair[k][-1]) for pair in pairs]) for k in (0, 1)
    )
    own_points, other_points = ours - ours.mean(), theirs - theirs.mean()
    turn = np.vdot(own_points, other_points)  # Kabsch in the plane: the rotation with the least sum of squares
    turn = turn / abs(turn) if abs(turn) else 1.0
    return float(np.abs(turn * own_points - other_points).max())


def _same(place: Junction, other_place: Junction, onto: _Onto) -> bool:
    """Return whether stopping lines, phases and the relations of entrances and movements are the same."""
    entrances = onto.entrances
    rows = Orbits.at(place).rows if place.phase_groups else range(1)
    widths = [(place.lane_width, other_place.lane_width)]
    for number, lane in enumerate(place.entrances):
        image = other_place.entrances[entrances[number]]
        if (lane.sign_setback is None) is not (image.sign_setback is None) or (lane.phase is None) is not (image.phase is None):
            return False
        widths += [(lane.setback, image.setback), (lane.sign_setback or 0.0, image.sign_setback or 0.0)]

    def key(movement: tuple[int, int]) -> tuple[int, int]:
        return entrances[movement[0]], onto.exits[movement[1]]

    return (
        all(abs(own_value - other_value) <= TOLERANCE for own_value, other_value in widths)
        and _lifted(place.right_of, entrances.__getitem__) == other_place.right_of
        and _lifted(place.opposite, entrances.__getitem__) == other_place.opposite
        and _lifted(place.stated, key) == other_place.stated
        and _lifted(place.conflicts or (), key) == other_place.conflicts
        and {(key(own_value), key(other_value)): why for (own_value, other_value), why in (place.yields or {}).items()}
        == other_place.yields
        and all(_row(place, row, other_place, entrances) is not None for row in rows)
    )


def _lifted(pairs: Any, image: Callable[[Any], Any]) -> frozenset[tuple[Any, Any]]:
    return frozenset((image(first), image(second)) for first, second in pairs)


def _row(place: Junction, row: int, other_place: Junction, entrances: Sequence[int]) -> int | None:
    """Return the row of the other junction in which lights begin as in a row of this junction; None if no such row exists.

    Of several rows, the row that also keeps the order of creation is returned.
    """
    turns = _turns(place, row, entrances)
    rows = Orbits.at(other_place).rows
    same_order = [other_row for other_row in rows if other_row == entrances[row]]
    return next((other_row for other_row in (*same_order, *rows) if _turns(other_place, other_row) == turns), None)


def _turns(place: Junction, row: int, entrances: Sequence[int] | None = None) -> list[frozenset[int]]:
    """Return the groups of entrances that have green, in order from the first group on, as images of the entrances."""
    plan = SignalPlan(place.phase_groups, first_green(place, row))
    groups = plan.groups[plan.first :] + plan.groups[: plan.first]
    return [group if entrances is None else frozenset(entrances[k] for k in group) for group in groups]
