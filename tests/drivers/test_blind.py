"""Drivers that overlook traffic, and policies with a fault: each fails in a run of the default grid, and in one of a town."""

from collections.abc import Mapping
from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import choose_among
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.campaigns.town import Plan, Request
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection

from .blind import BLIND

GRID = {  # driver: run, rule that it breaks there
    "blind left": ("stop4-class06-as1132-s3-cfgS56_56_26", "no_collision"),
    "blind right": ("stop4-class05-as1123-s2-cfgS26_56_56", "no_collision"),
    "blind ahead": ("stop4-class06-as1132-s3-cfgS21", "first_come"),
    "blind to whoever is inside": ("stop4-class06-as1132-s3-cfgS56_56_26", "no_collision"),
    "gaps a second too short": ("stop4-class05-as1123-s2-cfgC", "right_first"),
    "rolling_stop": ("stop4-class01-as1111-s0-cfgS46", "full_stop"),
    "red_light_runner": ("stop4-class01-as1111-s0-cfgC", "full_stop"),
}
TOWN = {
    "blind right": ("sumo_stop4.1-class12-as2321-s2-cfgC", "right_first"),
    "deaf to fast vehicles": ("Town01.222-class03-as212-s0-cfgS31", "no_collision"),
    "gaps a second too short": ("sumo_stop4.1-class12-as2321-s2-cfgC", "right_first"),
    "blind left": ("sumo_stop4.1-class10-as2212-s0-cfgS56_56_26", "no_collision"),
    "blind ahead": ("Town01.26-class03-as122-s1-cfgS42", "left_yields"),
    "blind to whoever is inside": ("Town01.26-class03-as122-s1-cfgS42", "no_conflict"),
    "rolling_stop": ("Town01.26-class03-as221-s2-cfgH", "right_on_red"),
    "red_light_runner": ("Town01.26-class00-as010-s1-cfgH", "red"),
}


SAFETY = ("no_collision", "no_conflict", "first_come", "right_first", "left_yields", "yield_sign", "right_on_red")
"""Rules about other vehicles."""


def failed(scenario: Scenario, name: str) -> set[str]:
    """Return the rules of the road that a driver breaks as the subject among reference traffic."""
    run = rvads.simulate(rvads.Case(scenario, BLIND.get(name) or rvads.traffic(name)))
    verdicts = [rvads.check(run, rule) for rule in rules_for("road", scenario.place)]
    return {v.rule for v in verdicts if v.status in ("FAIL", "OPEN") and not (v.provoked or v.unavoidable)}


@pytest.fixture(scope="module")
def default_grid() -> Mapping[str, Scenario]:
    """The runs of ``@rvads.scenario("stop4", subject="all")`` by their names."""
    place = rvads.find("stop4")
    return {scenario.name: scenario for scenario in Selection(place, grid(ARRIVALS, 4, place.control), subject="all")}


@pytest.fixture(scope="module")
def town(shared: Path) -> Mapping[str, Scenario]:
    """The runs of ``rvads town Town01.xodr sumo_stop4.xodr`` by their names."""
    places = choose_among([("*", shared / "maps" / file) for file in ("Town01.xodr", "sumo_stop4.xodr")]).junctions
    plan = Plan(places, Request(rvads.Reference, subject="all"))
    return {planned.name: planned.case.scenario for planned in plan}


@pytest.mark.parametrize("driver", BLIND)
def test_driver_alone_crosses_and_breaks_no_rule(driver: str) -> None:
    """Without other vehicles there is nothing to overlook."""
    alone = rvads.Scenario(rvads.find("stop4"), "2000", subject=0)
    assert rvads.simulate(rvads.Case(alone, BLIND[driver])).provenance["end"] == "left"
    assert not failed(alone, driver)


QUICK = ("blind right", "gaps a second too short", "rolling_stop")


@pytest.mark.parametrize("driver", [pytest.param(name, marks=[] if name in QUICK else pytest.mark.extended) for name in GRID])
def test_default_grid_has_a_run_in_which_the_fault_shows(default_grid: Mapping[str, Scenario], driver: str) -> None:
    run, rule = GRID[driver]
    assert rule in failed(default_grid[run], driver)
    assert not failed(default_grid[run], "reference")


@pytest.mark.extended
@pytest.mark.parametrize("driver", TOWN)
def test_town_has_a_run_in_which_the_fault_shows(town: Mapping[str, Scenario], driver: str) -> None:
    run, rule = TOWN[driver]
    assert rule in failed(town[run], driver)
    assert not failed(town[run], "reference")


@pytest.mark.extended
def test_rolling_stop_breaks_full_stop_in_a_town_with_stop_signs_and_the_reference_does_not(shared: Path) -> None:
    places = choose_among([("*", shared / "maps" / "sumo_stop4.xodr")]).junctions
    cases = [planned.case.scenario for planned in Plan(places, Request(rvads.Reference, subject="all"))]
    free = [scenario for scenario in cases if sum(map(bool, scenario.placed)) == 1 or scenario.configuration == "S46"]
    assert len(free) >= 12 + 7
    for scenario in free[:2] + free[-2:]:
        assert "full_stop" in failed(scenario, "rolling_stop")
        assert not failed(scenario, "reference")


@pytest.mark.extended
@pytest.mark.parametrize("driver", BLIND)
def test_first_tests_of_a_user_fail_by_a_rule_about_other_vehicles(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, driver: str
) -> None:
    assert main(["init", "."]) == 0
    (pytester.path / "conftest.py").unlink()
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    result = pytester.runpytest("-x", "-k", " or ".join(SAFETY), f"--rvads-autopilot=blind:{BLIND[driver].__name__}")
    assert result.parseoutcomes()["failed"] == 1


@pytest.mark.extended
@pytest.mark.parametrize("driver", BLIND)
def test_bundled_tests_fail_by_a_rule_about_other_vehicles(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch, driver: str
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    named = f"--rvads-autopilot=blind:{BLIND[driver].__name__}"
    result = pytester.runpytest("--pyargs", "pytest_rvads.session.suite", "-x", "-k", " or ".join(SAFETY), named)
    assert result.parseoutcomes()["failed"] == 1
