"""Cost of the plugin: collecting ten thousand items, reporting cheap ones, and the profile of a pull request.

Run with ``pytest benchmarks/bench_plugin.py -s``. Sessions run in this process, so that ratios are of one run of it.
"""

import gc
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path

import pytest

ITEMS = 9720
OURS = """
import pytest_rvads as rvads

@rvads.scenario("stop4", cover="scenario", distances=[float(d) for d in range(1, 21)], speeds=[0, 0.5], rules=("p1", "p2", "p3"))
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""
BARE = f"""
import pytest

@pytest.mark.parametrize("cell", [f"stop4-class07-as1133-cfgd{{i:07d}}v00.00-p1" for i in range({ITEMS})])
def test_bare(cell): ...
"""
CHEAP = """
from types import SimpleNamespace

import pytest
import pytest_rvads as rvads
from pytest_rvads.fixtures.running import Simulated

@pytest.fixture(scope="session")
def rvads_runs():
    scenario = rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=1.0)
    one = Simulated(lambda: rvads.simulate(rvads.Case(scenario, rvads.Reference)))
    return SimpleNamespace(get=lambda *args: one)

@pytest.fixture
def rvads_autopilot():
    return rvads.Reference

here = rvads.scenario("stop4", cover="scenario", distances=[1.0, 2.0], rules="p4")

@here
def test_not_applicable(run, rule, monitor):
    monitor.check(rule)  # lights at a stop junction: NA

@here
def test_passes(run):
    assert run.steps
"""
PROFILE = """
import pytest_rvads as rvads

@rvads.scenario("stop4", grid="paper", rules=("paper", "road"))
def test_rules(run, rule, monitor):
    monitor.check(rule)
"""


class Clock:
    """Times the collection and the running of a session [s]."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        gc.collect()
        start = time.process_time()
        found = yield
        self.collecting = time.process_time() - start
        return found

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self) -> Generator[None, object, object]:
        start = time.process_time()
        found = yield
        self.running = time.process_time() - start
        return found


def session(folder: Path, code: str, *options: str) -> Clock:
    """Run a session in this process, apart from the project's configuration, and return its times."""
    file = folder / f"test_{abs(hash(code))}.py"
    file.write_text(code, encoding="utf-8")
    clock = Clock()
    pytest.main(
        ["-qq", "-p", "no:cacheprovider", f"--rootdir={folder}", "-c", "/dev/null", "-p", "no:logging", *options, str(file)],
        [clock],
    )
    return clock


def test_collecting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times: dict[str, list[float]] = {OURS: [], BARE: []}
    session(tmp_path, OURS, "--collect-only")  # maps and modules are read once per process
    for _ in range(7):
        for code, found in times.items():
            found.append(session(tmp_path, code, "--collect-only").collecting)
    ours, bare = (statistics.median(times[code]) for code in (OURS, BARE))
    with capsys.disabled():
        print(f"\n{ITEMS} items: {ours:.3f} s, bare {bare:.3f} s, ratio {ours / bare:.2f}")
    assert ours <= 1.5 * bare


def test_na_and_pass_items(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    count = 2 * 81 * 2
    bare = BARE.replace(str(ITEMS), str(count))
    differences = []
    for _ in range(3):
        ours, plain = (session(tmp_path, code).running for code in (CHEAP, bare))
        differences.append((ours - plain) / count)
    with capsys.disabled():
        print(f"\n{count} NA and pass items: {1e3 * min(differences):.3f} ms of the plugin each")
    assert min(differences) <= 1e-3


@pytest.mark.parametrize("workers", [(), ("-n", "2", "--dist", "worksteal")], ids=["one process", "two workers"])
def test_the_profile_of_a_pull_request(tmp_path: Path, workers: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "test_profile.py"
    file.write_text(PROFILE, encoding="utf-8")
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "--tb=no",
        "-rN",
        "-p",
        "no:cacheprovider",
        "--rvads-autopilot=reference",
        f"--rootdir={tmp_path}",
        "-c",
        "/dev/null",
    ]
    done = subprocess.run([*command, *workers, str(file)], cwd=tmp_path, capture_output=True, text=True, check=False)
    spent, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    worked = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    with capsys.disabled():
        print(f"\n{spent:.1f} s, {worked:.1f} s of processors: {done.stdout.splitlines()[-1]}")
    assert "120 runs" in done.stdout
    assert worked <= 60, "so that two processors that have nothing else to do take less than a minute"
