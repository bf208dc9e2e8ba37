"""Searches over many scenarios that never asked anything, and a rule that means something else in every file."""

import pytest

import pytest_rvads as rvads
from pytest_rvads.satellites.relations.metamorphic import equivalent
from pytest_rvads.scenarios.case import Case
from pytest_rvads.simulators.loop import usual

from .attempts import CHECKED, STOPPED, Session
from .shown import shows


@shows("search_where_nothing_applies")
def test_a_search_in_which_a_rule_never_applied_found_nothing_out(pytestconfig: pytest.Config) -> None:
    """p4 is about lights, and is looked for at stop signs."""

    @rvads.falsify("stop4", rule="p4", autopilot=rvads.Reference, budget=2, duration=1.0)
    def nothing_found() -> None: ...

    with pytest.raises(rvads.errors.ScenarioError, match="p4 was not triggered in any of"):
        nothing_found(pytestconfig=pytestconfig, rvads_vehicle=rvads.Vehicle(), rvads_simulator=usual())


@shows("compare_where_nothing_applies")
def test_a_comparison_in_which_no_rule_applied_found_nothing_out() -> None:
    two = rvads.Scenario(rvads.find("stop4"), "1010", distance=0.3, duration=1)
    with pytest.raises(rvads.errors.ScenarioError, match="no rule applied"):
        equivalent(Case(two, rvads.Reference), rules="p4", relations="creation")


@shows("one_name_for_two_rules")
def test_one_name_for_two_rules_is_refused(session: Session, pytester: pytest.Pytester) -> None:
    """Each of two files registers `calm`; what is harmless in one of them would also judge the tests of the other one."""
    session("rvads.rule('calm', 'forall a. G !speeding(a)')\n" + CHECKED.format("rules='calm'"), name="test_a")
    result = session("rvads.rule('calm', 'forall a. F a@j')\n" + CHECKED.format("rules='calm'"), name="test_b")
    assert result.ret == STOPPED
    result.stdout.fnmatch_lines(["*'calm' is registered at *test_a.py:* and says something else at *test_b.py:*"])
