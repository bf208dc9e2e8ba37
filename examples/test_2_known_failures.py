"""A faulty autopilot: what it breaks, and how known failures are marked.

`rvads.RollingStop` takes stop signs for yield signs. It keeps the rules where vehicles arrive two by two; where two that
face each other arrive alone they enter together (p1), and who came first does not matter to it (p3). The marks make those
cells a strict xfail: the build stays green, and turns red when one of them passes. Remove a mark to see the failure, with
the vehicles, the instant, a replay page and the line that reruns it.
"""

import pytest

import pytest_rvads as rvads


@pytest.fixture
def rvads_autopilot():
    """Return the system under test."""
    return rvads.RollingStop


@rvads.scenario("stop4", classes=(1, 7, 19, 24), grid="E")
def test_two_by_two(run, rule, monitor):
    monitor.check(rule)


@rvads.known("rolls", rule="p1", reason="two that face each other enter together")
@rvads.scenario("stop4", classes=(1, 7, 19, 24), distances=(10, 20, 10, 20), rules=("p1", "p2"))
def test_facing_each_other(run, rule, monitor):
    monitor.check(rule)


@rvads.known("rolls", rule="p3", reason="lets pass who stands to the right, not who came first")
@rvads.scenario("stop4", classes=(1, 7, 19, 24), distances=(10, 11, 12, 13))
def test_one_after_the_other(run, rule, monitor):
    monitor.check(rule)
