"""Junctions as rules and scenarios use them: arms with their lanes, movements and further ways, and the geometry to drive on.

Arms are numbered counter-clockwise. Entrances and exits are lanes, numbered arm by arm and on each arm from the kerb. So with one
lane per arm an entrance, and the exit beside it, have the number of their arm. Direction ``d_j`` leads from arm ``i`` to arm
``(i + j) mod n`` (paper, section 5.2).

Arms, lanes and agents are different things. A pair of entrance and exit need not have a movement, and several agents may come to
one entrance. So no code takes the number of an arm, a lane or an agent for the number of another thing.

Ways begin at starts and end at ends. Starts are numbered: first the entrances, then the starts of further ways; ends likewise.
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

from pytest_rvads.geometry.conflicts import CONFLICT_WIDTH, JunctionKind, Key, Line, Shared, Way, stretches
from pytest_rvads.geometry.control import JunctionControl, Sign, control_of
from pytest_rvads.geometry.segment import SPEED_LIMIT, Limits, Segment, Turn
from pytest_rvads.geometry.sweep import BEFORE, CAR, Course, no_way, through
from pytest_rvads.geometry.yielding import Precedence, Reason
from pytest_rvads.support.displayed import shown
from pytest_rvads.support.errors import MapError, ScenarioError

__all__ = ["Arm", "Entrance", "Exit", "Further", "Junction", "Movement", "cross"]


# Autopilots receive the tables of a junction, so the tables are read-only. A run must be picklable nevertheless.
def _table(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


copyreg.pickle(MappingProxyType, lambda table: (_table, (dict(table),)))


@dataclass(frozen=True, slots=True, eq=False)
class Entrance:
    """A lane that leads into a junction."""

    arm: int
    lane: int = 0
    """Number of the lane on its arm, counted from the kerb."""
    sign: Sign = Sign.NONE
    phase: int | None = None
    """Number of the entrance's phase group; None without a light."""
    setback: float = 0.0
    """Distance of the stopping line before the entrance vertex [m]; 0 if no line is marked."""
    approach: Segment | None = None
    """The lane followed upstream to the previous junction or the end of the road; the segment ends at the entrance vertex."""
    sign_setback: float | None = None
    """Distance of the stop sign before the vertex [m]; None without a stop sign away from the stopping line."""


@dataclass(frozen=True, slots=True, eq=False)
class Exit:
    """A lane that leads out of a junction."""

    arm: int
    lane: int = 0
    """Number of the lane on its arm, counted from the kerb."""
    road: Segment | None = None
    """The lane followed downstream to the next junction or the end of the road; the segment starts at the exit vertex."""


class Arm(NamedTuple):
    """The lanes of an arm, as numbers of entrances and exits, counted from the kerb."""

    entrances: tuple[int, ...]
    exits: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Movement:
    """The way of vehicles from a lane to a lane: an edge of the metric graph, or several consecutive edges."""

    entrance: int
    """Number of the entrance."""
    exit: int
    """Number of the exit."""
    turn: Turn
    length: float
    """Length from the entrance vertex to the exit vertex along the centre line [m]."""
    segment: str
    """Id of the segment that labels the edge."""
    path: Segment | None = field(default=None, compare=False, repr=False)
    """The centre line; None if a recording does not hold the centre line."""

    @property
    def key(self) -> Key:
        """Numbers of entrance and exit."""
        return self.entrance, self.exit

    @property
    def kind(self) -> str:
        """The kind of way: a movement."""
        return "movement"

    @property
    def width(self) -> float:
        """Width that vehicles on the movement take up [m]."""
        return CONFLICT_WIDTH


class Further(NamedTuple):
    """A way that is no movement, with the places where it starts and ends: kerbs of an arm, for example."""

    way: Way
    start: Entrance
    """The place where the way starts, with its arm, and with its sign or light, if any."""
    end: Exit


