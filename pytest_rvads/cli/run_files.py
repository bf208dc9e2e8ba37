"""Finds the files that names of files, folders and patterns denote."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from glob import has_magic
from pathlib import Path

from pytest_rvads.runs.readers import READERS
from pytest_rvads.runs.run_paths import files_of, matching

__all__ = ["run_files"]


def run_files(names: Sequence[str], lament: Callable[[str], None]) -> list[str]:
    """Return the files that names denote, each once: in the order of the names, the files of a folder or pattern sorted.

    Args:
        names: names of files; of folders, which are searched for files of runs at any depth; and patterns, which some shells do
            not expand.
        lament: called with a sentence for each folder or pattern without files.
    """
    found: dict[str, str] = {}
    for name in names:
        files = _meant(name)
        if not files:
            kinds = f"expected files of runs ({', '.join(READERS)}) in it"
            lament(f"{name}: the folder is empty, {kinds}" if os.path.isdir(name) else f"{name}: no file matches this pattern")
        for file in files:
            found.setdefault(os.path.abspath(file), file)
    return list(found.values())


def _meant(name: str) -> list[str]:
    if not os.path.isdir(name) and (os.path.lexists(name) or not has_magic(name)):
        return [name]  # the reader reports a file that can't be read
    return list(map(str, files_of(Path(name)) if os.path.isdir(name) else matching(name)))
