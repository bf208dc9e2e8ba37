"""What asking a stack in another process costs, beside its own computing and the simulation.

The stack computes for 1 ms per decision at 20 Hz; the same run in process computes nothing. The protocol may add 20 % to
the sum of both. Measured in one session, so that the ratio does not depend on the machine.
"""

import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from pytest_rvads.drivers.interface import Observation, TargetSpeed
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.geometry.finder import find
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

CLIENTS = Path(__file__).parents[1] / "clients"
SCENARIO = Scenario(find("stop4"), "1133", distance=20, speed=8, subject=0, duration=15)
MOST = 1.2
ROUNDS = 9

CPP = """
#include "rvads.h"
int main() {
    rvads link;
    rvads_observation seen;
    rvads_command command;
    if (!rvads_open(&link, "busy", 20.0)) return 1;
    while (rvads_next(&link, &seen)) {
        timespec now;
        do clock_gettime(CLOCK_MONOTONIC, &now);
        while ((now.tv_sec - link.since.tv_sec) * 1e9 + (now.tv_nsec - link.since.tv_nsec) < 1e6);
        rvads_target_speed(&command, 5.0);
        rvads_answer(&link, &command);
    }
}
"""
PYTHON = """
import sys, time
sys.path.insert(0, {clients!r})
import rvads_client
for seen in rvads_client.connect("busy", rate=20):
    began = time.perf_counter()
    while time.perf_counter() - began < 0.001:
        pass
    seen.answer(target_speed=5.0)
"""


class Inside:
    """The same decisions in process."""

    period = 0.05

    def control(self, _seen: Observation) -> TargetSpeed:
        return TargetSpeed(5.0)


@pytest.fixture(params=["cpp", "python"])
def stack(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Process]:
    """A stack that is busy for 1 ms per decision."""
    if request.param == "python":
        (tmp_path / "busy.py").write_text(PYTHON.format(clients=str(CLIENTS / "python")), encoding="utf-8")
        command = [sys.executable, "-I", "-S", str(tmp_path / "busy.py")]
    else:
        if shutil.which("g++") is None:
            pytest.skip("needs g++")
        (tmp_path / "busy.cpp").write_text(CPP, encoding="utf-8")
        command = [str(tmp_path / "busy")]
        subprocess.run(["g++", "-O2", f"-I{CLIENTS / 'c'}", "-o", *command, str(tmp_path / "busy.cpp")], check=True)
    with Process(command) as process:
        yield process


def busy(stack: Process) -> float:
    """Processor time that this process and the stack have used [s]; of no other process, so that their load decides nothing."""
    pids = [connection.child.pid for connection in stack.connections]
    used = (int(Path(f"/proc/{pid}/schedstat").read_text(encoding="utf-8").split()[0]) for pid in pids)
    return time.process_time() + sum(used) / 1e9


def test_the_protocol_adds_at_most_a_fifth(benchmark: BenchmarkFixture, stack: Process) -> None:
    """Rounds of both are interleaved; the ratio of elapsed times, which depends on the load, is told beside."""

    def seconds(autopilot: Any) -> tuple[float, float, dict[str, float]]:
        elapsed, used = time.perf_counter(), busy(stack)
        run = simulate(Case(SCENARIO, autopilot, traffic=Reference))
        assert run.fault is None
        timing = run.provenance.get("timing", {}).get("a0", {"compute": 0.0, "decisions": 0})
        return busy(stack) - used, time.perf_counter() - elapsed, timing

    seconds(stack), seconds(Inside)
    ratios, elapsed = [], []
    for _ in range(ROUNDS):
        inside, inside_elapsed, _ = seconds(Inside)
        outside, outside_elapsed, timing = seconds(stack)
        ratios.append(outside / (0.001 * timing["decisions"] + inside))
        elapsed.append(outside_elapsed / (timing["compute"] + inside_elapsed))
    benchmark.extra_info["ratio"] = round(statistics.median(ratios), 3)
    benchmark.extra_info["ratio of elapsed times"] = [round(min(elapsed), 3), round(statistics.median(elapsed), 3)]
    benchmark.pedantic(lambda: seconds(stack), rounds=3)
    assert simulate(Case(SCENARIO, stack, traffic=Reference)).hash == simulate(Case(SCENARIO, Inside, traffic=Reference)).hash
    assert statistics.median(ratios) <= MOST, ratios
