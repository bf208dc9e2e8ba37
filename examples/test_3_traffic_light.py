"""Traffic lights with the reference autopilot: red, right on red, left turns that yield.

Many cells are NA, each for a reason that the summary of skips (`-rs`) tells: nobody faces a red light with a left
turn ahead, or nobody turns left against oncoming traffic.
"""

import pytest_rvads as rvads


@rvads.scenario("light4", classes=(1, 8, 13, 14, 24), grid="GHJ", cover="rotation")
def test_rules(run, rule, monitor):
    monitor.check(rule)


@rvads.scenario("light3", grid="I")
def test_t_junction(run, rule, monitor):
    monitor.check(rule)
