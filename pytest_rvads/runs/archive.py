"""Files of runs and recordings: arrays in an npz archive, a JSON header with a version, and bounds on their content.

Within the bounds, reading and judging a run takes seconds and fits into memory. The size of every array is known and bounded
before the array is unpacked. A file of another version is refused, and no file is converted. Reports, and the protocol of drivers
in other processes, also refuse other versions.

A junction is in such a file as JSON (lanes, signs and movements), with the centre lines as separate arrays. The file of a run
with pedestrians also holds the crosswalks, from which reading rebuilds the ways of the pedestrians.
"""

from __future__ import annotations

import io
import math
import re
import reprlib
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.signals import INSIDE
from pytest_rvads.geometry.segment import NO_LIMIT, Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.support.decoding import decode, typed
from pytest_rvads.support.errors import MapError, RunError
from pytest_rvads.support.storage import open_file, read_file, write_file
from pytest_rvads.support.wording import one_line

FARTHEST = 1e9
"""Largest number in an array of places, speeds or commands."""
MOST_LANES = _MOST_AGENTS = 100
"""Most vehicles of a run, and most entrances, or exits, of a junction."""
_MOST_WORK = 320_000_000
"""Largest sum, over the runs of a file, of the ticks times the square of the number of vehicles and entrances.

Five million ticks with four vehicles at four entrances reach it. Judging so many ticks takes half a gigabyte and some seconds.
"""

Name = Annotated[str, Meta(min_length=1, max_length=1000, pattern="^[^\x00-\x1f\x7f-\x9f\ud800-\udfff]+$")]
"""Name of a run, a vehicle or a junction: a text without control characters."""
Step = Annotated[float, Meta(ge=1e-6, le=3600.0)]
"""Time between two states [s]."""
Size = Annotated[float, Meta(gt=0.0, le=1e4)]
"""Length or width of a vehicle, width of a lane [m]."""

_Header = TypeVar("_Header")
_Value = TypeVar("_Value")
MOST_BYTES = 64 * 2**20
"""Largest archive of a run, and largest sum of its arrays [bytes]: 40 minutes of four vehicles."""
_MOST_MEMBERS = 1000
_DIRECTORY_ENTRY = b"PK\x01\x02"
_SHAPE = 10
"""Position of the header in the npy format, after the magic number, the version and the length of the header [bytes]."""
_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..{'descr': '([<>|](?:[iu][1248]|f[48]))', "
    rb"'fortran_order': (True|False), 'shape': \(([\d, ]{0,60})\), } *\n",
    re.DOTALL,
)
"""Header of an array in version 1 of the npy format, as numpy writes it; numpy's reader evaluates the header as Python."""


def check_size(where: str, sizes: Iterable[tuple[int, int, int]]) -> None:
    """Raise a `RunError` if runs are too large to be judged together."""
    ticks = work = 0
    for steps, agents, entrances in sizes:
        if agents > _MOST_AGENTS or entrances > MOST_LANES:
            raise RunError(
                f"{where}: {agents:,} vehicles at {entrances:,} entrances, at most {_MOST_AGENTS} of either are read: cut it up"
            )
        ticks, work = ticks + steps, work + steps * (agents + entrances) ** 2
    if work > _MOST_WORK:
        raise RunError(
            f"{where}: {ticks:,} ticks of so many vehicles and entrances are {work:,} pairs of them, at most {_MOST_WORK:,} are "
            "read: cut it into several files, or record in longer steps"
        )


