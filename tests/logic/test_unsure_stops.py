"""Full stops in logs with noisy speeds: definite verdicts are true, and few are UNSURE."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

from pytest_rvads import Case, Reference, RollingStop, Run, Scenario, Status, check, find, simulate
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.satellites.tracks.importing import read_tracks

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


def passing(often: int, deviation: float, link: float, seed: int) -> tuple[dict[str, Any], dict[str, Status]]:
    """Return a log of vehicles that slow down before the line, and whether each has stopped.

    Errors of coordinates and speeds have the same deviation, and correlate by `link` within a tenth of a second.
    """
    rng, way, rows, truth = np.random.default_rng(seed), Itinerary.through(STOP, 0, 2), [], {}
    profiles = [(0.0, lasts) for lasts in (0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0)]
    profiles += [(least, min(1.5, 3.0 / least)) for least in (0.2, 0.2, 0.25, 0.3, 0.35, 0.5, 1.0, 2.0)]
    for number, (least, lasts) in enumerate(profiles):
        fine = np.arange(0.0, 12.0 + lasts, 0.001)
        speed = np.minimum(least + np.where(fine < 5.0, 3.0 * (5.0 - fine), 2.0 * np.maximum(fine - 5.0 - lasts, 0.0)), 8.0)
        station = np.cumsum(speed) * 0.001
        station -= station[round((5.0 + lasts) * 1000)] + 1.0
        at = slice(int(rng.integers(1000 // often)), int(np.searchsorted(station, way.end - 1.0)), 1000 // often)
        errors = rng.normal(0.0, deviation, (len(fine[at]), 3))
        kept = link ** (10 / often)
        for k in range(1, len(errors)):
            errors[k] = kept * errors[k - 1] + np.sqrt(1.0 - kept**2) * errors[k]
        for time, where, fast, (dx, dy, dv) in zip(fine[at], station[at], speed[at], errors, strict=True):
            x, y, heading = way.pose(where)
            x, y = x - 2.3 * np.cos(heading) + dx, y - 2.3 * np.sin(heading) + dy
            rows.append((40.0 * number + time, f"v{number}", x, y, heading, abs(fast + dv), 4.6, 1.8))
        truth[f"v{number}"] = Status.FAIL if least else Status.PASS
    columns = ("time", "id", "x", "y", "heading", "speed", "length", "width")
    return {name: np.array(values) for name, values in zip(columns, zip(*rows, strict=True), strict=True)}, truth


@pytest.mark.extended
@pytest.mark.parametrize("link", [0.0, 0.4, 0.8])
@pytest.mark.parametrize("deviation", [0.02, 0.05, 0.1, 0.15])
@pytest.mark.parametrize("often", [5, 10, 25])
def test_no_stop_is_judged_wrong(often: int, deviation: float, link: float) -> None:
    """The longest stop and the fastest of who rolls are definite where a tenth of a second tells 2 m/s from a stop."""
    log, truth = passing(often, deviation, link, seed=0)
    found = verdicts(read_tracks(log, STOP))
    assert {a: status for a, status in found.items() if status not in (truth[a], Status.UNSURE)} == {}
    if link == 0.0 and deviation <= 0.05 and often >= 10:
        assert (found["v7"], found["v15"]) == (Status.PASS, Status.FAIL)
