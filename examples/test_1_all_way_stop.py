"""An all-way stop with the reference autopilot: every class of scenarios, judged by the paper's rules p1, p2, p3.

The reference autopilot obeys, so nothing fails. Where four vehicles arrive at the same time each has another one on its right,
a cycle: whoever moves first breaks p2, whatever it is. Such a violation is told as unavoidable, and fails no test unless
``--rvads-strict=unavoidable`` is given.
"""

import pytest_rvads as rvads


@rvads.scenario("stop4", grid="CD", rules=("p1", "p2", "p3"))
def test_rules(run, rule, monitor):
    monitor.check(rule)


@rvads.scenario("stop4", grid="E", rules=("p1", "p2", "p3"))
def test_two_arrive_first(run, rule, monitor):
    monitor.check(rule)


@rvads.scenario("stop3", grid="BE", cover="scenario")  # no `rule` argument: one item per run
def test_nobody_collides_and_everybody_leaves(run):
    assert not run.collisions
    assert all(run.entry(column) is not None for column in range(3))
