"""Staggered configurations: the subject and the others arrive one after the other."""

from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.support.errors import ScenarioError

OFFSETS = {  # distance of the subject, distances of the others [m]
    "stop4": (36.0, [21.0, 26.0, 31.0, 46.0, 51.0, 56.0]),
    "light3": (20.0, [31.0, 42.0, 53.0, 64.0, 75.0]),
    "yield4": (20.0, [31.0, 42.0, 53.0, 64.0, 75.0]),
    "right4": (20.0, [31.0, 42.0, 53.0, 64.0, 75.0]),
}


def staggered(place: Junction, *names: str, **asked: Any) -> list[Scenario]:
    """Return the scenarios of class 1 in staggered configurations, or of those of some names."""
    points = grid(names or "staggered", len(place.entrances), place.control)
    given: dict[str, Any] = {"classes": (1,), "subject": 1} | asked
    return list(Selection(place, points, **given))


@pytest.mark.parametrize("name", OFFSETS)
def test_staggered_grid_varies_the_starts_of_traffic_only(name: str) -> None:
    own, others = OFFSETS[name]
    place, count = rvads.find(name), len(rvads.find(name).entrances)
    scenarios = staggered(place, cover="rotation")
    for scenario in scenarios:
        starts = [scenario.start(entrance)[0] for entrance in range(count)]
        assert starts.pop(1) == own
        assert len({*starts}) == 1
    assert {scenario.start(0)[0] for scenario in scenarios} == {*others}
    assert {speed for scenario in scenarios for speed in scenario.speeds} == {8.0}


@pytest.mark.parametrize("name", OFFSETS)
def test_scenario_of_a_staggered_id(name: str) -> None:
    for scenario in staggered(rvads.find(name), subject="all", cover="rotation", followers=(0, 2)):
        assert from_id(scenario.name) == scenario


def test_label_names_the_metres_of_the_others() -> None:
    assert [s.configuration for s in staggered(rvads.find("stop4"))] == ["S21", "S26", "S31", "S46", "S51", "S56"]
    assert [s.configuration for s in staggered(rvads.find("stop4"), "S46", "C")] == ["S46", "C"]


def test_others_of_different_metres_follow_each_other_counter_clockwise_from_the_subject() -> None:
    scenarios = staggered(rvads.find("stop4"), "S26_46_56", subject="all", cover="rotation")
    for scenario in scenarios:
        starts = [scenario.start((scenario.subject + further) % 4)[0] for further in range(4)]
        assert starts == [36.0, 26.0, 46.0, 56.0]
        assert from_id(scenario.name) == scenario
    assert {scenario.subject for scenario in scenarios} == {0, 1, 2, 3}


def test_metres_of_another_number_of_others_are_refused() -> None:
    with pytest.raises(ScenarioError, match="'S26_56' is for 3 entrances, the junction has 4"):
        staggered(rvads.find("stop4"), "S26_56")


def test_staggered_configuration_without_a_subject_is_refused() -> None:
    with pytest.raises(ScenarioError, match="S21 is staggered around a subject, and there is none: say subject=0 or 'all'"):
        staggered(rvads.find("stop4"), subject=None)


def test_short_approaches_take_the_nearest_start_that_fits() -> None:
    (point,) = grid("S53", 3, rvads.find("light3").control)
    assert point.around(0, [158.0, 35.7, 42.2]).distances == (20.0, 35.0, 42.0)
    assert point.around(1, [14.2, 200.0, 4.0]).distances == (14.0, 20.0, 10.0)  # 4 m are too short for everybody


def test_traffic_keeps_its_offsets_if_the_subject_starts_nearer() -> None:
    early, late = grid(("S21", "S46"), 4, rvads.find("stop4").control)
    assert early.around(2, [90.0, 90.0, 31.5, 90.0]).distances == (16.0, 16.0, 31.0, 16.0)
    assert late.around(2, [90.0, 90.0, 31.5, 90.0]).distances == (41.0, 41.0, 31.0, 41.0)
    assert early.around(2, [90.0, 90.0, 20.0, 90.0]).distances == (10.0, 10.0, 20.0, 10.0)  # where 8 m/s can still be stopped


@pytest.mark.parametrize(("label", "least", "most"), [("S21", -1.8, -1.2), ("S46", 0.7, 1.3), ("S26_56_56", -1.3, -0.7)])
def test_others_arrive_a_second_apart_for_every_ten_metres(label: str, least: float, most: float) -> None:
    """The others of an all-way stop come from 15 m nearer, 10 m farther, and one of them from 10 m nearer."""
    scenario = from_id(f"stop4-class19-as2222-s0-cfg{label}")
    times = {
        one.agent: one.arrival for one in rvads.kpis(rvads.simulate(rvads.Case(scenario, rvads.traffic("reference")))).vehicles
    }
    assert times["a0"] is not None
    assert times["a1"] is not None
    assert least < times["a1"] - times["a0"] < most
