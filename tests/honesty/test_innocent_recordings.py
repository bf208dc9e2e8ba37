"""What others did in recorded runs, where vehicles also follow each other, is not held against the subject."""

from collections.abc import Callable
from typing import Any

import pytest

import pytest_rvads as rvads

from .byhand import CROSS, GREEN, joined, until_contact
from .cases import told, verdicts
from .shown import shows

Make = Callable[..., rvads.Run]
STANDS = (2, -0.4, [(0, 0.0)])


def hit_from_behind(drive: Make, junction: str, entrance: int, lights: Any) -> rvads.Run:
    """Return a run in which the subject stands at its line and another vehicle drives into it at 8 m/s."""
    front = drive(junction, {entrance: STANDS}, 400, lights, subject=f"a{entrance}")
    return until_contact(joined(front, drive(junction, {entrance: (2, -30.0, [(0, 8.0)])}, 400, lights)))


@shows("hit_from_behind_at_the_line")
def test_who_waits_at_the_line_is_not_to_blame_for_being_hit(drive: Make) -> None:
    run = hit_from_behind(drive, "stop4", 0, None)
    assert verdicts(run)["no_collision"] == "PROVOKED b0"
    assert {rule for rule, text in verdicts(run).items() if text.endswith("a0")} == set()


@shows("hit_from_behind_at_red")
def test_who_waits_at_red_is_not_to_blame_for_being_hit(drive: Make) -> None:
    run = hit_from_behind(drive, "light4", 1, CROSS)
    assert verdicts(run)["no_collision"] == "PROVOKED b1"
    # What it still waits for when the run ends is open by the doing of who ended it.
    assert verdicts(run)["red"].split()[0] == "PROVOKED"
    assert {rule for rule, text in verdicts(run).items() if text.split()[0] in ("FAIL", "OPEN", "ERROR")} == set()


@shows("queue_behind_another")
def test_queued_vehicle_is_not_idle(drive: Make) -> None:
    """a0 idles at green for 15 s; the subject stands 2 m behind it."""
    front = drive("light4", {0: STANDS}, 1500, GREEN)
    run = joined(drive("light4", {0: (2, -7.0, [(0, 0.0)])}, 1500, GREEN, subject="a0"), front)
    assert verdicts(run)["progress"] == "PROVOKED b0"


@shows("no_time_to_react")
@pytest.mark.parametrize("later", [0, 50, 90])
def test_who_enters_just_after_a_runner_had_no_chance(drive: Make, later: int) -> None:
    """a1 runs the sign at 10 m/s and enters at 0.96 s; the subject, which had stopped, enters less than a second after it."""
    vehicles = {1: (2, -10.0, [(0, 10.0)]), 0: (2, -0.5, [(0, 0.0), (95 + later, 10.0)])}
    run = drive("stop4", vehicles, 600, subject="a0")
    assert told(rvads.check(run, "p1")).split()[0] == "PROVOKED"
    assert verdicts(run)["full_stop"] == "PROVOKED a1"
