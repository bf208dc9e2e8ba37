"""Finding files of runs: those of folders, and those that patterns match."""

from __future__ import annotations

import os
from glob import glob
from pathlib import Path

from pytest_rvads.runs.readers import READERS

__all__ = ["files_of", "matching"]


def files_of(path: Path) -> list[Path]:
    """Return the files of runs in a folder and in those in it, sorted, but for hidden ones; of anything else the path itself."""
    if not path.is_dir():
        return [path]
    found: list[Path] = []
    for place, folders, files in os.walk(path):
        folders[:] = [inner for inner in folders if not inner.startswith(".")]
        inside = (Path(place, file) for file in files if not file.startswith("."))
        found += [file for file in inside if file.suffix.lower() in READERS and file.is_file()]
    return sorted(found)


def matching(pattern: str, folder: Path | None = None) -> list[Path]:
    """Return what a pattern matches in a folder, by default the working directory, sorted; of folders their files of runs."""
    base = folder or Path()
    found = sorted(base / name for name in glob(pattern, root_dir=folder, recursive=True))
    return [file for one in found for file in files_of(one)]
