"""The folders in which sessions write their files: numbered below the folder of artefacts; the latest few folders are kept.

The main process draws a random text (token) and sends the token to its workers. The first process with a file to write makes a
folder with the token as its name, which only one process can do, and then renames the folder to the next free number. A marker
file in the folder holds the token, by which the other processes find the folder. Only a folder with a marker file counts as the
folder of a session, and only such folders are removed.
"""

from __future__ import annotations

import re
import time
from contextlib import suppress
from errno import EEXIST
from pathlib import Path

from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import write_file
from pytest_rvads.support.wording import quoted

ROOT = ".rvads"
"""Default folder of artefacts."""
INDEX, REPORT = "index.html", "report.json"
"""Files that an ended session leaves in its folder: its page, and its report for programs."""
STARTS = "critical.html"
"""Page of `rvads critical --all-lines` in the folder of artefacts, to which the pages of sessions link."""
_RUNS, _MARKER, _LATEST = "runs", ".session", "latest"
_OURS = (".html", ".svg", ".json", ".npz", ".part")
"""Suffixes of the files that a session writes to its folder; files with other suffixes belong to the user."""
_HASH = re.compile("[0-9a-f]+")
_ALIVE = 3600.0
"""A session that has written no report counts as running until this time after its last written file [s]."""
KEPT = 5
"""Number of sessions whose folders stay."""
_ATTEMPTS, _PAUSE = 100, 0.02
"""How often a process checks whether another process has made the session's folder, and the pause between checks [s]."""


def sessions(root: Path) -> list[Path]:
    """Return the folders of the sessions below a folder of artefacts, the oldest first; folders of other origin are left out."""
    numbered = [folder for _, folder in sorted(_numbered_folders(root).items())]
    return [folder for folder in numbered if not folder.is_symlink() and (folder / _MARKER).is_file()]


def claimed(root: Path, token: str, keep: int = KEPT) -> Path:
    """Return the folder of a session. The first process of the session makes the folder and removes the oldest folders."""
    part = root / f".{token}"
    for _ in range(_ATTEMPTS):
        if folder := _session_folder(root, token):
            return folder
        root.mkdir(parents=True, exist_ok=True)
        ignored = root / ".gitignore"
        if not ignored.exists():
            write_file(ignored, b"*\n")
        try:
            part.mkdir()  # only one process of the session succeeds
        except FileExistsError:
            time.sleep(_PAUSE)
            continue
        try:
            # Another process may have made this folder before and renamed the folder to its number.
            if folder := _session_folder(root, token):
                return folder
            # The marker file is written before the move: the file system does not replace a folder that is not empty, so no
            # session takes the number of another session.
            (part / _MARKER).write_text(token, encoding="utf-8")
            while True:
                numbered = root / str(max(_numbered_folders(root), default=0) + 1)
                try:
                    part.rename(numbered)
                    break
                except OSError:
                    if not numbered.exists():  # an existing folder means that another session has taken this number
                        raise
        finally:
            _remove(part)
        _point(root, numbered, token)
        for folder in sessions(root)[:-keep]:
            with suppress(OSError):
                written = max(path.stat().st_mtime for path in (folder, folder / _RUNS) if path.exists())
                if not (folder / REPORT).exists() and time.time() - written < _ALIVE:
                    continue
            _remove(folder)
        return numbered
    raise OSError(EEXIST, "another process of this session began to make a folder there and did not end", str(root))


def option(folder: Path) -> str:
    """Return the option by which ``rvads replay`` reads a certain session in place of the latest session."""
    numbered = folder.parent == Path(ROOT) and folder.name.isdecimal()
    return f"--session {folder.name if numbered else quoted(folder.as_posix())}"


def run_file(folder: Path, digest: str) -> Path:
    """Return the path of the file of a run."""
    if not _HASH.fullmatch(digest):
        raise RunError(f"the hash of a run consists of the digits 0-9 a-f, got {digest[:80]!r}")
    return folder / _RUNS / f"{digest[:16]}.npz"


def used(folder: Path) -> int:
    """Return the disk space that the files of a session's runs take [bytes]."""
    with suppress(OSError):
        return sum(path.stat().st_size for path in (folder / _RUNS).iterdir())
    return 0


def _numbered_folders(root: Path) -> dict[int, Path]:
    """Return, by number, the files and folders in `root` whose name is a number, whether a session made them or not."""
    with suppress(OSError):
        return {int(p.name): p for p in root.iterdir() if p.name.isascii() and p.name.isdecimal() and p.name[0] != "0"}
    return {}


def _session_folder(root: Path, token: str) -> Path | None:
    for folder in sessions(root):
        with suppress(OSError, UnicodeDecodeError):
            if (folder / _MARKER).read_text(encoding="utf-8") == token:
                return folder
    return None


def _point(root: Path, folder: Path, token: str) -> None:
    """Make the link ``latest`` point to the newest session, if the system has links and no file of the user has this name."""
    link, part = root / _LATEST, root / f".{token}.link"
    with suppress(OSError, NotImplementedError):
        if link.is_symlink() or not link.exists():
            part.symlink_to(folder.name, target_is_directory=True)
            try:
                part.replace(link)
            finally:
                part.unlink(missing_ok=True)


def _remove(folder: Path) -> None:
    """Remove the files that a session wrote, and its folder unless the folder contains files of the user."""
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