@dataclass(frozen=True, slots=True)
class Kept:
    """A kind of file: an npz archive of arrays, with a JSON header."""

    what: str
    """Content of the file: ``run`` or ``recording``."""
    format: str
    version: int
    most_bytes: int
    """Largest size of the file, and of all its arrays together [bytes]."""
    most_header: int
    """Largest size of the header [bytes]."""

    def write(self, label: str, path: Path, text: str, arrays: Mapping[str, NDArray[Any]], lines: Sequence[Segment]) -> None:
        """Write a header and arrays, and the centre lines to which the header refers as ``line_<k>``."""
        header = np.frombuffer(text.encode(), dtype=np.uint8)
        entries = {**arrays, "header": header} | {f"line_{k}": line.points for k, line in enumerate(lines)}
        size = sum(array.nbytes for array in entries.values())
        if size > self.most_bytes or len(header) > self.most_header:
            raise RunError(
                f"{self.what} {label!r} can't be kept: it takes {size:,} bytes, which is more than would be read again"
            )
        content = io.BytesIO()
        np.savez_compressed(content, **entries)  # type: ignore[arg-type]
        try:
            write_file(path, content.getvalue())
        except OSError as error:
            raise RunError(f"{path}: can't be written: {error.strerror}") from error

    def read(self, path: Path, header: type[_Header], make: Callable[[_Header, Mapping[str, NDArray[Any]]], _Value]) -> _Value:
        """Return the run or recording in a file."""
        prefix = f"{path}: not a {self.what} kept by rvads"
        try:
            arrays = unpack(read_file(path, self.most_bytes), self.most_bytes)
            text = arrays.pop("header").tobytes()
        except OSError as error:
            raise RunError(f"{path}: can't be read: {error.strerror}") from error
        except KeyError:
            raise RunError(f"{prefix}: it has no header") from None
        except ValueError as error:
            raise RunError(f"{prefix}: {one_line(str(error))}") from error
        if len(text) > self.most_header:
            raise RunError(f"{path}: its header takes {len(text):,} bytes, expected at most {self.most_header:,}")
        head = decode(text, dict[str, Any], f"{path}: header", RunError)
        if head.get("format") != self.format:
            raise RunError(f"{prefix}: its format is {reprlib.repr(head.get('format'))}")
        if head.get("version") != self.version:
            version = reprlib.repr(head.get("version"))
            raise RunError(f"{path}: written in version {version} of the format, this library reads version {self.version}")
        record = typed(head, header, f"{path}: header", RunError)
        try:
            return make(record, arrays)
        except KeyError as error:
            raise RunError(f"{path}: damaged: {error} is missing") from error
        except (ValueError, MapError) as error:
            raise RunError(f"{path}: damaged: {one_line(str(error))}") from error


def check_array(name: str, array: NDArray[Any], shape: tuple[int, ...], kind: str) -> None:
    """Check the shape of an array in a file, and the kind of its numbers: whole numbers (``i``) or floats (``f``)."""
    if (array.shape, array.dtype.kind) != (shape, kind):
        numbers = "whole numbers" if kind == "i" else "numbers"
        raise ValueError(f"{name} must be {numbers} in the shape {shape}, got {array.dtype} in {array.shape}")


def unpack(content: bytes, most: int = MOST_BYTES) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive by name, read-only; together they may take at most `most` bytes."""
    count = content.count(_DIRECTORY_ENTRY)
    if count > _MOST_MEMBERS:
        raise ValueError(f"it holds {count:,} arrays, expected at most {_MOST_MEMBERS:,}")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            if len(entries) < len(archive.infolist()):
                raise ValueError("two of its arrays have the same name")
            if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in entries.values()):
                raise ValueError("it is compressed by another method than deflate, which alone unpacks in steps")
            size = sum(entry.file_size for entry in entries.values())
            if size > most:
                raise ValueError(f"its arrays take {size:,} bytes, expected at most {most:,}")
            members = {}
            for name, entry in entries.items():
                with archive.open(entry) as member:
                    members[name] = member.read(entry.file_size + 1)  # without a size, any amount of data would be unpacked
                if len(members[name]) != entry.file_size:
                    raise ValueError(f"{name} has {len(members[name]):,} bytes where {entry.file_size:,} are announced")
    except ValueError:
        raise
    except Exception as error:  # zipfile and zlib raise many types of errors
        raise ValueError(f"{error or type(error).__name__}") from error
    arrays: dict[str, NDArray[Any]] = {}
    for name, data in members.items():
        head = _HEADER.match(data)
        if head is None:
            raise ValueError(f"{name} is no array of numbers")
        kind, fortran, lengths = head.groups()
        shape = tuple(int(length) for length in lengths.split(b",") if length.strip())
        dtype = np.dtype(kind.decode())
        if math.prod(shape) * dtype.itemsize != len(data) - head.end():
            raise ValueError(f"{name} has {len(data) - head.end():,} bytes of numbers, which do not fill the shape {shape}")
        order: Literal["F", "C"] = "F" if fortran == b"True" else "C"
        arrays[name] = np.frombuffer(data, dtype, offset=head.end()).reshape(shape, order=order)
    return arrays


def peek(path: Path, name: str, most: int = 2**16) -> bytes:
    """Return at most `most` bytes from the start of an array in a file of a run; no bytes if the array is missing or damaged."""
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as archive, archive.open(f"{name}.npy") as member:
            data = member.read(most)
    except Exception:  # zipfile and zlib raise many types of errors
        return b""
    return data[_SHAPE + int.from_bytes(data[_SHAPE - 2 : _SHAPE], "little") :]


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
