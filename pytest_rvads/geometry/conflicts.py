"""The ways of a junction, the stretches that two ways share, and which of two movements that cross or merge gives way.

The first of these criteria that applies to two movements decides (Vienna Convention on Road Traffic 1968, Art. 16(1)(b), 18 and
25(2); StVO, sections 8(1), 9(3), 9(4) and 18(3); Uniform Vehicle Code 11-401 to 11-405):

1. The map states which movement has priority.
2. The signs of the two entrances have different ranks.
3. The movements come from opposite sides: the movement that turns across the way of the other movement gives way.
4. If the map shows that a lane joins another lane, the movement on the joining lane gives way.
5. One movement comes from the right of the other movement and has priority.

Lanes of two entrances at a flat angle come together and do not cross. If the map does not show which of two such lanes joins the
other lane, their priority can't be decided. At an all-way stop, priority counts between vehicles that arrive together; at lights,
between vehicles that both have green.

Two movements whose priority can't be decided have the reason `Reason.UNDECIDED` in both orders, and no rule accuses a vehicle
because of these two movements.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.geometry.turns import Turn

__all__ = ["CONFLICT_WIDTH", "JunctionKind", "Key", "Line", "Precedence", "Reason", "Shared", "Stretch", "Way", "stretches"]

CONFLICT_WIDTH = 2.6
"""Width of a movement: distance of centre lines below which two movements are in conflict [m].

The distance is the sum of the width of a car and of the additional width that its body sweeps in a bend.
"""
_SPACING = 0.5

Key = tuple[int, int]
"""A way, as the numbers of its start and its end: for a movement the numbers of its entrance and its exit."""

_RANK = {Sign.STOP: 0, Sign.YIELD: 0, Sign.NONE: 1, Sign.LIGHTS: 1, Sign.PRIORITY: 2}
"""Ranks of signs: a vehicle from an entrance gives way to vehicles from entrances with a sign of higher rank.

The ranks follow the Vienna Convention on Road Signs and Signals 1968, signs B,1 to B,3. Stop and yield signs both oblige to give
way to the road ahead. Between two vehicles with signs of the same rank, the sides from which the vehicles come decide.
"""
_AHEAD = 1e-6
_FLAT = math.radians(50.0)
"""Angle between entrances below which their lanes come together and do not cross [rad].

Roads that cross do so at 60 degrees or more (AASHTO, A Policy on Geometric Design: angle of intersection); the difference leaves
room for the bend of a lane in the junction.
"""


class Way(Protocol):
    """A path through a junction: a movement of vehicles from lane to lane, or another path, see `Junction.further`."""

    @property
    def entrance(self) -> int:
        """Number of the start of the way; for a movement, the number of its entrance."""

    @property
    def exit(self) -> int:
        """Number of the exit of the way. A way that is no movement gets a number after the exits of lanes."""

    @property
    def key(self) -> Key:
        """Numbers of the start and the end of the way."""

    @property
    def kind(self) -> str:
        """The noun for the way in messages, such as ``movement``."""

    @property
    def turn(self) -> Turn:
        """The side to which the way turns."""

    @property
    def length(self) -> float:
        """Length of the way from its start to its end along the centre line [m]."""

    @property
    def width(self) -> float:
        """Width that bodies on the way take up [m]."""

    @property
    def path(self) -> Segment | None:
        """The centre line of the way; None if the line is not known."""


class JunctionKind(StrEnum):
    """The kind of a junction: whether some of its movements cross, movements only merge, or no two movements meet."""

    CROSSING = "crossing"
    """Some movements cross, or come nearer to each other than `CONFLICT_WIDTH`, although they have different exits."""
    MERGING = "merging"
    """Movements meet only if they lead into the same exit."""
    CONFLICT_FREE = "conflict-free"
    """No two movements from different entrances meet."""


class Stretch(NamedTuple):
    """A part of a way, given by two distances along the way from its start."""

    start: float
    """First station [m]."""
    end: float
    """Last station [m]."""


class Shared(NamedTuple):
    """The stretches on which two ways are in conflict."""

    mine: Stretch
    """The stretch of the first way."""
    yours: Stretch
    """The stretch of the second way."""
    merges: bool
    """Whether both ways lead into the same exit, where two vehicles have room behind each other."""


class Line(NamedTuple):
    """A centre line along which an agent moves on a way."""

    path: Segment
    width: float
    """Width of the way [m]."""
    origin: float = 0.0
    """Distance from the beginning of the line to the start of the way [m]."""


def stretches(ways: Mapping[Key, Line]) -> dict[tuple[Key, Key], Shared]:
    """Return, per ordered pair of ways, the stretches on which the two are nearer than half the sum of their widths.

    Pairs of ways from the same start are left out, because vehicles of an entrance follow each other.

    Args:
        ways: the line of every way.
    """
    keys = list(ways)
    lines = [_sample(line) for line in ways.values()]
    widths = np.array([line.width for line in ways.values()])
    boxes = np.array([(*points.min(axis=0), *points.max(axis=0)) for _, points in lines]).reshape(-1, 4)
    shared = {}
    for i, (key, (along, own_points)) in enumerate(zip(keys, lines, strict=True)):
        # Most ways of a junction with many lanes are far apart; comparing their boxes is cheaper than comparing their lines.
        reach = (widths[i] + widths) / 2
        near_boxes = np.all(
            (boxes[:, :2] < boxes[i, 2:] + reach[:, None]) & (boxes[:, 2:] > boxes[i, :2] - reach[:, None]), axis=1
        )
        for k in near_boxes.nonzero()[0]:
            other_key, (across, other_points) = keys[k], lines[k]
            if key[0] >= other_key[0]:
                continue
            apart = own_points[:, None] - other_points[None]
            near = np.einsum("ijk,ijk->ij", apart, apart) < float(reach[k]) ** 2
            own_stations, other_stations = along[near.any(axis=1)], across[near.any(axis=0)]
            if len(own_stations):
                mine, yours = (
                    Stretch(float(own_stations[0]), float(own_stations[-1])),
                    Stretch(float(other_stations[0]), float(other_stations[-1])),
                )
                merges = key[1] == other_key[1]
                shared[key, other_key], shared[other_key, key] = Shared(mine, yours, merges), Shared(yours, mine, merges)
    return shared


def _sample(line: Line) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations, shape ``(k,)``, and points, shape ``(k, 2)``, along a centre line [m]."""
    segment = line.path
    stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
    return stations - line.origin, np.column_stack(
        [np.interp(stations, segment.stations, segment.points[:, axis]) for axis in (0, 1)]
    )


