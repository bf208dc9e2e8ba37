"""Both physics engines side by side: the step of a world alone, and a whole simulation per tick, from 1 to 80 vehicles.

Run with ``pytest -s benchmarks/bench_engines.py``. Time is that of the process on the processor, the least of some rounds, in
which the engines take turns, so that what else the machine does meets both.
"""

import time
from collections.abc import Callable

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.physics.body import Motion
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.loop import bullet, mujoco
from pytest_rvads.simulators.simulator import Simulator, simulate

ENGINES = (BULLET, MUJOCO)
ROUNDS = 5
LANES = find("lanes4")
SCENARIOS = {
    1: Scenario(find("stop4"), "2000", distance=20, duration=5.0),
    4: Scenario(find("stop4"), "3333", distance=20, duration=5.0),
    16: Scenario(find("stop4"), "3333", distance=3, followers=3, duration=5.0),
    80: Scenario(LANES, [LANES.directions(k)[0] for k in range(8)], distance=3, followers=9, duration=1.0),
}
"""By the number of vehicles."""


@pytest.fixture(autouse=True)
def _both() -> None:
    for engine in ENGINES:
        pytest.importorskip(engine.library)


def steps(engine: Engine, count: int, ticks: int = 500) -> float:
    """Return how long a step takes, with forces in, motions and contacts out [s]."""
    world = engine.world([Vehicle()] * count, [Motion(0.0, 20.0 * k, 0.0, 1.0, 0.0, 0.0) for k in range(count)])
    forces = [1.0] * (3 * count)
    start = time.process_time()
    for _ in range(ticks):
        world.step(forces)
        world.contacts()
        world.motions()
    spent = time.process_time() - start
    world.close()
    return spent / ticks


def told(what: str, count: int, measures: tuple[Callable[[], float], Callable[[], float]]) -> tuple[float, float]:
    """Print the least time of each engine, ticks per second and their ratio; return both times [s]."""
    rounds = [tuple(measure() for measure in measures) for _ in range(ROUNDS)]
    one, two = (min(column) for column in zip(*rounds, strict=True))
    times = ", ".join(f"{name} {t * 1e6:.1f} us ({1 / t:,.0f} ticks/s)" for name, t in (("bullet", one), ("mujoco", two)))
    print(f"\n{what}, {count} vehicle{'s' * (count > 1)}: {times}, bullet takes {one / two:.1f} times as long")
    return one, two


@pytest.mark.parametrize("count", SCENARIOS)
def test_a_step_of_the_world_alone(count: int) -> None:
    one, two = told("step alone", count, (lambda: steps(BULLET, count), lambda: steps(MUJOCO, count)))
    assert two < one


@pytest.mark.parametrize("count", SCENARIOS)
def test_a_tick_of_a_whole_simulation(count: int) -> None:
    """With sampling, decisions and recording."""
    case = Case(SCENARIOS[count], Reference)

    def tick(simulator: Simulator) -> Callable[[], float]:
        def measure() -> float:
            start = time.process_time()
            run = simulate(case, simulator)
            spent = time.process_time() - start
            assert len(run.agents) == count
            return spent / (run.steps - 1)

        return measure

    told("whole simulation", count, (tick(bullet), tick(mujoco)))
