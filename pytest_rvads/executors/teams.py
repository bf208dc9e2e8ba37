"""Who does the work: processes of our own, or an executor of others."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, NamedTuple, TypeAlias

from pytest_rvads.errors import RvadsError
from pytest_rvads.executors.crew import AHEAD, Crew
from pytest_rvads.wording import one_line

__all__ = ["ExecutorGone", "Failed", "Foreign", "Own", "Part", "Team", "tried"]

_UNKNOWN = 512
"""Parts that are handed out to an executor that does not tell how many workers it has."""
_TRIES = 3
"""How often what an executor of others has lost is handed to it again."""
_ANSWER = 60.0
"""How long an executor that has lost something may take to do something else: Dask looks for its scheduler meanwhile [s]."""


class ExecutorGone(RvadsError):
    """Nobody is there any more to do what is left; what was done is not lost."""


class Failed(NamedTuple):
    """What there is in place of the result of a job."""

    error: Exception
    """What it raised; where its process died, an `RvadsError` that says so."""
    lost: bool = False
    """Whether its process died."""


class Part(NamedTuple):
    """Jobs that travel together."""

    begin: int
    """Number of the first."""
    jobs: tuple[Any, ...]
    losses: int = 0
    """How often it was under way when a process died, or it was lost otherwise."""
    sent: int = 0
    """How many were handed out before it; another one each time, so that no executor takes what was lost for what it knows."""


class Done(NamedTuple):
    """The answers to the jobs of one part, as an executor from outside returns them."""

    sent: int
    """Number of the part, see `Part.sent`."""
    answers: list[Any]


class Own:
    """Processes of our own."""

    def __init__(self, work: Callable[[Any], Any], processes: int) -> None:
        self.ahead = AHEAD * processes
        self._crew: Crew[bytes, list[Any]] = Crew(partial(_opener, _packed(work)), processes)
        self.close, self.stop = self._crew.close, self._crew.stop

    def submit(self, part: Part) -> Future[list[Any]]:
        """Hand out a part."""
        return self._crew.submit(_packed(part.jobs))

    def again(self, part: Part, error: BaseException) -> bool:
        """Tell whether a part that was lost by `error` goes out again; else each of its jobs is done alone.

        Raises:
            RvadsError: nobody can do it.
        """
        if not isinstance(error, BrokenProcessPool):
            raise RvadsError(f"a job or its result does not travel between processes: {_told(error)}") from error
        return part.losses < 2

    def answers(self, _: Part, future: Future[list[Any]]) -> list[Any]:
        """Return the answers to the jobs of a part."""
        return future.result()

    def alone(self, job: Any) -> Any:
        """Return the answer to a job that may be what kills processes."""
        try:
            return self._crew.alone(_packed((job,)))[0]
        except BrokenProcessPool:
            return _dead()


class Foreign:
    """An executor of others, which they end."""

    def __init__(self, work: Callable[[Any], Any], executor: Executor) -> None:
        workers = getattr(executor, "_max_workers", None)  # of those of the standard library
        self.ahead = AHEAD * workers if isinstance(workers, int) else _UNKNOWN
        self._work, self._executor = work, executor
        self._sent = self._sound = 0
        """What was handed out last, and what had been when something was lost and something else was done after all."""

    def submit(self, part: Part) -> Future[Any]:
        """Hand out a part.

        Raises:
            ExecutorGone: it takes nothing any more.
            RvadsError: what it gives for that is no future.
        """
        self._sent = part.sent
        try:
            future = self._executor.submit(_done, self._work, part.jobs, part.sent)
        except Exception as error:  # each has its own
            raise self._gone(error) from error
        if not hasattr(future, "add_done_callback"):
            raise RvadsError(f"submit of {self._name} returned {future!r:.60}, expected a concurrent.futures.Future")
        return future

    def answers(self, part: Part, future: Future[Any]) -> list[Any]:
        """Return the answers to the jobs of a part, one for each job.

        Raises:
            RvadsError: the executor answers something else.
        """
        found = future.result()
        if not (isinstance(found, Done) and found.sent == part.sent):
            raise RvadsError(
                f"{self._name} answered {found!r:.60}, expected what the function given to its submit returns for these jobs"
            )
        return found.answers

    def again(self, part: Part, error: BaseException) -> bool:
        """Tell what `Own.again` does."""
        if isinstance(error, RvadsError):
            raise error
        if type(error).__name__ == "KilledWorker":  # Dask, after several workers; its class is there where Dask is
            return False
        if isinstance(error, CancelledError) and part.losses <= _TRIES:
            if part.sent > self._sound:
                self._probe(error)
            return True
        if isinstance(error, CancelledError | BrokenExecutor):
            raise self._gone(error) from error
        cause = error.__cause__ if isinstance(error.__cause__, ImportError) else error
        raise RvadsError(
            f"{self._name} can't work on this, perhaps because a job does not travel or who is to open it lacks a module: "
            f"{_told(cause)}"
        ) from error

    def alone(self, job: Any) -> Any:
        """Return what `Own.alone` does."""
        for losses in range(1, _TRIES + 2):
            part = Part(0, (job,), losses, self._sent + 1)
            try:
                return self.answers(part, self.submit(part))[0]
            except (Exception, CancelledError) as error:
                if not self.again(part, error):
                    break
        return _dead()

    def _probe(self, error: BaseException) -> None:
        """See whether the executor does anything; what waits for a scheduler that is gone may wait for ever."""
        try:
            self._executor.submit(_done, self._work, (), self._sent).result(_ANSWER)
        except (Exception, CancelledError):
            raise self._gone(error) from error
        self._sound = self._sent

    def close(self) -> None:
        """Leave it to those whose it is."""

    stop = close

    @property
    def _name(self) -> str:
        return f"the executor {type(self._executor).__name__}"

    def _gone(self, error: BaseException) -> ExecutorGone:
        return ExecutorGone(f"{self._name} takes no more work, its workers or scheduler are gone: {_told(error)}")


Team: TypeAlias = Own | Foreign
"""Each with `ahead`, the number of parts that may be under way."""


def _opener(work: bytes) -> Callable[[bytes], list[Any]]:
    """Return what opens packed jobs and does them."""
    done = pickle.loads(work)
    return lambda packed: _all(done, pickle.loads(packed))


def _all(work: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    return [_fit(tried(work, job)) for job in jobs]


def _done(work: Callable[[Any], Any], jobs: Sequence[Any], sent: int) -> Done:
    return Done(sent, _all(work, jobs))


def _fit(answer: Any) -> Any:
    """Return an answer that can travel: exceptions of others may not be made again from what they keep."""
    if isinstance(answer, Failed):
        try:
            pickle.loads(pickle.dumps(answer))
        except Exception:
            return Failed(RvadsError(_told(answer.error)))
    return answer


def tried(work: Callable[[Any], Any], job: Any) -> Any:
    """Return the result of a job, or how it failed."""
    try:
        return work(job)
    except Exception as error:
        return Failed(error)


def _packed(value: object) -> bytes:
    try:
        return pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    except Exception as error:  # whatever the code of others raises
        raise RvadsError(
            f"this can't travel to another process ({_told(error)}): name functions and classes of modules, no lambdas and none "
            "of functions, or say executor=1 (-j 1 of a command)"
        ) from error


def _dead() -> Failed:
    return Failed(RvadsError("the process that worked on it died, perhaps for lack of memory"), lost=True)


def _told(error: BaseException) -> str:
    return one_line(": ".join(filter(None, (type(error).__name__, str(error)))), 300)
