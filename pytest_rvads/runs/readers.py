"""Reads files of runs. The suffix of a file decides on its reader; a format of logs is one line of the table below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from pytest_rvads.entrypoints import entries, load
from pytest_rvads.errors import RunError
from pytest_rvads.runs.archive import peek
from pytest_rvads.runs.recorded import read_recorded
from pytest_rvads.runs.recordingfile import FORMAT, load_recording
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run

__all__ = ["READERS", "read_runs"]


def _kept(path: str | Path) -> Sequence[Run]:
    return load_recording(path) if _is_recording(Path(path)) else [load_run(path)]


def _is_recording(path: Path) -> bool:
    """Return whether a header says that a file is a recording; what is damaged is for the readers to tell."""
    return f'"format": "{FORMAT}"'.encode() in peek(path, "header")


def _added(name: str, path: str | Path) -> Sequence[Run]:
    """Read a file by the entry point of that name."""
    runs: Sequence[Run] = load("runs", name)(path)
    return runs


READERS: dict[str, Callable[[str | Path], Sequence[Run]]] = {
    ".json": read_recorded,
    ".npz": _kept,
    **{f".{name}": partial(_added, name) for name in entries("runs")},
}
"""Per suffix, in small letters: a function that reads a file and raises `RunError` where it can't; those of other packages are
entry points ``rvads.runs``, named by the suffix."""


def read_runs(path: str | Path) -> Sequence[Run]:
    """Read the runs of a file.

    Such are recorded elsewhere (``.json``), kept by this library (``.npz``: a run, or a recording), or trajectories in
    OpenSCENARIO XML (``.xosc``): what `export_run` wrote is judged as the run was; files of others are recorded traffic, at all
    junctions that somebody passes of the map that the file names.

    The runs of a recording are made one by one, when they are asked for.

    Raises:
        RunError: another kind of file, or a damaged one.
        MapError: the map of a ``.xosc`` can't be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        known = ", ".join(READERS)
        got = f"expected a file of runs ({known}), got one ending in {suffix or 'nothing'!r}"
        raise RunError(f"{path}: {got}; rvads import makes a recording (.npz) of a log of tracks")
    return READERS[suffix](path)
