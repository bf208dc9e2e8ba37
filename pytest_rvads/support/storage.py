"""Files: only regular files of bounded size are read, and files are written atomically."""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

__all__ = ["open_file", "read_file", "slug", "write_file"]

_LONGEST = 190
"""Longest name of a file without its ending [bytes]; file systems take 255."""
_PLAIN = re.compile(r"(?:\w+/)*\w+\.py(?:::\w+)*(?:\[[\w.-]*[\w.]\])?", re.ASCII)
"""Ids of items that stay distinct when brackets and slashes become hyphens."""


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading; a pipe or device, which may never end, is refused without waiting.

    Raises:
        OSError: the file can't be read or is not regular; ``strerror`` states the reason.
    """
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
    """Return the content of a regular file.

    Args:
        path: path of the file, see `open_file`.
        most: greatest accepted size [bytes].

    Raises:
        OSError: the file can't be read, is not regular, or is too large; ``strerror`` states the reason.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read() if size <= most else b""
    if max(size, len(content)) > most:
        raise OSError(errno.EFBIG, f"it is too large, expected at most {most:,} bytes", str(path))
    return content


def write_file(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write a file atomically: a reader sees the old content or the whole new content, even if the writer is killed.

    Several processes may write the same file: each process writes a temporary file and renames it. A path of another kind,
    such as ``/dev/stdout``, is written to directly. Missing folders are made.

    Args:
        path: path of the file.
        content: content of the file; an iterable of pieces for content that does not fit into memory.

    Raises:
        OSError: the file can't be written; an earlier file is kept.
    """
    path = Path(os.path.realpath(path))
    pieces = [content] if isinstance(content, bytes) else content
    if path.exists() and not path.is_file():
        number = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))  # a pipe that nobody reads is refused
        os.set_blocking(number, True)
        with open(number, "wb") as file:
            file.writelines(pieces)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    # The temporary name does not contain the name of the file, which may have the greatest length.
    part = path.with_name(f".{uuid4().hex}.part")
    try:
        with part.open("wb") as file:
            file.writelines(pieces)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def slug(text: str) -> str:
    """Return a file name without ending for the id of an item or another text; different texts get different names."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", text.replace(".py::", ".")).strip("-")
    if _PLAIN.fullmatch(text) and len(name) <= _LONGEST:
        return name
    digest = sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:12]
    return f"{name[: _LONGEST - 13]}-{digest}"
