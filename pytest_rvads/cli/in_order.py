"""Judging files on several processes: results in the order of the files, as they come; a process that dies costs one result."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from pytest_rvads.cli.run_answers import Batch, Judge, Part, Question

__all__ = ["judged"]

_AHEAD = 4
"""Parts that are handed out per process before the oldest is back: more would pile up results behind a slow one."""
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
    crew, flying = _Crew(question, processes), deque[tuple[Part, Future[Batch]]]()
    waiting = iter(files)
    try:
        while True:
            while len(flying) < _AHEAD * processes and (file := next(waiting, None)) is not None:
                part = Part(file, 0, _SIZE)
                flying.append((part, crew.submit(part)))
            if not flying:
                break
            part, future = flying.popleft()
            try:
                batch = future.result()
            except BrokenProcessPool:  # by this part or by any that was handed out with it
                batch = crew.alone(part)
            yield batch
            flying.extendleft([(rest, crew.submit(rest)) for rest in part.rest(batch.total)][::-1])
    except BaseException:
        crew.stop()
        raise
    crew.close()


class _Crew:
    """Processes that judge; they end with this one, however it ends."""

    def __init__(self, question: Question, processes: int) -> None:
        self._question, self._processes = question, processes
        self._others = set(multiprocessing.active_children())
        self._pool = self._hire(processes)

    def _hire(self, processes: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(processes, initializer=_begin, initargs=(self._question,))

    def submit(self, part: Part) -> Future[Batch]:
        try:
            return self._pool.submit(_answer, part)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = self._hire(self._processes)
            return self._pool.submit(_answer, part)

    def alone(self, part: Part) -> Batch:
        """Return what is said of a part by a process of its own, so that nothing but the part can be what kills it."""
        with self._hire(1) as pool:
            try:
                return pool.submit(_answer, part).result()
            except BrokenProcessPool:
                return Batch(part.file, 0, error=f"{part.file}: the process that judged it died, perhaps for lack of memory")

    def close(self) -> None:
        self._pool.shutdown()

    def stop(self) -> None:
        """End all processes at once."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()
        self._pool.shutdown(cancel_futures=True)


_judge: list[Judge] = []
"""That of a process of the crew."""


def _begin(question: Question) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal interrupts all of us; who hired us tells us when to end
    threading.Thread(target=_watch, daemon=True).start()
    _judge[:] = [Judge(question)]


def _watch() -> None:
    """End with the process that hired this one, even if it was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _answer(part: Part) -> Batch:
    return _judge[0].answer(part)
