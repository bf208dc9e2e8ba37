"""Let Hypothesis look for a scenario that breaks a rule; what it finds, it makes as simple as it can."""

from functools import partial

import pytest

import pytest_rvads as rvads


@rvads.falsify("stop4", rule="p1", budget=8)
def test_nobody_meets_in_the_junction():
    """The reference autopilot: nothing is found."""


@pytest.mark.xfail(strict=True, raises=rvads.RuleViolation, reason="I3: ties are decided by creation order")
@rvads.falsify("stop4", rule="p2", autopilot=partial(rvads.LgsvlLike, i1=False, i2=False), budget=60)
def test_right_before_left():
    """The LGSVL-like autopilot: two vehicles suffice."""
