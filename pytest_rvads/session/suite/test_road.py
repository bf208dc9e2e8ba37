"""Tests by the rulebook road at the built-in junctions: the vehicle under test starts at every entrance in turn, among traffic.

Every class runs in one order of arrival, and the orders change from class to class.
"""

from typing import Any

import pytest_rvads as rvads


@rvads.scenario("stop3", subject="all", classes=(3, 4), grid="S56_26")
@rvads.scenario("stop3", subject="all", classes=(1, 2), grid="S21")
@rvads.scenario("stop4", subject="all", classes=range(5, 25, 5), grid="S56_56_26")
@rvads.scenario("stop4", subject="all", classes=range(4, 25, 5), grid="S26_56_56")
@rvads.scenario("stop4", subject="all", classes=range(3, 25, 5), grid="S46")
@rvads.scenario("stop4", subject="all", classes=range(2, 25, 5), grid="S21")
@rvads.scenario("stop4", subject="all", classes=range(1, 25, 5), grid="C")
def test_all_way_stop(rule: Any, monitor: Any) -> None:
    """All vehicles arrive together, or some or all other vehicles arrive before or after the subject (vehicle under test)."""
    monitor.check(rule)


@rvads.scenario("light3", subject="all", classes=(3, 4), grid="S64")
@rvads.scenario("light3", subject="all", classes=(1, 2), grid="S53")
@rvads.scenario("light4", subject="all", classes=range(3, 25, 3), grid="S64")
@rvads.scenario("light4", subject="all", classes=range(2, 25, 3), grid="S53")
@rvads.scenario("light4", subject="all", classes=range(1, 25, 3), grid="H")
def test_lights(rule: Any, monitor: Any) -> None:
    """All vehicles arrive together, or the traffic arrives 3 or 4 s after the vehicle under test; entrance 0 has green first."""
    monitor.check(rule)


@rvads.scenario("yield4", subject="all", scenarios="2222", grid=("S31", "S42"))
@rvads.scenario("right4", subject="all", scenarios="2222", grid="S31")
def test_yielding(rule: Any, monitor: Any) -> None:
    """Others arrive 1 or 3 s after the subject at yield signs, and 1 s after the subject at a junction without signs."""
    monitor.check(rule)


@rvads.scenario("stop3", subject=0, scenarios=("100", "200"), grid="C")
@rvads.scenario("stop4", subject=0, scenarios=("1000", "2000", "3000"), grid="C")
@rvads.scenario("light3", subject="all", scenarios=("100", "200", "010", "020"), grid="H")
@rvads.scenario("light4", subject="all", scenarios=("1000", "2000", "3000", "0100", "0200", "0300"), grid="H")
def test_alone(rule: Any, monitor: Any) -> None:
    """The vehicle under test is alone on every movement; at lights its entrance has green or red."""
    monitor.check(rule)
