"""Processes that work for this one, and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Generic, TypeVar

__all__ = ["AHEAD", "Crew"]

AHEAD = 4
"""Jobs that are handed out per process before the oldest is back: more would pile up behind a slow one."""
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


class Crew(Generic[_Job, _Result]):
    """Processes that work; they end with this one, however it ends, and leave interrupts to it.

    Args:
        begin: called in each of them; returns what does the jobs there.
        processes: how many.
    """

    def __init__(self, begin: Callable[[], Callable[[_Job], _Result]], processes: int) -> None:
        self._begin, self._processes = begin, processes
        self._others = set(multiprocessing.active_children())
        self._pool = self._hire(processes)

    def _hire(self, processes: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(processes, initializer=_enter, initargs=(self._begin,))

    def submit(self, job: _Job) -> Future[_Result]:
        """Hand out a job; where a process died, others are hired first."""
        try:
            return self._pool.submit(_do, job)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = self._hire(self._processes)
            return self._pool.submit(_do, job)

    def alone(self, job: _Job) -> _Result:
        """Return the result of a job in a process of its own, so that nothing but the job can be what kills it.

        Raises:
            BrokenProcessPool: it did.
        """
        with self._hire(1) as pool:
            result: _Result = pool.submit(_do, job).result()
            return result

    def close(self) -> None:
        """End the processes when all is done."""
        self._pool.shutdown()

    def stop(self) -> None:
        """End all processes at once."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()
        self._pool.shutdown(cancel_futures=True)


_doer: list[Callable[[Any], Any]] = []
"""What does the jobs in a process of a crew."""


def _enter(begin: Callable[[], Callable[[Any], Any]]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal interrupts all of us; who hired us tells us when to end
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # that is how we are told
    threading.Thread(target=_watch, daemon=True).start()
    _doer[:] = [begin()]


def _watch() -> None:
    """End with the process that hired this one, even if it was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(job: Any) -> Any:
    return _doer[0](job)
