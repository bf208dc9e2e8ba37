"""Which of two ways that share a stretch gives way to the other way.

The first of these criteria that applies to two movements decides (Vienna Convention on Road Traffic 1968, Art. 16(1)(b), 18 and
25(2); StVO, sections 8(1), 9(3), 9(4) and 18(3); Uniform Vehicle Code 11-401 to 11-405):

1. The map states which movement has priority.
2. The signs of the two entrances have different ranks.
3. The movements come from opposite sides: the movement that turns across the way of the other movement gives way.
4. If the map shows that a lane joins another lane, the movement on the joining lane gives way.
5. One movement comes from the right of the other movement and has priority.

Movements from the same arm have no priority: the vehicle ahead goes first. Between two lights that are not opposite, only the
first criterion applies.

Lanes of two entrances at a flat angle come together and do not cross. If the map does not show which of two such lanes joins the
other lane, their priority can't be decided. At an all-way stop, priority counts between vehicles that arrive together; at lights,
between vehicles that both have green.

Two movements whose priority can't be decided have the reason `Reason.UNDECIDED` in both orders, and no rule accuses a vehicle
because of these two movements.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from types import MappingProxyType

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Key, Movement, Way

RANK = {Sign.STOP: 0, Sign.YIELD: 0, Sign.NONE: 1, Sign.LIGHTS: 1, Sign.PRIORITY: 2}
"""Ranks of signs: a vehicle from an entrance gives way to vehicles from entrances with a sign of higher rank.

The ranks follow the Vienna Convention on Road Signs and Signals 1968, signs B,1 to B,3. Stop and yield signs both oblige to give
way to the road ahead. Between two vehicles with signs of the same rank, the sides from which the vehicles come decide.
"""
_AHEAD = 1e-6
"""Difference from opposite headings up to which two entrances count as facing each other [rad]."""
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
    """The other movement comes from the right, or, where traffic keeps left, from the left."""
    MERGE = "merge"
    """According to the map, the movement joins the other movement."""
    CROSSWALK = "crosswalk"
    """The movement leads over a crosswalk, and the other way is a crossing of pedestrians."""
    UNDECIDED = "undecided"
    """The movements come together at a flat angle, and the map does not show which movement joins the other movement."""


@dataclass(frozen=True)
class Precedence:
    """The properties of a junction that decide which movement gives way."""

    starts: Sequence[Entrance]
    """The starts of all ways, the entrances first."""
    ways: Mapping[Key, Way]
    right_of: Collection[tuple[int, int]]
    """Pairs of entrances, see `Junction.right_of`."""
    opposite: Collection[tuple[int, int]]
    """Pairs of entrances that face each other."""
    stated: Collection[tuple[Key, Key]]
    """Pairs of movements of which, according to the map, the first gives way to the second."""
    joining: Collection[tuple[Key, Key]]
    """Pairs of movements of which, according to the map, the first joins the second."""
    left_hand: bool
    all_way_stop: bool

    @cached_property
    def _poses(self) -> Mapping[int, Pose]:
        """Per entrance, the pose at which its movements begin."""
        # In reverse order, so that the first movement of an entrance is the one that counts.
        movements = reversed([way for way in self.ways.values() if isinstance(way, Movement)])
        return {movement.entrance: movement.path.pose(0.0) for movement in movements if movement.path}

    def yields(self, conflicts: Iterable[tuple[Key, Key]]) -> Mapping[tuple[Key, Key], Reason]:
        """Return the pairs of conflicting ways of which the first gives way to the second, with the reason.

        Two ways with lights that never have green together are left out, because the light decides.
        """
        phases = [start.phase if start.sign is Sign.LIGHTS else None for start in self.starts]
        at_once = (
            (way, other_way)
            for way, other_way in sorted(conflicts)
            if None in (phases[way[0]], phases[other_way[0]]) or phases[way[0]] == phases[other_way[0]]
        )
        reasons = ((pair, self.why(*pair)) for pair in at_once)
        return MappingProxyType({pair: reason for pair, reason in reasons if reason is not None})

    def why(self, key: Key, other_key: Key) -> Reason | None:
        """Return the reason why an agent on way `key` gives way to an agent on way `other_key`, or None."""
        if (key, other_key) in self.stated:
            return Reason.STATED
        way, other_way = self.ways[key], self.ways[other_key]
        if isinstance(other_way, Crossing) and not isinstance(way, Crossing):
            return Reason.CROSSWALK
        if (other_key, key) in self.stated or not (isinstance(way, Movement) and isinstance(other_way, Movement)):
            return None
        entrance, other_entrance = key[0], other_key[0]
        start, other_start = self.starts[entrance], self.starts[other_entrance]
        if start.arm == other_start.arm:  # the vehicle ahead goes first
            return None
        ranks = RANK[start.sign], RANK[other_start.sign]
        if ranks[0] != ranks[1]:
            return Reason.SIGN if ranks[0] < ranks[1] else None
        if (entrance, other_entrance) in self.opposite:
            turn = Turn.RIGHT if self.left_hand else Turn.LEFT
            across, other_across = way.turn is turn, other_way.turn is turn
            if across != other_across:
                return Reason.TURN if across else None
            if across:
                return None
        elif start.sign is other_start.sign is Sign.LIGHTS:
            return None
        if not self.all_way_stop:  # at an all-way stop, lanes that come together take turns like other lanes
            if (key, other_key) in self.joining or (other_key, key) in self.joining:
                return Reason.MERGE if (key, other_key) in self.joining else None
            if abs(math.remainder(self._poses[other_entrance].heading - self._poses[entrance].heading, math.tau)) < _FLAT:
                return Reason.UNDECIDED
        return Reason.RIGHT if self._from_right(entrance, other_entrance) else None

    def _from_right(self, entrance: int, other_entrance: int) -> bool:
        """Return whether `other_entrance` lies to the right of `entrance`, or, where traffic keeps left, to the left.

        The positions decide if only one of the two lies to the right of the other, else the paper's ``right-of``, else the angle.
        """
        pose, other_pose = self._poses[entrance], self._poses[other_entrance]
        # Whether the second entrance lies to the right of the line along which traffic enters at the first, and the reverse.
        right, other_right = (
            math.sin(heading) * (u - x) - math.cos(heading) * (v - y) > 0.0
            for (x, y, heading), (u, v, _) in ((pose, other_pose), (other_pose, pose))
        )
        if right != other_right:
            return right != self.left_hand
        if (other_entrance, entrance) in self.right_of or (entrance, other_entrance) in self.right_of:
            return (other_entrance, entrance) in self.right_of
        return ((other_pose.heading - pose.heading) % math.tau < math.pi - _AHEAD) != self.left_hand
