"""Which files somebody means by names of files, folders and patterns."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from glob import glob, has_magic
from pathlib import Path

from pytest_rvads.runs.readers import READERS

__all__ = ["run_files"]


def run_files(names: Sequence[str], lament: Callable[[str], None]) -> list[str]:
    """Return the files that are meant, each once: in the order of the names, those of a folder or pattern sorted.

    Args:
        names: of files; of folders, which are searched for files of runs at any depth; patterns, which not every shell expands.
        lament: called with a sentence for each folder or pattern behind which there is nothing.
    """
    found: dict[str, str] = {}
    for name in names:
        files = list(_meant(name))
        if not files:
            kinds = f"expected files of runs ({', '.join(READERS)}) in it"
            lament(f"{name}: the folder is empty, {kinds}" if os.path.isdir(name) else f"{name}: no file matches this pattern")
        for file in files:
            found.setdefault(os.path.abspath(file), file)
    return list(found.values())


def _meant(name: str) -> Iterator[str]:
    if os.path.isdir(name):
        yield from _inside(name)
    elif os.path.lexists(name) or not has_magic(name):
        yield name  # what can't be read is told by who reads it
    else:
        for match in sorted(glob(name, recursive=True)):
            if os.path.isdir(match):
                yield from _inside(match)
            else:
                yield match


def _inside(folder: str) -> Iterator[str]:
    """Yield the files of runs in a folder and those in it, but for hidden ones."""
    for place, folders, files in os.walk(folder):
        folders[:] = sorted(inner for inner in folders if not inner.startswith("."))
        for file in sorted(files):
            if Path(file).suffix.lower() in READERS and not file.startswith("."):
                yield os.path.join(place, file)
