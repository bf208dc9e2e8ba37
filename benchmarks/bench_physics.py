"""Cost of simulating: four vehicles for 20 simulated seconds, control and sampling included, and the bare steps of the engine.

Run with ``pytest benchmarks/bench_physics.py``. Time is that of the process on the processor: a simulation is one thread that
waits for nothing, and so the numbers hold on a machine with other work, too.
"""

import resource
import time

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from pytest_rvads.drivers.interface import Autopilot, Command, Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.braking import _vmax, stopping_distance, vmax
from pytest_rvads.physics.engines import BulletWorld
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.pedestrians import Pedestrian
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tests.zebras import zebra

BUDGET = 0.15
"""Longest time for 20 simulated seconds on the machine of CI [s]."""
STAY = Control(brake=1.0)
CASES = [
    Case(Scenario(find(junction), directions, distance=20, duration=20), Reference)
    for junction, directions in (("stop4", "3333"), ("light4", "3232"))
]


def bare_steps() -> None:
    """2000 steps of the same world without forces, control or sampling."""
    world = BulletWorld([Vehicle()] * 4, [Motion(20.0 * k, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(4)])
    bullet, client = world._bullet, world._client
    for _ in range(2000):
        bullet.stepSimulation(physicsClientId=client)
    world.close()


@pytest.mark.benchmark(timer=time.process_time)
def test_bare_steps(benchmark: BenchmarkFixture) -> None:
    benchmark.pedantic(bare_steps, rounds=10, warmup_rounds=2)


@pytest.mark.benchmark(timer=time.process_time)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.scenario.place.name)
def test_four_vehicles_for_twenty_seconds(benchmark: BenchmarkFixture, case: Case) -> None:
    run = benchmark.pedantic(simulate, args=(case,), rounds=10, warmup_rounds=2)
    assert (run.duration, len(run.agents)) == (20.0, 4)
    bare = []
    for _ in range(5):
        start = time.process_time()
        bare_steps()
        bare.append(time.process_time() - start)
    ratio = benchmark.stats["min"] / min(bare)
    benchmark.extra_info["total over bare steps"] = round(ratio, 1)
    print(f"\n{case.scenario.place.name}: {benchmark.stats['min']:.3f} s, {ratio:.1f} times the bare steps ({min(bare):.4f} s)")
    assert benchmark.stats["min"] <= BUDGET


class Stands(Autopilot):
    """Stands without a look at anybody."""

    def control(self, _: Observation) -> Command:
        return STAY


def test_two_pedestrians_cost_little() -> None:
    """What two pedestrians add to the cost of four vehicles, in turns; no vehicle waits for a pedestrian.

    The limit is for the simulator, measured with vehicles that see nobody. What the reference driver spends is printed.
    """
    place = zebra("light4", lit=True)
    walkers = [Pedestrian(1, "near", "stops", 4.0), Pedestrian(2, "far", "waits")]
    scenarios = [Scenario(place, "3232", distance=20, duration=20, pedestrians=on_foot) for on_foot in ([], walkers)]
    cases = [Case(scenario, driver) for driver in (Reference, Stands) for scenario in scenarios]
    times: list[list[float]] = [[] for _ in cases]
    for _ in range(8):
        for case, measured in zip(cases, times, strict=True):
            start = time.process_time()
            run = simulate(case)
            measured.append(time.process_time() - start)
            assert (run.duration, len(run.agents)) == (20.0, 4 + len(case.scenario.pedestrians))
    alone, together, standing, standing_together = map(min, times)
    added = (standing_together - standing) / alone
    print(f"\ntwo pedestrians add {added:.0%} to the cost of four vehicles, and {together / alone - 1.0:.0%} with the driver's")
    assert added <= 0.15


def test_braking_envelope(benchmark: BenchmarkFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVADS_CACHE", "")

    def table() -> list[float | None]:
        _vmax.cache_clear()
        stopping_distance.cache_clear()
        return [vmax(d, level) for level in (1, 2, 3) for d in (0.3, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0)]

    assert None not in benchmark.pedantic(table, rounds=3)


def test_memory_of_a_thousand_runs() -> None:
    case = Case(Scenario(find("stop4"), "3333", distance=0.3, duration=0.5), Reference)
    for _ in range(200):
        simulate(case)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(1000):
        simulate(case)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 4096, "kilobytes"
