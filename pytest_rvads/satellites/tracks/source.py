"""Reads files of tracks piece by piece, because a file may be compressed or larger than memory."""

from __future__ import annotations

import gzip
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import XmlError, open_file
from pytest_rvads.support.wording import one_line

Watch = Callable[[int, int], None]
"""A function that is called with the number of bytes read so far and the number of all bytes."""
_MOST_UNPACKED = 2**33
"""Largest size of an unpacked file [bytes]: 20 million samples have 1 to 4 GB."""
_MOST_RATIO, _ALWAYS_UNPACKED = 200, 2**24
"""The content of a packed file can have `_ALWAYS_UNPACKED` bytes, or if more, `_MOST_RATIO` times the packed size. Logs pack to a
fiftieth at best, so a larger ratio is an attack."""
_MOST_BLANK = 100_000
"""Largest number by which empty lines of a file exceed its lines with content."""


class Source:
    """An open file of tracks."""

    def __init__(self, where: str, raw: BinaryIO, watch: Watch | None) -> None:
        self.where = where
        self._raw = raw
        self._watch = watch
        self._size = os.fstat(raw.fileno()).st_size
        self._most = min(_MOST_UNPACKED, max(_MOST_RATIO * self._size, _ALWAYS_UNPACKED))
        self._unpacked = 0
        start = raw.read(2)
        raw.seek(0)
        self._file = cast(BinaryIO, gzip.GzipFile(fileobj=raw)) if start == b"\x1f\x8b" else raw

    def chunks(self) -> Iterator[bytes]:
        """Yield the unpacked content of the file in pieces."""
        while chunk := self._file.read(2**18):
            self._count(len(chunk), report=True)
            yield chunk

    def lines(self, longest: int = 2**22) -> Iterator[bytes]:
        """Yield the unpacked lines of the file, each with its line end; a line is an error if it exceeds `longest` bytes."""
        count = blank = 0
        while line := self._file.readline(longest + 1):
            count += 1
            self._count(len(line), report=count % 1000 == 0)
            if len(line) > longest:
                raise RunError(f"{self.where}: row {count} is too long, expected at most {longest:,} bytes")
            blank += line.isspace()
            if 2 * blank > count + _MOST_BLANK:
                raise RunError(f"{self.where}: row {count}: {blank:,} of the rows up to here are empty, expected fewer")
            yield line

    def _count(self, size: int, *, report: bool) -> None:
        self._unpacked += size
        if self._unpacked > self._most:
            raise RunError(f"{self.where}: the file unpacks to more than {self._most:,} bytes: cut the file into several files")
        if report and self._watch is not None and self._size:
            self._watch(min(self._raw.tell(), self._size), self._size)


@contextmanager
def opened(path: Path, watch: Watch | None = None) -> Iterator[Source]:
    """Open a file of tracks; a file compressed by gzip is unpacked."""
    try:
        with open_file(path) as raw:
            yield Source(path.name, raw, watch)
    except XmlError as error:
        raise RunError(f"{path.name}: {error}") from error
    except (OSError, EOFError, zlib.error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
        raise RunError(f"{path}: can't be read: {one_line(reason)}") from error
