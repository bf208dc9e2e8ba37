"""Ways through a junction, the lanes at which ways start and end, and the digest of a junction, which is made of these.

Arms are numbered counter-clockwise. Entrances and exits are lanes, numbered arm by arm and on each arm from the kerb. So in a
junction with one lane per arm, entrances and exits have the number of their arm.

Arms, lanes and agents are different things. A pair of entrance and exit need not have a movement, and several agents can come to
one entrance. So no code takes the number of an arm, a lane or an agent for the number of another thing.

Every way begins at a numbered start: the entrances have the first numbers, then come the starts of ways that are no movements.
Every way ends at a numbered end: the exits have the first numbers, then come the ends of ways that are no movements.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.geometry.turns import Turn

CONFLICT_WIDTH = 2.6
"""Width of a movement: distance of centre lines below which two movements are in conflict [m].

The distance is the sum of the width of a car and of the additional width that its body sweeps in a bend.
"""
Key = tuple[int, int]
"""A way, as the numbers of its start and its end: for a movement the numbers of its entrance and its exit."""


class Way(Protocol):
    """A path through a junction: a movement of vehicles from lane to lane, or another path, see `Junction.further`."""

    @property
    def entrance(self) -> int:
        """Number of the start of the way; for a movement, the number of its entrance."""

    @property
    def exit(self) -> int:
        """Number of the end of the way; for a movement, the number of its exit."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Entrance:
    """A lane that leads into a junction."""

    arm: int
    """Number of the arm, counted counter-clockwise from 0."""
    lane: int = 0
    """Number of the lane on its arm, counted from the kerb."""
    sign: Sign = Sign.NONE
    """The sign or light that controls the entrance."""
    phase: int | None = None
    """Number of the entrance's phase group; None without a light."""
    setback: float = 0.0
    """Distance of the stopping line before the entrance vertex [m]; 0 if no line is marked.

    The distance is negative for a line that is painted behind the vertex. The junction then begins at the line.
    """
    approach: Segment | None = None
    """Centre line of the lane from the previous junction, or the end of the road, down to the entrance vertex."""
    sign_setback: float | None = None
    """Distance of the stop sign before the vertex [m]; None without a stop sign away from the stopping line."""
    light: tuple[float, float] | None = None
    """Place of the first light of the entrance in its map file [m]; None without a light, and for a junction of a run file."""
    no_turn_on_red: bool = False
    """Whether the map forbids turns on red, which are allowed to the near side otherwise."""
    beyond: float | None = None
    """Distance behind the vertex of a painted line that lies where ways have met, and is not used [m]; None without such a line.

    A violation that would be none with this line is UNSURE.
    """

    @property
    def stop_line(self) -> Pose | None:
        """The middle of the lane at the stopping line, in the direction of travel; None if the lane is not known."""
        return self.approach.pose(self.approach.length - self.setback) if self.approach else None


@dataclass(frozen=True, slots=True, eq=False)
class Exit:
    """A lane that leads out of a junction."""

    arm: int
    """Number of the arm, counted counter-clockwise from 0."""
    lane: int = 0
    """Number of the lane on its arm, counted from the kerb."""
    road: Segment | None = None
    """Centre line of the lane from the exit vertex down to the next junction, or the end of the road."""


class Arm(NamedTuple):
    """The lanes of an arm: the numbers of its entrances and of its exits, from the kerb on."""

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
    """Turn type of the movement."""
    length: float
    """Length from the entrance vertex to the exit vertex along the centre line [m]."""
    segment: str
    """Id of the segment that labels the edge."""
    path: Segment | None = field(default=None, compare=False, repr=False)
    """The centre line; None if a recording does not hold the centre line."""

    @property
    def key(self) -> Key:
        """Numbers of the entrance and the exit of the movement."""
        return self.entrance, self.exit

    @property
    def kind(self) -> str:
        """The noun for this way in messages."""
        return "movement"

    @property
    def width(self) -> float:
        """Width that vehicles on the movement take up [m]."""
        return CONFLICT_WIDTH


