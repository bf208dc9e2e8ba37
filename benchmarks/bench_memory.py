"""Memory and speed of long sessions: 20,000 items collected, 3,000 run, that pass, fail or are not applicable.

Run with ``pytest benchmarks/bench_memory.py -s``; minutes, on Linux.
"""

import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from tests.inner_sessions import driven_by

RUN, EVERY = 3000, 500
MOST = 20.0
"""How much memory may grow after the first items [MB]."""
TESTS = driven_by(
    'Racer if "class01" in request.node.name else rvads.Reference',
    """
@rvads.scenario(
    "stop4",
    cover="scenario",
    distances=[0.5 * i for i in range(1, 21)],
    speeds=[0, 0.1, 0.25, 0.5],
    rules=("p1", "p2", "p3"),
    duration=1,
)
def test_rules(run, rule, monitor):
    monitor.check(rule)
""",
)
CONFTEST = f"""
import time
from pathlib import Path

import pytest

class Watch:
    def __init__(self, config):
        self.config, self.ran = config, 0
        self.who = config.workerinput["workerid"] if hasattr(config, "workerinput") else "main"

    def pytest_sessionstart(self, session):
        self.session = session

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report):
        self.ran += report.when == "teardown"
        if report.when == "teardown" and self.ran % {EVERY} == 0 and self.ran <= {RUN}:  # workers go on with what they were given
            size = next(line.split()[1] for line in Path("/proc/self/status").open() if line.startswith("VmRSS"))
            with Path(f"{{self.who}}.log").open("a") as log:
                print(self.ran, int(size) / 1024, time.process_time(), file=log)
        if self.who == "main" and self.ran == {RUN}:
            (self.config.pluginmanager.getplugin("dsession") or self.session).shouldstop = "enough"

def pytest_configure(config):
    config.pluginmanager.register(Watch(config))
"""


@pytest.mark.parametrize("workers", [(), ("-n", "2")], ids=["one process", "two workers"])
def test_memory_stays(tmp_path: Path, workers: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "test_it.py").write_text(TESTS, encoding="utf-8")
    (tmp_path / "conftest.py").write_text(CONFTEST, encoding="utf-8")
    options = ["-q", "--tb=short", "-p", "no:cacheprovider", f"--rootdir={tmp_path}", "-c", os.devnull, "--rvads-max-items=30000"]
    command = [sys.executable, "-m", "pytest", *options, "--rvads-report=out.json", *workers]
    subprocess.run(command, cwd=tmp_path, stdout=subprocess.DEVNULL, check=False, timeout=3600)
    for log in sorted(tmp_path.glob("*.log")):
        _, sizes, times = zip(*(map(float, line.split()) for line in log.read_text(encoding="utf-8").splitlines()), strict=True)
        items = [1000 * (later - earlier) / EVERY for earlier, later in pairwise(times)]
        with capsys.disabled():
            print(f"\n{log.stem}: {sizes[0]:.0f} MB after {EVERY} items, {sizes[-1]:.0f} MB at the end;", end=" ")
            print(f"ms of processor per item, every {EVERY}:", *(f"{item:.2f}" for item in items))
        assert sizes[-1] - sizes[0] <= MOST
