"""Concrete scenarios: names, rotation, starts, and wrong use."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.states import Colour
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import MapError, ScenarioError


def test_name_has_junction_class_directions_and_configuration() -> None:
    # `stop4-class07-as3113-cfgD.r1` stands in `scenarios/ids.py` as row 1 of class 7.
    made = Scenario(find("stop4"), "1133", distance=20, speed=10, configuration="D", rotation=1)
    assert made.name == "stop4-class07-as3113-cfgD.r1"


@given(st.lists(st.integers(1, 3), min_size=4, max_size=4), st.integers(0, 3))
@settings(derandomize=True, deadline=None)
def test_everything_rotates_together(directions: list[int], row: int) -> None:
    distances, speeds = (1.0, 2.0, 3.0, 4.0), (0.1, 0.2, 0.3, 0.4)
    still = Scenario(find("light4"), directions, distance=distances, speed=speeds)
    turned = Scenario(find("light4"), directions, distance=distances, speed=speeds, rotation=row)
    for entrance in range(4):
        moved = (entrance + row) % 4
        assert turned.placed[moved] == still.placed[entrance]
        assert turned.start(moved) == still.start(entrance)
        assert turned.creation[entrance] == moved, "vehicle i stands at entrance (i + r) mod n"
        green = turned.signals().colours(0.0, 4)[moved] is Colour.GREEN
        assert green == (still.signals().colours(0.0, 4)[entrance] is Colour.GREEN), "odd rows swap the phase"


def test_agents_leave_by_the_exit_of_their_direction() -> None:
    agents = Scenario(find("stop4"), "1203").agents()
    assert [(a.name, a.entrance, a.exit, a.turn.value) for a in agents] == [
        ("a0", 0, 1, "right"),
        ("a1", 1, 3, "straight"),
        ("a3", 3, 2, "left"),
    ]


def test_equal_scenarios_are_equal_and_hashable() -> None:
    one, two = Scenario(find("stop4"), "1133", distance=5), Scenario(find("stop4"), (1, 1, 3, 3), distance=(5, 5, 5, 5))
    assert one == two
    assert len({one, two, Scenario(find("stop4"), "1133", distance=6)}) == 2
    record = one.record()
    assert record["distances"] == (5.0, 5.0, 5.0, 5.0)
    assert record["map"] is None, "where a library is installed is no part of what came out"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"rotation": 4}, "rotation must be one of 0..3"),
        ({"aggression": 0}, "aggression must be 1, 2 or 3"),
        ({"duration": math.inf}, "duration must lie above 0"),
        ({"wait": -1}, "wait must be 0 s or more"),
        ({"subject": 4}, "occupied entrance"),
        ({"distance": (1, 2)}, "one per entrance"),
        ({"speed": math.nan}, "speed must be 0 or more and finite"),
        ({"rotation": True}, "rotation must be one of 0..3 for 4 entrances, got True"),
        ({"rotation": 1.0}, "rotation must be one of 0..3"),
        ({"rotation": "1"}, "rotation must be one of 0..3"),
        ({"subject": True}, "occupied entrance"),
        ({"subject": "0"}, "occupied entrance"),
        ({"aggression": 2.0}, "aggression must be 1, 2 or 3, got 2.0"),
        ({"configuration": 3}, "configuration must be a label of letters"),
        ({"configuration": "a b/c"}, "configuration must be a label of letters"),
        ({"order": 5}, "order must name each of the entrances 0..3 once, got 5"),
        ({"order": (0, 1, "2", 3)}, "order must name each"),
        ({"order": (False, 1, 2, 3)}, "order must name each"),
        ({"senses": 0.2}, "senses must be rvads.Senses"),
    ],
)
def test_wrong_values_are_named(change: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        Scenario(find("stop4"), "1133", **change)


def test_a_subject_needs_a_vehicle() -> None:
    assert Scenario(find("stop4"), "1030", subject=2).name == "stop4-class00-as1030-s2-cfgd20.00v00.00"
    with pytest.raises(ScenarioError, match="occupied entrance"):
        Scenario(find("stop4"), "1030", subject=1)


def test_junction_and_directions_have_to_agree() -> None:
    with pytest.raises(ScenarioError, match="describe 3 entrances, junction 'stop4' has 4"):
        Scenario(find("stop4"), "112")
    with pytest.raises(MapError, match="unknown junction"):
        find("stop9")


def test_a_start_beyond_the_approach_is_refused_where_a_vehicle_stands() -> None:
    Scenario(find("stop4"), "0111", distance=(500, 20, 20, 20)).starts()
    with pytest.raises(ScenarioError, match="distance 500 m does not fit on entrance 1"):
        Scenario(find("stop4"), "1111", distance=(500, 20, 20, 20), rotation=1).starts()


def test_the_start_is_told_of_the_first_ones_and_how_many_queue_behind() -> None:
    """Who follows starts farther away than the first one, so that its distance is none of those."""
    told = Scenario(find("stop4"), "1030", distance=(20, 0, 30, 0), followers=2).describe()
    assert told.endswith("(0->1 2->1)  d=(20 30) m  v=(0 0) m/s  2 behind each")
