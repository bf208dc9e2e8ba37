"""Junctions as the rules and the scenarios see them: topology, and the geometry to drive on.

Entrances are numbered counter-clockwise, an exit has the number of its arm, and direction ``d_j`` leads
from entrance ``i`` to exit ``(i + j) mod n`` (paper, section 5.2).
"""

from __future__ import annotations

import copyreg
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import Any

from pytest_rvads.errors import MapError, ScenarioError
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.maps.segment import Segment, Turn

__all__ = ["Geometry", "Junction", "Movement", "digest"]


# Autopilots are handed the tables of a junction, so they are read-only; a run has to be picklable all the same.
def _table(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


copyreg.pickle(MappingProxyType, lambda table: (_table, (dict(table),)))


@dataclass(frozen=True, slots=True)
class Movement:
    """One way through a junction: an edge of the metric graph."""

    entrance: int
    exit: int
    turn: Turn
    length: float
    """From the entrance vertex to the exit vertex along the centre line [m]."""
    segment: str
    """Id of the segment that labels the edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """Where the arms and the movements of a junction lie."""

    approaches: tuple[Segment, ...]
    """Per entrance, the road walked upstream to the previous junction or the end of the road; ends at the vertex."""
    movements: Mapping[tuple[int, int], Segment]
    """Per (entrance, exit), the centre line through the junction."""
    exits: tuple[Segment, ...]
    """Per exit, the road walked downstream to the next junction or the end of the road; starts at the vertex."""
    lane_width: float = 3.5
    """Width of the lanes [m]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "movements", MappingProxyType(dict(self.movements)))


@dataclass(frozen=True, slots=True, eq=False)
class Junction:
    """A junction of one lane per direction and arm.

    A recorded run may know only the topology; `geometry` is then None, and nothing can be simulated there.
    """

    name: str
    """Name in test ids: a built-in name, or ``stem.id`` for a junction of a file."""
    id: str
    """Id in its map file."""
    control: JunctionControl
    movements: Mapping[tuple[int, int], Movement]
    """Per (entrance, exit); all n - 1 of every entrance."""
    right_of: frozenset[tuple[int, int]]
    """Pairs (v1, v2) of entrances with ``v1 right-of v2`` (paper, table of semantics; mirrored where traffic keeps left)."""
    opposite: frozenset[tuple[int, int]]
    """Pairs of entrances facing each other; symmetric."""
    phase_groups: tuple[frozenset[int], ...] = ()
    """Entrances that have green together, the group of entrance 0 first; empty without lights."""
    setbacks: tuple[float, ...] = ()
    """Per entrance, distance of the stopping line before the entrance vertex [m]."""
    left_hand: bool = False
    """True where traffic keeps left."""
    geometry: Geometry | None = None
    ways: int = field(init=False)
    """Number of entrances."""

    def __post_init__(self) -> None:
        ways = 1 + max((m.entrance for m in self.movements.values()), default=-1)
        complete = len(self.movements) == ways * (ways - 1)  # asked first: a damaged file may claim any number of ways
        if ways < 2 or not complete or set(self.movements) != {(i, k) for i in range(ways) for k in range(ways) if i != k}:
            raise MapError(
                f"junction {self.name!r} needs one movement from every entrance to every other arm, got {sorted(self.movements)}"
            )
        object.__setattr__(self, "movements", MappingProxyType(dict(self.movements)))
        object.__setattr__(self, "ways", ways)
        if not self.setbacks:
            object.__setattr__(self, "setbacks", (0.0,) * ways)

    def exit_of(self, entrance: int, direction: int) -> int:
        """Return the exit that symbolic direction `direction` (1..n-1) leads to from `entrance`."""
        if not 1 <= direction < self.ways:
            raise ScenarioError(
                f"direction {direction} is not one of 1..{self.ways - 1} of the {self.ways}-way junction {self.name!r}"
            )
        return (entrance + direction) % self.ways

    def turn(self, entrance: int, exit: int) -> Turn:
        """Return the turn type of the movement from `entrance` to `exit`."""
        return self.movements[entrance, exit].turn

    def approach(self, entrance: int) -> float:
        """Return the length of the approach of `entrance`, up to its stopping line [m]; 0 without geometry."""
        return self.geometry.approaches[entrance].length - self.setbacks[entrance] if self.geometry else 0.0

    @property
    def near(self) -> Turn:
        """The turn that crosses nobody's way: right where traffic keeps right."""
        return Turn.LEFT if self.left_hand else Turn.RIGHT

    @property
    def far(self) -> Turn:
        """The turn across oncoming traffic: left where traffic keeps right."""
        return Turn.RIGHT if self.left_hand else Turn.LEFT


@lru_cache(maxsize=64)
def digest(junction: Junction) -> str:
    """Return the SHA-256 of all that a run or a verdict can depend on: names don't count, signs and centre lines do."""
    found = hashlib.sha256()
    ways = sorted((m.entrance, m.exit, m.turn, m.length) for m in junction.movements.values())
    groups = [sorted(group) for group in junction.phase_groups]
    relations = sorted(junction.right_of), sorted(junction.opposite)
    found.update(json.dumps([junction.control, ways, relations, groups, junction.setbacks, junction.left_hand]).encode())
    if junction.geometry is not None:
        geometry = junction.geometry
        lines = [*geometry.approaches, *(geometry.movements[way] for way in sorted(geometry.movements)), *geometry.exits]
        found.update(json.dumps([geometry.lane_width, [len(line.points) for line in lines]]).encode())
        for line in lines:
            found.update(line.points.tobytes())
    return found.hexdigest()
