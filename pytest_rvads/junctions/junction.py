"""Junctions as the rules and the scenarios see them: arms with their lanes, movements, and the geometry to drive on.

Arms are numbered counter-clockwise. Entrances and exits are lanes, numbered arm by arm and on each arm from the kerb, so that
with one lane per arm an entrance, and the exit beside it, have the number of their arm. Direction ``d_j`` leads from arm ``i``
to arm ``(i + j) mod n`` (paper, section 5.2).
"""

from __future__ import annotations

import copyreg
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

from pytest_rvads.displayed import shown
from pytest_rvads.errors import MapError, ScenarioError
from pytest_rvads.junctions.conflicts import JunctionKind, Key, Shared, stretches
from pytest_rvads.junctions.sweep import BEFORE, CAR, Course, no_way, through
from pytest_rvads.junctions.yielding import Precedence, Reason
from pytest_rvads.maps.control import JunctionControl, Sign, control_of
from pytest_rvads.maps.segment import SPEED_LIMIT, Limits, Segment, Turn

__all__ = ["Arm", "Entrance", "Exit", "Junction", "Movement", "cross"]


# Autopilots are handed the tables of a junction, so they are read-only; a run has to be picklable all the same.
def _table(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


copyreg.pickle(MappingProxyType, lambda table: (_table, (dict(table),)))


@dataclass(frozen=True, slots=True, eq=False)
class Entrance:
    """A lane that leads into a junction."""

    arm: int
    lane: int = 0
    """Counted from the kerb."""
    sign: Sign = Sign.NONE
    phase: int | None = None
    """Number of the phase group it has green with; None without a light."""
    setback: float = 0.0
    """Distance of the stopping line before the entrance vertex [m]; 0 where no line is marked."""
    approach: Segment | None = None
    """The lane walked upstream to the previous junction or the end of the road; ends at the vertex."""
    sign_setback: float | None = None
    """Distance of its stop sign before the vertex, where that is not at the stopping line [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Exit:
    """A lane that leads out of a junction."""

    arm: int
    lane: int = 0
    """Counted from the kerb."""
    road: Segment | None = None
    """The lane walked downstream to the next junction or the end of the road; starts at the vertex."""


class Arm(NamedTuple):
    """The lanes of one arm, by their numbers, counted from the kerb."""

    entrances: tuple[int, ...]
    exits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Movement:
    """One way through a junction: an edge of the metric graph, or several that follow each other."""

    entrance: int
    """Number of the entrance."""
    exit: int
    """Number of the exit."""
    turn: Turn
    length: float
    """From the entrance vertex to the exit vertex along the centre line [m]."""
    segment: str
    """Id of the segment that labels the edge."""
    path: Segment | None = field(default=None, compare=False, repr=False)
    """The centre line; None where a recording does not hold it."""

    @property
    def key(self) -> Key:
        """Numbers of entrance and exit."""
        return self.entrance, self.exit


@dataclass(frozen=True, eq=False)
class Junction:
    """A junction. Two are equal when name, lanes, movements, signs and centre lines are.

    A recorded run may know only the topology; segments are then None, and nothing can be simulated there.

    Raises:
        MapError: a movement from or to a lane that is not there, fewer than two arms, or arms that leave numbers out.
    """

    name: str
    """Name in test ids: a built-in name, or ``stem.id`` for a junction of a file."""
    id: str
    """Id in its map file."""
    entrances: tuple[Entrance, ...]
    exits: tuple[Exit, ...]
    movements: Mapping[Key, Movement]
    """Per (entrance, exit); there need not be one for every pair."""
    right_of: frozenset[tuple[int, int]]
    """Pairs (v1, v2) of entrances with ``v1 right-of v2`` (paper, table of semantics; mirrored where traffic keeps left)."""
    opposite: frozenset[tuple[int, int]]
    """Pairs of entrances facing each other; symmetric."""
    left_hand: bool = False
    """True where traffic keeps left."""
    lane_width: float = 3.5
    """Width of the lanes [m]."""
    map: str | None = None
    """File it was read from; None for a built-in one, or one from no map. No part of what is compared."""
    stated: frozenset[tuple[Key, Key]] = frozenset()
    """Pairs of movements of which the map says that the first gives way to the second."""
    joining: frozenset[tuple[Key, Key]] = frozenset()
    """Pairs of movements into one exit of which the map shows that the first joins the second: from a ramp, an entry or exit
    lane or one that ends, or onto a motorway."""

    def __post_init__(self) -> None:
        arms = {entrance.arm for entrance in self.entrances} | {exit.arm for exit in self.exits}
        if len(arms) < 2 or arms != set(range(len(arms))):
            raise MapError(f"junction {self.name!r} needs two or more arms, numbered from 0, got {sorted(arms)}")
        for key, movement in self.movements.items():
            if key != movement.key or not (0 <= key[0] < len(self.entrances) and 0 <= key[1] < len(self.exits)):
                raise MapError(
                    f"junction {self.name!r} has {len(self.entrances)} entrances and {len(self.exits)} exits, and no room for a "
                    f"movement from {movement.entrance} to {movement.exit} under {key}"
                )
        object.__setattr__(self, "movements", MappingProxyType(dict(self.movements)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Junction):
            return NotImplemented
        return self is other or (self.name, self.digest) == (other.name, other.digest)

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        return f"<Junction {self.name}: {self.ways}-way {self.control}>"

    def _repr_html_(self) -> str:
        return shown(self)

    @cached_property
    def arms(self) -> tuple[Arm, ...]:
        """The lanes of every arm."""
        return tuple(
            Arm(
                tuple(k for k, lane in enumerate(self.entrances) if lane.arm == arm),
                tuple(k for k, lane in enumerate(self.exits) if lane.arm == arm),
            )
            for arm in sorted({e.arm for e in self.entrances} | {e.arm for e in self.exits})
        )

    @cached_property
    def lanes(self) -> tuple[int, ...]:
        """Per arm, how many entrances it has."""
        return tuple(len(arm.entrances) for arm in self.arms)

    @cached_property
    def ways(self) -> int:
        """Number of arms."""
        return len(self.arms)

    @cached_property
    def control(self) -> JunctionControl:
        """What regulates the junction as a whole."""
        return control_of(entrance.sign for entrance in self.entrances)

    @cached_property
    def phase_groups(self) -> tuple[frozenset[int], ...]:
        """Entrances that have green together, the group of entrance 0 first; empty without lights."""
        phases = sorted({lane.phase for lane in self.entrances if lane.phase is not None})
        return tuple(frozenset(k for k, lane in enumerate(self.entrances) if lane.phase == phase) for phase in phases)

    @cached_property
    def setbacks(self) -> tuple[float, ...]:
        """Per entrance, distance of the stopping line before the entrance vertex [m]."""
        return tuple(entrance.setback for entrance in self.entrances)

    @cached_property
    def drivable(self) -> bool:
        """Whether it is known where all lanes lie."""
        lines = [e.approach for e in self.entrances] + [e.road for e in self.exits] + [m.path for m in self.movements.values()]
        return None not in lines

    @cached_property
    def _lines(self) -> tuple[Segment, ...]:
        """The known centre lines of the junction: approaches, movements in the order of their keys, exit roads."""
        paths = (self.movements[key].path for key in sorted(self.movements))
        return tuple(line for line in (*(e.approach for e in self.entrances), *paths, *(e.road for e in self.exits)) if line)

    @cached_property
    def top_limit(self) -> float:
        """Highest speed limit of its lanes, `SPEED_LIMIT` where the map states none [m/s]."""
        return max(
            (limit or SPEED_LIMIT for line in self._lines for _, limit in line.limits or ((0.0, None),)), default=SPEED_LIMIT
        )

    def limited(self, limit: float | None) -> Junction:
        """Return the junction with one speed limit [m/s] on all its lanes; None: as if its map stated none."""
        return _limited(self, limit) if limit or any(line.limits for line in self._lines) else self

    @cached_property
    def stretches(self) -> Mapping[tuple[Key, Key], Shared] | None:
        """What pairs of movements from different entrances share, in both orders; None without centre lines."""
        paths = {key: m.path for key, m in self.movements.items() if m.path is not None}
        return MappingProxyType(stretches(paths)) if len(paths) == len(self.movements) else None

    @cached_property
    def conflicts(self) -> frozenset[tuple[Key, Key]] | None:
        """Pairs of movements, in both orders, that two vehicles can't make at the same time; None without centre lines."""
        return None if self.stretches is None else frozenset(self.stretches)

    @cached_property
    def kind(self) -> JunctionKind | None:
        """How its movements meet; None without centre lines."""
        if self.stretches is None:
            return None
        if not self.stretches:
            return JunctionKind.CONFLICT_FREE
        merge = all(shared.merges for shared in self.stretches.values())
        return JunctionKind.MERGING if merge else JunctionKind.CROSSING

    @cached_property
    def tight(self) -> Mapping[Key, float]:
        """Movements on which no path of the rear axle keeps a usual car in its lane, with their least radii [m]."""
        found = {key: no_way(course, CAR) for key in self.movements if (course := self._course(key)) is not None}
        return MappingProxyType({key: narrow.radius for key, narrow in found.items() if narrow is not None})

    def _course(self, key: Key) -> Course | None:
        """Return the centre line from the approach to the exit road of a movement, None where it is not known."""
        entrance, path, road = self.entrances[key[0]], self.movements[key].path, self.exits[key[1]].road
        if entrance.approach is None or path is None or road is None:
            return None
        whole = through(entrance.approach, path, road)
        start = max(-entrance.approach.length, -entrance.setback - BEFORE)
        return Course(whole, entrance.approach.length, path.length, start, self.lane_width) if whole else None

    @cached_property
    def yields(self) -> Mapping[tuple[Key, Key], Reason] | None:
        """Pairs (one, other) of conflicting movements of which the first gives way to the second, and why.

        Of two that have lights but never green together there is none: the light says who goes. A pair of which nobody can say
        who gives way is in it in both orders, with the reason ``undecided``. None without centre lines. See
        `pytest_rvads.junctions.yielding`.
        """
        if self.conflicts is None:
            return None
        precedence = Precedence(
            [entrance.sign for entrance in self.entrances],
            [entrance.arm for entrance in self.entrances],
            {m.entrance: m.path.pose(0.0) for m in reversed([*self.movements.values()]) if m.path},
            {key: movement.turn for key, movement in self.movements.items()},
            self.right_of,
            self.opposite,
            self.stated,
            self.joining,
            self.left_hand,
        )
        phases = [entrance.phase if entrance.sign is Sign.LIGHTS else None for entrance in self.entrances]
        at_once = (
            (one, other)
            for one, other in sorted(self.conflicts)
            if None in (phases[one[0]], phases[other[0]]) or phases[one[0]] == phases[other[0]]
        )
        found = ((pair, precedence.why(*pair)) for pair in at_once)
        return MappingProxyType({pair: reason for pair, reason in found if reason is not None})

    @cached_property
    def by_direction(self) -> Mapping[tuple[int, int], Movement]:
        """Per entrance and symbolic direction the movement there.

        Direction ``n`` is the U-turn. Where several exits of one arm can be reached, ``j`` leads to the one nearest to the kerb,
        ``j + n`` to the next, and so on.
        """
        found: dict[tuple[int, int], Movement] = {}
        for (entrance, exit), movement in sorted(self.movements.items()):
            direction = (self.exits[exit].arm - self.entrances[entrance].arm) % self.ways or self.ways
            while (entrance, direction) in found:
                direction += self.ways
            found[entrance, direction] = movement
        return MappingProxyType(found)

    @cached_property
    def entex(self) -> frozenset[tuple[int, int]]:
        """Pairs of an entrance and an exit of one arm, the paper's relation of this name."""
        return frozenset((entrance, exit) for arm in self.arms for entrance in arm.entrances for exit in arm.exits)

    @cached_property
    def by_turn(self) -> Mapping[tuple[int, Turn], tuple[Movement, ...]]:
        """Per entrance and turn, the movements that a vehicle with this indicator may make."""
        keys = [(entrance, turn) for entrance in range(len(self.entrances)) for turn in Turn]
        ways = self.movements.values()
        return MappingProxyType({key: tuple(m for m in ways if (m.entrance, m.turn) == key) for key in keys})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that a run or a verdict can depend on: names don't count, signs and centre lines do."""
        found = hashlib.sha256()
        entrances = [(e.arm, e.lane, e.sign, e.phase, e.setback) for e in self.entrances]
        exits = [(e.arm, e.lane) for e in self.exits]
        ways = sorted((m.entrance, m.exit, m.turn, m.length) for m in self.movements.values())
        relations = sorted(self.right_of), sorted(self.opposite)
        # What most junctions don't have comes in only where there is some, so that digests of the others stay as they were.
        signs = [e.sign_setback for e in self.entrances] if any(e.sign_setback is not None for e in self.entrances) else None
        joining = self.joining and {"joining": sorted(self.joining)}
        limits = [line.limits for line in self._lines]
        rare = [item for item in (signs, sorted(self.stated), joining, limits if any(limits) else None) if item]
        found.update(json.dumps([entrances, exits, ways, relations, self.left_hand, self.drivable, *rare]).encode())
        if self.drivable:
            found.update(json.dumps([self.lane_width, [len(line.points) for line in self._lines]]).encode())
            for line in self._lines:
                found.update(line.points.tobytes())
        return found.hexdigest()

    def leads(self, entrance: int, direction: int) -> Movement:
        """Return the movement from `entrance` into symbolic direction `direction`, see `by_direction`.

        Raises:
            ScenarioError: there is none.
        """
        movement = self.by_direction.get((entrance, direction))
        if movement is None:
            known = ", ".join(map(str, self.directions(entrance)))
            raise ScenarioError(
                f"direction {direction} is none of entrance {entrance} of junction {self.name!r}, its movements lead into "
                f"{known or 'none'}"
            )
        return movement

    def directions(self, entrance: int) -> tuple[int, ...]:
        """Return the symbolic directions that movements from `entrance` lead into, in ascending order."""
        return tuple(sorted(direction for start, direction in self.by_direction if start == entrance))

    @cached_property
    def one_lane_each(self) -> bool:
        """Whether no arm has more than one entrance or more than one exit."""
        return all(len(arm.entrances) <= 1 and len(arm.exits) <= 1 for arm in self.arms)

    @cached_property
    def rotations(self) -> tuple[int, ...]:
        """By how many arms the junction can be rotated so that lanes, movements and signs stay the same; 0 comes first.

        Turns may change: rotating a T is a symmetry in the paper's sense (section 5.2).
        """
        found = []
        for arms in range(self.ways):
            images = self.image(arms)
            if images is not None:
                entrances, exits = images
                same = all(lane.sign is self.entrances[entrances[k]].sign for k, lane in enumerate(self.entrances))
                if same and {(entrances[a], exits[b]) for a, b in self.movements} == self.movements.keys():
                    found.append(arms)
        return tuple(found)

    def image(self, arms: int) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
        """Return which entrances and exits take the places of each when every arm moves on by `arms`; None if one has none."""
        entrances, exits = (_image(lanes, arms, self.ways) for lanes in (self.entrances, self.exits))
        return None if entrances is None or exits is None else (entrances, exits)

    def vehicle_at(self, entrance: int) -> str:
        """Return the name of the first vehicle at an entrance: ``a0``; ``a0.1`` on lane 1 of an arm that has several."""
        lane = self.entrances[entrance]
        return f"a{lane.arm}" if len(self.arms[lane.arm].entrances) == 1 else f"a{lane.arm}.{lane.lane}"

    def approach(self, entrance: int) -> float:
        """Return the length of the approach of `entrance`, up to its stopping line [m]; 0 where it is not known."""
        lane = self.entrances[entrance]
        return lane.approach.length - lane.setback if lane.approach else 0.0

    def way_in(self, entrance: int) -> Segment:
        """Return the lane that leads to `entrance`; see `Entrance.approach`.

        Raises:
            MapError: it is not known where the lanes lie.
        """
        return self._known(self.entrances[entrance].approach)

    def way_through(self, entrance: int, exit: int) -> Segment:
        """Return the centre line of a movement; see `way_in` for errors."""
        return self._known(self.movements[entrance, exit].path)

    def way_out(self, exit: int) -> Segment:
        """Return the lane that leads away from `exit`; see `way_in` for errors."""
        return self._known(self.exits[exit].road)

    def _known(self, line: Segment | None) -> Segment:
        if line is None:
            raise MapError(f"junction {self.name!r} comes from a recording without positions, so nothing can be placed there")
        return line

    @property
    def near(self) -> Turn:
        """The turn that crosses nobody's way: right where traffic keeps right."""
        return Turn.LEFT if self.left_hand else Turn.RIGHT

    @property
    def far(self) -> Turn:
        """The turn across oncoming traffic: left where traffic keeps right."""
        return Turn.RIGHT if self.left_hand else Turn.LEFT


@lru_cache(maxsize=256)  # one object per limit, so that what is found out about it is found out once
def _limited(junction: Junction, limit: float | None) -> Junction:
    limits: Limits = () if limit is None else ((0.0, limit),)

    def on(line: Segment | None) -> Segment | None:
        return line and replace(line, limits=limits)

    return replace(
        junction,
        entrances=tuple(replace(lane, approach=on(lane.approach)) for lane in junction.entrances),
        exits=tuple(replace(lane, road=on(lane.road)) for lane in junction.exits),
        movements={key: replace(movement, path=on(movement.path)) for key, movement in junction.movements.items()},
    )


def _image(lanes: Sequence[Entrance | Exit], arms: int, ways: int) -> tuple[int, ...] | None:
    numbers = {(lane.arm, lane.lane): number for number, lane in enumerate(lanes)}
    places = [((lane.arm + arms) % ways, lane.lane) for lane in lanes]
    return tuple(numbers[place] for place in places) if numbers.keys() == set(places) else None


def cross(
    signs: Sequence[Sign],
    *,
    phase_groups: Sequence[frozenset[int]] = (),
    setbacks: Sequence[float] = (),
    approaches: Sequence[Segment] = (),
    roads: Sequence[Segment] = (),
) -> tuple[tuple[Entrance, ...], tuple[Exit, ...]]:
    """Return the entrances and exits of a junction of one lane per arm.

    Args:
        signs: per arm.
        phase_groups: entrances per phase group.
        setbacks: per arm, distance of the stopping line before the entrance vertex [m]; 0 where none is given.
        approaches: per arm, the lane that leads in, where known.
        roads: per arm, the lane that leads out, where known.
    """
    phases = {entrance: number for number, group in enumerate(phase_groups) for entrance in group}
    return (
        tuple(
            Entrance(k, 0, sign, phases.get(k), setbacks[k] if setbacks else 0.0, approaches[k] if approaches else None)
            for k, sign in enumerate(signs)
        ),
        tuple(Exit(k, 0, roads[k] if roads else None) for k in range(len(signs))),
    )
