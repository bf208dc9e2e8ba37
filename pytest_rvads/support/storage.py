"""Files: only regular files of bounded size are read, XML is read within bounds, and files are written atomically.

XML is read element by element, within bounds on depth and tag length. A document type declaration is refused when it begins, so
a file can declare no entity and refer to nothing outside.
"""

from __future__ import annotations

import errno
import math
import os
import re
import stat
from collections.abc import Callable, Iterable
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO
from uuid import uuid4
from xml.parsers import expat

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.wording import one_line

_LONGEST = 190
"""Longest name of a file without its ending [bytes]; file systems take 255."""
_PLAIN = re.compile(r"(?:\w+/)*\w+\.py(?:::\w+)*(?:\[[\w.-]*[\w.]\])?", re.ASCII)
"""Ids of items that stay distinct when brackets and slashes become hyphens."""

DEEPEST = 60
"""Deepest nesting that is read: a trajectory of OpenSCENARIO lies 16 levels deep, a lane of OpenDRIVE 10."""
LONGEST_TAG = 2**23
"""Longest tag or comment that is read [bytes]; a tag is held in memory as a whole."""


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; a pipe or device, which could be endless, is refused without waiting."""
    try:
        # Without O_NONBLOCK, the opening of a pipe waits for a writer.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError as error:
        raise OSError(errno.EINVAL, f"no file has such a name: {error}", ascii(str(path))) from error
    mode = os.fstat(number).st_mode
    if not stat.S_ISREG(mode):
        os.close(number)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise OSError(errno.EINVAL, "it is a pipe or device, expected a regular file", str(path))
    return open(number, "rb")


def read_file(path: Path, most: int) -> bytes:
    """Return the content of a regular file of at most `most` bytes."""
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read() if size <= most else b""
    if max(size, len(content)) > most:
        raise OSError(errno.EFBIG, f"it is too large, expected at most {most:,} bytes", str(path))
    return content


def write_file(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write a file atomically: a reader sees the old content or the whole new content, even if the writer is killed.

    Several processes can write the same file at once, because each process writes a temporary file and renames it. A pipe or
    device, such as ``/dev/stdout``, is written to directly. A symbolic link to a file is replaced. Missing folders are made.
    """
    place = _place(path)
    pieces = [content] if isinstance(content, bytes) else content
    # The temporary name does not contain the name of the file, which may have the greatest length.
    part = place.with_name(f".{uuid4().hex}.part")
    try:
        if place.exists() and not place.is_file():
            number = os.open(place, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))  # a pipe that nobody reads is refused
            os.set_blocking(number, True)
            with open(number, "wb") as file:
                file.writelines(pieces)
            return
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as file:
                file.writelines(pieces)
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _place(path: Path) -> Path:
    """Return the absolute path at which a file is written; links are followed to folders, pipes and devices, and in ``/dev``."""
    folder = Path(os.path.realpath(path.parent))
    if path.name in ("", "..") or (path.exists() and not path.is_file()) or folder.parts[1:2] in (("dev",), ("proc",)):
        return Path(os.path.realpath(path))
    return folder / path.name


def check_writable(path: Path) -> None:
    """Check before a long computation that `write_file` may write its result; nothing is written."""
    path = _place(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if path.exists() and not path.is_file():
        return
    folder = next(parent for parent in path.parents if parent.exists())
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))


def slug(text: str) -> str:
    """Return a file name without ending for the id of a test or another text; different texts get different names."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", text.replace(".py::", ".")).strip("-")
    if _PLAIN.fullmatch(text) and len(name) <= _LONGEST:
        return name
    digest = sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:12]
    return f"{name[: _LONGEST - 13]}-{digest}"


class XmlError(RvadsError):
    """The error that a file is no XML, or exceeds a bound; the message names the row, and the caller adds the file's name."""


def number_in(text: str) -> float:
    """Return the number that a text, such as an attribute in XML, holds; NaN for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def read_xml(
    chunks: Iterable[bytes],
    expected: str,
    start: Callable[[str, dict[str, str], int], None],
    end: Callable[[str], None] | None = None,
    text: Callable[[str], None] | None = None,
) -> None:
    """Read XML and call a function for each element."""
    parser = expat.ParserCreate()
    # By default, expat delays the parsing of a long tag, and its position does not show how long the tag is.
    getattr(parser, "SetReparseDeferralEnabled", bool)(False)
    depth = fed = 0

    def doctype(*_: Any) -> None:
        raise XmlError("it has a document type declaration (DTD), which can hide entity bombs; remove it")

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise XmlError(f"row {parser.CurrentLineNumber}: elements are nested deeper than {DEEPEST} levels")
        start(tag, attributes, parser.CurrentLineNumber)

    def finish(tag: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(tag)

    parser.StartDoctypeDeclHandler, parser.StartElementHandler, parser.EndElementHandler = doctype, begin, finish
    parser.CharacterDataHandler = text
    complete = False
    try:
        for chunk in chunks:
            parser.Parse(chunk, False)
            fed += len(chunk)
            if fed - parser.CurrentByteIndex > LONGEST_TAG:
                raise XmlError(f"row {parser.CurrentLineNumber}: a tag or comment has more than {LONGEST_TAG // 2**20} MB")
        complete = True
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        what = one_line(expat.errors.messages.get(error.code, str(error))) + ", the file is cut off" * complete
        raise XmlError(f"row {error.lineno}, column {error.offset}: not XML: {what}; expected {expected}") from error
    except (ValueError, LookupError) as error:  # the file declares an unknown encoding
        raise XmlError(f"not XML: {one_line(str(error))}; expected {expected}") from error
