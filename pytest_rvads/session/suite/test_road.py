"""The rulebook road at the built-in junctions: the subject at every seat in turn, among reference traffic.

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
    """All vehicles arrive together, or all others, or one of them, arrive before or after the subject."""
    monitor.check(rule)


@rvads.scenario("light3", subject="all", classes=(3, 4), grid="S64")
@rvads.scenario("light3", subject="all", classes=(1, 2), grid="S53")
@rvads.scenario("light4", subject="all", classes=range(3, 25, 3), grid="S64")
@rvads.scenario("light4", subject="all", classes=range(2, 25, 3), grid="S53")
@rvads.scenario("light4", subject="all", classes=range(1, 25, 3), grid="H")
def test_lights(rule: Any, monitor: Any) -> None:
    """All vehicles arrive together, or the others 3 or 4 s after the subject; the light of entrance 0 is green at first."""
    monitor.check(rule)


@rvads.scenario("stop3", subject=0, scenarios=("100", "200"), grid="C")
@rvads.scenario("stop4", subject=0, scenarios=("1000", "2000", "3000"), grid="C")
@rvads.scenario("light3", subject="all", scenarios=("100", "200", "010", "020"), grid="H")
@rvads.scenario("light4", subject="all", scenarios=("1000", "2000", "3000", "0100", "0200", "0300"), grid="H")
def test_alone(rule: Any, monitor: Any) -> None:
    """The subject is alone: on every movement, at lights from an entrance with green and from an entrance with red."""
    monitor.check(rule)
