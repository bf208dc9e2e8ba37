"""Files of tracks, read piece by piece: they may be larger than memory, and compressed."""

from __future__ import annotations

import gzip
import os
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast
from xml.parsers import expat

from pytest_rvads.errors import RunError
from pytest_rvads.storage import open_file
from pytest_rvads.wording import one_line

__all__ = ["Source", "Watch", "opened", "parse_xml"]

Watch = Callable[[int, int], None]
"""Told how many bytes of how many have been read."""
_MOST_LINE = 2**22
"""Longest line that is read [bytes]."""
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
        start = raw.read(2)
        raw.seek(0)
        self._file = cast(BinaryIO, gzip.GzipFile(fileobj=raw)) if start == b"\x1f\x8b" else raw

    def chunks(self) -> Iterator[bytes]:
        """Yield its content, unpacked."""
        while chunk := self._file.read(_CHUNK):
            self._tell()
            yield chunk

    def lines(self) -> Iterator[bytes]:
        """Yield its lines, unpacked, each with its end.

        Raises:
            RunError: a line is too long.
        """
        count = 0
        while line := self._file.readline(_MOST_LINE + 1):
            count += 1
            if len(line) > _MOST_LINE:
                raise RunError(f"{self.where}: row {count} is too long, expected at most {_MOST_LINE:,} bytes")
            if count % 1000 == 0:
                self._tell()
            yield line

    def _tell(self) -> None:
        if self._watch is not None and self._size:
            self._watch(min(self._raw.tell(), self._size), self._size)


@contextmanager
def opened(path: Path, watch: Watch | None = None) -> Iterator[Source]:
    """Open a file, unpacked where it is compressed by gzip.

    Raises:
        RunError: it can't be read, or turns out to be damaged.
    """
    try:
        with open_file(path) as raw:
            yield Source(path.name, raw, watch)
    except (OSError, EOFError, zlib.error) as error:
        told = error.strerror if isinstance(error, OSError) and error.strerror else str(error) or type(error).__name__
        raise RunError(f"{path}: can't be read: {one_line(told)}") from error


def parse_xml(
    source: Source, start: Callable[[str, dict[str, str], int], None], end: Callable[[str], None] | None = None
) -> None:
    """Read a file of XML element by element; nothing of it is kept.

    Args:
        source: the file.
        start: called with the tag of every element, its attributes, and the line that it begins in.
        end: called with the tag of every element when it ends.

    Raises:
        RunError: no XML, or some with a document type declaration or a tag that is too long.
    """
    parser = expat.ParserCreate()
    # Where expat puts long tags off, it can't be told how long they are; that bound is here instead.
    getattr(parser, "SetReparseDeferralEnabled", bool)(False)

    def doctype(*_: object) -> None:
        raise RunError(f"{source.where}: it has a document type declaration (DTD), which can hide entity bombs; remove it")

    parser.StartElementHandler = lambda tag, attributes: start(tag, attributes, parser.CurrentLineNumber)
    parser.StartDoctypeDeclHandler = doctype
    if end is not None:
        parser.EndElementHandler = end
    try:
        fed = 0
        for chunk in source.chunks():
            parser.Parse(chunk, False)
            fed += len(chunk)
            if fed - parser.CurrentByteIndex > 2 * _MOST_LINE:  # of an element that has not ended everything is in memory
                raise RunError(f"{source.where}: row {parser.CurrentLineNumber}: a tag has more than {2 * _MOST_LINE:,} bytes")
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        told = one_line(expat.errors.messages.get(error.code, str(error)))
        raise RunError(f"{source.where}: row {error.lineno}, column {error.offset}: not XML: {told}") from error
    except (ValueError, LookupError) as error:  # an encoding that is none
        raise RunError(f"{source.where}: not XML: {one_line(str(error))}") from error
