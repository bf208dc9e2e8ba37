"""Who gives way to whom where two movements of a junction cross or merge, and why.

Where the map itself says which movement has priority, that decides; then signs; then, of two that come from opposite sides, the
turn across the other's way gives way; else right before left (Vienna Convention on Road Traffic 1968, Art. 16(1)(b) and 18; StVO,
sections 8(1), 9(3) and 9(4); Uniform Vehicle Code 11-401 to 11-405). At an all-way stop this is who goes first in a tie; at
lights, who gives way while both have green.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.maps.control import Sign
from pytest_rvads.maps.segment import Turn

__all__ = ["Precedence", "Reason"]

_RANK = {Sign.STOP: 0, Sign.YIELD: 0, Sign.NONE: 1, Sign.LIGHTS: 1, Sign.PRIORITY: 2}
"""Whoever comes past a sign of lower rank gives way (Vienna Convention on Road Signs and Signals 1968, signs B,1 to B,3). Stop
and yield signs both say to give way to the road ahead; between two who come past them, sides decide."""
_AHEAD = 1e-6


class Reason(StrEnum):
    """Why one movement gives way to another."""

    STATED = "stated"
    """The map says so."""
    SIGN = "sign"
    """Its entrance has a stop or yield sign, or the other one a priority sign."""
    TURN = "turn"
    """It turns across the way of the other one, which comes from the opposite side."""
    RIGHT = "right"
    """The other one comes from the right; from the left, where traffic keeps left."""


@dataclass(frozen=True, slots=True)
class Precedence:
    """What decides who gives way at a junction."""

    signs: Sequence[Sign]
    """Per entrance."""
    arms: Sequence[int]
    """The arm of every entrance."""
    outward: Sequence[float]
    """Direction of every entrance against its traffic [rad]."""
    turns: Mapping[Key, Turn]
    right_of: Collection[tuple[int, int]]
    opposite: Collection[tuple[int, int]]
    stated: Collection[tuple[Key, Key]]
    """Pairs of movements of which the map says that the first gives way to the second."""
    left_hand: bool

    def why(self, one: Key, other: Key) -> Reason | None:
        """Return why whoever makes the movement `one` gives way to whoever makes `other`, None where it need not.

        Two lanes of one arm owe each other nothing here: whoever is ahead goes first.
        """
        if (one, other) in self.stated:
            return Reason.STATED
        mine, yours = one[0], other[0]
        if (other, one) in self.stated or self.arms[mine] == self.arms[yours]:
            return None
        ranks = _RANK[self.signs[mine]], _RANK[self.signs[yours]]
        if ranks[0] != ranks[1]:
            return Reason.SIGN if ranks[0] < ranks[1] else None
        if (mine, yours) in self.opposite:
            if self._across(one) != self._across(other):
                return Reason.TURN if self._across(one) else None
            if self._across(one):
                return None
        elif self.signs[mine] is self.signs[yours] is Sign.LIGHTS:
            return None
        return Reason.RIGHT if self._from_right(mine, yours) else None

    def _across(self, key: Key) -> bool:
        return self.turns[key] is (Turn.RIGHT if self.left_hand else Turn.LEFT)

    def _from_right(self, mine: int, yours: int) -> bool:
        """Whether the other entrance lies to the right: by the angle of the arms where the relation of the paper says nothing."""
        if (yours, mine) in self.right_of or (mine, yours) in self.right_of:
            return (yours, mine) in self.right_of
        ahead = (self.outward[yours] - self.outward[mine]) % math.tau
        return (ahead < math.pi - _AHEAD) != self.left_hand
