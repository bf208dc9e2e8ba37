"""Several lanes per arm: lights with turn lanes, where the left turn has a lane and an arrow of its own, and queues.

A scenario gives the directions lane by lane, the arms parted by ``_``, lanes from the kerb: in ``10_03_10_00`` one turns right on
the lane at the kerb of arm 0, named ``a0.0``, and one turns left on the lane beside it of arm 1, named ``a1.1``. With
``followers=1`` another one waits behind each, ``a0.0+1``.
"""

import pytest_rvads as rvads

JUNCTION = rvads.find("lanes4")


def test_left_turns_have_green_alone():
    """The two lanes of an arm are in phases of their own, each with that of the arm across."""
    names = [{JUNCTION.vehicle_at(entrance) for entrance in group} for group in JUNCTION.phase_groups]
    assert names == [{"a0.0", "a2.0"}, {"a0.1", "a2.1"}, {"a1.0", "a3.0"}, {"a1.1", "a3.1"}]


def test_queues_on_both_lanes_get_through():
    """Two vehicles on each lane of two arms that face each other: all leave, nobody collides."""
    scenario = rvads.Scenario(JUNCTION, "23_00_13_00", distance=5, followers=1, duration=90)
    run = rvads.simulate(rvads.Case(scenario, rvads.Reference))
    assert not run.collisions
    assert all(run.entry(column) is not None for column in range(len(run.agents)))
    assert rvads.check(run, "red").status in ("PASS", "NA")
