"""Campaigns on the workers of a Dask scheduler: every case once, and the same as in one process, whoever dies meanwhile."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.satellites.campaigns.resultsfile import Judged

distributed = pytest.importorskip("distributed")

CASES = 36
BEFORE = 8
"""Cases that are done before something dies: others are under way then, and others still to come."""
pytestmark = pytest.mark.filterwarnings("default")  # those of Dask are its own


class Cluster:
    """A scheduler and two workers, processes of their own on this machine."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._file = folder, folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0")
        while not self._file.exists():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        self.workers = [self._start("worker", "--no-nanny", "--nthreads", "1") for _ in range(2)]

    def _start(self, what: str, *arguments: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--scheduler-file", str(self._file), "--no-dashboard"]
        with (self._folder / f"{what}.log").open("ab") as log:
            bounded = partial(signal.alarm, 60)
            return subprocess.Popen([*command, *arguments], cwd=self._folder, stdout=log, stderr=log, preexec_fn=bounded)

    @contextmanager
    def client(self) -> Iterator[Any]:
        """Connect to the scheduler when both workers are there."""
        client = distributed.Client(scheduler_file=str(self._file), timeout=5, set_as_default=False)
        try:
            client.wait_for_workers(2, timeout=30)
            yield client
        finally:
            client.close(timeout=2)

    def stop(self) -> None:
        """Kill all that is left."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()
        self._file.unlink(missing_ok=True)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Callable[[], Cluster]]:
    """Start clusters."""
    started: list[Cluster] = []

    def start() -> Cluster:
        started.append(Cluster(tmp_path))
        return started[-1]

    yield start
    for one in started:
        one.stop()


def cases() -> Iterator[rvads.Case]:
    place = rvads.find("stop4")
    for k in range(CASES):
        yield rvads.Case(rvads.Scenario(place, "1010", distance=3 + k / 2, duration=1), rvads.Reference)


def at(number: int, act: Callable[[], object]) -> Callable[[int, int], None]:
    """Act when so many cases are done."""

    def progress(done: int, _: int) -> None:
        if done == number:
            act()

    return progress


@pytest.fixture(scope="module")
def alone() -> list[Judged]:
    """All results of one process."""
    with rvads.campaign(cases(), executor=1) as results:
        return list(results)


@pytest.mark.extended
def test_what_a_killed_worker_was_at_runs_again_and_nothing_counts_twice(
    cluster: Callable[[], Cluster], alone: list[Judged]
) -> None:
    here = cluster()
    with here.client() as client:
        results = rvads.campaign(cases(), executor=client.get_executor(), progress=at(BEFORE, here.workers[0].kill))
    assert list(results) == alone
    assert len({judged.hash for judged in results}) == CASES


@pytest.mark.extended
def test_a_campaign_whose_scheduler_was_killed_ends_and_goes_on_where_it_was(
    cluster: Callable[[], Cluster], alone: list[Judged], tmp_path: Path
) -> None:
    here, path = cluster(), tmp_path / "results.jsonl"
    died: list[float] = []

    def die() -> None:
        here.scheduler.kill()
        died.append(time.monotonic())

    with (
        here.client() as client,
        pytest.raises(rvads.errors.RvadsError, match=r"gone.*results are kept in .* run the campaign again"),
    ):
        rvads.campaign(cases(), executor=client.get_executor(), results=path, progress=at(BEFORE, die))
    assert time.monotonic() - died[0] < 20
    here.stop()
    kept = path.read_bytes()
    assert BEFORE <= kept.count(b'"case":') < CASES
    with cluster().client() as client:
        results = rvads.campaign(cases(), executor=client.get_executor(), results=path)
    assert list(results) == alone
    assert path.read_bytes().startswith(kept)
    assert path.read_bytes().count(b'"case":') == CASES
