"""Files of tracks, read piece by piece: they may be larger than memory, and compressed."""

from __future__ import annotations

import gzip
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from pytest_rvads.boundedxml import XmlError
from pytest_rvads.errors import RunError
from pytest_rvads.storage import open_file
from pytest_rvads.wording import one_line

__all__ = ["Source", "Watch", "opened"]

Watch = Callable[[int, int], None]
"""Told how many bytes of how many have been read."""
_MOST_LINE = 2**22
"""Longest line that is read [bytes]."""
_MOST_BYTES = 2**33
"""Most that is read of a file, as unpacked [bytes]: 20 million samples have 1 to 4 GB."""
_RATIO, _FREE = 200, 2**24
"""A packed file unpacks to at most so many times its size, or so many bytes: logs pack to a fiftieth at best."""
_BLANK = 100_000
"""So many more lines may be empty than are not."""
_CHUNK = 2**18


class Source:
    """A file being read.

    Args:
        where: its name, for messages.
        raw: the file.
        watch: told how far reading is.
    """

    def __init__(self, where: str, raw: BinaryIO, watch: Watch | None) -> None:
        self.where = where
        self._raw = raw
        self._watch = watch
        self._size = os.fstat(raw.fileno()).st_size
        self._most = min(_MOST_BYTES, max(_RATIO * self._size, _FREE))
        self._unpacked = 0
        start = raw.read(2)
        raw.seek(0)
        self._file = cast(BinaryIO, gzip.GzipFile(fileobj=raw)) if start == b"\x1f\x8b" else raw

    def chunks(self) -> Iterator[bytes]:
        """Yield its content, unpacked."""
        while chunk := self._file.read(_CHUNK):
            self._count(len(chunk))
            self._tell()
            yield chunk

    def lines(self, longest: int = _MOST_LINE) -> Iterator[bytes]:
        """Yield its lines, unpacked, each with its end.

        Raises:
            RunError: a line is longer than so many bytes, too many are empty, or the file is too large.
        """
        count = blank = 0
        while line := self._file.readline(longest + 1):
            count += 1
            self._count(len(line))
            if len(line) > longest:
                raise RunError(f"{self.where}: row {count} is too long, expected at most {longest:,} bytes")
            blank += line.isspace()
            if 2 * blank > count + _BLANK:
                raise RunError(f"{self.where}: row {count}: {blank:,} of the rows so far are empty, expected fewer")
            if count % 1000 == 0:
                self._tell()
            yield line

    def _count(self, size: int) -> None:
        self._unpacked += size
        if self._unpacked > self._most:
            raise RunError(f"{self.where}: it unpacks to more than {self._most:,} bytes: cut it into several files")

    def _tell(self) -> None:
        if self._watch is not None and self._size:
            self._watch(min(self._raw.tell(), self._size), self._size)


@contextmanager
def opened(path: Path, watch: Watch | None = None) -> Iterator[Source]:
    """Open a file, unpacked where it is compressed by gzip.

    Raises:
        RunError: the file can't be read, is damaged, or was read as XML and is no XML.
    """
    try:
        with open_file(path) as raw:
            yield Source(path.name, raw, watch)
    except XmlError as error:
        raise RunError(f"{path.name}: {error}") from error
    except (OSError, EOFError, zlib.error) as error:
        told = error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
        raise RunError(f"{path}: can't be read: {one_line(told)}") from error
