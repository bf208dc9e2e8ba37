"""Failures for other tools: the runs of a session that failed, as OpenSCENARIO XML."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.entrypoints import load
from pytest_rvads.errors import RvadsError
from pytest_rvads.storage import open_file, slug
from pytest_rvads.wording import one_line

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.runs.run import Run

__all__ = ["check_library", "export"]

_MOST = 100
"""A session that breaks everywhere needs no more files than this from one process."""
_HEAD = 2**16
"""The hash of its run stands in the head of a file [bytes]."""
_WRITTEN = pytest.StashKey[int]()


def check_library() -> None:
    """Check that files can be written at all.

    Raises:
        RvadsError: the library is missing; the message says how to install it.
    """
    load("exports", "xosc").library()


def export(item: pytest.Item, folder: Path, name: str, run: Run, verdict: Verdict, map: str | None) -> str:
    """Write the run of a failed item, unless one of the same run has done so, and return where, or why not.

    Args:
        item: whose it is.
        folder: where to write.
        name: of the run, which becomes that of the file.
        run: what happened.
        verdict: what went wrong.
        map: of the session, where the run does not say which map it is from.
    """
    path, here = folder / f"{slug(name)}.xosc", item.config.invocation_params.dir
    told = path.relative_to(here) if path.is_relative_to(here) else path
    if _holds(path, run):
        return told.as_posix()
    written = item.config.stash.get(_WRITTEN, 0)
    if written >= _MOST:
        return f"not written: {_MOST} failures of this process are written already"
    try:
        load("exports", "xosc").export_run(run, path, map=map, verdict=verdict)
    except (RvadsError, OSError) as error:  # a file for others never costs a verdict
        return f"not written: {one_line(str(error))}"
    item.config.stash[_WRITTEN] = written + 1
    return told.as_posix()


def _holds(path: Path, run: Run) -> bool:
    """Return whether a file is the export of this run; what an earlier session left of another one is not."""
    try:
        with open_file(path) as file:
            return run.hash.encode() in file.read(_HEAD)
    except OSError:
        return False
