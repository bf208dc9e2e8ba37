"""Decides which of two movements of a junction that cross or merge gives way, and for which reason.

If the map itself states which movement has priority, the map decides; then signs decide; then, of two movements from opposite
sides, the turn across the other's way gives way; then, if the map shows that a lane joins another lane, the joining movement
gives way; else right goes before left (Vienna Convention on Road Traffic 1968, Art. 16(1)(b), 18 and 25(2); StVO, sections 8(1),
9(3), 9(4) and 18(3); Uniform Vehicle Code 11-401 to 11-405). Two lanes at a flat angle come together. If the map does not show
which of the two joins the other, it can't be decided which gives way. At an all-way stop the relation says which vehicle goes
first in a tie; at lights, which vehicle gives way while both have green.

A pair that can't be decided has the reason `Reason.UNDECIDED` in both orders, and is no ground of any rule.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.segment import Pose, Turn

__all__ = ["Precedence", "Reason"]

_RANK = {Sign.STOP: 0, Sign.YIELD: 0, Sign.NONE: 1, Sign.LIGHTS: 1, Sign.PRIORITY: 2}
"""Ranks of signs: a vehicle past a sign of lower rank gives way.

The ranks follow the Vienna Convention on Road Signs and Signals 1968, signs B,1 to B,3. Stop and yield signs both oblige to give
way to the road ahead. Between two vehicles past such signs, sides decide.
"""
_AHEAD = 1e-6
_FLAT = math.radians(50.0)
"""Angle between entrances below which their lanes come together and do not cross [rad].

Roads that cross do so at 60 degrees or more (AASHTO, A Policy on Geometric Design: angle of intersection); the difference leaves
room for the bend of a lane in the junction.
"""


class Reason(StrEnum):
    """The reason why a movement gives way to another movement."""

    STATED = "stated"
    """The map states the priority."""
    SIGN = "sign"
    """The entrance of the movement has a stop or yield sign, or the entrance of the other movement has a priority sign."""
    TURN = "turn"
    """The movement turns across the way of the other movement, which comes from the opposite side."""
    RIGHT = "right"
    """The other movement comes from the right; from the left, where traffic keeps left."""
    MERGE = "merge"
    """According to the map, the movement joins the other movement."""
    UNDECIDED = "undecided"
    """Both come together at a flat angle, and the map does not show which joins the other, so it can't be decided."""


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

    def why(self, key: Key, other_key: Key) -> Reason | None:
        """Return the reason why an agent on way `key` gives way to an agent on way `other_key`, or None.

        Movements from two lanes of one arm never give way to each other here: the vehicle ahead goes first. Between a movement
        and a further way the map decides alone.
        """
        if (key, other_key) in self.stated:
            return Reason.STATED
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
        """Return whether `other_entrance` lies to the right of `entrance`; to the left, where traffic keeps left.

        The places of the entrances decide, if exactly one entrance lies to the right of the other. Two facing entrances may lie
        to the right of each other. Then the paper's relation decides, and without the relation the angle between the entrances.
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
