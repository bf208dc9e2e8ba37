"""The folders of sessions: numbered below one folder of artefacts, the last few of them kept."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from errno import EEXIST
from pathlib import Path

from pytest_rvads.errors import RunError
from pytest_rvads.wording import quoted

__all__ = ["INDEX", "REPORT", "ROOT", "claimed", "option", "run_file", "sessions", "shown", "used"]

ROOT = ".rvads"
"""Where sessions leave what they leave unless they are told otherwise."""
INDEX, REPORT = "index.html", "report.json"
"""What a session leaves in its folder when it has ended: its page, and its report for programs."""
_RUNS, _MARKER, _LATEST = "runs", ".session", "latest"
_OURS = (".html", ".svg", ".json", ".npz", ".part")
"""Endings of what lies in the folder of a session; anything else is the user's."""
_HASH = re.compile("[0-9a-f]+")
_ALIVE = 3600.0
"""A session without a report that wrote something so lately may still be running [s]."""
_ATTEMPTS, _PAUSE = 100, 0.02
"""How often a process looks whether another one has made the folder of their session, and how long it waits in between [s]."""


def sessions(root: Path) -> list[Path]:
    """Return the folders of the sessions below a folder of artefacts, the oldest first; what we did not make is none."""
    found = _numbered(root)
    return [found[number] for number in sorted(found) if _made(found[number])]


def claimed(root: Path, token: str, keep: int) -> Path:
    """Return the folder of a session, and make it if no other of its processes has; then older ones are removed.

    Args:
        root: folder of artefacts, which version control ignores.
        token: what all processes of the session share and no other session has.
        keep: how many sessions stay, this one included; those that may be running stay, too.

    Raises:
        OSError: it can't be made.
    """
    part = root / f".{token}"
    for _ in range(_ATTEMPTS):
        if found := _of(root, token):
            return found
        _prepare(root)
        try:
            part.mkdir()  # one process alone can
        except FileExistsError:
            time.sleep(_PAUSE)
            continue
        try:
            # Where it can be made again, another process has moved it to its place since we looked.
            if found := _of(root, token):
                return found
            made = _numbered_anew(root, part, token)
        finally:
            _remove(part)
        _point(root, made, token)
        _prune(root, keep)
        return made
    raise OSError(EEXIST, "another process of this session began to make a folder there and did not end", str(root))


def option(folder: Path) -> str:
    """Return the option by which ``rvads replay`` takes a session, and no later one.

    Args:
        folder: of the session, from where it was started.
    """
    numbered = folder.parent == Path(ROOT) and folder.name.isdecimal()
    return f"--session {folder.name if numbered else quoted(folder.as_posix())}"


def shown(folder: Path, name: str) -> Path:
    """Return the page of a failure.

    Args:
        folder: of the session.
        name: of the item as a file.
    """
    return folder / f"{name}.html"


def run_file(folder: Path, digest: str) -> Path:
    """Return the file of a run.

    Args:
        folder: of the session.
        digest: hash of the run.

    Raises:
        RunError: it is no hash, as in a report that somebody has changed; no path is made of it.
    """
    if not _HASH.fullmatch(digest):
        raise RunError(f"the hash of a run consists of the digits 0-9 a-f, got {digest[:80]!r}")
    return folder / _RUNS / f"{digest[:16]}.npz"


def used(folder: Path) -> int:
    """Return how much the runs of a session take on disk [bytes]."""
    with suppress(OSError):
        return sum(path.stat().st_size for path in (folder / _RUNS).iterdir())
    return 0


def _numbered(root: Path) -> dict[int, Path]:
    """Return what is called by a number, whoever made it."""
    with suppress(OSError):
        return {int(p.name): p for p in root.iterdir() if p.name.isascii() and p.name.isdecimal() and p.name[0] != "0"}
    return {}


def _made(folder: Path) -> bool:
    """Return whether we made a folder; what a link leads to is none of ours."""
    return not folder.is_symlink() and (folder / _MARKER).is_file()


def _of(root: Path, token: str) -> Path | None:
    """Return the folder of a session, where it has one."""
    for folder in sessions(root):
        with suppress(OSError, UnicodeDecodeError):
            if (folder / _MARKER).read_text(encoding="utf-8") == token:
                return folder
    return None


def _numbered_anew(root: Path, part: Path, token: str) -> Path:
    """Return a folder that has been moved to a number of its own.

    It has its marker by then: a folder that holds something is replaced by no other one.

    Raises:
        OSError: it can't be moved there.
    """
    (part / _MARKER).write_text(token, encoding="utf-8")
    while True:
        mine = root / str(max(_numbered(root), default=0) + 1)
        try:
            return part.rename(mine)
        except OSError:
            if not mine.exists():  # else another session has that number
                raise


def _prepare(root: Path) -> None:
    root.mkdir(parents=True, exist_ok=True)
    ignored = root / ".gitignore"
    if not ignored.exists():
        ignored.write_text("*\n", encoding="utf-8")


def _point(root: Path, folder: Path, token: str) -> None:
    """Have a link lead to the latest session, where the system has links and the name is free."""
    link, part = root / _LATEST, root / f".{token}.link"
    with suppress(OSError, NotImplementedError):
        if link.is_symlink() or not link.exists():
            part.symlink_to(folder.name, target_is_directory=True)
            try:
                part.replace(link)
            finally:
                part.unlink(missing_ok=True)


def _prune(root: Path, keep: int) -> None:
    """Remove the oldest sessions, but for those that may be running."""
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
    """Remove what a session has left; where somebody has put files of his own into its folder, they stay, and so does that."""
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
