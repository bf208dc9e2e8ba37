"""The road rulebook at the built-in junctions: the subject at every seat in turn, among reference traffic."""

from typing import Any

import pytest_rvads as rvads


@rvads.scenario("stop3", subject="all", grid="C")
@rvads.scenario("stop4", subject="all", grid="C")
def test_all_way_stop(rule: Any, monitor: Any) -> None:
    """20 m before the line, all at once."""
    monitor.check(rule)


@rvads.scenario("light3", subject="all", grid="H")
@rvads.scenario("light4", subject="all", grid="H")
def test_lights(rule: Any, monitor: Any) -> None:
    """20 m before the line; the light of entrance 0 is green at first."""
    monitor.check(rule)
