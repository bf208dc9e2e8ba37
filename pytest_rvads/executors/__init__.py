"""Runs jobs on any `concurrent.futures.Executor`. A job travels with its inputs, so that every process gives the same result.

A worker process may die because of a job, or for another reason. So the jobs of a dead process run again. A job whose process
died twice runs alone in a process: only a job that kills this process is lost.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from concurrent.futures import CancelledError, Executor, Future
from contextlib import closing
from itertools import count, islice
from queue import SimpleQueue
from typing import Any, TypeVar

from pytest_rvads.errors import RvadsError
from pytest_rvads.executors.teams import ExecutorGone, Failed, Foreign, Own, Part, Team, tried

__all__ = ["ExecutorGone", "Failed", "Progress", "gathered", "spread"]

Progress = Callable[[int, int], None]
"""Called with the number of jobs done and the number of all."""
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


def spread(
    work: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    executor: Executor | int | None = None,
    progress: Progress | None = None,
    batch: int = 4,
) -> Generator[_Result, None, None]:
    """Yield the result of every job, in order; an exception of a job is raised in its place. Closing the generator ends the work.

    Args:
        work: the function that runs a job; a function of a module, because other processes import the function by name.
        jobs: the jobs, as values that can be pickled.
        executor: number of processes, by default the number of processors; 1 is this process. Or any executor.
        progress: called after every job.
        batch: number of jobs that a process gets at a time.

    Raises:
        RvadsError: a job can't be pickled, a job killed its process, or the executor was shut down.
    """
    known: dict[int, _Result | Failed] = {}
    due = 0
    with closing(gathered(work, jobs, executor, batch)) as answers:
        for done, (number, answer) in enumerate(answers, start=1):
            if progress is not None:
                progress(done, len(jobs))
            known[number] = answer
            while due in known:
                result = known.pop(due)
                if isinstance(result, Failed):
                    raise result.error
                due += 1
                yield result


def gathered(
    work: Callable[[_Job], _Result], jobs: Iterable[_Job], executor: Executor | int | None = None, batch: int = 4
) -> Generator[tuple[int, _Result | Failed], None, None]:
    """Yield the number of every job and its result, as they come; close it to end early.

    Jobs are asked for when there is somebody to do them, and nothing is kept of those that are done.

    Args:
        work: as for `spread`.
        jobs: plain values, any number of them. An iterator that has ended is asked again after every result, so a result may
            lead to further jobs.
        executor: as for `spread`.
        batch: jobs that a process gets at a time.

    Raises:
        RvadsError: a job can't travel, or the executor is gone.
    """
    if not isinstance(executor, Executor):
        executor = _processes(executor, jobs)
    if executor == 1:
        for number, job in enumerate(jobs):
            yield number, tried(work, job)
        return
    team: Team = Foreign(work, executor) if isinstance(executor, Executor) else Own(work, executor)
    try:
        for part, answers in _flown(team, _Parts(jobs, batch)):
            yield from enumerate(answers, start=part.begin)
    except BaseException:
        team.stop()
        raise
    team.close()


class _Parts(Iterator[Part]):
    """Jobs in parts of some size; unlike a generator it goes on when there are jobs again."""

    def __init__(self, jobs: Iterable[Any], size: int) -> None:
        self._begin, self._rest, self._size = 0, iter(jobs), size

    def __next__(self) -> Part:
        taken = tuple(islice(self._rest, self._size))
        if not taken:
            raise StopIteration
        self._begin += len(taken)
        return Part(self._begin - len(taken), taken)


def _flown(team: Team, parts: Iterator[Part]) -> Iterator[tuple[Part, list[Any]]]:
    """Yield parts with their answers in the order of completion; the parts of dead processes are submitted again."""
    flying: dict[Future[Any], Part] = {}
    back: SimpleQueue[Future[Any]] = SimpleQueue()
    sent = count(1)

    def launch(part: Part) -> None:
        part = part._replace(sent=next(sent))
        future = team.submit(part)
        if flying.setdefault(future, part) is not part:
            raise RvadsError("submit of the executor returned one future for two calls, expected one for each")
        future.add_done_callback(back.put)

    try:
        while True:
            while len(flying) < team.ahead and (part := next(parts, None)) is not None:
                launch(part)
            if not flying:
                return
            future = back.get()
            part = flying.pop(future)
            try:
                answers = team.answers(part, future)
            except (Exception, CancelledError) as error:
                part = part._replace(losses=part.losses + 1)
                if team.again(part, error):
                    launch(part)
                    continue
                answers = list(map(team.alone, part.jobs))
            yield part, answers
    finally:
        for future in flying:
            future.cancel()


def _processes(wanted: int | None, jobs: object) -> int:
    if wanted is not None and (type(wanted) is not int or wanted < 1):
        raise RvadsError(f"executor= takes a number of processes from 1 on, or a concurrent.futures.Executor, got {wanted!r:.60}")
    found = wanted or os.cpu_count() or 1
    return max(1, min(found, len(jobs))) if isinstance(jobs, Sized) else found
