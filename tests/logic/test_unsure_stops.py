"""Full stops in logs with noisy speeds: definite verdicts are true, and few are UNSURE."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from pytest_rvads import Case, Reference, RollingStop, Run, Scenario, Status, check, find, simulate
from pytest_rvads.files import read_tracks
from pytest_rvads.runs.recording import Recording

COLUMNS = ("time", "id", "x", "y", "heading", "vx", "vy", "length", "width")
STOP = find("stop4")


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two runs of four vehicles each: all stop at their lines, or two of them roll on."""
    scenario = Scenario(STOP, "1233", distance=(20.0, 26.0, 23.0, 33.0), speed=5.0, duration=25.0)
    return [simulate(Case(scenario, driver)) for driver in (Reference, RollingStop)]


def logged(run: Run, accuracy: float, seed: int, *, forward: bool) -> dict[str, Any]:
    """Return a run as a log at 10 Hz, places known to 10 cm and velocities to `accuracy` [m/s].

    A log gives velocities in x and y, or only how fast a vehicle is, forwards.
    """
    rng, rows = np.random.default_rng(seed), []
    pose, speed = run.need("pose"), run.need("speed")
    for tick in range(0, run.steps, 10):
        for column in np.flatnonzero(run.here[tick]):
            (x, y, heading), (length, width) = pose[tick, column], run.agents[column].size or (4.6, 1.8)
            fast = speed[tick, column] * np.array((np.cos(heading), np.sin(heading))) + rng.normal(0, accuracy, 2)
            x, y = (x, y) - length / 2 * np.array((np.cos(heading), np.sin(heading))) + rng.normal(0, 0.1, 2)
            rows.append((tick * run.dt, run.agents[column].name, x, y, heading, *fast, length, width))
    table: dict[str, Any] = {name: np.array(values) for name, values in zip(COLUMNS, zip(*rows, strict=True), strict=True)}
    if forward:
        east, north = table.pop("vx"), table.pop("vy")
        table["speed"] = east * np.cos(table["heading"]) + north * np.sin(table["heading"])
    return table


def verdicts(runs: "list[Run] | Recording") -> dict[str, Status]:
    return {dict(i.binding)["a"]: i.status for run in runs for i in check(run, "full_stop").instances}


@pytest.mark.extended
@pytest.mark.parametrize("stated", [{}, {"position_accuracy": 0.1, "speed_accuracy": 0.1}], ids=["estimated", "stated"])
@pytest.mark.parametrize("forward", [True, False], ids=["speed", "vx and vy"])
def test_stops_in_noise(runs: list[Run], forward: bool, stated: dict[str, Any]) -> None:
    told: Counter[str] = Counter()
    for run in runs:
        truth = verdicts([run])
        for seed in range(3):
            found = verdicts(read_tracks(logged(run, 0.1, seed, forward=forward), STOP, **stated))
            told += Counter("UNSURE" if found[a] is Status.UNSURE else str(found[a] is truth[a]) for a in truth)
    assert told.total() == 24
    assert told["False"] == 0
    assert told["UNSURE"] <= 0.15 * 24


def test_noise_of_twice_the_threshold_fails_no_full_stop(runs: list[Run]) -> None:
    """The length of a velocity that is noise is 0.25 m/s on average, and none of these vehicles was that fast."""
    recording = read_tracks(logged(runs[0], 0.2, 0, forward=False), STOP)
    assert Status.FAIL not in verdicts(recording).values()


@pytest.mark.parametrize("accuracy", [0.05, 0.1, 0.3])
def test_accuracy_of_speeds_is_estimated_to_a_quarter(runs: list[Run], accuracy: float) -> None:
    recording = read_tracks(logged(runs[0], accuracy, 0, forward=True), STOP)
    assert recording.speed_accuracy == pytest.approx(accuracy, rel=0.25)
    assert read_tracks(logged(runs[0], 0.0, 0, forward=True), STOP).speed_accuracy == 0.0
