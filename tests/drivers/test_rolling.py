"""The faulty autopilot does what its docstring says, and breaks the rules that forbid it."""

import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.rolling import RollingStop
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate


def test_it_rolls_over_a_free_line_at_walking_pace() -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=10), RollingStop))
    before = run.zone[:, 0] <= Zone.ENTRANCE
    assert 2.0 < run.speed[before, 0].min() < 3.0
    assert check(run, "full_stop").status == "FAIL"
    assert check(simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=10), Reference)), "full_stop").status == "PASS"


def test_rolling_stop_ignores_the_order_of_arrival() -> None:
    # a0 is held up by a3 and waits; a1, from the right, comes later and goes first.
    case = Scenario(find("stop4"), "2203", distance=[3, 21, 20, 0.3])
    assert check(simulate(Case(case, RollingStop)), "p3").status == "FAIL"
    assert check(simulate(Case(case, Reference)), "p3").status in ("PASS", "NA")


def test_two_that_face_each_other_enter_together() -> None:
    case = Scenario(find("stop4"), "2020", distance=20, speed=5)
    run = simulate(Case(case, RollingStop))
    assert check(run, "p1").status == "FAIL"
    assert not run.collisions
    assert check(simulate(Case(case, Reference)), "p1").status == "PASS"


def test_it_turns_right_on_red_without_looking() -> None:
    # a1 turns right at red; a0 comes from its left at green.
    case = Scenario(find("light4"), "2100", distance=[0.3, 0.3, 0, 0])
    run = simulate(Case(case, RollingStop))
    assert check(run, "p5").status == "FAIL"
    assert check(simulate(Case(case, Reference)), "p5").status == "PASS"
    alone = simulate(Case(Scenario(find("light4"), "0100", distance=20, speed=8), RollingStop))
    assert alone.speed[alone.zone[:, 0] <= Zone.ENTRANCE, 0].min() > 2.0


@pytest.mark.parametrize("code", ["2222", "1313", "1321"])
def test_otherwise_it_obeys_lights(code: str) -> None:
    run = simulate(Case(Scenario(find("light4"), code, distance=20, speed=10), RollingStop))
    assert check(run, "p4").status == "PASS"
    assert check(run, "p6").status in ("PASS", "NA")
    assert run.provenance["end"] == "left"


def test_rolling_stop_yields_pass_fail_and_na() -> None:
    facing = simulate(Case(Scenario(find("stop4"), "2222", distance=[10, 20, 10, 20]), RollingStop))
    in_turn = simulate(Case(Scenario(find("stop4"), "2222", distance=[10, 11, 12, 13]), RollingStop))
    pairs = simulate(Case(Scenario(find("stop4"), "2222", distance=[0.3, 0.3, 20, 20]), RollingStop))
    assert [check(facing, rule).status.value for rule in ("p1", "p4")] == ["FAIL", "NA"]
    assert check(in_turn, "p3").status == "FAIL"
    assert [check(pairs, rule).status.value for rule in ("p1", "p2", "p3")] == ["PASS"] * 3
