"""Runs jobs in processes that the package starts, or on any `concurrent.futures.Executor` of a user.

A job travels with its inputs, so that every process gives the same result.

A worker process can die because of a job, or for another reason. So the jobs of a dead process run again. A job whose process
died twice runs alone in a new process. Only a job that kills this process as well is lost.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence, Sized
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import lru_cache
from itertools import count, islice
from operator import call
from queue import SimpleQueue
from typing import Any, NamedTuple, TypeAlias, TypeVar

from pytest_rvads.support.errors import RvadsError, located
from pytest_rvads.support.wording import one_line

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")
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
        """Return whether a part lost by `error` is submitted again; if not, each of its jobs is done alone in a process.

        Only other processes can have harmed a part, so the part of a single process is not submitted again.
        """
        if not isinstance(error, BrokenProcessPool):
            raise RvadsError(f"a job or its result can't be sent between processes: {_text_of(error)}") from error
        return part.losses < min(self._processes, 2)

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


Progress = Callable[[int, int], None]
"""Called with the number of jobs done and the number of all."""


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
