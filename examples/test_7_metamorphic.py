"""Equivalent scenarios have to be judged alike; nobody needs to know how."""

from functools import partial

import pytest

import pytest_rvads as rvads


@pytest.mark.parametrize("directions", ["1010", "2200", "1230"])
def test_reference_is_fair(directions):
    rvads.equivalent(
        rvads.Case(rvads.Scenario(rvads.find("stop4"), directions), rvads.Reference), relations=("rotation", "creation")
    )


def test_the_hidden_zone_is_seen_by_turning_the_scenario():
    only_i2 = partial(rvads.LgsvlLike, i1=False, i3=False, i4=False, i5=False)
    with pytest.raises(rvads.errors.MetamorphicViolation, match="rotation by 1 turns p1"):
        rvads.equivalent(rvads.Case(rvads.Scenario(rvads.find("paper_stop4"), "1010"), only_i2))
