"""Junctions as rules and scenarios use them: arms with their lanes, the ways through a junction, and centre lines to drive on.

Direction ``d_j`` leads from arm ``i`` to arm ``(i + j) mod n`` (paper, section 5.2).
"""

from __future__ import annotations

import copyreg
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pytest_rvads.geometry.conflicts import JunctionKind, Line, Shared, Stretch, conflicts_of
from pytest_rvads.geometry.control import JunctionControl, control_of
from pytest_rvads.geometry.crosswalks import Crosswalk, covered, walking_ways
from pytest_rvads.geometry.opendrive.map_file import NAMES, path_of, text_of
from pytest_rvads.geometry.precedence import Precedence, Reason
from pytest_rvads.geometry.segment import SPEED_LIMIT, Limits, Segment
from pytest_rvads.geometry.sweep import CAR, Course, course_of, no_way
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import CONFLICT_WIDTH, Arm, Entrance, Exit, Further, Key, Movement, Way, centre_lines, digest_of
from pytest_rvads.support.errors import MapError, ScenarioError
from pytest_rvads.support.wording import shown


# Autopilots receive the tables of a junction, so the tables are read-only. A run must be picklable nevertheless.
def _table(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


copyreg.pickle(MappingProxyType, lambda table: (_table, (dict(table),)))


@dataclass(frozen=True, eq=False)
class Junction:
    """A junction: lanes, ways, signs. Two junctions are equal if their names, lanes, ways, signs, centre lines are equal.

    Some recorded runs hold only the topology of their junction. All centre lines of such a junction are None, and no vehicle can
    be simulated on it.

    Raises:
        MapError: a movement uses a lane that does not exist, a further way has the number of another start or end, the junction
            has fewer than two arms, or the numbers of the arms have gaps.
    """

    name: str
    """Name in test ids: a built-in name, or ``stem.id`` for a junction of a file."""
    id: str
    """Id in its map file."""
    entrances: tuple[Entrance, ...]
    """The lanes that lead into the junction, counter-clockwise; the number of an entrance is its index."""
    exits: tuple[Exit, ...]
    """The lanes that lead out of the junction, counter-clockwise; the number of an exit is its index."""
    movements: Mapping[Key, Movement]
    """Movements by (entrance, exit); a pair without a key has no movement."""
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

    Either the first movement comes from a ramp, an entry or exit lane or a lane that ends, and the second movement does not. Or
    the second movement comes along a motorway, and the first movement does not.
    """
    further: tuple[Further, ...] = ()
    """Ways that are no movements. Way k has the key (number of entrances + k, number of exits + k).

    So the starts of these ways have other numbers than all entrances, and their ends have other numbers than all exits.
    """
    crossings: tuple[Crosswalk, ...] = ()
    """The crosswalks over the arms; the crossings, which are ways, are in `further` of the junction `walked`. The digest ignores
    crosswalks until pedestrians walk there."""

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
        """The lanes of every arm, as numbers of entrances and exits."""
        return tuple(
            Arm(
                tuple(k for k, lane in enumerate(self.entrances) if lane.arm == arm),
                tuple(k for k, lane in enumerate(self.exits) if lane.arm == arm),
            )
            for arm in sorted({e.arm for e in self.entrances} | {e.arm for e in self.exits})
        )

    @cached_property
    def every_way(self) -> Mapping[Key, Way]:
        """All ways, movements and others, by their keys."""
        return MappingProxyType({**self.movements, **{further.way.key: further.way for further in self.further}})

    @cached_property
    def walked(self) -> Junction:
        """The junction for runs in which pedestrians walk: every crosswalk has two crossings and a parking place as further ways.

        Of n crosswalks, crosswalk k has the further ways 2k, from the near side to the far side, and 2k + 1, in the opposite
        direction. The parking place before the crosswalk, for a vehicle that hides the kerb, is the further way 2n + k.
        """
        if self.further or not self.crossings:
            return self
        further = walking_ways(self.crossings, len(self.entrances), len(self.exits), left_hand=self.left_hand)
        walked = replace(self, further=further)
        walked.__dict__["unwalked"] = self  # what the two junctions have computed is not computed again
        return walked

    @cached_property
    def unwalked(self) -> Junction:
        """The junction for runs in which nobody walks: without the ways that `walked` adds."""
        return replace(self, further=()) if self.further and self.crossings else self

    @cached_property
    def covers(self) -> Mapping[tuple[int, Key], Stretch]:
        """Per crosswalk and movement that leads over the painted area, the stretch of the movement inside this area [m].

        Stations are measured from the entrance vertex, so they are negative for an area on the approach.
        """
        crosswalks, lines = enumerate(self.crossings), self._course_lines.items()
        stretches = {(number, key): covered(walk.area, line) for (number, walk), (key, line) in product(crosswalks, lines)}
        return MappingProxyType({pair: stretch for pair, stretch in stretches.items() if stretch})

    @cached_property
    def starts(self) -> tuple[Entrance, ...]:
        """The places where ways start: the entrances, then the starts of ways that are no movements."""
        return (*self.entrances, *(further.start for further in self.further))

    @cached_property
    def ends(self) -> tuple[Exit, ...]:
        """The places where ways end: the exits, then the ends of ways that are no movements."""
        return (*self.exits, *(further.end for further in self.further))

    @cached_property
    def lanes(self) -> tuple[int, ...]:
        """Number of entrances of every arm."""
        return tuple(len(arm.entrances) for arm in self.arms)

    @cached_property
    def ways(self) -> int:
        """Number of arms, as in "4-way"; the ways through the junction are in `every_way`."""
        return len(self.arms)

    @cached_property
    def control(self) -> JunctionControl:
        """Control of the junction as a whole, such as stop signs at all entrances."""
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
        """Whether the centre lines of all lanes are known, so that vehicles can drive here."""
        return None not in self._centre_lines

    @cached_property
    def _centre_lines(self) -> tuple[Segment | None, ...]:
        return centre_lines(self.entrances, self.exits, self.movements)

    @cached_property
    def _limits(self) -> tuple[Limits, ...]:
        return tuple(line.limits for line in self._centre_lines if line)

    @cached_property
    def top_limit(self) -> float:
        """Highest speed limit of the lanes [m/s]; 25 mph (11.176 m/s) for lanes without a limit in the map."""
        return max(
            (limit or SPEED_LIMIT for limits in self._limits for _, limit in limits or ((0.0, None),)), default=SPEED_LIMIT
        )

    def limited(self, limit: float | None) -> Junction:
        """Return the junction with one speed limit [m/s] on all its lanes; with None, without the limits of its map."""
        return _limited(self, limit) if limit or any(self._limits) else self

    @cached_property
    def stretches(self) -> Mapping[tuple[Key, Key], Shared] | None:
        """Per ordered pair of ways from different starts, the stretches on which the two conflict; None without centre lines.

        The stretch that a movement shares with a way that is no movement, such as a crossing of pedestrians, can also lie on the
        approach of the movement, where stations are negative, or on its exit road. Two ways that are no movements share nothing.
        """
        return conflicts_of(self.every_way, self.movements, self._course_lines if self.further else {})

    @cached_property
    def conflicts(self) -> frozenset[tuple[Key, Key]] | None:
        """Pairs of ways, in both orders, that two agents can't take at the same time; None without centre lines."""
        return None if self.stretches is None else frozenset(self.stretches)

    @cached_property
    def kind(self) -> JunctionKind | None:
        """Whether movements of the junction cross, only merge, or never meet; None without centre lines."""
        if self.stretches is None:
            return None
        return JunctionKind.of(shared for pair, shared in self.stretches.items() if self.movements.keys() >= {*pair})

    @cached_property
    def tight(self) -> Mapping[Key, float]:
        """Per movement on which no path of the rear axle keeps a usual car in its lane, the least radius of the movement [m]."""
        bends = {key: no_way(course, CAR) for key, course in self._courses.items()}
        return MappingProxyType({key: narrow.radius for key, narrow in bends.items() if narrow is not None})

    @cached_property
    def _courses(self) -> Mapping[Key, Course]:
        """Per movement, the centre line from the approach to the exit road, if the line is known."""
        ends = ((m, self.entrances[m.entrance], self.exits[m.exit]) for m in self.movements.values())
        courses = {m.key: course_of(entrance, m, exit, self.lane_width) for m, entrance, exit in ends}
        return MappingProxyType({key: course for key, course in courses.items() if course is not None})

    @cached_property
    def _course_lines(self) -> Mapping[Key, Line]:
        lines = {key: Line(course.path, CONFLICT_WIDTH, course.origin) for key, course in self._courses.items()}
        return MappingProxyType(lines)

    @cached_property
    def yields(self) -> Mapping[tuple[Key, Key], Reason] | None:
        """Pairs of conflicting ways of which the first gives way to the second, with the reason.

        Two ways with lights that never have green together are no pair, because the light decides. If it can't be decided which
        of two movements gives way, both orders of the two are pairs, with the reason ``undecided``. A junction without centre
        lines has None instead of pairs. See `pytest_rvads.geometry.precedence`.
        """
        if self.conflicts is None:
            return None
        relations = self.right_of, self.opposite, self.stated, self.joining
        all_way_stop = self.control is JunctionControl.STOP
        return Precedence(self.starts, self.every_way, *relations, self.left_hand, all_way_stop).yields(self.conflicts)

    @cached_property
    def by_direction(self) -> Mapping[tuple[int, int], Movement]:
        """Movements by entrance and symbolic direction: ``j`` leads to the j-th arm after the entrance's, counter-clockwise.

        Direction ``n``, the number of arms, is the U-turn. If several exits of one arm can be reached, ``j`` leads to the exit
        nearest to the kerb, ``j + n`` to the next exit, and so on.
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
        """Per start of ways and turn, the ways that an agent at this start can take if it indicates this turn."""
        keys = [(start, turn) for start in range(len(self.starts)) for turn in Turn]
        ways = self.every_way.values()
        return MappingProxyType({key: tuple(way for way in ways if (way.entrance, way.turn) == key) for key in keys})

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that a run or a verdict can depend on, including signs and centre lines, without names."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("name", "id", "map", "crossings")}
        return digest_of(**values, areas=[(walk.arm, walk.middle, walk.island, walk.area) for walk in self.crossings])

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

    def exits_of(self, entrance: int, turn: str) -> tuple[int, ...]:
        """Return the exits that vehicles reach from an entrance by a turn, in ascending order; empty if no movement turns so.

        Args:
            entrance: number of the entrance.
            turn: ``left``, ``straight`` or ``right``; a `Turn` is such a text.

        Raises:
            ScenarioError: the junction has no such entrance, or `turn` names no turn.
        """
        if turn not in tuple(Turn) or not 0 <= entrance < len(self.entrances):
            raise ScenarioError(
                f"junction {self.name!r} has no turn {turn!r} from entrance {entrance!r}: its entrances are 0 to "
                f"{len(self.entrances) - 1}, and the turns {', '.join(Turn)}"
            )
        return tuple(exit for (start, exit), way in sorted(self.movements.items()) if (start, way.turn) == (entrance, turn))

    @cached_property
    def one_lane_each(self) -> bool:
        """Whether no arm has more than one entrance or more than one exit."""
        return all(len(arm.entrances) <= 1 and len(arm.exits) <= 1 for arm in self.arms)

    @cached_property
    def rotations(self) -> tuple[int, ...]:
        """Numbers of arms by which a rotation keeps lanes, movements and signs the same; 0 comes first.

        A rotation can change the turns of movements: rotating a T is a symmetry in the paper's sense (section 5.2).
        """
        symmetries = []
        for arms in range(self.ways):
            images = self.image(arms)
            if images is not None:
                entrances, exits = images
                signs = [(lane.sign, lane.no_turn_on_red) for lane in self.entrances]
                same = all(sign == signs[entrances[k]] for k, sign in enumerate(signs))
                if same and {(entrances[a], exits[b]) for a, b in self.movements} == self.movements.keys():
                    symmetries.append(arms)
        return tuple(symmetries)

    def image(self, arms: int) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
        """Return the entrances and exits onto which a rotation by `arms` arms moves the entrances and exits.

        Args:
            arms: number of arms by which the junction is rotated, counter-clockwise.

        Returns:
            Per entrance the number of its image, and per exit the number of its image; None if a lane has no image.
        """
        images = []
        sides: tuple[Sequence[Entrance | Exit], ...] = self.entrances, self.exits
        for lanes in sides:
            numbers = {(lane.arm, lane.lane): number for number, lane in enumerate(lanes)}
            places = [((lane.arm + arms) % self.ways, lane.lane) for lane in lanes]
            if numbers.keys() != set(places):
                return None
            images.append(tuple(numbers[place] for place in places))
        return images[0], images[1]

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
        """Return the lane that leads away from `exit`, or the path from the end of another way; see `way_in` for errors."""
        return self._known(self.ends[exit].road)

    def _known(self, line: Segment | None) -> Segment:
        if line is None:
            raise MapError(f"junction {self.name!r} comes from a recording without positions, so nothing can be placed there")
        return line

    @property
    def map_file(self) -> Path | None:
        """The map file, also of a built-in junction; None for a junction without a map."""
        if self.map is None:
            return path_of(self.name) if self.name in NAMES else None
        return Path(self.map)

    def opendrive(self) -> str:
        """Return an OpenDRIVE text with the junction: the text of its map file, which may hold more junctions.

        What was changed in the junction since it was read, such as a speed limit, is not in this text. For a junction of a map in
        another format, the text is written anew, with this junction alone.

        Raises:
            MapError: the junction has no map file, or the file can't be read.
        """
        if self.map_file is None:
            raise MapError(
                f"junction {self.name!r} has no map file, expected one of rvads.find, which reads maps and built-in ones"
            )
        from pytest_rvads.support.installed import load  # it needs the types of the whole package, which need this module's

        text = text_of(self.map_file)
        return text if "<OpenDRIVE" in text else str(load("map_writers", "xodr")(self))

    def turns_on_red(self, start: int, turn: Turn) -> bool:
        """Return whether a vehicle may enter on red after a stop: it turns to the near side, and no sign forbids this."""
        return turn is self.near and not self.starts[start].no_turn_on_red

    @property
    def near(self) -> Turn:
        """The turn that crosses no other way: right where traffic keeps right."""
        return Turn.LEFT if self.left_hand else Turn.RIGHT

    @property
    def far(self) -> Turn:
        """The turn across oncoming traffic: left where traffic keeps right."""
        return Turn.RIGHT if self.left_hand else Turn.LEFT


@lru_cache(maxsize=256)  # one object per junction and limit, so that the cached properties of the object are computed once
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
