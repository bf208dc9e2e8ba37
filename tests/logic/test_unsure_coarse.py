"""Recordings at 10 Hz: every definite verdict is the one at 100 Hz."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from pytest_rvads import Run, Status, check
from pytest_rvads.runs.readers import read_recorded
from pytest_rvads.runs.states import Colour, Zone

from ..run_builders import coarse

RULES = ("p1", "p2", "p3", "p4", "p5", "p6")
KEPT = {Status.PASS, Status.NA}


@pytest.mark.extended
@pytest.mark.parametrize("name", ["4-way-stop", "4-way-light", "t-way-stop", "t-way-light"])
def test_shared_recordings_thinned(name: str, shared: Path) -> None:
    counts: Counter[Status] = Counter()
    for run in read_recorded(shared / "runs" / f"{name}.json"):
        for rule in RULES:
            truth = {i.binding: i.status for i in check(run, rule).instances}
            for i in check(coarse(run, 10), rule).instances:
                counts[i.status] += 1
                if i.status is not Status.UNSURE and i.status is not truth[i.binding]:
                    assert {i.status, truth[i.binding]} <= KEPT, (run.label, rule, i)
    assert counts[Status.PASS] + counts[Status.FAIL] > counts[Status.UNSURE] > 0


def test_events_between_the_same_two_samples_have_no_order(make: Callable[..., Run]) -> None:
    """One leaves the junction at 3.95 s, the other enters at 3.95 s or 3.92 s: at 10 Hz that is the same."""
    for enters, fine in ((395, Status.PASS), (392, Status.FAIL)):
        run = make("stop4", {0: (2, 100, 200, 395), 1: (2, 120, enters, 600)}, 700)
        assert check(run, "p1").status is fine
        assert check(coarse(run, 10), "p1").status is Status.UNSURE
    run = make("stop4", {0: (2, 100, 200, 395), 1: (2, 120, 380, 600)}, 700)
    assert check(coarse(run, 10), "p1").status is Status.FAIL  # 0.15 s are a sample in between


def test_vehicle_skipping_the_entrance_zone_was_at_the_entrance(make: Callable[..., Run]) -> None:
    """Whoever drives 12.8 m/s is at the entrance for 0.08 s, and may be so between two samples."""
    run = make("light4", {0: (2, 202, 210, 320)}, 400, {0: [(0, Colour.RED)]})
    skipping = coarse(run, 10, 1)
    assert Zone.ENTRANCE not in skipping.zone
    verdict = check(skipping, "p4")
    assert check(run, "p4").status is Status.FAIL
    assert verdict.status is Status.FAIL
    assert verdict.time == pytest.approx(2.1, abs=0.1)


def test_a_light_turns_while_somebody_enters(make: Callable[..., Run]) -> None:
    run = make("light4", {0: (2, 150, 205, 320)}, 400, {0: [(0, Colour.RED), (207, Colour.GREEN)]})
    verdict = check(coarse(run, 10), "p4")
    assert check(run, "p4").status is Status.FAIL
    assert verdict.status is Status.UNSURE
    assert "light 0 turned green at 2.10 s" in verdict.reason
