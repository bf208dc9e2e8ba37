"""Cost of live monitors: run with ``pytest benchmarks/bench_live.py``; the marks fail when they are missed.

The runs are simulated, with three vehicles on every arm; all rules for the road are followed at once, a hundred states a second.
"""

from collections.abc import Callable
from time import thread_time

import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.live.instant import Seen
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate


@pytest.fixture(scope="module", params=["stop4", "light4", "yield4"])
def run(request: pytest.FixtureRequest) -> Run:
    start = Scenario(find(request.param), "2321", distance=12.0, speed=4.0, followers=2, duration=30)
    return simulate(Case(start, Reference))


def fixed(run: Run, block: int = 1) -> Callable[[int], object]:
    """Return what reads a state of vehicles that are known beforehand."""
    monitor = RuleMonitor("road", run.junction, run.agents, speed_limit=run.facts.speed_limit, block=block)
    station, speed, pose = (run.need(name) for name in ("station", "speed", "pose"))
    return lambda k: monitor.step(run.zone[k], run.lights[k], station=station[k], speed=speed[k], pose=pose[k])


def coming(run: Run) -> Callable[[int], object]:
    """Return what reads a state of vehicles that come and go."""
    monitor = RuleMonitor("road", run.junction, speed_limit=run.facts.speed_limit)
    station, speed, pose = (run.need(name).tolist() for name in ("station", "speed", "pose"))
    here = run.here.tolist()

    def read(k: int) -> object:
        there = [i for i, is_here in enumerate(here[k]) if is_here]
        return monitor.see([Seen(run.agents[i], station[k][i], speed[k][i], *pose[k][i]) for i in there], run.lights[k])

    return read


def costs(run: Run, read: Callable[[int], object]) -> list[float]:
    """Return the processor time of every state after the first ten states [s]; in these the monitors are made."""
    costs = []
    for k in range(run.steps):
        before = thread_time()
        read(k)
        costs.append(thread_time() - before)
    mean, middle, most = np.mean(costs[10:]) * 1e6, np.median(costs[10:]) * 1e6, max(costs[10:]) * 1e3
    there = run.here.sum(axis=1).mean()
    print(f"\n{run.junction.name}: {there:.1f} there, mean {mean:.0f} us, median {middle:.0f} us, at most {most:.1f} ms")
    return costs[10:]


@pytest.mark.parametrize("reading", [fixed, coming])
def test_all_rules_for_the_road(run: Run, reading: Callable[[Run], Callable[[int], object]]) -> None:
    """A state of up to twelve vehicles: at most 1.6 ms in the mean, and at most 6 ms; a tick of 100 Hz has 10 ms."""
    found = costs(run, reading(run))
    assert np.mean(found) < 1.6e-3
    assert max(found) < 6e-3


def test_all_rules_for_the_road_in_blocks_of_ten_states(run: Run) -> None:
    """Ten states that are judged together cost at most a third of ten states that are judged one by one."""
    assert np.mean(costs(run, fixed(run, 10))) < np.mean(costs(run, fixed(run))) / 3
