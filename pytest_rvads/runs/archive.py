"""npz archives from elsewhere: what a member unpacks to is known, and within bounds, before anything is unpacked."""

from __future__ import annotations

import io
import math
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.storage import open_file

__all__ = ["MOST_BYTES", "peek", "unpack"]

MOST_BYTES = 64 * 2**20
"""Of an archive of a run, and of all its arrays together: 40 minutes of four vehicles."""
_MOST_MEMBERS = 1000
_DIRECTORY_ENTRY = b"PK\x01\x02"
_SHAPE = 10
"""Where an array in the npy format says what it holds, after its magic number and the length of that [bytes]."""
_HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..{'descr': '([<>|](?:[iu][1248]|f[48]))', "
    rb"'fortran_order': (True|False), 'shape': \(([\d, ]{0,60})\), } *\n",
    re.DOTALL,
)
"""Header of an array in version 1 of the npy format, as numpy writes it; numpy's reader evaluates the header as Python."""


def unpack(content: bytes, most: int = MOST_BYTES) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive by name; they can't be written to.

    Args:
        content: of the file.
        most: how much memory all arrays together may take [bytes].

    Raises:
        ValueError: a damaged archive, or one that would take too much memory.
    """
    count = content.count(_DIRECTORY_ENTRY)
    if count > _MOST_MEMBERS:
        raise ValueError(f"it holds {count:,} arrays, expected at most {_MOST_MEMBERS:,}")
    try:
        members = _members(content, most)
    except ValueError:
        raise
    except Exception as error:  # zipfile and zlib raise whatever they stumble over
        raise ValueError(f"{error or type(error).__name__}") from error
    return {name: _array(name, data) for name, data in members.items()}


def peek(path: Path, name: str, most: int = 2**16) -> bytes:
    """Return the first bytes of an array in a file of a run, at most `most`; no bytes if the array is missing or damaged."""
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as archive, archive.open(f"{name}.npy") as member:
            data = member.read(most)
    except Exception:  # zipfile and zlib raise whatever they stumble over
        return b""
    return data[_SHAPE + int.from_bytes(data[_SHAPE - 2 : _SHAPE], "little") :]


def _members(content: bytes, most: int) -> dict[str, bytes]:
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
                members[name] = member.read(entry.file_size + 1)  # without a number it unpacks whatever comes
            if len(members[name]) != entry.file_size:
                raise ValueError(f"{name} has {len(members[name]):,} bytes where {entry.file_size:,} are announced")
        return members


def _array(name: str, data: bytes) -> NDArray[Any]:
    head = _HEADER.match(data)
    if head is None:
        raise ValueError(f"{name} is no array of numbers")
    kind, fortran, lengths = head.groups()
    shape = tuple(int(length) for length in lengths.split(b",") if length.strip())
    dtype = np.dtype(kind.decode())
    if math.prod(shape) * dtype.itemsize != len(data) - head.end():
        raise ValueError(f"{name} has {len(data) - head.end():,} bytes of numbers, which do not fill the shape {shape}")
    return np.frombuffer(data, dtype, offset=head.end()).reshape(shape, order="F" if fortran == b"True" else "C")
