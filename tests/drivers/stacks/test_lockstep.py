"""Lock-step: what a stack in another process drives does not depend on how fast it is, nor in which language or format."""

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.drivers.interface import Observation, TargetSpeed
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.stacks.process import Process
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from .conftest import Find

ROOT = Path(__file__).parents[3]
SCENARIO = Scenario(find("stop4"), "1133", distance=20, subject=0, duration=12)

ECHO = """
import random, sys, time
sys.path.insert(0, {clients!r})
import rvads_client
random.seed({seed})
print("this goes to standard error")
for seen in rvads_client.connect("echo", rate=20):
    if {sleeps}:
        time.sleep(random.random() * 0.004)
    before = seen.me["zone"] in ("approach", "entrance")
    line = seen.scenario["itinerary"]["line"] - 0.5 - seen.me["station"]
    busy = any(other["zone"] == "junction" for other in seen.others)
    seen.answer(target_speed=rvads_client.stopping_speed(line) if before and busy else 5.0)
"""


class Echo:
    """The same in process."""

    period = 0.05

    def control(self, seen: Observation) -> TargetSpeed:
        before = seen.me.zone in (Zone.APPROACH, Zone.ENTRANCE)
        line = seen.itinerary.line - 0.5 - seen.me.station
        busy = any(other.zone is Zone.JUNCTION for other in seen.others)
        return TargetSpeed(((2.0 * 2.0 * line) ** 0.5 if line > 0 else 0.0) if before and busy else 5.0)


@pytest.fixture
def echo(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    made: list[Process] = []

    def make(seed: int = 0, sleeps: bool = False) -> Process:
        script = tmp_path / f"echo{len(made)}.py"
        script.write_text(ECHO.format(clients=str(ROOT / "clients" / "python"), seed=seed, sleeps=sleeps), encoding="utf-8")
        made.append(Process([sys.executable, "-I", "-S", str(script)]))
        return made[-1]

    yield make
    for stack in made:
        stack.close()


def drive(autopilot: Any, scenario: Scenario = SCENARIO) -> Run:
    run = simulate(Case(scenario, autopilot, traffic=Reference))
    assert run.fault is None, run.fault
    return run


def test_a_stack_drives_as_the_same_code_in_process(echo: Callable[..., Process]) -> None:
    inside = drive(Echo)
    assert drive(echo()).hash == inside.hash
    assert inside.entry(0) is not None


@pytest.mark.extended
def test_random_sleeps_change_no_bit(echo: Callable[..., Process]) -> None:
    started = time.perf_counter()
    fast, *slow = drive(echo()), drive(echo(1, sleeps=True)), drive(echo(2, sleeps=True))
    taken = time.perf_counter() - started
    assert {run.hash for run in slow} == {fast.hash}
    longest = slow[0].provenance["timing"]["a0"]["longest"]
    assert 0.001 < longest < taken, "the compute time is reported, in seconds"
    steps = int((fast.zone[:-1, 0] != Zone.GONE).sum())
    assert slow[0].provenance["timing"]["a0"]["decisions"] == -(-steps // 5), "asked at 20 Hz while it is in the run"


@pytest.mark.extended
def test_one_process_serves_many_scenarios(compiled: Path, marked: Find) -> None:
    """A run does not depend on what the process did before, and there is one process."""
    scenarios = [Scenario(find("stop4"), "1133", subject=s, duration=8) for s in range(4)] + [
        Scenario(find("light3"), "112", subject=1, duration=8)
    ]
    with Process([str(compiled)]) as stack:
        together = [drive(stack, s).hash for s in scenarios]
        assert len(marked(str(compiled))) == 1
    assert marked(str(compiled)) == []
    for scenario, found in zip(scenarios, together, strict=True):
        with Process([str(compiled)]) as stack:
            assert drive(stack, scenario).hash == found


def test_every_vehicle_may_be_a_stack(compiled: Path, marked: Find) -> None:
    with Process([str(compiled)]) as stack:
        run = simulate(Case(Scenario(find("stop4"), "2222", duration=5), stack))
        assert run.fault is None
        assert len(marked(str(compiled))) == 4


def test_decision_rate_is_the_requested_rate(compiled: Path) -> None:
    for rate, decisions in ((None, 10), (10, 5), (50, 25)):
        with Process([str(compiled)], rate=rate) as stack:
            run = simulate(Case(Scenario(find("stop4"), "2000", duration=0.5), stack))
        assert run.provenance["timing"]["a0"]["decisions"] == decisions
