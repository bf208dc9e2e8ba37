"""What no rule of the road looks at: such drives are bad, and every rule says PASS or NA."""

from collections.abc import Callable
from typing import Any

import pytest_rvads as rvads
from pytest_rvads.logic.conduct.standing import entered
from pytest_rvads.runs.states import Colour

from .byhand import GREEN, joined
from .cases import verdicts
from .shown import shows

Make = Callable[..., rvads.Run]


def kept(run: rvads.Run) -> dict[str, str]:
    """Return the rules that a run keeps, having been asked; none is broken."""
    found = verdicts(run)
    assert set(found.values()) <= {"PASS", "NA"}, found
    return {rule: text for rule, text in found.items() if text == "PASS"}


def behind(drive: Make, gap: float, speeds: Any, ahead: Any, subject: str) -> rvads.Run:
    """Return a run at green: b0 drives 40 m before the line, a0 a gap [m] behind its rear."""
    follower = drive("light4", {0: (2, -44.6 - gap, speeds)}, 1500, GREEN, subject=subject)
    return joined(follower, drive("light4", {0: (2, -40.0, ahead)}, 1500, GREEN))


@shows("yellow_that_it_could_have_stopped_for")
def test_entering_on_yellow_is_not_looked_at(drive: Make) -> None:
    """Yellow comes 20 m before the line at 10 m/s: to stop there takes 2.5 m/s^2."""
    lights = {0: [(0, Colour.GREEN), (100, Colour.YELLOW)], 2: [(0, Colour.GREEN), (100, Colour.YELLOW)]}
    run = drive("light4", {0: (2, -30.0, [(0, 10.0)])}, 700, lights, subject="a0")
    assert run.lights[entered(run)[-1, 0], 0] == Colour.YELLOW
    assert "red" not in kept(run)


@shows("tailgating")
def test_the_gap_to_the_vehicle_ahead_is_not_looked_at(drive: Make) -> None:
    """1 m at 10 m/s is a tenth of a second."""
    assert "no_collision" in kept(behind(drive, 1.0, [(0, 10.0)], [(0, 10.0)], "a0"))


@shows("brake_test")
def test_needless_braking_is_unwatched(drive: Make) -> None:
    """The subject drops from 10 to 1.5 m/s and goes on after 2 s; the vehicle behind it has to brake as hard."""
    run = behind(drive, 12.0, [(0, 10.0), (150, 1.5), (350, 10.0)], [(0, 10.0), (100, 1.5), (300, 10.0)], "b0")
    assert "no_collision" in kept(run)


@shows("slow_driving")
def test_slow_driving_is_not_looked_at(drive: Make) -> None:
    """2 m/s where 11 m/s are allowed."""
    assert "progress" in kept(drive("light4", {0: (2, -20.0, [(0, 2.0)])}, 3500, GREEN, subject="a0"))
