"""Verdicts on SUMO's traffic equal a count by hand, however densely it was recorded (only where eclipse-sumo is installed)."""

from functools import cache
from pathlib import Path

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.runs.recording import Recording

from .counting import COUNTS, Found
from .traffic import Traffic, recorded, simulate

sumo = pytest.importorskip("sumo")
HOME = Path(sumo.SUMO_HOME)
RATE = {"stop": 0.22, "lights": 0.27, "yield": 0.25}
SYMMETRIC = ("p1", "no_collision")


@cache
def traffic(folder: Path, kind: str, seconds: float, seed: int) -> Traffic:
    folder.mkdir(exist_ok=True)
    return simulate(kind, folder, HOME, seconds=seconds, rate=RATE[kind], seed=seed)


def violated(recording: Recording, rule: str) -> Found:
    """Return the vehicles of every violated instance; nothing may be left out for want of data."""
    found: Found = set()
    for run in recording:
        verdict = check(run, rule)
        assert not verdict.reason.startswith("not recorded")
        names = {agent.name for agent in run.agents}
        for instance in verdict.instances:
            if instance.status is Status.FAIL:
                who = tuple(name for _, name in instance.binding if name in names)
                found.add(tuple(sorted(who)) if rule in SYMMETRIC else who)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("traffic")


@pytest.mark.extended
@pytest.mark.parametrize("kind", ["stop", "lights", "yield"])
def test_a_few_minutes(folder: Path, kind: str) -> None:
    some = traffic(folder / kind, kind, 100.0, 11)
    at_10_hz = recorded(some, 10)
    assert sum(len(run.excerpt.judged) for run in at_10_hz) == len(some.vehicles)
    for rule, count in COUNTS[kind].items():
        assert violated(at_10_hz, rule) == count(some), rule


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["stop", "lights", "yield"])
def test_a_quarter_of_an_hour(folder: Path, kind: str) -> None:
    some = traffic(folder / f"{kind}15", kind, 900.0, 7)
    wanted = {rule: count(some) for rule, count in COUNTS[kind].items()}
    print({rule: len(found) for rule, found in wanted.items()})
    for every in (1, 4, 10):
        recording = recorded(some, every)
        for rule, found in wanted.items():
            assert violated(recording, rule) == found, (every, rule)
