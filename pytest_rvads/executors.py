"""Work on any `concurrent.futures.Executor`: what a job depends on travels with it, so that any process gives the same result."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

__all__ = ["Progress", "spread"]

Progress = Callable[[int, int], None]
"""Called with the number of jobs done and the number of all."""
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def spread(
    work: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    workers: int | None = None,
    progress: Progress | None = None,
    batch: int = 4,
) -> Iterator[_Result]:
    """Yield the result of every job, in order.

    Args:
        work: a function of a module, so that other processes find it.
        jobs: plain values.
        workers: processes; as many as there are processors by default.
        progress: called after every job.
        batch: jobs that a process gets at a time.
    """
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    if workers <= 1:
        yield from _counted(map(work, jobs), len(jobs), progress)
        return
    with ProcessPoolExecutor(workers) as pool:
        yield from _counted(pool.map(work, jobs, chunksize=batch), len(jobs), progress)


def _counted(results: Iterator[_Result], total: int, progress: Progress | None) -> Iterator[_Result]:
    for done, result in enumerate(results, start=1):
        if progress is not None:
            progress(done, total)
        yield result
