"""Runs that are measured again with noise: no definite verdict about an instance is wrong, and few are UNSURE."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from pytest_rvads import Agent, Case, LgsvlLike, Run, Scenario, Status, check, find, simulate, validate
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from studies.mutants import MUTANTS

KEPT = {Status.PASS, Status.NA, None}
CASES: dict[str, tuple[str, str, Any]] = {
    "lgsvl at stop signs": ("stop4", "1233", LgsvlLike),
    "ignores stop signs": ("stop4", "1322", MUTANTS["ignores stop"]),
    "last come first": ("stop4", "2131", MUTANTS["last come first"]),
    "runs red": ("light4", "2312", MUTANTS["runs red"]),
    "no yield turning left": ("light4", "3222", MUTANTS["no yield turning left"]),
}


@pytest.fixture(scope="module")
def runs() -> dict[str, Run]:
    """The runs as they were."""
    found = {}
    for name, (place, code, driver) in CASES.items():
        scenario = Scenario(find(place), code, distance=(20.0, 26.0, 23.0, 33.0), speed=5.0, duration=20.0)
        found[name] = simulate(Case(scenario, driver))
    return found


def verdicts(runs: Iterable[Run], place: Run) -> dict[tuple[str, object], Status]:
    """Return what every instance of every rule says."""
    rules = {r.name for book in ("paper", "road") for r in rules_for(book, place.junction)}
    return {(name, i.binding): i.status for run in runs for name in sorted(rules) for i in check(run, name).instances}


@pytest.fixture(scope="module")
def noisy(runs: dict[str, Run], measured: Callable[..., Recording]) -> dict[str, dict[tuple[str, object], Status]]:
    """What instances say of the runs at 10 Hz with 10 cm of noise."""
    return {name: verdicts(measured(run, 10, 0.1), run) for name, run in runs.items()}


def wrong(
    found: dict[tuple[str, object], Status], truth: dict[tuple[str, object], Status]
) -> dict[tuple[str, object], tuple[Status | None, Status]]:
    """Return the definite verdicts that are not the true ones; whether what was kept was asked at all makes no difference."""
    return {
        key: (truth.get(key), status)
        for key, status in found.items()
        if status is not Status.UNSURE and status is not truth.get(key) and not {status, truth.get(key)} <= KEPT
    }


@pytest.mark.extended
@pytest.mark.parametrize("name", CASES)
def test_no_definite_verdict_is_wrong(
    name: str,
    runs: dict[str, Run],
    noisy: dict[str, dict[tuple[str, object], Status]],
    measured: Callable[..., Recording],
) -> None:
    run = runs[name]
    truth = verdicts([run], run)
    assert not wrong(noisy[name], truth)
    assert not wrong(verdicts(measured(run, 25, 0.05, speeds=False), run), truth)


@pytest.mark.extended
def test_few_verdicts_are_unsure(noisy: dict[str, dict[tuple[str, object], Status]]) -> None:
    """At most a tenth of the instances that are about anything; those of runs with violations among them."""
    counts = Counter(status for found in noisy.values() for status in found.values())
    asked = sum(n for status, n in counts.items() if status is not Status.NA)
    assert asked > 100
    assert counts[Status.UNSURE] <= 0.1 * asked
    assert counts[Status.FAIL] > 0


def test_smoothed_places_need_not_agree_with_speeds_better_than_they_are_known() -> None:
    times = np.arange(0.0, 8.0, 0.1)
    junction = find("stop4")
    way = Itinerary.through(junction, 0, 2)
    station = 8.0 * times - 30.0 + 0.15 * (-1.0) ** np.arange(len(times))  # to and fro, at a steady speed
    pose = np.array([way.pose(s) for s in station])
    agent = Agent("a", junction.movements[0, 2])
    steady, known = np.full(len(times), 8.0), np.full(len(times), 0.2)
    tracks = [Track(agent, times, station, steady, pose, spread) for spread in (None, known)]
    found = [{f.kind for f in validate(Recording("t", junction, (track,))[0])} for track in tracks]
    assert found == [{"progress"}, set()]
