"""Recorded traffic: run with ``pytest benchmarks/bench_recorded.py -s``; minutes. The first needs the eclipse-sumo wheel.

The marks are for a machine with nothing else to do.
"""

import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.runfile import load_run, save_run

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.recorded.strung import driven
from tests.recorded.traffic import recorded, simulate

HOUR, EACH = 30.0, 0.020
MEMORY = 500
"""Most memory of the process [MB]."""


def memory() -> float:
    """Return the most memory that this process has needed [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def test_an_hour_at_an_all_way_stop(tmp_path: Path) -> None:
    """Nine hundred vehicles at 10 Hz, by all rules of `road`."""
    sumo = pytest.importorskip("sumo")
    traffic = simulate("stop", tmp_path, Path(sumo.SUMO_HOME), seconds=3600.0, rate=0.25, seed=7)
    recording = recorded(traffic, 10)
    begin, verdicts = time.perf_counter(), 0
    for run in recording:
        for rule in rules_for("road", run.junction):
            check(run, rule)
            verdicts += 1
    took = time.perf_counter() - begin
    print(f"{recording}: {verdicts} verdicts in {took:.1f} s")
    assert took < HOUR


@pytest.mark.parametrize("book", ["paper", "road"])
def test_many_short_runs(tmp_path: Path, book: str) -> None:
    """Each read and judged in time, in memory that does not grow."""
    paths = []
    for place, directions in (("stop4", "1133"), ("light4", "2323"), ("yield4", "2311"), ("right4", "2222")):
        for driver in ("reference", "lgsvl", "racer"):
            run = driven(place, directions, driver, (8.0, 12.0, 16.0, 9.0))
            for number in range(25):
                paths.append(tmp_path / f"{place}-{driver}-{number}.npz")
                save_run(replace(run, label=f"run {number}"), paths[-1])
    grown = []
    begin = time.perf_counter()
    for path in paths * 2:
        run = load_run(path)
        for rule in rules_for(book, run.junction):
            check(run, rule)
        grown.append(memory())
    took = (time.perf_counter() - begin) / len(grown)
    print(f"{book}: {took * 1000:.1f} ms per run, {grown[-1]:.0f} MB")
    assert took < EACH
    assert grown[-1] - grown[len(paths)] < 10
    assert grown[-1] < MEMORY
