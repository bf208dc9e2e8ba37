"""What a campaign spends its time on: simulating and judging the same 40 cases in both engines, and on two processes against one.

Run with ``pytest -s benchmarks/bench_runs.py``; a minute or two. It prints shares and ratios. The engines take turns, and
time is that of the process on the processor, so what else the machine does meets both; two processes want an idle machine.
"""

import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.physics.engines import BULLET, MUJOCO, Engine
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.simulators.loop import Planar
from pytest_rvads.simulators.simulator import simulate

JUNCTIONS = ("light3", "stop4", "right4", "light4")
EACH = 10


def cases() -> list[Case]:
    """The same number at each junction, spread over its scenarios and configurations."""
    found = []
    for name in JUNCTIONS:
        place = find(name)
        points = list(Selection(place, grid(["paper"], len(place.entrances), place.control), "conflicts"))
        found += [Case(scenario, Reference) for scenario in points[:: len(points) // EACH][:EACH]]
    return found


def spent(engine: Engine, case: Case) -> tuple[float, float, int]:
    """Return the time to simulate a case and to judge it by the road rules [s], and its ticks."""
    start = time.process_time()
    run = simulate(case, Planar(engine))
    simulated = time.process_time()
    for rule in rules_for(("road",), run.junction):
        check(run, rule)
    return simulated - start, time.process_time() - simulated, run.steps


def work(numbers: list[int]) -> int:
    """Simulate and judge cases of `cases`, given by their places; return how many."""
    known = cases()
    for number in numbers:
        spent(BULLET, known[number])
    return len(numbers)


def test_what_a_run_spends_its_time_on() -> None:
    engines = (BULLET, MUJOCO)
    for engine in engines:
        pytest.importorskip(engine.library)
    known = cases()
    for engine in engines:  # monitors and maps are made once per process
        for case in known:
            for rule in rules_for(("road",), case.scenario.place):
                check(simulate(case.but(duration=0.1), Planar(engine)), rule)
    each: dict[str, list[tuple[float, float, int]]] = {engine.name: [] for engine in engines}
    for case in known:
        for engine in engines:
            each[engine.name].append(spent(engine, case))
    totals = {}
    for name, rows in each.items():
        simulating, judging = sum(row[0] for row in rows), sum(row[1] for row in rows)
        ticks = sum(row[2] for row in rows)
        totals[name] = simulating + judging
        print(
            f"\n{name}: {simulating / ticks * 1e6:.0f} us per tick, {simulating / len(rows) * 1e3:.0f} ms to simulate a run and "
            f"{judging / len(rows) * 1e3:.0f} ms to judge it"
        )
        assert judging < simulating
    print(f"\na campaign in bullet takes {totals['bullet'] / totals['mujoco']:.2f} times as long as one in mujoco")


def test_two_processes_against_one() -> None:
    if (os.cpu_count() or 1) < 2:
        pytest.skip("there is one processor")
    numbers = list(range(len(JUNCTIONS) * EACH))
    times = {}
    for processes in (1, 2):
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            list(pool.map(work, [[k] for k in range(processes)]))  # so that starting processes is not measured
            start = time.perf_counter()
            assert sum(pool.map(work, [numbers[k::8] for k in range(8)])) == len(numbers)
            times[processes] = time.perf_counter() - start
    print(f"\n{len(numbers)} cases: two processes are {times[1] / times[2]:.2f} times as fast as one")
