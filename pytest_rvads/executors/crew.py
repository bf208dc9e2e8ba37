"""Worker processes of this process, which end with it."""

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
"""Jobs per process that are submitted before the oldest is done; more jobs would pile up behind a slow job."""
_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


class Crew(Generic[_Job, _Result]):
    """Worker processes, which end with this process however it ends, and which leave interrupts to this process.

    Args:
        begin: called in each worker process; returns the function that does the jobs.
        processes: number of processes.
    """

    def __init__(self, begin: Callable[[], Callable[[_Job], _Result]], processes: int) -> None:
        self._begin, self._processes = begin, processes
        self._others = set(multiprocessing.active_children())
        self._pool = self._hire(processes)

    def _hire(self, processes: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(processes, initializer=_enter, initargs=(self._begin,))

    def submit(self, job: _Job) -> Future[_Result]:
        """Submit a job; if a process died, new processes are started first."""
        try:
            return self._pool.submit(_do, job)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = self._hire(self._processes)
            return self._pool.submit(_do, job)

    def alone(self, job: _Job) -> _Result:
        """Return the result of a job in a separate process, so that only this job can kill the process.

        Raises:
            BrokenProcessPool: the job killed the process.
        """
        with self._hire(1) as pool:
            result: _Result = pool.submit(_do, job).result()
            return result

    def close(self) -> None:
        """End the processes after all jobs are done."""
        self._pool.shutdown()

    def stop(self) -> None:
        """End all processes at once."""
        for process in set(multiprocessing.active_children()) - self._others:
            process.terminate()
        self._pool.shutdown(cancel_futures=True)


_doer: list[Callable[[Any], Any]] = []
"""The function that does the jobs, in a worker process."""


def _enter(begin: Callable[[], Callable[[Any], Any]]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal interrupts all processes; the parent decides when workers end
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the parent ends a worker by this signal
    threading.Thread(target=_watch, daemon=True).start()
    _doer[:] = [begin()]


def _watch() -> None:
    """End this worker when its parent process ends, even if the parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(job: Any) -> Any:
    return _doer[0](job)
