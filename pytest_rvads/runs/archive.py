"""Files of runs and recordings: arrays in an npz archive, a JSON header with a version, and bounds on their content.

Within the bounds, reading and judging a run takes seconds and fits into memory. The size of every array is known and bounded
before the array is unpacked. A file of another version is refused, and no file is converted. Reports, and the protocol of drivers
in other processes, also refuse other versions.
"""

from __future__ import annotations

import io
import math
import re
import reprlib
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import Segment
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
