"""Rationality and determinacy: kept by the reference, broken by autopilots made to break them."""

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Control, Observation


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