class Reason(StrEnum):
    """The reason why a movement gives way to another movement."""

    STATED = "stated"
    """The map states the priority."""
    SIGN = "sign"
    """The entrance of the movement has a stop or yield sign, or the entrance of the other movement has a priority sign."""
    TURN = "turn"
    """The movement turns across the way of the other movement, which comes from the opposite side."""
    RIGHT = "right"
    """The other movement comes from the right, or, where traffic keeps left, from the left."""
    MERGE = "merge"
    """According to the map, the movement joins the other movement."""
    CROSSWALK = "crosswalk"
    """The movement leads over a crosswalk, and the other way is a crossing of pedestrians."""
    UNDECIDED = "undecided"
    """The movements come together at a flat angle, and the map does not show which movement joins the other movement."""


@dataclass(frozen=True, slots=True)
class Precedence:
    """The properties of a junction that decide which movement gives way."""

    signs: Sequence[Sign]
    """Sign of every entrance."""
    arms: Sequence[int]
    """The arm of every entrance."""
    starts: Mapping[int, Pose]
    """Pose at which the movements of an entrance begin."""
    turns: Mapping[Key, Turn]
    right_of: Collection[tuple[int, int]]
    opposite: Collection[tuple[int, int]]
    stated: Collection[tuple[Key, Key]]
    """Pairs of movements of which, according to the map, the first gives way to the second."""
    joining: Collection[tuple[Key, Key]]
    """Pairs of movements of which, according to the map, the first joins the second."""
    left_hand: bool
    crossings: Collection[int] = ()
    """Numbers of the starts of crossings over crosswalks."""

    def why(self, key: Key, other_key: Key) -> Reason | None:
        """Return the reason why an agent on way `key` gives way to an agent on way `other_key`, or None.

        Movements from two lanes of one arm have no reason, because the vehicle ahead goes first. A movement gives way to a
        crossing of pedestrians. A movement and another way that is no movement (`Junction.further`) have a reason only if the map
        states the priority.
        """
        if (key, other_key) in self.stated:
            return Reason.STATED
        if other_key[0] in self.crossings and key[0] not in self.crossings:
            return Reason.CROSSWALK
        entrance, other_entrance = key[0], other_key[0]
        if (
            (other_key, key) in self.stated
            or max(entrance, other_entrance) >= len(self.arms)
            or self.arms[entrance] == self.arms[other_entrance]
        ):
            return None
        ranks = _RANK[self.signs[entrance]], _RANK[self.signs[other_entrance]]
        if ranks[0] != ranks[1]:
            return Reason.SIGN if ranks[0] < ranks[1] else None
        if (entrance, other_entrance) in self.opposite:
            if self._across(key) != self._across(other_key):
                return Reason.TURN if self._across(key) else None
            if self._across(key):
                return None
        elif self.signs[entrance] is self.signs[other_entrance] is Sign.LIGHTS:
            return None
        return self._among_equals(key, other_key)

    def _among_equals(self, key: Key, other_key: Key) -> Reason | None:
        entrance, other_entrance = key[0], other_key[0]
        if set(self.signs) != {Sign.STOP}:  # at an all-way stop, lanes that come together take turns like other lanes
            if (key, other_key) in self.joining or (other_key, key) in self.joining:
                return Reason.MERGE if (key, other_key) in self.joining else None
            if abs(math.remainder(self.starts[other_entrance].heading - self.starts[entrance].heading, math.tau)) < _FLAT:
                return Reason.UNDECIDED
        return Reason.RIGHT if self._from_right(entrance, other_entrance) else None

    def _across(self, key: Key) -> bool:
        return self.turns[key] is (Turn.RIGHT if self.left_hand else Turn.LEFT)

    def _from_right(self, entrance: int, other_entrance: int) -> bool:
        """Return whether `other_entrance` lies to the right of `entrance`, or, where traffic keeps left, to the left.

        If exactly one of the two entrances lies to the right of the other by position, the positions decide. For all other pairs,
        such as two entrances that face each other, the paper's relation ``right-of`` decides. If this relation does not hold in
        either order, the angle between the two entrances decides.
        """
        right = self._right_by_place(entrance, other_entrance)
        if right != self._right_by_place(other_entrance, entrance):
            return right != self.left_hand
        if (other_entrance, entrance) in self.right_of or (entrance, other_entrance) in self.right_of:
            return (other_entrance, entrance) in self.right_of
        turned = (self.starts[other_entrance].heading - self.starts[entrance].heading) % math.tau
        return (turned < math.pi - _AHEAD) != self.left_hand

    def _right_by_place(self, entrance: int, other_entrance: int) -> bool:
        """Return whether entrance `other_entrance` lies to the right of the line along which traffic enters at `entrance`."""
        (x, y, heading), (u, v, _) = self.starts[entrance], self.starts[other_entrance]
        return math.sin(heading) * (u - x) - math.cos(heading) * (v - y) > 0.0
