"""Finds and reads files of runs: the suffix of a file selects its reader in the table `READERS`."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from glob import glob
from pathlib import Path

from pytest_rvads.runs.archive import peek
from pytest_rvads.runs.recorded import read_recorded
from pytest_rvads.runs.recordingfile import FORMAT, load_recording
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.support.entrypoints import entries, load
from pytest_rvads.support.errors import RunError

__all__ = ["READERS", "files_of", "matching", "read_runs"]


def _read_npz(path: str | Path) -> Sequence[Run]:
    return load_recording(path) if _is_recording(Path(path)) else [load_run(path)]


def _is_recording(path: Path) -> bool:
    """Return whether the header of a file states a recording; the readers report damaged files."""
    return f'"format": "{FORMAT}"'.encode() in peek(path, "header")


def _read_by_entry_point(name: str, path: str | Path) -> Sequence[Run]:
    """Read a file with the reader of entry point `name`."""
    runs: Sequence[Run] = load("runs", name)(path)
    return runs


READERS: dict[str, Callable[[str | Path], Sequence[Run]]] = {
    ".json": read_recorded,
    ".npz": _read_npz,
    **{f".{name}": partial(_read_by_entry_point, name) for name in entries("runs")},
}
"""Per suffix, in lower case, a reader, which raises `RunError` for a file that it can't read. Readers of other packages are entry
points ``rvads.runs``, named by the suffix."""


def read_runs(path: str | Path) -> Sequence[Run]:
    """Read the runs of a file.

    A file is a table of recorded runs (``.json``), a run or a recording of this library (``.npz``), or trajectories in
    OpenSCENARIO XML (``.xosc``). A file of `export_run` is judged as the exported run was. Other ``.xosc`` files are recorded
    traffic, at all junctions of the named map that a vehicle passes.

    A run of a recording is built when the run is indexed.

    Raises:
        RunError: the file is of another kind, or damaged.
        MapError: the map of a ``.xosc`` file can't be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        fault = f"expected a file of runs ({', '.join(READERS)}), got one ending in {suffix or 'nothing'!r}"
        raise RunError(f"{path}: {fault}; rvads import makes a recording (.npz) of a log of tracks")
    return READERS[suffix](path)


def files_of(path: Path) -> list[Path]:
    """Return the files of runs in a folder and its subfolders, sorted, without hidden files; a path that is no folder itself."""
    if not path.is_dir():
        return [path]
    run_files: list[Path] = []
    for folder, subfolders, names in os.walk(path):
        subfolders[:] = [name for name in subfolders if not name.startswith(".")]
        files = (Path(folder, name) for name in names if not name.startswith("."))
        run_files += [file for file in files if file.suffix.lower() in READERS and file.is_file()]
    return sorted(run_files)


def matching(pattern: str, folder: Path | None = None) -> list[Path]:
    """Return the files that a pattern matches, sorted by match; a matched folder stands for its files of runs.

    Args:
        pattern: a glob pattern, in which ``**`` matches any number of folders.
        folder: the folder in which the pattern is matched; None for the working directory.
    """
    base = folder or Path()
    matches = sorted(base / name for name in glob(pattern, root_dir=folder, recursive=True))
    return [file for match in matches for file in files_of(match)]
