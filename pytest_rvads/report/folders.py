"""The folders of sessions: numbered below the folder of artefacts, the latest few of them kept.

The main process draws a token and tells it to its workers. The first process with a file to write makes a folder with the token
as its name, which only one process can do, and then moves the folder to the next number. A marker in the folder holds the token,
by which the other processes find the folder. Only folders with a marker count as sessions or are removed.
"""

from __future__ import annotations

import re
import time
from contextlib import suppress
from errno import EEXIST
from pathlib import Path

from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import quoted

__all__ = ["INDEX", "REPORT", "ROOT", "claimed", "option", "run_file", "sessions", "shown", "used"]

ROOT = ".rvads"
"""Default folder of artefacts."""
INDEX, REPORT = "index.html", "report.json"
"""Files that an ended session leaves in its folder: its page, and its report for programs."""
_RUNS, _MARKER, _LATEST = "runs", ".session", "latest"
_OURS = (".html", ".svg", ".json", ".npz", ".part")
"""Suffixes of the files that a session writes to its folder; other files are the user's."""
_HASH = re.compile("[0-9a-f]+")
_ALIVE = 3600.0
"""A session without a report that wrote a file less than this time ago may still be running [s]."""
_ATTEMPTS, _PAUSE = 100, 0.02
"""How often a process checks whether another process has made the session's folder, and the pause between checks [s]."""


def sessions(root: Path) -> list[Path]:
    """Return the folders of the sessions below a folder of artefacts, the oldest first; folders of other origin are left out."""
    numbered = _numbered(root)
    return [numbered[number] for number in sorted(numbered) if _made(numbered[number])]


def claimed(root: Path, token: str, keep: int) -> Path:
    """Return the folder of a session. The first process of the session makes the folder and removes the oldest folders.

    Args:
        root: the folder of artefacts, which version control ignores.
        token: a text that all processes of the session share and no other session has.
        keep: the number of sessions that stay, this session included; sessions that may be running stay as well.

    Raises:
        OSError: the folder can't be made.
    """
    part = root / f".{token}"
    for _ in range(_ATTEMPTS):
        if folder := _of(root, token):
            return folder
        _prepare(root)
        try:
            part.mkdir()  # only one process can
        except FileExistsError:
            time.sleep(_PAUSE)
            continue
        try:
            # If the folder can be made again, another process may have moved it to its place in the meantime.
            if folder := _of(root, token):
                return folder
            numbered = _numbered_anew(root, part, token)
        finally:
            _remove(part)
        _point(root, numbered, token)
        _prune(root, keep)
        return numbered
    raise OSError(EEXIST, "another process of this session began to make a folder there and did not end", str(root))


def option(folder: Path) -> str:
    """Return the option by which ``rvads replay`` takes this session, not a later session.

    Args:
        folder: the folder of the session, as seen from its working directory.
    """
    numbered = folder.parent == Path(ROOT) and folder.name.isdecimal()
    return f"--session {folder.name if numbered else quoted(folder.as_posix())}"


def shown(folder: Path, name: str) -> Path:
    """Return the path of the page of a failure.

    Args:
        folder: the folder of the session.
        name: the name of the item as a file name.
    """
    return folder / f"{name}.html"


def run_file(folder: Path, digest: str) -> Path:
    """Return the path of the file of a run.

    Args:
        folder: the folder of the session.
        digest: the hash of the run.

    Raises:
        RunError: `digest` is no hash, for example in a report that was changed by hand; no path is made from such a text.
    """
    if not _HASH.fullmatch(digest):
        raise RunError(f"the hash of a run consists of the digits 0-9 a-f, got {digest[:80]!r}")
    return folder / _RUNS / f"{digest[:16]}.npz"


def used(folder: Path) -> int:
    """Return the size of the runs of a session on disk [bytes]."""
    with suppress(OSError):
        return sum(path.stat().st_size for path in (folder / _RUNS).iterdir())
    return 0


def _numbered(root: Path) -> dict[int, Path]:
    """Return all files and folders whose name is a number, of any origin."""
    with suppress(OSError):
        return {int(p.name): p for p in root.iterdir() if p.name.isascii() and p.name.isdecimal() and p.name[0] != "0"}
    return {}


def _made(folder: Path) -> bool:
    """Return whether a session made a folder; a link does not count."""
    return not folder.is_symlink() and (folder / _MARKER).is_file()


def _of(root: Path, token: str) -> Path | None:
    """Return the folder of a session, or None."""
    for folder in sessions(root):
        with suppress(OSError, UnicodeDecodeError):
            if (folder / _MARKER).read_text(encoding="utf-8") == token:
                return folder
    return None


def _numbered_anew(root: Path, part: Path, token: str) -> Path:
    """Move a new folder to the next free number, and return its path.

    The folder already contains its marker, because the file system does not replace a folder that is not empty.

    Raises:
        OSError: the folder can't be moved.
    """
    (part / _MARKER).write_text(token, encoding="utf-8")
    while True:
        folder = root / str(max(_numbered(root), default=0) + 1)
        try:
            return part.rename(folder)
        except OSError:
            if not folder.exists():  # else another session has this number
                raise


def _prepare(root: Path) -> None:
    root.mkdir(parents=True, exist_ok=True)
    ignored = root / ".gitignore"
    if not ignored.exists():
        ignored.write_text("*\n", encoding="utf-8")


def _point(root: Path, folder: Path, token: str) -> None:
    """Make the link ``latest`` point to the newest session, if the system has links and the name is not taken by a file."""
    link, part = root / _LATEST, root / f".{token}.link"
    with suppress(OSError, NotImplementedError):
        if link.is_symlink() or not link.exists():
            part.symlink_to(folder.name, target_is_directory=True)
            try:
                part.replace(link)
            finally:
                part.unlink(missing_ok=True)


def _prune(root: Path, keep: int) -> None:
    """Remove the oldest sessions, except sessions that may be running."""
    for folder in sessions(root)[:-keep]:
        if not _running(folder):
            _remove(folder)


def _running(folder: Path) -> bool:
    if (folder / REPORT).exists():
        return False
    with suppress(OSError):
        written = max(path.stat().st_mtime for path in (folder, folder / _RUNS) if path.exists())
        return time.time() - written < _ALIVE
    return False


def _remove(folder: Path) -> None:
    """Remove the files of a session, and its folder unless the folder contains files of the user."""
    runs = folder / _RUNS
    with suppress(OSError):
        for place in (folder,) if runs.is_symlink() else (runs, folder):
            if place.is_dir():
                for path in place.iterdir():
                    if path.suffix in _OURS and (path.is_symlink() or path.is_file()):
                        path.unlink()
    with suppress(OSError):
        runs.rmdir()
    with suppress(OSError):
        (folder / _MARKER).unlink(missing_ok=True)
        folder.rmdir()
