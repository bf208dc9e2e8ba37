"""Judging files on several processes: results in the order of the files, as they come; a process that dies costs one result."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial

from pytest_rvads.cli.run_answers import Batch, Judge, Part, Question
from pytest_rvads.executors.crew import AHEAD, Crew

__all__ = ["judged"]

_SIZE = 4
"""Runs of a file that a process gets at a time; alone, one: each is told at once."""


def judged(files: Sequence[str], question: Question, processes: int = 1) -> Generator[Batch, None, None]:
    """Yield what is said of the runs of files, in order; close it to end the processes early."""
    if processes > 1:
        yield from _spread(files, question, processes)
        return
    judge = Judge(question)
    for file in files:
        first = Part(file, 0, 1)
        batch = judge.answer(first)
        yield batch
        yield from map(judge.answer, first.rest(batch.total))


def _spread(files: Sequence[str], question: Question, processes: int) -> Generator[Batch, None, None]:
    crew: Crew[Part, Batch] = Crew(partial(_judging, question), processes)
    flying = deque[tuple[Part, Future[Batch]]]()
    waiting = iter(files)
    try:
        while True:
            while len(flying) < AHEAD * processes and (file := next(waiting, None)) is not None:
                part = Part(file, 0, _SIZE)
                flying.append((part, crew.submit(part)))
            if not flying:
                break
            part, future = flying.popleft()
            try:
                batch = future.result()
            except BrokenProcessPool:  # by this part or by any that was handed out with it
                try:
                    batch = crew.alone(part)
                except BrokenProcessPool:
                    batch = _dead(part)
            yield batch
            flying.extendleft([(rest, crew.submit(rest)) for rest in part.rest(batch.total)][::-1])
    except BaseException:
        crew.stop()
        raise
    crew.close()


def _judging(question: Question) -> Callable[[Part], Batch]:
    return Judge(question).answer


def _dead(part: Part) -> Batch:
    return Batch(part.file, 0, error=f"{part.file}: the process that judged it died, perhaps for lack of memory")
