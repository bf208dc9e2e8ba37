"""Timelines tell the same as verdicts: since when an obligation is due, and when it was violated."""

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import rule
from pytest_rvads.satellites.lgsvl import LgsvlLike
from pytest_rvads.satellites.pages.replay import timelines
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import FormulaError


@pytest.mark.parametrize(
    ("scenario", "names"),
    [
        (Scenario(find("stop4"), "1133", distance=0.3), ("p1", "p2", "p3")),
        (Scenario(find("light4"), "1132", distance=0.3), ("p4", "p5", "p6")),
    ],
    ids=["stop", "light"],
)
def test_timelines_and_verdicts_agree(scenario: Scenario, names: tuple[str, ...]) -> None:
    run = simulate(Case(scenario, LgsvlLike))
    seen = set()
    for name in names:
        lines = {line.binding: line for line in timelines(run, name)}
        for instance in check(run, name).instances:
            seen.add(instance.status)
            changes = lines[instance.binding].changes
            violated = [tick for tick, word in changes if word == "violated"]
            assert violated == ([instance.failed] if instance.status is Status.FAIL else [])
            # p1 has nothing to wait for: it is violated in a state, not by the end of an obligation.
            if name != "p1" and instance.trigger not in (None, instance.failed):
                assert (instance.trigger, "due") in changes
    assert {Status.FAIL, Status.PASS} <= seen


def test_a_monitor_can_be_satisfied_for_good_before_the_run_ends() -> None:
    run = simulate(Case(Scenario(find("stop4"), "1000", distance=5.0), Reference))
    (line,) = timelines(run, rule("passes", "forall a, j. F a@j"))
    assert [word for _, word in line.changes] == ["watching", "satisfied"]
    entered = run.entry(0)
    assert entered is not None
    assert line.changes[-1][0] == round(entered / run.dt)
    assert line.moved


def test_an_unknown_rule_is_refused_by_name() -> None:
    run = simulate(Case(Scenario(find("stop4"), "1000", distance=1.0, duration=0.1), Reference))
    with pytest.raises(FormulaError, match="p99"):
        timelines(run, "p99")
