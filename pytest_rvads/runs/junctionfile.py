"""A junction in a file: lanes, signs and movements as JSON, and the centre lines as separate arrays.

The file of a run with pedestrians also holds the crosswalks, from which reading rebuilds the ways of the pedestrians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.signals import INSIDE
from pytest_rvads.geometry.segment import NO_LIMIT, Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.runs.archive import FARTHEST, MOST_LANES, Name, Size
from pytest_rvads.support.errors import RunError

_MOST_POINTS = 100_000
"""Most points of all centre lines together."""
_LONGEST = 10_000
"""Greatest length of all movements of a junction together [m]; computing their conflicts then takes seconds."""

Count = Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
_Length = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
"""A length or distance of a junction in a file [m]."""


Key = tuple[Count, Count]
"""A movement: entrance and exit."""
Exits = Annotated[tuple[Count, ...], msgspec.Meta(max_length=5)]
"""Exits to which a vehicle may also have gone; left out of the file if its way is decided."""
_Limit = Annotated[float, msgspec.Meta(gt=0.0, le=NO_LIMIT)]
"""A speed limit in a file [m/s]."""
_Place = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]
"""A coordinate of a crosswalk [m]."""
_MOST_PAIRS = 100_000
"""Most pairs of movements with a priority in the map; 64 movements have 4,032 pairs."""


class _Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """A centre line: the number of its array, and the attributes of its segment."""

    number: Count
    id: str
    turn: Turn
    junction: str | None
    limits: Annotated[tuple[tuple[_Length, _Limit | None], ...], msgspec.Meta(max_length=_MOST_POINTS)] = ()
    """Speed limits; left out of the file if the map states no limit."""


class _Entrance(msgspec.Struct, frozen=True, omit_defaults=True):
    arm: Count
    lane: Count
    sign: Sign
    phase: Count | None
    setback: Annotated[float, msgspec.Meta(ge=-INSIDE, le=1e6)]
    approach: _Line | None
    sign_setback: _Length | None = None
    """Left out of the file if no sign stands before the line."""
    no_turn_on_red: bool = False
    beyond: _Length | None = None


class _Exit(msgspec.Struct, frozen=True):
    arm: Count
    lane: Count
    road: _Line | None


class _Movement(msgspec.Struct, frozen=True):
    entrance: Count
    exit: Count
    turn: Turn
    length: _Length
    segment: str
    path: _Line | None


class _Crosswalk(msgspec.Struct, frozen=True):
    """A crosswalk; its points are in the header, because they are few."""

    id: str
    arm: Count
    area: Annotated[list[tuple[_Place, _Place]], msgspec.Meta(min_length=3, max_length=1000)]
    path: Annotated[list[tuple[_Place, _Place]], msgspec.Meta(min_length=2, max_length=1000)]
    middle: _Length
    island: _Length
    phase: Count | None


class JunctionRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """A junction as JSON."""

    name: Name
    id: Name
    entrances: Annotated[list[_Entrance], msgspec.Meta(max_length=MOST_LANES)]
    exits: Annotated[list[_Exit], msgspec.Meta(max_length=MOST_LANES)]
    movements: Annotated[list[_Movement], msgspec.Meta(max_length=MOST_LANES**2)]
    right_of: list[tuple[Count, Count]]
    opposite: list[tuple[Count, Count]]
    left_hand: bool
    lane_width: Size
    stated: Annotated[list[tuple[Key, Key]], msgspec.Meta(max_length=_MOST_PAIRS)] = []
    """Left out of the file if the map states no priority."""
    joining: Annotated[list[tuple[Key, Key]], msgspec.Meta(max_length=_MOST_PAIRS)] = []
    crosswalks: Annotated[list[_Crosswalk], msgspec.Meta(max_length=MOST_LANES)] = []
    """Left out of the file if nobody walks."""

    @property
    def starts(self) -> int:
        """Number of starts of ways: every crosswalk has two crossings and a parking place."""
        return len(self.entrances) + 3 * len(self.crosswalks)


def put_junction(junction: Junction, lines: list[Segment]) -> JunctionRecord:
    """Return a junction as JSON, and add its centre lines to `lines`, which a file stores as arrays."""
    walked = bool(junction.further)
    if walked and (not junction.crossings or junction.unwalked.walked != junction):
        kinds = ", ".join(sorted({way.kind for way, _, _ in junction.further}))
        raise RunError(
            f"junction {junction.name!r} has ways of the kind {kinds} that do not follow from its crosswalks, and files hold "
            "movements and crosswalks only: save it without"
        )

    def put(line: Segment | None) -> _Line | None:
        if line is None:
            return None
        lines.append(line)
        return _Line(len(lines) - 1, line.id, line.turn, line.junction, line.limits)

    return JunctionRecord(
        junction.name,
        junction.id,
        [
            _Entrance(e.arm, e.lane, e.sign, e.phase, e.setback, put(e.approach), e.sign_setback, e.no_turn_on_red, e.beyond)
            for e in junction.entrances
        ],
        [_Exit(e.arm, e.lane, put(e.road)) for e in junction.exits],
        [_Movement(*m.key, m.turn, m.length, m.segment, put(m.path)) for m in junction.movements.values()],
        sorted(junction.right_of),
        sorted(junction.opposite),
        junction.left_hand,
        junction.lane_width,
        sorted(junction.stated),
        sorted(junction.joining),
        [
            _Crosswalk(c.id, c.arm, c.area.tolist(), c.path.points.tolist(), c.middle, c.island, c.phase)
            for c in (junction.crossings if walked else ())
        ],
    )


def get_junction(record: JunctionRecord, arrays: Mapping[str, NDArray[Any]]) -> Junction:
    """Return the junction of a file. Equal files give the same object, so that results cached on a junction are computed once."""
    lines = tuple((name, a.dtype.str, a.shape, a.tobytes()) for name, a in sorted(arrays.items()) if name.startswith("line_"))
    return _junction(msgspec.msgpack.encode(record), lines)


@lru_cache(maxsize=16)
def _junction(content: bytes, lines: tuple[tuple[str, str, tuple[int, ...], bytes], ...]) -> Junction:
    arrays = {name: np.frombuffer(array, dtype).reshape(shape) for name, dtype, shape, array in lines}
    record = msgspec.msgpack.decode(content, type=JunctionRecord)
    points = 0

    def get(line: _Line | None) -> Segment | None:
        nonlocal points
        if line is None:
            return None
        along = arrays[f"line_{line.number}"]
        points += along.size // 2
        if points > _MOST_POINTS or (np.abs(along) > FARTHEST).any():
            raise ValueError(f"its centre lines have more than {_MOST_POINTS:,} points, or some beyond {FARTHEST:g} m")
        return Segment(line.id, along, line.turn, line.junction, line.limits)

    movements = [Movement(m.entrance, m.exit, m.turn, m.length, m.segment, get(m.path)) for m in record.movements]
    crosswalks = tuple(
        Crosswalk(c.id, c.arm, np.array(c.area), Segment(c.id, np.array(c.path)), c.middle, c.island, c.phase)
        for c in record.crosswalks
    )
    paths = [*(m.path for m in movements), *(c.path for c in crosswalks)]
    length = math.fsum(path.length for path in paths if path is not None)
    if length > _LONGEST:
        raise ValueError(f"its movements and crosswalks are {length:,.0f} m long together, expected at most {_LONGEST:,} m")
    ways = {m.key: m for m in movements}
    if unknown := [key for pair in (*record.stated, *record.joining) for key in pair if key not in ways]:
        raise ValueError(f"its junction states a priority of the movement {unknown[0]}, which it does not have")
    junction = Junction(
        record.name,
        record.id,
        tuple(
            Entrance(e.arm, e.lane, e.sign, e.phase, e.setback, get(e.approach), e.sign_setback, None, e.no_turn_on_red, e.beyond)
            for e in record.entrances
        ),
        tuple(Exit(e.arm, e.lane, get(e.road)) for e in record.exits),
        ways,
        frozenset(record.right_of),
        frozenset(record.opposite),
        record.left_hand,
        record.lane_width,
        stated=frozenset(record.stated),
        joining=frozenset(record.joining),
        crossings=crosswalks,
    )
    if wrong := [c.arm for c in crosswalks if c.arm >= junction.ways]:
        raise ValueError(f"it has a crosswalk over arm {wrong[0]}, and its junction has {junction.ways} arms")
    return junction.walked


def check_ways(junction: Junction, name: str, route: Key, other_exits: Exits) -> None:
    """Check that the way of an agent in a file exists, and that movements lead to the other exits."""
    entrance, own_exit = route
    for exit in (own_exit, *other_exits):
        if (entrance, exit) not in junction.every_way:
            raise ValueError(f"{name} goes from entrance {entrance} to exit {exit}, where no way leads")
