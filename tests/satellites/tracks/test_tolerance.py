"""A violation in a recording tells how far it is from PASS: with how large an error of places or speeds it stays definite."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.sweep import LANE_TOLERANCE
from pytest_rvads.satellites.tracks.importing import read_tracks

from .drives import WIDTH, Drive, drive, write_csv

STOP = rvads.find("stop4")
STRAIGHT = drive(STOP, (0, 2))


def beside(distance: float) -> Drive:
    """Return the drive of a vehicle that keeps a distance to the right of the middle of its lane [m]."""
    right = np.column_stack((np.sin(STRAIGHT.heading), -np.cos(STRAIGHT.heading)))
    return replace(STRAIGHT, points=STRAIGHT.points + distance * right)


def note(folder: Path, vehicle: Drive, rule: str, **intake: Any) -> str:
    recording = read_tracks(write_csv(folder / "log.csv", [vehicle]), "stop4", strict=True, **intake)
    verdict = rvads.check(recording[0], rule)
    assert verdict.status is rvads.Status.FAIL
    (note,) = verdict.notes
    assert f"note      {note}" in verdict.explanation
    return note


@pytest.mark.parametrize(
    ("over", "held", "doubted"),
    [(0.3, "by 0.2 m, ", "at 0.4 m"), (0.9, "by 0.8 m, ", "at 1.6 m"), (0.06, "if places", "at 0.1 m")],
)
def test_vehicle_beside_its_lane_is_definite_up_to_the_distance_beyond_the_border(
    tmp_path: Path, over: float, held: str, doubted: str
) -> None:
    # With an error of as much as its body juts out, the vehicle could have kept its lane.
    text = note(tmp_path, beside(STOP.lane_width / 2 - WIDTH / 2 + LANE_TOLERANCE + over), "keep_lane")
    assert held in text
    assert text.endswith(f"{doubted} it is in doubt")
    assert "speeds" not in text


def test_vehicle_over_the_limit_is_definite_up_to_its_excess(tmp_path: Path) -> None:
    seconds, text = note(tmp_path, drive(STOP, (0, 2), speed=10.5), "speed_limit", speed_limit=9.3).split(" s from PASS; ")
    assert text == "speeds may be wrong by 0.5 m/s, at 1 m/s it is in doubt"
    # The rule tolerates 0.5 m/s, and the vehicle is over the limit as long as it is recorded.
    assert float(seconds) > 5.0


def test_vehicle_that_never_slows_down_did_not_stop_whatever_the_error(tmp_path: Path) -> None:
    text = note(tmp_path, STRAIGHT, "full_stop")
    assert text.endswith("a violation even if places are wrong by 1.6 m and speeds are wrong by 2 m/s")


def test_simulated_violation_has_no_error() -> None:
    case = rvads.Case(rvads.Scenario(STOP, "2000"), rvads.RollingStop)
    assert not rvads.check(rvads.simulate(case), "full_stop").notes
