"""The two kinds of workers that do jobs: processes that the package starts, or the executor of a user."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import lru_cache
from itertools import count
from typing import Any, NamedTuple, TypeAlias

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.tracebacks import located
from pytest_rvads.support.wording import one_line

AHEAD = 4
"""Parts (groups of jobs) per worker that are submitted before the oldest part is done; more would wait for a slow job."""
_UNKNOWN = 512
"""Number of parts that are submitted and not done at the same time, if an executor does not state its number of workers."""
DIED = "died, perhaps for lack of memory, or because its driver hung or ended it"
"""What is told of a process that gave no answer."""


class ExecutorGone(RvadsError):
    """The executor takes no more work; the results so far are not lost."""


class Failed(NamedTuple):
    """The failure of a job, in place of its result."""

    error: Exception
    """The exception of the job, or an `RvadsError` if its process died."""
    lost: bool = False
    """Whether the process of the job died."""


class Part(NamedTuple):
    """Jobs that are sent to a worker together."""

    begin: int
    """Number of the first job."""
    jobs: tuple[Any, ...]
    losses: int = 0
    """How often the part was lost, for example because it was in flight when a process died."""


class Own:
    """Workers that are processes of this computer; they ignore Ctrl-C, and end when this process ends, even if it is killed."""

    def __init__(self, work: Callable[[Any], Any], processes: int) -> None:
        self.ahead = AHEAD * processes
        self._tries = min(processes, 2)
        """How often a part is lost before its jobs run alone; other processes can't have harmed the part of a single one."""
        self._work, self._processes = _packed(work), processes
        self._foreign_children = set(multiprocessing.active_children())
        self._pool = _hired(processes)

    def submit(self, part: Part) -> Future[list[Any]]:
        """Submit a part; if a process died, new processes are started first."""
        jobs = _packed(part.jobs)
        try:
            return self._pool.submit(_unpacked_answers, self._work, jobs)
        except BrokenProcessPool:
            self._pool.shutdown()
            self._pool = _hired(self._processes)
            return self._pool.submit(_unpacked_answers, self._work, jobs)

    def submits_again(self, part: Part, error: BaseException) -> bool:
        """Return whether a part lost by `error` is submitted again; if not, each of its jobs is done alone in a process."""
        if not isinstance(error, BrokenProcessPool):
            raise RvadsError(f"a job or its result can't be sent between processes: {_text_of(error)}") from error
        return part.losses < self._tries

    def alone(self, job: Any) -> Any:
        """Return the answer to a job that may kill its process; the job has a separate process."""
        pool = _hired(1)
        try:
            return pool.submit(_unpacked_answers, self._work, _packed((job,))).result()[0]
        except BrokenProcessPool:
            return _dead()
        except KeyboardInterrupt:
            self.stop()
            raise
        finally:
            pool.shutdown()

    def close(self) -> None:
        """End the processes after all jobs are done."""
        self._pool.shutdown()

    def stop(self) -> None:
        """End all processes at once."""
        for process in set(multiprocessing.active_children()) - self._foreign_children:
            process.terminate()
        self._pool.shutdown(cancel_futures=True)


class Foreign:
    """Workers in the executor of a user; the user shuts the executor down."""

    def __init__(self, work: Callable[[Any], Any], executor: Executor) -> None:
        workers = getattr(executor, "_max_workers", None)  # set by executors of the standard library
        self.ahead = AHEAD * workers if isinstance(workers, int) else _UNKNOWN
        self._work, self._executor, self._name = work, executor, f"the executor {type(executor).__name__}"
        self._numbers = count()
        """Numbers of the submissions; Dask would return the result of an earlier submission with equal arguments."""

    def submit(self, part: Part) -> Future[list[Any]]:
        """Submit a part."""
        try:
            return self._executor.submit(_answers, self._work, part.jobs, next(self._numbers))
        except Exception as error:  # each executor has its own exceptions
            raise self._gone(error) from error

    def submits_again(self, _: Part, error: BaseException) -> bool:
        """Return False, as each job of a part that killed several workers of Dask is submitted alone."""
        if type(error).__name__ == "KilledWorker":  # Dask's, after several workers died; Dask may be missing
            return False
        if isinstance(error, CancelledError | BrokenExecutor):
            raise self._gone(error) from error
        cause = error.__cause__ if isinstance(error.__cause__, ImportError) else error
        raise RvadsError(
            f"{self._name} can't work on this, perhaps because a job can't be pickled or the worker lacks a module: "
            f"{_text_of(cause)}"
        ) from error

    def alone(self, job: Any) -> Any:
        """Return the answer to a job that may kill its process."""
        part = Part(0, (job,))
        future = self.submit(part)
        try:
            return future.result()[0]
        except (Exception, CancelledError) as error:
            self.submits_again(part, error)
            return _dead()

    def close(self) -> None:
        """Leave the executor running, because its owner shuts it down."""

    stop = close

    def _gone(self, error: BaseException) -> ExecutorGone:
        return ExecutorGone(f"{self._name} takes no more work, its workers or scheduler are gone: {_text_of(error)}")


Team: TypeAlias = Own | Foreign
"""Either kind of workers; the attribute `ahead` of both is the largest number of parts that are submitted and not done."""


def _hired(processes: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(processes, initializer=_enter)


def _enter() -> None:
    for name in ("SIGINT", "SIGHUP"):  # the terminal interrupts all processes; the parent decides when workers end
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the parent ends a worker by this signal
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    """End this worker when its parent process ends, even if the parent was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _unpacked_answers(work: bytes, jobs: bytes) -> list[Any]:
    try:
        function, unpacked = _unpacked(work), pickle.loads(jobs)
    except SystemExit as error:  # a module of a user that is imported here
        raise RvadsError(located(error)) from None
    return _answers(function, unpacked)


@lru_cache(maxsize=1)
def _unpacked(work: bytes) -> Callable[[Any], Any]:
    """Return the function that does the jobs, which is equal for all jobs of a worker."""
    function: Callable[[Any], Any] = pickle.loads(work)
    return function


def _answers(work: Callable[[Any], Any], jobs: Sequence[Any], _number: int = 0) -> list[Any]:
    """Return an answer per job, for another process; an exception that can't be unpickled there is replaced by its text."""
    answers = []
    for job in jobs:
        answer = tried(work, job)
        if isinstance(answer, Failed):
            try:
                pickle.loads(pickle.dumps(answer))
            except Exception:
                answer = Failed(RvadsError(_text_of(answer.error)))
        answers.append(answer)
    return answers


def tried(work: Callable[[Any], Any], job: Any) -> Any:
    """Return the result of a job, or its failure."""
    try:
        return work(job)
    except Exception as error:
        return Failed(error)
    except SystemExit as error:  # code of a user; it ends the job, not the process
        return Failed(RvadsError(f"code that a job called raised {located(error)}"))


def _packed(value: object) -> bytes:
    try:
        return pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    except Exception as error:  # the code of users may raise any exception
        raise RvadsError(
            f"this can't travel to another process ({_text_of(error)}): use functions and classes at the top level of a module, "
            "no lambdas and no inner functions, or say executor=1 in Python"
        ) from error


def _dead() -> Failed:
    return Failed(RvadsError(f"the process that worked on it {DIED}"), lost=True)


def _text_of(error: BaseException) -> str:
    return one_line(": ".join(filter(None, (type(error).__name__, str(error)))), 300)
