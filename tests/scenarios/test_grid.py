"""Configurations, also staggered ones around a subject, and the braking envelope."""

import math
from typing import Any

import pytest

import pytest_rvads as rvads
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.configurations import configuration, explicit, grid, outside, probe
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.support.errors import ScenarioError


def test_letters_of_configurations_match_the_paper() -> None:
    # Column heads of the two tables of the paper (distance; speed).
    heads = {
        "A": ((0.01,) * 4, 0), "B": ((0.3,) * 4, 0), "C": ((20,) * 4, 0), "D": ((20,) * 4, 10), "E": ((0.3, 0.3, 20, 20), 0),
        "F": ((0.01,) * 4, 0), "G": ((0.3,) * 4, 0), "H": ((20,) * 4, 0), "I": ((20,) * 4, 10), "J": ((20, 0.3, 20, 0.3), 0),
    }  # fmt: skip
    for letter, (distances, speed) in heads.items():
        point = configuration(letter, 4)
        assert (point.distances, point.speeds) == (distances, (speed,) * 4), letter


def test_uneven_configurations_in_a_t() -> None:
    assert configuration("E", 3).distances == (0.3, 0.3, 20.0)
    assert configuration("J", 3).distances == (20.0, 0.3, 20.0)


def test_the_papers_grid_depends_on_the_control() -> None:
    assert "".join(p.label for p in grid("paper", 4, JunctionControl.STOP)) == "ABCDE"
    assert "".join(p.label for p in grid("paper", 4, JunctionControl.LIGHTS)) == "FGHIJ"
    assert "".join(p.label for p in grid(("CD", "C"), 4, JunctionControl.STOP)) == "CD"


def test_explicit_grids_are_products() -> None:
    points = explicit([5, (20, 20, 0.3, 0.3)], [0, 2.5], 4)
    assert [p.label for p in points] == [
        "d05.00v00.00",
        "d05.00v02.50",
        "d20.00_20.00_00.30_00.30v00.00",
        "d20.00_20.00_00.30_00.30v02.50",
    ]


def test_points_beyond_the_envelope_are_found() -> None:
    def envelope(distance: float) -> float:
        return math.sqrt(2 * 4.0 * distance)  # v^2 = 2 a d

    (inside,) = explicit(2.0, 4.0, 3)
    (fast,) = explicit((9.0, 9.0, 1.0), 4.0, 3)
    assert outside(inside, envelope) is None
    assert outside(fast, envelope) == (1.0, 4.0)
    assert outside(explicit(0.0, 0.0, 3)[0], lambda _: None) is None
    assert outside(explicit(0.0, 1.0, 3)[0], lambda _: None) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("distances", "speeds", "says"),
    [
        (-1, 0, "distances must be 0 or more and finite, got -1"),
        (math.nan, 0, "must be 0 or more and finite, got nan"),
        (math.inf, 0, "got inf"),
        (5, "fast", "speeds"),
        ((1, 2), 0, "one per entrance"),
        ([], 0, "empty list"),
        (True, 0, "must be 0 or more"),
    ],
)
def test_wrong_numbers_are_named(distances: object, speeds: object, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        explicit(distances, speeds, 4)  # type: ignore[arg-type]


def test_unknown_configuration_and_empty_grid() -> None:
    with pytest.raises(ScenarioError, match="unknown configuration 'K'"):
        grid("DK", 4, JunctionControl.STOP)
    with pytest.raises(ScenarioError, match="at least one configuration"):
        grid((), 4, JunctionControl.STOP)


def test_probe_names_vehicle_speed_and_limit() -> None:
    (fast,) = explicit((20.0, 1.0, 20.0, 20.0), 4.0, 4)
    assert probe(fast, lambda distance: 2.0 * distance) == (
        "a deliberate probe: at 4 m/s nobody stops within 1 m, v(d)max is 2.00 m/s"
    )
    assert "drives off before looking" in probe(configuration("A", 4), lambda distance: 10.0)
    assert [probe(configuration(letter, 4), lambda distance: 10.0) for letter in "BCDE"] == [""] * 4


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
