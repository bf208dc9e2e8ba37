"""Tests that expect an error, rules that say nothing, and sessions that judge nothing: sessions of one file each."""

import pytest

from .attempts import CHECKED, NOTHING, STOPPED, Attempt, Session
from .shown import shows_each

EXPECTS = {
    "xfail_without_a_reason_over_an_error": Attempt(
        "@pytest.mark.xfail" + CHECKED.format(""), ("ERROR",), {"errors": 1}, "*no gap found*", "raises"
    ),
    "xfail_over_an_error": Attempt(
        "@pytest.mark.xfail(reason='known')" + CHECKED.format(""), ("ERROR",), {"errors": 1}, "*no gap found*", "raises"
    ),
    "known_over_an_error": Attempt(
        "@rvads.known('gaps', reason='finds none')" + CHECKED.format(""), ("ERROR",), {"errors": 1}, "*no gap found*", "raises"
    ),
    "xfail_over_a_typo": Attempt(
        """
        @pytest.mark.xfail(reason="known")
        @here()
        def test_it(run, rule, monitor):
            monitr.check(rule)
        """,
        ("ERROR",),
        says="*name 'monitr' is not defined*",
    ),
    "xfail_over_a_broken_fixture": Attempt(
        """
        @pytest.fixture
        def settings():
            raise ValueError("no settings")

        @pytest.mark.xfail(reason="known")
        @here()
        def test_it(settings, run, rule, monitor):
            monitor.check(rule)
        """,
        ("ERROR",),
        {"errors": 1},
        "*no settings*",
    ),
    "a_run_made_elsewhere": Attempt(
        """
        @pytest.fixture
        def rvads_run():
            return rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "2222", duration=30), rvads.Reference))

        @here()
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """,
        ("ERROR",),
        says="*nothing was simulated: the fixture rvads_run is one of your own*",
    ),
    "known_over_a_pass": Attempt(
        "@rvads.known('races')" + CHECKED.format("duration=20"), ("FAIL",), {"failed": 1}, "*XPASS(strict)* races*", "reference"
    ),
    "known_that_matches_nothing": Attempt(
        """
        @rvads.known("left turns", rule="p6")
        class TestIt:
            @here()
            def test_it(self, run, rule, monitor):
                monitor.check(rule)
        """,
        outcomes={},
        says="*@rvads.known('left turns', rule=('p6',)) matches no cell of any of its tests",
        exits=pytest.ExitCode.USAGE_ERROR,
    ),
    "assert_on_a_run_that_broke_off": Attempt(
        """
        @here(rules=None)
        def test_it(run):
            assert not run.collisions
        """,
        ("ERROR",),
        {"errors": 1},
        "*no gap found*",
        "raises",
    ),
    "end_before_it_gets_in": Attempt(
        "rvads.rule('gets_in', 'forall a. F a@j')\n" + CHECKED.format("rules='gets_in', duration=0.1"),
        ("OPEN",),
        says="*OpenObligation: gets_in*",
    ),
}


@shows_each(EXPECTS)
def test_an_error_is_not_expected_away(case: Attempt, session: Session, pytester: pytest.Pytester) -> None:
    case.hold(session, pytester)


RULES = {
    "rule_without_always": Attempt(
        "rvads.rule('stays_out', 'forall a. !a@j')\n" + CHECKED.format("rules='stays_out'"),
        outcomes={"errors": 1},
        says="*'stays_out' asks for *in the first state only*write G(...)*",
        exits=STOPPED,
    ),
    "predicate_that_is_just_true": Attempt(
        """
        @rvads.predicate("fine", "agent")
        def fine(run, agent):
            return True

        rvads.rule("all_fine", "forall a. G fine(a)")
        """
        + CHECKED.format("rules='all_fine'").replace("\n", "\n        "),
        ("ERROR",),
        says="*predicate 'fine' must return one bool per state*",
    ),
    "no_rules_at_all": Attempt(CHECKED.format("rules=()"), outcomes={"errors": 1}, says="*rules is empty*", exits=STOPPED),
    "redefine_a_shipped_rule": Attempt(
        "rvads.rule('p1', 'forall a. F a@j')\n" + CHECKED.format(""),
        outcomes={"errors": 1},
        says="*'p1' is a shipped rule or rulebook: choose another name*",
        exits=STOPPED,
    ),
}


@shows_each(RULES)
def test_empty_rule_is_refused(case: Attempt, session: Session, pytester: pytest.Pytester) -> None:
    case.hold(session, pytester)


EMPTY = {
    "nothing_but_na": Attempt(CHECKED.format("rules='p4'"), ("NA",), {"skipped": 1}, "*nothing was judged*", exits=NOTHING),
    "catch_the_skip_of_na": Attempt(
        """
        @here(rules="p4")
        def test_it(run, rule, monitor):
            try:
                monitor.check(rule)
            except pytest.skip.Exception:
                pass
        """,
        ("NA",),
        {"passed": 1},
        "*nothing was judged*",
        exits=NOTHING,
    ),
    "nothing_but_provoked": Attempt(
        """
        from conftest import Racer

        @here(rules="full_stop", subject=0, traffic=Racer, classes=None, scenarios="2200", grid="C", duration=6)
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """,
        ("PROVOKED",),
        {"passed": 1},
        "*nothing was judged*",
        "reference",
        exits=NOTHING,
    ),
    "nothing_but_unavoidable": Attempt(
        CHECKED.format("scenarios='1111', classes=None, rules='p2', duration=12"),
        ("UNAVOIDABLE",),
        {"passed": 1},
        "*nothing was judged*",
        "reference",
        exits=NOTHING,
    ),
    "a_rule_that_never_applies": Attempt(
        "rvads.rule('nowhere', 'forall a, j.en. G(a@j & a@j.en -> stopped(a))')\n" + CHECKED.format("rules='nowhere'"),
        ("NA",),
        {"skipped": 1},
        "*nothing was judged*",
        exits=NOTHING,
    ),
    "skip_everything": Attempt(
        "@pytest.mark.skip" + CHECKED.format(""), ("NOT RUN",), {"skipped": 1}, "*nothing was judged*", exits=NOTHING
    ),
}


@shows_each(EMPTY)
def test_session_without_verdicts_is_no_success(case: Attempt, session: Session, pytester: pytest.Pytester) -> None:
    case.hold(session, pytester)
