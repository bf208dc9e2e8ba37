"""Work on executors: results in order or as they come, the same everywhere, and what becomes of it when processes die."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.executors import ExecutorGone, Failed, gathered, spread


def square(number: int) -> int:
    return number * number


def picky(number: int) -> int:
    if number in (3, 5):
        raise ValueError(f"not {number}")
    return number


class Odd(Exception):
    """One that can't be made again from what it keeps."""

    def __init__(self, one: int, two: int) -> None:
        super().__init__(f"{one} and {two}")

    def __reduce__(self) -> tuple[Any, ...]:
        return Odd, self.args  # said here too, because Dask teaches exceptions of others to travel


def odd(number: int) -> int:
    raise Odd(number, number)


def fatal(number: int) -> int:
    if number == 6:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fatal_once(job: tuple[int, str]) -> int:
    number, mark = job
    if number == 6:
        try:
            Path(mark).touch(exist_ok=False)
        except FileExistsError:
            return number
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def ends_soon() -> None:
    """End a process of a pool after a minute, because it outlives the process that started it if that one is killed."""
    if threading.current_thread() is threading.main_thread() and multiprocessing.parent_process() is not None:
        signal.alarm(60)


@pytest.mark.parametrize("made", [1, 2, None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_results_come_in_order_whatever_works_on_them(made: Any) -> None:
    told: list[tuple[int, int]] = []
    executor = made(2, initializer=ends_soon) if isinstance(made, type) else made
    assert list(spread(square, range(11), executor, lambda *now: told.append(now))) == [k * k for k in range(11)]
    assert told == [(k, 11) for k in range(1, 12)]
    if isinstance(executor, Executor):
        executor.shutdown()


class Shuffled(Executor):
    """Does what is handed to it the last first, now and then, and the rest at the end."""

    def __init__(self, draws: list[bool], parts: int) -> None:
        self._now = iter([*(draws + [False] * parts)[: parts - 1], True])
        self._waiting: list[tuple[Future[Any], Any, tuple[Any, ...]]] = []

    def submit(self, work: Any, /, *arguments: Any, **_: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        self._waiting.append((future, work, arguments))
        if next(self._now):
            while self._waiting:
                other, job, given_to = self._waiting.pop()
                other.set_result(job(*given_to))
        return future


@settings(max_examples=25, deadline=None)
@given(st.lists(st.booleans(), max_size=40), st.integers(1, 30), st.integers(1, 5))
def test_order_and_sizes_of_parts_change_no_result(draws: list[bool], jobs: int, batch: int) -> None:
    executor = Shuffled(draws, parts=-(-jobs // batch))
    assert list(spread(square, range(jobs), executor, batch=batch)) == [k * k for k in range(jobs)]


@pytest.mark.parametrize("executor", [1, 2])
def test_the_first_error_by_number_is_raised_in_its_place(executor: int) -> None:
    results = spread(picky, range(9), executor, batch=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="not 3"):
        next(results)


def test_an_error_that_can_not_travel_is_told_all_the_same() -> None:
    with pytest.raises(RvadsError, match="Odd: 0 and 0"):
        list(spread(odd, range(4), 2))


def test_jobs_are_asked_for_when_there_is_somebody_to_do_them() -> None:
    asked = []

    def jobs() -> Iterator[int]:
        for k in range(10_000):
            asked.append(k)
            yield k

    with closing(gathered(square, jobs(), 2, batch=3)) as answers:
        next(answers)
        assert len(asked) <= 4 * 2 * 3


@pytest.mark.parametrize("executor", [1, 2])
def test_results_lead_to_further_jobs(executor: int) -> None:
    class Halves:
        def __init__(self) -> None:
            self.waiting = [64]

        def __iter__(self) -> "Halves":
            return self

        def __next__(self) -> int:
            if not self.waiting:
                raise StopIteration
            return self.waiting.pop()

    jobs, squares = Halves(), []
    for _, answer in gathered(square, jobs, executor, batch=1):
        assert isinstance(answer, int)
        squares.append(answer)
        jobs.waiting += [round(answer**0.5) // 2] if answer > 1 else []
    assert squares == [4**k for k in range(6, -1, -1)]


def test_what_was_under_way_when_a_process_died_is_done_again(tmp_path: Path) -> None:
    jobs = [(number, str(tmp_path / "died")) for number in range(20)]
    assert sorted(gathered(fatal_once, jobs, 2, batch=2)) == [(k, k) for k in range(20)]
    assert (tmp_path / "died").exists()


def test_what_kills_its_process_costs_no_other_job() -> None:
    found = dict(gathered(fatal, range(20), 2, batch=3))
    lost = found.pop(6)
    assert isinstance(lost, Failed)
    assert lost.lost
    assert "died" in str(lost.error)
    assert found == {k: k for k in range(20) if k != 6}
    with pytest.raises(RvadsError, match="died"):
        list(spread(fatal, range(8), 2))


def test_what_can_not_travel_is_said_in_one_sentence() -> None:
    with pytest.raises(RvadsError, match=r"can't travel to another process .*say executor=1"):
        list(spread(lambda number: number, range(3), 2))
    with pytest.raises(RvadsError, match="can't travel"):
        list(spread(str, [lambda: 1, 2, 3], 2))


@pytest.mark.parametrize("wrong", [0, -1, True, 1.5, "2"])
def test_what_is_no_executor_is_refused(wrong: Any) -> None:
    with pytest.raises(RvadsError, match="takes a number of processes from 1 on"):
        list(spread(square, range(3), wrong))


def test_an_executor_that_was_shut_down_is_told() -> None:
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(ExecutorGone, match="ThreadPoolExecutor takes no more work"):
        list(spread(square, range(3), executor))


def test_a_pool_of_others_that_broke_is_told() -> None:
    with (
        ProcessPoolExecutor(2, initializer=ends_soon) as pool,
        pytest.raises(ExecutorGone, match="workers or scheduler are gone"),
    ):
        list(spread(fatal, range(20), pool))


class Cancelling(ThreadPoolExecutor):
    """Cancels what is handed to it, as a scheduler that starts anew does."""

    def submit(self, work: Any, /, *arguments: Any, **_: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


class Lacking(ThreadPoolExecutor):
    """Can't open what is handed to it, as a scheduler without the code of a driver."""

    def submit(self, work: Any, /, *arguments: Any, **_: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        error = RuntimeError("Error during deserialization")
        error.__cause__ = ModuleNotFoundError("No module named 'mine'")
        future.set_exception(error)
        return future


def test_a_module_that_an_executor_lacks_is_named() -> None:
    with Lacking(1) as pool, pytest.raises(RvadsError, match=r"lacks a module: ModuleNotFoundError: No module named 'mine'$"):
        list(spread(square, range(3), pool))


def test_executor_that_cancels_jobs_is_given_up() -> None:
    with Cancelling(2) as pool, pytest.raises(ExecutorGone, match="CancelledError"):
        list(spread(square, range(30), pool))


PARENT = """
import os, sys, time
from pytest_rvads.support.executors import gathered
def work(job):
    os.write(1, b"%d\\n" % os.getpid())  # in one piece
    time.sleep(12)
if __name__ == "__main__":
    list(gathered(work, range(8), 2))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_processes_end_with_the_one_that_hired_them(tmp_path: Path, number: int) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(number)
        assert parent.wait(20) != 0
        until = time.monotonic() + 20
        while any(running(worker) for worker in workers):
            assert time.monotonic() < until
            time.sleep(0.05)


def running(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
