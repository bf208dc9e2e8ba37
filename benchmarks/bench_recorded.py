"""Recorded traffic: run with ``pytest benchmarks/bench_recorded.py -s``; two minutes.

The marks are for a machine with nothing else to do. Memory is that of a process of its own, so on Linux alone.
"""

import json
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import save_recording, save_run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

RUNS = 1000
SCENARIOS = 100
"""Different ones among them."""
EACH, FIRST, HOUR = 0.020, 2.0, 30.0
"""Most time of the processor per short run, until the first verdict, for an hour of traffic [s]."""
MEMORY = 500.0
"""Most memory of the process [MB]."""
GROWTH = 40.0
"""Most that it may grow from a fifth of the runs on [MB]: what is kept of rules and scenarios is bounded."""


@dataclass(frozen=True)
class Cost:
    """What a check took."""

    first: float
    """Until the first verdicts [s]."""
    seconds: float
    """Time of the processor [s]."""
    memory: tuple[float, ...]
    """Most of the process so far, every fifth of the runs [MB]."""


def checked(target: Path, book: str, runs: int) -> Cost:
    """Check files in a process of their own."""
    command = [sys.executable, "-c", "from pytest_rvads.cli import main; raise SystemExit(main())"]
    begin, first, memory, seconds = time.perf_counter(), 0.0, [], 0.0
    with subprocess.Popen(
        [*command, "check", str(target), "--rules", book, "--jsonl"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdout is not None
        with_end = Timer(600.0, process.kill)
        with_end.start()
        for number, line in enumerate(process.stdout, 1):
            assert json.loads(line)["verdicts"]
            first = first or time.perf_counter() - begin
            if number % (runs // 5) == 0:
                place = Path("/proc") / str(process.pid)
                told = dict(row.split(":", 1) for row in (place / "status").read_text().splitlines())
                memory.append(int(told["VmHWM"].split()[0]) / 1024)
                seconds = sum(map(int, (place / "stat").read_text().rsplit(") ", 1)[1].split()[11:13])) / 100
        with_end.cancel()
    return Cost(first, seconds, tuple(memory))


def driven(number: int, rng: random.Random, places: tuple[str, ...]) -> Run:
    """Return a simulated run of four vehicles as a recording has it: nobody watched for collisions."""
    directions = "".join(rng.choice("1123") for _ in range(4))
    distances = tuple(rng.uniform(15.0, 50.0) for _ in range(4))
    scenario = Scenario(find(places[number % len(places)]), directions, distance=distances, speed=5.0, duration=24)
    return replace(simulate(Case(scenario, Reference)), collisions=None, controls=None)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of short runs."""
    rng, made = random.Random(1), tmp_path_factory.mktemp("runs")
    runs = [driven(number, rng, ("stop4", "light4", "yield4", "right4")) for number in range(SCENARIOS)]
    for number in range(RUNS):
        save_run(replace(runs[number % SCENARIOS], label=f"run {number}"), made / f"{number:04}.npz")
    return made


@pytest.mark.parametrize("book", ["paper", "road"])
def test_many_short_runs(folder: Path, book: str) -> None:
    """Each is read and judged in time, in memory that does not grow."""
    cost = checked(folder, book, RUNS)
    print(f"{book}: {cost.seconds / RUNS * 1000:.1f} ms per run, the first after {cost.first:.1f} s, {cost.memory[-1]:.0f} MB")
    assert cost.seconds < EACH * RUNS
    assert cost.first < FIRST
    assert cost.memory[-1] - cost.memory[0] < GROWTH
    assert cost.memory[-1] < MEMORY


def tracks(run: Run, start: float, number: int) -> Iterator[Track]:
    """Yield the vehicles of a run as they are recorded ten times a second, from a time on."""
    for column, agent in enumerate(run.agents):
        rows = np.flatnonzero(run.here[:, column])[::10]
        station, speed, pose = (run.need(name)[rows, column] for name in ("station", "speed", "pose"))
        yield Track(replace(agent, name=f"{agent.name}-{number}"), start + rows.astype(np.float64) * run.dt, station, speed, pose)


def test_an_hour_of_traffic(tmp_path: Path) -> None:
    """Nine hundred vehicles at an all-way stop, four every 16 s, so that one group meets the next."""
    rng = random.Random(2)
    runs = [driven(number, rng, ("stop4",)) for number in range(45)]
    vehicles = [track for number in range(225) for track in tracks(runs[number % 45], 16.0 * number, number)]
    recording = Recording("hour", runs[0].junction, tuple(vehicles))
    save_recording(recording, tmp_path / "hour.npz")
    cost = checked(tmp_path / "hour.npz", "road", len(recording))
    print(f"{recording}: {cost.seconds:.1f} s, the first after {cost.first:.1f} s, {cost.memory[-1]:.0f} MB")
    assert cost.seconds < HOUR
    assert cost.first < FIRST
    assert cost.memory[-1] < MEMORY
