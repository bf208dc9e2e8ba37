"""Drivers that overlook a part of the traffic, and policies with a fault, each found by the runs that are the default."""

from functools import lru_cache

import pytest

import pytest_rvads as rvads
from pytest_rvads.campaigns.town_plan import Asked, Plan
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection

from .blind import BLIND

STOP4 = rvads.find("stop4")
SAFETY = "no_collision", "no_conflict", "first_come", "right_first", "left_yields", "right_on_red"


@lru_cache
def default_grid() -> dict[str, Scenario]:
    """Return the runs of ``@rvads.scenario("stop4", subject="all")`` by their names."""
    points = grid(ARRIVALS, 4, STOP4.control)
    return {scenario.name: scenario for scenario in Selection(STOP4, points, subject="all")}


def failed(scenario: Scenario, driver: rvads.Factory) -> set[str]:
    """Return the rules of the road that a driver breaks among reference traffic."""
    run = rvads.simulate(rvads.Case(scenario, driver))
    verdicts = [rvads.check(run, rule) for rule in rvads.rules_for("road", scenario.place)]
    return {v.rule for v in verdicts if v.status is rvads.Status.FAIL and not (v.provoked or v.unavoidable)}
