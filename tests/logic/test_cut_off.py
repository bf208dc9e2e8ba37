"""Runs that end before the subject has crossed: nothing is known of its crossing, so nothing has passed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.runs.run import Facts, Run

Drive = Callable[..., Run]
LENGTH = 4.6
"""Of a vehicle [m]."""


def crossing(drive: Drive, behind: float) -> Run:
    """Return a run of a0 that ends with its rear so far behind the junction [m]."""
    run = drive("stop4", {0: (2, -2.0, [(0, 1.0), (150, 0.0), (250, 5.0)])}, 2000)
    station = run.need("station")[:, 0]
    steps = int((station - LENGTH - run.agents[0].way.length < behind).sum())
    return part(run, steps)


def part(run: Run, steps: int, **changes: Any) -> Run:
    names = ("zone", "lights", "station", "speed", "pose")
    return replace(run, **{name: getattr(run, name)[:steps] for name in names}, facts=Facts(subject="a0"), **changes)


@pytest.mark.parametrize(("behind", "status"), [(-0.5, "NA"), (0.5, "PASS")])
def test_rear_of_the_subject_decides_what_has_crossed(drive: Drive, behind: float, status: str) -> None:
    verdict = check(crossing(drive, behind), "full_stop")
    assert verdict.status == status
    assert verdict.reason.startswith("cut off: ") == (status == "NA")


def test_violation_before_the_end_stands(drive: Drive) -> None:
    run = part(drive("stop4", {0: (2, -10.0, [(0, 5.0)])}, 400), 220)
    assert check(run, "full_stop").status == "FAIL"


def test_runs_without_a_subject_are_judged_as_far_as_they_go(drive: Drive) -> None:
    run = replace(crossing(drive, -0.5), facts=Facts())
    assert check(run, "full_stop").status == "PASS"