@dataclass(frozen=True, eq=False)
class Junction:
    """A junction. Two junctions are equal if their names, lanes, movements, signs and centre lines are equal.

    A recorded run may know only the topology of its junction. Segments are then None, and the junction can't be simulated.

    Raises:
        MapError: a movement uses a lane that does not exist, a further way has the number of another start or end, the junction
            has fewer than two arms, or the numbers of the arms have gaps.
    """

    name: str
    """Name in test ids: a built-in name, or ``stem.id`` for a junction of a file."""
    id: str
    """Id in its map file."""
    entrances: tuple[Entrance, ...]
    exits: tuple[Exit, ...]
    movements: Mapping[Key, Movement]
    """Movements by (entrance, exit); some pairs may have no movement."""
    right_of: frozenset[tuple[int, int]]
    """Pairs (v1, v2) of entrances with ``v1 right-of v2`` (paper, table of semantics; mirrored where traffic keeps left)."""
    opposite: frozenset[tuple[int, int]]
    """Pairs of entrances facing each other; symmetric."""
    left_hand: bool = False
    """True where traffic keeps left."""
    lane_width: float = 3.5
    """Width of the lanes [m]."""
    map: str | None = None
    """The map file; None for a built-in junction or a junction without a map. Comparisons ignore the file."""
    stated: frozenset[tuple[Key, Key]] = frozenset()
    """Pairs of ways of which, according to the map, the first gives way to the second."""
    joining: frozenset[tuple[Key, Key]] = frozenset()
    """Pairs of movements into one exit of which, according to the map, the first joins the second.

    The first movement comes from a ramp, an entry or exit lane or a lane that ends, or leads onto a motorway.
    """
    further: tuple[Further, ...] = ()
    """Ways that are no movements. Way k has the key ``(entrances + k, exits + k)``, so no lane has the number of its start."""

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
        for number, (way, _, _) in enumerate(self.further):
            if way.key != (len(self.entrances) + number, len(self.exits) + number):
                raise MapError(
                    f"junction {self.name!r} has {len(self.entrances)} entrances and {len(self.exits)} exits, so its further way "
                    f"{number} needs the key {(len(self.entrances) + number, len(self.exits) + number)}, got {way.key}"
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
    def every_way(self) -> Mapping[Key, Way]:
        """The movements and the further ways, by their keys."""
        return MappingProxyType({**self.movements, **{further.way.key: further.way for further in self.further}})

    @cached_property
    def starts(self) -> tuple[Entrance, ...]:
        """The places where ways start: the entrances, then the starts of further ways."""
        return (*self.entrances, *(further.start for further in self.further))

    @cached_property
    def ends(self) -> tuple[Exit, ...]:
        """The places where ways end: the exits, then the ends of further ways."""
        return (*self.exits, *(further.end for further in self.further))

    @cached_property
    def lanes(self) -> tuple[int, ...]:
        """Number of entrances of every arm."""
        return tuple(len(arm.entrances) for arm in self.arms)

    @cached_property
    def ways(self) -> int:
        """Number of arms."""
        return len(self.arms)

    @cached_property
    def control(self) -> JunctionControl:
        """The control of the junction as a whole."""
        return control_of(entrance.sign for entrance in self.entrances)

    @cached_property
    def phase_groups(self) -> tuple[frozenset[int], ...]:
        """Groups of entrances that have green together, the group of entrance 0 first; empty without lights."""
        phases = sorted({lane.phase for lane in self.entrances if lane.phase is not None})
        return tuple(frozenset(k for k, lane in enumerate(self.entrances) if lane.phase == phase) for phase in phases)

    @cached_property
    def setbacks(self) -> tuple[float, ...]:
        """Per start of a way, distance of the stopping line before the start [m]."""
        return tuple(start.setback for start in self.starts)

    @cached_property
    def drivable(self) -> bool:
        """Whether the places of all lanes are known."""
        lines = [e.approach for e in self.entrances] + [e.road for e in self.exits] + [m.path for m in self.movements.values()]
        return None not in lines

    @cached_property
    def _lines(self) -> tuple[Segment, ...]:
        """The known centre lines of the junction: approaches, movements in the order of their keys, exit roads."""
        paths = (self.movements[key].path for key in sorted(self.movements))
        return tuple(line for line in (*(e.approach for e in self.entrances), *paths, *(e.road for e in self.exits)) if line)

    @cached_property
    def top_limit(self) -> float:
        """Highest speed limit of the lanes [m/s]; `SPEED_LIMIT` for lanes without a limit in the map."""
        return max(
            (limit or SPEED_LIMIT for line in self._lines for _, limit in line.limits or ((0.0, None),)), default=SPEED_LIMIT
        )

    def limited(self, limit: float | None) -> Junction:
        """Return the junction with one speed limit [m/s] on all its lanes; with None, without the limits of its map."""
        return _limited(self, limit) if limit or any(line.limits for line in self._lines) else self

    @cached_property
    def stretches(self) -> Mapping[tuple[Key, Key], Shared] | None:
        """Shared stretches of pairs of ways from different starts, in both orders; None without centre lines.

        A movement meets further ways on its approach and its exit road, too; a station before the entrance vertex is negative.
        """
        ways = {key: Line(way.path, way.width) for key, way in self.every_way.items() if way.path is not None}
        if len(ways) < len(self.every_way):
            return None
        if not self.further:
            return MappingProxyType(stretches(ways))
        courses = {
            key: Line(course.path, CONFLICT_WIDTH, course.origin) for key in self.movements if (course := self._course(key))
        }
        between = stretches({key: ways[key] for key in self.movements})
        return MappingProxyType(
            between | {pair: s for pair, s in stretches(ways | courses).items() if not self.movements.keys() >= {*pair}}
        )

    @cached_property
    def conflicts(self) -> frozenset[tuple[Key, Key]] | None:
        """Pairs of ways, in both orders, that two agents can't take at the same time; None without centre lines."""
        return None if self.stretches is None else frozenset(self.stretches)

    @cached_property
    def kind(self) -> JunctionKind | None:
        """The kind of the junction by the meetings of its movements; None without centre lines."""
        if self.stretches is None:
            return None
        meetings = [shared for pair, shared in self.stretches.items() if self.movements.keys() >= {*pair}]
        if not meetings:
            return JunctionKind.CONFLICT_FREE
        return JunctionKind.MERGING if all(shared.merges for shared in meetings) else JunctionKind.CROSSING

    @cached_property
    def tight(self) -> Mapping[Key, float]:
        """Least radius [m] of the movements on which no path of the rear axle keeps a usual car in its lane."""
        bends = {key: no_way(course, CAR) for key in self.movements if (course := self._course(key)) is not None}
        return MappingProxyType({key: narrow.radius for key, narrow in bends.items() if narrow is not None})

    def _course(self, key: Key) -> Course | None:
        """Return the centre line from the approach to the exit road of a movement; None if the centre line is not known."""
        entrance, path, road = self.entrances[key[0]], self.movements[key].path, self.exits[key[1]].road
        if entrance.approach is None or path is None or road is None:
            return None
        whole = through(entrance.approach, path, road)
        start = max(-entrance.approach.length, -entrance.setback - BEFORE)
        return Course(whole, entrance.approach.length, path.length, start, self.lane_width) if whole else None

    @cached_property
    def yields(self) -> Mapping[tuple[Key, Key], Reason] | None:
        """Pairs of conflicting ways of which the first gives way to the second, with the reason.

        Two ways with lights that never have green together are no pair, because the light decides. If it can't be decided which
        of two movements gives way, both orders of the two are pairs, with the reason ``undecided``. None without centre lines.
        See `pytest_rvads.geometry.yielding`.
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
        phases = [start.phase if start.sign is Sign.LIGHTS else None for start in self.starts]
        at_once = (
            (way, other_way)
            for way, other_way in sorted(self.conflicts)
            if None in (phases[way[0]], phases[other_way[0]]) or phases[way[0]] == phases[other_way[0]]
        )
        reasons = ((pair, precedence.why(*pair)) for pair in at_once)
        return MappingProxyType({pair: reason for pair, reason in reasons if reason is not None})

    @cached_property
    def by_direction(self) -> Mapping[tuple[int, int], Movement]:
        """Movements by entrance and symbolic direction.

        Direction ``n`` is the U-turn. If several exits of one arm can be reached, ``j`` leads to the exit nearest to the kerb,
        ``j + n`` to the next exit, and so on.
        """
        table: dict[tuple[int, int], Movement] = {}
        for (entrance, exit), movement in sorted(self.movements.items()):
            direction = (self.exits[exit].arm - self.entrances[entrance].arm) % self.ways or self.ways
            while (entrance, direction) in table:
                direction += self.ways
            table[entrance, direction] = movement
        return MappingProxyType(table)

    @cached_property
    def entex(self) -> frozenset[tuple[int, int]]:
        """Pairs of an entrance and an exit of the same arm, the paper's relation ``entex``."""
        return frozenset((entrance, exit) for arm in self.arms for entrance in arm.entrances for exit in arm.exits)

    @cached_property
    def by_turn(self) -> Mapping[tuple[int, Turn], tuple[Way, ...]]:
        """Per start and turn, the ways that an agent with this indicator may take."""
        keys = [(start, turn) for start in range(len(self.starts)) for turn in Turn]
        ways = self.every_way.values()
        return MappingProxyType({key: tuple(way for way in ways if (way.entrance, way.turn) == key) for key in keys})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that a run or a verdict can depend on, including signs and centre lines, without names."""
        sha = hashlib.sha256()
        entrances = [(e.arm, e.lane, e.sign, e.phase, e.setback) for e in self.entrances]
        exits = [(e.arm, e.lane) for e in self.exits]
        ways = sorted((m.entrance, m.exit, m.turn, m.length) for m in self.movements.values())
        relations = sorted(self.right_of), sorted(self.opposite)
        # Rare properties enter the digest only if the junction has them, so that other junctions keep their digests.
        signs = [e.sign_setback for e in self.entrances] if any(e.sign_setback is not None for e in self.entrances) else None
        joining = self.joining and {"joining": sorted(self.joining)}
        limits = [line.limits for line in self._lines]
        further = self.further and {
            "further": [
                (way.kind, way.turn, way.width, way.length, start.arm, start.sign, start.phase, start.setback, end.arm)
                for way, start, end in self.further
            ]
        }
        rare = [item for item in (signs, sorted(self.stated), joining, limits if any(limits) else None, further) if item]
        sha.update(json.dumps([entrances, exits, ways, relations, self.left_hand, self.drivable, *rare]).encode())
        if self.drivable:
            sha.update(json.dumps([self.lane_width, [len(line.points) for line in self._lines]]).encode())
            for line in self._lines:
                sha.update(line.points.tobytes())
            for way, start, end in self.further:
                for beside in (start.approach, way.path, end.road):
                    sha.update(b"-" if beside is None else beside.points.tobytes())
        return sha.hexdigest()

    def leads(self, entrance: int, direction: int) -> Movement:
        """Return the movement from `entrance` into symbolic direction `direction`, see `by_direction`.

        Raises:
            ScenarioError: no movement leads there.
        """
        movement = self.by_direction.get((entrance, direction))
        if movement is None:
            directions = ", ".join(map(str, self.directions(entrance)))
            raise ScenarioError(
                f"direction {direction} is none of entrance {entrance} of junction {self.name!r}, its movements lead into "
                f"{directions or 'none'}"
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
        """Numbers of arms by which a rotation keeps lanes, movements and signs the same; 0 comes first.

        Turns may change: rotating a T is a symmetry in the paper's sense (section 5.2).
        """
        symmetries = []
        for arms in range(self.ways):
            images = self.image(arms)
            if images is not None:
                entrances, exits = images
                same = all(lane.sign is self.entrances[entrances[k]].sign for k, lane in enumerate(self.entrances))
                if same and {(entrances[a], exits[b]) for a, b in self.movements} == self.movements.keys():
                    symmetries.append(arms)
        return tuple(symmetries)

    def image(self, arms: int) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
        """Return the images of entrances and exits when every arm moves on by `arms`; None if a lane has no image."""
        entrances, exits = (_image(lanes, arms, self.ways) for lanes in (self.entrances, self.exits))
        return None if entrances is None or exits is None else (entrances, exits)

    def vehicle_at(self, entrance: int) -> str:
        """Return the name of the first vehicle at an entrance: ``a0``; ``a0.1`` on lane 1 of an arm with several entrances."""
        lane = self.starts[entrance]
        return f"a{lane.arm}" if len(self.arms[lane.arm].entrances) == 1 else f"a{lane.arm}.{lane.lane}"

    def approach(self, entrance: int) -> float:
        """Return the length of the approach of `entrance`, up to its stopping line [m]; 0 if the approach is not known."""
        lane = self.entrances[entrance]
        return lane.approach.length - lane.setback if lane.approach else 0.0

    def way_in(self, entrance: int) -> Segment:
        """Return the lane that leads to `entrance`, or the path to the start of a further way; see `Entrance.approach`.

        Raises:
            MapError: the place of the lane is not known.
        """
        return self._known(self.starts[entrance].approach)

    def way_through(self, entrance: int, exit: int) -> Segment:
        """Return the centre line of a way; see `way_in` for errors."""
        return self._known(self.every_way[entrance, exit].path)

    def way_out(self, exit: int) -> Segment:
        """Return the lane that leads away from `exit`, or the path from the end of a further way; see `way_in` for errors."""
        return self._known(self.ends[exit].road)

    def _known(self, line: Segment | None) -> Segment:
        if line is None:
            raise MapError(f"junction {self.name!r} comes from a recording without positions, so nothing can be placed there")
        return line

    @property
    def near(self) -> Turn:
        """The turn that crosses no other way: right where traffic keeps right."""
        return Turn.LEFT if self.left_hand else Turn.RIGHT

    @property
    def far(self) -> Turn:
        """The turn across oncoming traffic: left where traffic keeps right."""
        return Turn.RIGHT if self.left_hand else Turn.LEFT


@lru_cache(maxsize=256)  # one object per limit, so that its cached properties are computed once
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
    """Return the entrances and exits of a junction with one lane per arm.

    Args:
        signs: the sign of every arm.
        phase_groups: the entrances of every phase group.
        setbacks: per arm, distance of the stopping line before the entrance vertex [m]; 0 by default.
        approaches: per arm, the lane that leads in, if known.
        roads: per arm, the lane that leads out, if known.
    """
    phases = {entrance: number for number, group in enumerate(phase_groups) for entrance in group}
    return (
        tuple(
            Entrance(k, 0, sign, phases.get(k), setbacks[k] if setbacks else 0.0, approaches[k] if approaches else None)
            for k, sign in enumerate(signs)
        ),
        tuple(Exit(k, 0, roads[k] if roads else None) for k in range(len(signs))),
    )
