"""The progress of a long command: a bar with an estimate of the remaining time, or a line per tenth without a terminal.

rich is imported while a town is judged.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pytest_rvads.cli.common import warn
from pytest_rvads.support import executors

__all__ = ["progressing"]


@contextmanager
def progressing(what: str) -> Iterator[executors.Progress]:
    """Yield a function that shows progress on standard error, given the number of finished jobs and of all jobs.

    Args:
        what: the name of the jobs, such as ``runs``.
    """
    if not sys.stderr.isatty():
        yield _Lines(what)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(what, total=None)

        def shown(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield shown


class _Lines:
    def __init__(self, what: str) -> None:
        self._what, self._told = what, -1

    def __call__(self, done: int, total: int) -> None:
        tenth = 10 * done // max(total, 1)
        if tenth > self._told and done:
            self._told = tenth
            warn(f"{done}/{total} {self._what}")
