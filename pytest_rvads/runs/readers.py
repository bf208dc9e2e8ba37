"""Files of runs, each read by what its suffix says: a format of logs is one line here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pytest_rvads.errors import RunError
from pytest_rvads.runs.recorded import read_recorded
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run

__all__ = ["READERS", "read_runs"]

READERS: dict[str, Callable[[str | Path], list[Run]]] = {
    ".json": read_recorded,
    ".npz": lambda path: [load_run(path)],
}
"""Per suffix, in small letters: a function that reads a file and raises `RunError` where it can't."""


def read_runs(path: str | Path) -> list[Run]:
    """Read the runs of a file, recorded elsewhere (``.json``) or kept by this library (``.npz``).

    Raises:
        RunError: another kind of file, or a damaged one.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in READERS:
        known = ", ".join(READERS)
        raise RunError(f"{path}: expected a file of runs ({known}), got one ending in {suffix or 'nothing'!r}")
    return READERS[suffix](path)
