"""The recipe "Add a word" of CONTRIBUTING.md, done from outside: one value, and everything that handles words handles it."""

from collections.abc import Callable

import numpy as np
import pytest

import pytest_rvads as rvads

CRAWL = 1.0
"""[m/s]."""


def crawls(run: rvads.Run, agent: int) -> np.ndarray:
    """Has been slow for two states, this one included."""
    slow = np.abs(run.need("speed")[:, agent]) < CRAWL
    return slow & np.append(False, slow[:-1])


def follow_crawls(_first: rvads.Run, agent: int) -> Callable[[rvads.Run], bool]:
    """The same, state by state."""
    before = False

    def follow(run: rvads.Run) -> bool:
        nonlocal before
        slow = abs(run.need("speed")[0, agent]) < CRAWL
        both, before = bool(slow and before), slow
        return both

    return follow


CRAWLS = rvads.values.Word("crawls", ("agent",), crawls, "{0} has crawled", "{0} has not crawled", follow_crawls)


def test_one_value_is_enough(drive: Callable[..., rvads.Run]) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 5.0), (100, 0.5), (200, 5.0)])}, 300)
    rule = rvads.Rule("brisk", "forall a. G !crawls(a)", words=(CRAWLS,))
    verdict = rvads.check(run, rule)
    assert (str(verdict.status), verdict.time) == ("FAIL", 1.01)
    assert verdict.instances[0].broken == ("a0 has crawled",)
    assert verdict.message == "brisk at t=1.01 s: a0 has crawled"

    monitor = rvads.RuleMonitor(rule, run.junction, run.agents)
    assert run.speed is not None
    said = [str(monitor.step(zone, speed=speed)) for zone, speed in zip(run.zone[:103], run.speed[:103], strict=True)]
    assert said == ["?"] * 101 + ["F"] * 2
    ten = rvads.RuleMonitor(rule, run.junction, run.agents, block=10)
    said = [str(ten.step(zone, speed=speed)) for zone, speed in zip(run.zone[:110], run.speed[:110], strict=True)]
    assert said == ["?"] * 109 + ["F"]
    blind = rvads.Rule("brisk", rule.text, words=(rvads.values.Word("crawls", ("agent",), crawls),))
    alone = rvads.RuleMonitor(blind, run.junction, run.agents)
    for zone, speed in zip(run.zone, run.speed, strict=True):
        assert str(alone.step(zone, speed=speed)) == "?", "without `follow` it sees one state only"


def test_a_word_of_a_conftest(pytester: pytest.Pytester) -> None:
    pytester.makeconftest(
        """
        import numpy as np
        import pytest_rvads as rvads

        @rvads.predicate("crowded", "junction", says="{0} is crowded", denies="{0} is not crowded")
        def crowded(run, junction):
            return (run.zone == rvads.Zone.JUNCTION).sum(axis=1) >= 1

        rvads.rule("calm", "G !crowded(j)")
        """
    )
    pytester.makepyfile(
        """
        import pytest_rvads as rvads

        @rvads.scenario("stop4", classes=1, grid="B", rules="calm", duration=60)
        def test_it(run, rule, monitor):
            monitor.check(rule)
        """
    )
    result = pytester.runpytest("--rvads-autopilot=reference")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*calm at t=* s: the junction is crowded*"])
