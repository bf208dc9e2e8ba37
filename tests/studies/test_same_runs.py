"""Critical starts beside other methods: what counts as found, and how runs are counted."""

from dataclasses import replace
from random import Random
from statistics import median

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.satellites.starts.critical import critical_starts
from pytest_rvads.satellites.starts.lines import Begin, lines_at
from studies.critical_power import Find, found_by, settings
from studies.same_runs import POOLS, SameRuns, first_runs, interval_of_median, row, rules_shown, summary

LINE = lines_at(find("stop4"))[0][0]
FIND = Find("dawdles", 6, ("keep_clear",), 6, ("keep_clear",), LINE)


@pytest.mark.extended
def test_critical_starts_find_the_dawdler_on_the_first_line() -> None:
    critical = found_by("dawdles")
    assert (critical.line, critical.safety_rules) == (LINE, ("keep_clear",))


@pytest.mark.extended
def test_turn_without_a_stop_fails_on_red_and_the_reference_passes() -> None:
    on_red = next(group[0] for group in lines_at(find("light4")) if group[0].begin is Begin.RED)
    faulty, sound = (replace(setting, rules=rules_for("road")) for setting in settings("no stop right on red"))
    assert "right_on_red" in [side.rule for side in critical_starts([[on_red]], faulty, executor=1)]
    assert [side.rule for side in critical_starts([[on_red]], sound, executor=1)] == ["", ""]


def test_fault_shown_by_a_rule_that_the_reference_keeps() -> None:
    alone = rvads.Scenario(find("stop4"), "2000", subject=0)
    assert rules_shown("ignores stop", alone) == ("full_stop",)
    assert rules_shown("blind to the left", alone) == ()


def test_pools_of_scenarios_that_can_be_simulated() -> None:
    for pool in POOLS.values():
        starts = pool("dawdles")
        assert starts == pool("dawdles")
        assert {start.place.name for start in starts} == {"stop4", "light4", "yield4", "right4"}
        assert all(start.starts() for start in starts)


def test_first_run_in_random_orders() -> None:
    assert first_runs(0, 5, Random(0), 3) == [6, 6, 6]
    assert first_runs(5, 5, Random(0), 3) == [1, 1, 1]
    counts = first_runs(1, 99, Random(0), 400)  # uniform from 1 to 99: standard error of the median about 2.5
    assert 40 < median(counts) < 60


def test_interval_of_the_median_reflects_the_pool() -> None:
    """Of 5 hits in 100, the median is about 13; pools with 1 to 10 hits are likely, with medians from 50 to 6."""
    low, high = interval_of_median(5, 100)
    assert 4 < low < 10
    assert 20 < high < 101
    assert interval_of_median(0, 100) == (101, 101)


def test_row_and_summary_count_only_rules_about_other_vehicles() -> None:
    pools = {"random starts": (("speed_limit",), ()), "class covering": (("keep_clear",),)}
    measured = SameRuns(FIND, pools, (3, 5, 41))
    assert row(measured).split(" | ")[1:] == [
        "6",
        "keep_clear",
        "6",
        "keep_clear",
        "> 2 (> 2 to > 2), 0%",
        "1 (1 to 1), 100%",
        "5 (3 to > 40), 67% |",
    ]
    assert summary([measured], (1, 6)).splitlines()[2:] == ["| 1 | 0 | 0.0 | 1.0 |", "| 6 | 1 | – | – |"]