class Further(NamedTuple):
    """A way that is no movement of vehicles, with the places where the way starts and ends, such as kerbs of an arm."""

    way: Way
    start: Entrance
    """The place where the way starts, with its arm, and with its sign or light, if any."""
    end: Exit


def centre_lines(
    entrances: Sequence[Entrance], exits: Sequence[Exit], movements: Mapping[Key, Movement]
) -> tuple[Segment | None, ...]:
    """Return the centre lines of approaches, of movements in the order of their keys, and of exit roads; None if not known."""
    paths = (movements[key].path for key in sorted(movements))
    return (*(lane.approach for lane in entrances), *paths, *(lane.road for lane in exits))


def digest_of(  # noqa: PLR0913 - the fields of a junction, by keyword
    *,
    entrances: Sequence[Entrance],
    exits: Sequence[Exit],
    movements: Mapping[Key, Movement],
    right_of: Collection[tuple[int, int]],
    opposite: Collection[tuple[int, int]],
    left_hand: bool,
    lane_width: float,
    stated: Collection[tuple[Key, Key]],
    joining: Collection[tuple[Key, Key]],
    further: Sequence[Further],
    areas: Sequence[tuple[int, float, float, NDArray[np.float64]]],
) -> str:
    """Return the digest of a junction, equal for junctions on which every case gives the same runs and verdicts.

    `areas` are the painted areas of crosswalks: arm, middle and width of the island [m], and corners, shape ``(k, 2)`` [m].
    """
    known = centre_lines(entrances, exits, movements)
    lines = [line for line in known if line is not None]
    drivable = len(lines) == len(known)
    lanes_in = [(e.arm, e.lane, e.sign, e.phase, e.setback) for e in entrances]
    lanes_out = [(e.arm, e.lane) for e in exits]
    ways = sorted((m.entrance, m.exit, m.turn, m.length) for m in movements.values())
    relations = sorted(right_of), sorted(opposite)
    # A rare property enters the digest only if the junction has the property. So a new property changes no digest of a
    # junction without the property.
    signs = [e.sign_setback for e in entrances] if any(e.sign_setback is not None for e in entrances) else None
    unused = {"beyond": [e.beyond for e in entrances]} if any(e.beyond is not None for e in entrances) else None
    joins = {"joining": sorted(joining)} if joining else None
    limits = [line.limits for line in lines]
    on_red = {"no_turn_on_red": [e.no_turn_on_red for e in entrances]} if any(e.no_turn_on_red for e in entrances) else None
    beside = further and {
        "further": [
            (way.kind, way.turn, way.width, way.length, start.arm, start.sign, start.phase, start.setback, end.arm)
            for way, start, end in further
        ]
    }
    rare = [item for item in (signs, sorted(stated), joins, limits if any(limits) else None, beside, on_red, unused) if item]
    sha = hashlib.sha256(json.dumps([lanes_in, lanes_out, ways, relations, left_hand, drivable, *rare]).encode())
    if drivable:
        sha.update(json.dumps([lane_width, [len(line.points) for line in lines]]).encode())
        for line in lines:
            sha.update(line.points.tobytes())
        for way, start, end in further:
            for part in (start.approach, way.path, end.road):
                sha.update(b"-" if part is None else part.points.tobytes())
        for *numbers, corners in areas if further else ():
            sha.update(json.dumps(numbers).encode() + corners.tobytes())
    return sha.hexdigest()


def cross(
    signs: Sequence[Sign],
    *,
    phase_groups: Sequence[frozenset[int]] = (),
    setbacks: Sequence[float] = (),
    approaches: Sequence[Segment] = (),
    roads: Sequence[Segment] = (),
) -> tuple[tuple[Entrance, ...], tuple[Exit, ...]]:
    """Return the entrances and exits of a junction with one lane per arm; setbacks of stopping lines [m] are 0 by default."""
    phases = {entrance: number for number, group in enumerate(phase_groups) for entrance in group}
    return (
        tuple(
            Entrance(k, 0, sign, phases.get(k), setbacks[k] if setbacks else 0.0, approaches[k] if approaches else None)
            for k, sign in enumerate(signs)
        ),
        tuple(Exit(k, 0, roads[k] if roads else None) for k in range(len(signs))),
    )
