"""Runs jobs on any `concurrent.futures.Executor`. A job travels with its inputs, so that every process gives the same result.

A worker process can die because of a job, or for another reason. So the jobs of a dead process run again. A job whose process
died twice runs alone in a new process. Only a job that kills this process as well is lost.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from concurrent.futures import CancelledError, Executor, Future
from contextlib import closing
from itertools import islice
from operator import call
from queue import SimpleQueue
from typing import Any, TypeVar

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors.teams import Failed, Foreign, Own, Part, Team, tried

Progress = Callable[[int, int], None]
"""Called with the number of jobs done and the number of all."""
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


class Apart(int):
    """A number of processes for a command: even a single one is not the command's own, which a driver could end or hold up."""


def apart(work: Callable[[], _Result]) -> _Result:
    """Return the result of a function that runs in a process of its own."""
    (result,) = spread(call, [work], Apart(1))
    return result


def spread(
    work: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    executor: Executor | int | None = None,
    progress: Progress | None = None,
    batch: int = 4,
) -> Generator[_Result, None, None]:
    """Yield the results in the order of the jobs; an exception of a job is raised in its place. Closing ends the work."""
    results: dict[int, _Result | Failed] = {}
    due = 0
    with closing(gathered(work, jobs, executor, batch)) as answers:
        for done, (number, answer) in enumerate(answers, start=1):
            if progress is not None:
                progress(done, len(jobs))
            results[number] = answer
            while due in results:
                result = results.pop(due)
                if isinstance(result, Failed):
                    raise result.error
                due += 1
                yield result


def gathered(
    work: Callable[[_Job], _Result], jobs: Iterable[_Job], executor: Executor | int | None = None, batch: int = 4
) -> Generator[tuple[int, _Result | Failed], None, None]:
    """Yield the number and the result of every job in the order of completion; closing the generator ends the work.

    A job is taken from `jobs` when a worker is free, and is not kept in memory after its result was yielded.
    """
    kept_apart = isinstance(executor, Apart)
    if not isinstance(executor, Executor):
        if executor is not None and (isinstance(executor, bool) or not isinstance(executor, int) or executor < 1):
            raise RvadsError(
                f"executor= takes a number of processes from 1 on, or a concurrent.futures.Executor, got {executor!r:.60}"
            )
        executor = executor or os.cpu_count() or 1
        executor = max(1, min(executor, len(jobs))) if isinstance(jobs, Sized) else executor
    if executor == 1 and not kept_apart:
        for number, job in enumerate(jobs):
            yield number, tried(work, job)
        return
    team: Team = Foreign(work, executor) if isinstance(executor, Executor) else Own(work, executor)
    try:
        # With one process, an interruption costs one job, as in the calling process.
        for part, answers in _completed(team, _Parts(jobs, 1 if executor == 1 else batch)):
            yield from enumerate(answers, start=part.begin)
    except BaseException:
        team.stop()
        raise
    team.close()


class _Parts(Iterator[Part]):
    """An iterator that groups jobs into parts; unlike a generator, it continues if an exhausted `jobs` yields further jobs."""

    def __init__(self, jobs: Iterable[Any], size: int) -> None:
        self._begin, self._jobs, self._size = 0, iter(jobs), size

    def __next__(self) -> Part:
        part_jobs = tuple(islice(self._jobs, self._size))
        if not part_jobs:
            raise StopIteration
        self._begin += len(part_jobs)
        return Part(self._begin - len(part_jobs), part_jobs)


def _completed(team: Team, parts: Iterator[Part]) -> Iterator[tuple[Part, list[Any]]]:
    """Yield parts (groups of jobs) with their answers in the order of completion; parts of dead processes are submitted again."""
    flying: dict[Future[list[Any]], Part] = {}
    done: SimpleQueue[Future[list[Any]]] = SimpleQueue()

    def launch(part: Part) -> None:
        future = team.submit(part)
        flying[future] = part
        future.add_done_callback(done.put)

    try:
        while True:
            while len(flying) < team.ahead and (part := next(parts, None)) is not None:
                launch(part)
            if not flying:
                return
            future = done.get()
            part = flying.pop(future)
            try:
                answers = future.result()
            except (Exception, CancelledError) as error:
                part = part._replace(losses=part.losses + 1)
                if team.submits_again(part, error):
                    launch(part)
                    continue
                answers = list(map(team.alone, part.jobs))
            yield part, answers
    finally:
        if isinstance(team, Foreign):  # our own pool ends its jobs itself, and may fail at a cancelled one
            for future in flying:
                future.cancel()
