"""Rationality, determinacy, and sweeps over chance: kept by the reference, broken by autopilots made to break them."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.search.chance import Interval, intervals

NONE: dict[str, Any] = {"i1": False, "i2": False, "i3": False, "i4": False, "i5": False}


class Tired(rvads.Reference):
    """After seven seconds it looks at nobody any more."""

    def control(self, seen: Observation) -> Control:
        return super().control(seen._replace(others=()) if seen.time > 7 else seen)


def test_reference_is_rational_and_determinate() -> None:
    rvads.rational(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2200", distance=5), rvads.Reference), farther=(5,))
    rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1300", distance=(20, 12, 20, 20)), rvads.Reference), at=2.0)


def test_tiring_driver_is_not_rational() -> None:
    with pytest.raises(rvads.errors.MetamorphicViolation, match="20 m farther away: turns p1 from PASS into FAIL") as caught:
        rvads.rational(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2020", distance=1), Tired), "p1", farther=(20,))
    assert "20 m farther away" in caught.value.__notes__[0]


def test_driver_counting_from_the_start_is_not_determinate() -> None:
    with pytest.raises(rvads.errors.MetamorphicViolation, match="restarted at 4 s"):
        rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2020"), Tired), "p1", at=4.0)


def test_case_that_can_not_be_restarted_is_refused() -> None:
    with pytest.raises(rvads.errors.ScenarioError, match="no rule passes in"):
        rvads.rational(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2000"), rvads.Reference))
    with pytest.raises(rvads.errors.ScenarioError, match="its lights would start anew"):
        rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("light4"), "2200"), rvads.Reference))
    walked = rvads.Scenario(rvads.find("zebra4"), "2000", pedestrians=[rvads.Pedestrian(0)])
    with pytest.raises(rvads.errors.ScenarioError, match="its pedestrians would start anew"):
        rvads.determinate(rvads.Case(walked, rvads.Reference))
    with pytest.raises(rvads.errors.ScenarioError, match="past the stopping line at 9 s"):
        rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2200"), rvads.Reference), at=9.0)
    with pytest.raises(rvads.errors.ScenarioError, match="can't be restarted at 1000"):
        rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2200"), rvads.Reference), at=1000)


class Parked(rvads.Autopilot):
    """It brakes all the time."""

    def control(self, seen: Observation) -> Control:
        return Control(0.0, 1.0, 0.0)


def test_driver_that_never_crosses_is_not_determinate() -> None:
    with pytest.raises(rvads.errors.ScenarioError, match=r"the run of stop4-.* shows no crossing"):
        rvads.determinate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2200", distance=5, duration=5), Parked))


def test_bisection_finds_the_edges_of_an_interval() -> None:
    evaluated: list[float] = []

    def statuses(waits: Sequence[float]) -> list[rvads.Status]:
        evaluated.extend(waits)
        return [rvads.Status.FAIL if 0.37 <= wait < 1.42 else rvads.Status.PASS for wait in waits]

    result = intervals(statuses, 0, 4, step=0.5)
    assert result == (
        Interval(0.0, 0.36, rvads.Status.PASS),
        Interval(0.37, 1.41, rvads.Status.FAIL),
        Interval(1.42, 4.0, rvads.Status.PASS),
    )
    assert len(evaluated) == len(set(evaluated)) < 25


def never(waits: Sequence[float]) -> list[rvads.Status]:
    return [rvads.Status.NA for _ in waits]


def test_interval_of_a_single_draw() -> None:
    assert intervals(never, 1.5, 1.5) == (Interval(1.5, 1.5, rvads.Status.NA),)


def test_right_on_red_after_a_timer_fails_for_some_draws() -> None:
    scenario = rvads.Scenario(rvads.find("paper_light4"), "1100", distance=(2, 1, 20, 20))
    spread = rvads.sweep(rvads.Case(scenario, partial(rvads.LgsvlLike, **(NONE | {"i4": True}))), "p5", 0, 1, step=0.5)
    first, second = spread.intervals
    assert (first.status, second.status) == (rvads.Status.FAIL, rvads.Status.PASS)
    assert spread.status is rvads.Status.FAIL
    assert sum(spread.shares.values()) == pytest.approx(1)
    with pytest.raises(rvads.RuleViolation, match=rf"p5 depends on the draw in .*: FAIL from 0.00 to {first.high:.2f} s"):
        spread.check()
    # Single draws on both sides confirm the edge.
    for wait, status in ((first.high, rvads.Status.FAIL), (second.low, rvads.Status.PASS)):
        once = rvads.sweep(rvads.Case(scenario, partial(rvads.LgsvlLike, **(NONE | {"i4": True}))), "p5", wait, wait)
        assert once.status is status
    assert second.low - first.high == pytest.approx(0.01)


@pytest.mark.extended
def test_parallel_sweep_gives_the_same_result() -> None:
    scenario = rvads.Scenario(rvads.find("paper_light4"), "1100", distance=(2, 1, 20, 20))
    case = rvads.Case(scenario, partial(rvads.LgsvlLike, **(NONE | {"i4": True})))
    alone, beside = (rvads.sweep(case, "p5", 0, 1, step=0.5, executor=executor) for executor in (1, 2))
    assert alone == beside
    assert len(alone.intervals) == 2


def test_empty_range_of_a_sweep_is_refused() -> None:
    with pytest.raises(rvads.errors.ScenarioError, match="range of a draw"):
        intervals(never, 2, 1)
    with pytest.raises(rvads.errors.ScenarioError, match="at least one tick"):
        intervals(never, 0, 1, step=0)
