"""Tests that pass over a violation, or judge something else: sessions of one file each."""

import pytest

from .attempts import FAILED, Attempt, Session, statuses
from .shown import shows, shows_each

SWALLOWED = "*RuleViolation: p1 at t=*and the test continued after the violation*"
SWALLOWING = """
@here()
def test_it(run, rule, monitor):
    try:
        monitor.check(rule)
    except AssertionError:
        {}
"""
PASSES_OVER = {
    "judge_elsewhere": Attempt(
        """
        @here()
        def test_it(run, rule):
            assert rvads.check(run, rule) is not None
        """,
        ("NOT JUDGED",),
        says="*NotJudged: nothing was judged*",
    ),
    "never_ask_the_monitor": Attempt(
        """
        @here()
        def test_it(run, rule, monitor):
            assert run.duration > 0
        """,
        ("NOT JUDGED",),
        says="*NotJudged: nothing was judged*",
    ),
    **{
        name: Attempt(SWALLOWING.format(then), ("FAIL",), says=SWALLOWED)
        for name, then in [
            ("swallow_by_try", "pass"),
            ("swallow_then_skip", "pytest.skip('not today')"),
            ("swallow_then_xfail", "pytest.xfail('some day')"),
        ]
    },
    "swallow_by_raises": Attempt(
        """
        @here()
        def test_it(run, rule, monitor):
            with pytest.raises(rvads.RuleViolation):
                monitor.check(rule)
        """,
        ("FAIL",),
        says=SWALLOWED,
    ),
    "verdict_without_assertion": Attempt(
        """
        @here()
        def test_it(run, rule, monitor):
            monitor.verdict(rule)
        """,
        ("FAIL",),
        says=SWALLOWED,
    ),
    "swallow_then_forget": Attempt(
        """
        rvads.rule("gets_in", "forall a. F a@j")

        @here(rules=None)
        def test_it(run, monitor):
            try:
                monitor.check("p1")
            except AssertionError:
                with contextlib.suppress(Exception):
                    monitor.verdicts.clear()
            monitor.check("gets_in")
        """,
        ("FAIL",),
    ),
    "check_another_rule": Attempt(
        """
        @here(rules=("p1", "p2"))
        def test_it(run, rule, monitor):
            monitor.check("p2")
        """,
        ("ERROR", "FAIL"),
        {"failed": 2},
        says="*this item is about p1, so a verdict on p2 can't be its own*",
    ),
    "judge_another_run": Attempt(
        """
        @here()
        def test_it(run, rule, monitor):
            with contextlib.suppress(Exception):
                monitor.run = rvads.simulate(
                    rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=9), rvads.Reference)
                )
            monitor.check(rule)
        """,
        ("FAIL|ERROR",),
    ),
    "a_monitor_of_its_own": Attempt(
        """
        class Kind:
            def check(self, rule):
                return True

        @pytest.fixture
        def monitor(run):
            return Kind()

        @here()
        def test_it(run, rule, monitor):
            assert monitor.check(rule)
        """,
        ("NOT JUDGED",),
        says="*NotJudged: nothing was judged*",
    ),
    "a_rule_of_its_own": Attempt(
        """
        kind = rvads.rule("kind", "forall a. F a@j")

        @pytest.fixture
        def rule():
            return kind

        @here()
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """,
        ("ERROR",),
        says="*this item is about p1, so a verdict on kind can't be its own*",
    ),
    "another_rule_by_that_name": Attempt(
        """
        @here(rules=None)
        def test_it(run, monitor):
            monitor.check(rvads.Rule("p1", "forall a. F a@j"))
        """,
        ("ERROR",),
    ),
    "parametrize_the_rule": Attempt(
        """
        rvads.rule("gets_in", "forall a. F a@j")

        @pytest.mark.parametrize("rule", ["gets_in"])
        @here()
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """,
        ("ERROR",),
    ),
    "change_the_run_in_place": Attempt(
        """
        @here(rules="speed_limit")
        def test_it(run, rule, monitor):
            run.speed[:] = 0.0
            monitor.check(rule)
        """,
        ("ERROR",),
        says="*ValueError: assignment destination is read-only*",
    ),
    "open_is_a_pass_so_fail_is": Attempt(
        """
        @here()
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """,
        ("FAIL",),
        options=("--rvads-strict=none",),
        says="*RuleViolation: p1 at t=*",
    ),
}


@shows_each(PASSES_OVER)
def test_a_violation_can_t_be_passed_over(case: Attempt, session: Session, pytester: pytest.Pytester) -> None:
    case.hold(session, pytester)


OWN_RUN = """
@pytest.fixture
def run():
    return rvads.simulate(rvads.Case(rvads.Scenario(rvads.find("stop4"), "1133", distance=0.3, duration=9), rvads.Reference))

@here()
def test_it(run, rule, monitor):
    monitor.check(rule)
"""


@shows("a_run_of_its_own")
def test_fixture_named_run_does_not_replace_the_run_of_the_item(session: Session, pytester: pytest.Pytester) -> None:
    """A fixture called `run` hides the plugin's: the item claims one scenario and driver, and another run is judged."""
    result = session(OWN_RUN)
    assert statuses(pytester)[0] not in ("PASS", "NA")
    assert result.ret == FAILED
