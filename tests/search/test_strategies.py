"""Strategies: what they promise of every example, and what they shrink to."""

from collections.abc import Callable

import pytest
from hypothesis import find, given, settings
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.search import strategies

LAW = settings(deadline=None, derandomize=True, max_examples=60)


@LAW
@given(strategies.junctions(control="stop"))
def test_junctions_by_control(junction: rvads.Junction) -> None:
    assert junction.control is JunctionControl.STOP


@LAW
@given(st.integers(3, 8).flatmap(strategies.abstract_scenarios))
def test_partial_scenarios_have_a_vehicle(code: tuple[int, ...]) -> None:
    assert any(code)
    assert all(0 <= d < len(code) for d in code)


@LAW
@given(strategies.abstract_scenarios(5, partial=False))
def test_full_scenarios_have_a_vehicle_on_each_arm(code: tuple[int, ...]) -> None:
    assert 0 not in code


@LAW
@given(strategies.scenarios("light3", near=0.5, far=12, wait=(1, 2)))
def test_scenarios_stay_in_range_and_inside_the_braking_envelope(scenario: rvads.Scenario) -> None:
    scenario.starts()
    assert 1 <= scenario.wait <= 2
    for entrance in scenario.creation:
        distance, speed = scenario.start(entrance)
        assert 0.5 <= distance <= 12
        assert speed <= rvads.vmax(distance)


@pytest.mark.extended
def test_scenarios_shrink_to_few_vehicles_and_round_numbers() -> None:
    few = settings(max_examples=100, derandomize=True, deadline=None)
    simplest = find(strategies.scenarios(), lambda scenario: sum(map(bool, scenario.directions)) >= 2, settings=few)
    assert sum(map(bool, simplest.directions)) == 2
    assert set(simplest.speeds) == {0.0}
    assert set(simplest.distances) == {20.0}
    assert simplest.wait == 1.5


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: strategies.junctions(ways=5), "no built-in junction"),
        (lambda: strategies.abstract_scenarios(2), "must be 3 to 8"),
        (lambda: strategies.distances(5, 1), "distances must go from"),
        (lambda: strategies.waits(-1, 1), "waits must begin at 0"),
        (lambda: strategies.scenarios("stop5"), "unknown junction 'stop5'"),
        (lambda: strategies.scenarios("stop4", subject=9), "subject must be an entrance of 'stop4', 0 to 3, got 9"),
    ],
)
def test_misuse(call: Callable[[], object], says: str) -> None:
    with pytest.raises(rvads.RvadsError, match=says):
        call()
