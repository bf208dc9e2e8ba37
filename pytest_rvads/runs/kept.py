"""What the files of runs and of recordings have in common: arrays in an npz archive, beside a header in JSON with a version.

A file of another version is refused in one sentence, and no file is converted. The same holds for reports and for the protocol of
stacks.
"""

from __future__ import annotations

import io
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.decoding import decode, typed
from pytest_rvads.errors import MapError, RunError
from pytest_rvads.maps.segment import Segment
from pytest_rvads.runs.archive import unpack
from pytest_rvads.storage import read_file, write_file
from pytest_rvads.wording import one_line

__all__ = ["Kept"]

_Header = TypeVar("_Header")
_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True)
class Kept:
    """A kind of file."""

    what: str
    """What it holds: ``run`` or ``recording``."""
    format: str
    """As its header says."""
    version: int
    most_bytes: int
    """Of the file, and of all its arrays together."""
    most_header: int
    """Of its header."""

    def write(self, label: str, path: Path, text: str, arrays: Mapping[str, NDArray[Any]], lines: Sequence[Segment]) -> None:
        """Write a header and arrays, and the centre lines that the header refers to as ``line_<k>``.

        Raises:
            RunError: the file can't be written, or is more than would be read.
        """
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
        """Return what a file holds.

        Args:
            path: of the file.
            header: the type that its header is held against.
            make: makes the value from header and arrays; raises ``KeyError``, ``ValueError``, `MapError` where they are damaged.

        Raises:
            RunError: not such a file, a damaged one, one that holds too much, or one of another version.
        """
        none = f"{path}: not a {self.what} kept by rvads"
        try:
            arrays = unpack(read_file(path, self.most_bytes), self.most_bytes)
            text = arrays.pop("header").tobytes()
        except OSError as error:
            raise RunError(f"{path}: can't be read: {error.strerror}") from error
        except KeyError:
            raise RunError(f"{none}: it has no header") from None
        except ValueError as error:
            raise RunError(f"{none}: {one_line(str(error))}") from error
        if len(text) > self.most_header:
            raise RunError(f"{path}: its header takes {len(text):,} bytes, expected at most {self.most_header:,}")
        head = decode(text, dict[str, Any], f"{path}: header", RunError)
        if head.get("format") != self.format:
            raise RunError(f"{none}: its format is {reprlib.repr(head.get('format'))}")
        if head.get("version") != self.version:
            told = reprlib.repr(head.get("version"))
            raise RunError(f"{path}: written in version {told} of the format, this library reads version {self.version}")
        known = typed(head, header, f"{path}: header", RunError)
        try:
            return make(known, arrays)
        except KeyError as error:
            raise RunError(f"{path}: damaged: {error} is missing") from error
        except (ValueError, MapError) as error:
            raise RunError(f"{path}: damaged: {one_line(str(error))}") from error
