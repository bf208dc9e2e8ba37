"""Junctions of arms, lanes and movements: numbers, what regulates them, who conflicts with and who gives way to whom."""

from dataclasses import replace

import numpy as np
import pytest

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.support.errors import MapError, ScenarioError


def signed(junction: Junction, *signs: Sign) -> Junction:
    """The same junction with these signs, one per entrance."""
    lanes = zip(junction.entrances, signs, strict=True)
    return replace(junction, entrances=tuple(replace(e, sign=sign, phase=None) for e, sign in lanes))


def two_lanes() -> Junction:
    """A T whose arm 0 has two entrance lanes: the one at the kerb turns right to arm 1, the other one left to arm 2."""

    def line(id: str, *points: tuple[float, float]) -> Segment:
        return Segment(id, np.array(points))

    entrances = (
        Entrance(0, 0, Sign.YIELD, None, 0.0, line("in0.0", (5.0, -50.0), (5.0, -10.0))),
        Entrance(0, 1, Sign.YIELD, None, 1.0, line("in0.1", (2.0, -50.0), (2.0, -10.0))),
        Entrance(1, 0, Sign.PRIORITY, None, 0.0, line("in1", (50.0, 2.0), (10.0, 2.0))),
        Entrance(2, 0, Sign.PRIORITY, None, 0.0, line("in2", (-50.0, -2.0), (-10.0, -2.0))),
    )
    exits = (Exit(1, 0, line("out1", (10.0, -2.0), (50.0, -2.0))), Exit(2, 0, line("out2", (-10.0, 2.0), (-50.0, 2.0))))
    ways = [
        (0, 0, Turn.RIGHT, line("right", (5.0, -10.0), (10.0, -2.0))),
        (1, 1, Turn.LEFT, line("left", (2.0, -10.0), (2.0, -2.0), (-10.0, 2.0))),
        (2, 1, Turn.STRAIGHT, line("west", (10.0, 2.0), (-10.0, 2.0))),
        (3, 0, Turn.STRAIGHT, line("east", (-10.0, -2.0), (10.0, -2.0))),
    ]
    movements = {(e, x): Movement(e, x, turn, path.length, path.id, path) for e, x, turn, path in ways}
    return Junction("t", "1", entrances, exits, movements, frozenset({(2, 0), (2, 1)}), frozenset({(2, 3), (3, 2)}))


def test_with_one_lane_per_arm_an_entrance_has_the_number_of_its_arm() -> None:
    junction = find("stop4")
    assert [(arm.entrances, arm.exits) for arm in junction.arms] == [((k,), (k,)) for k in range(4)]
    assert [junction.vehicle_at(k) for k in range(4)] == ["a0", "a1", "a2", "a3"]
    assert [junction.leads(1, direction).key for direction in (1, 2, 3)] == [(1, 2), (1, 3), (1, 0)]


def test_lanes_are_numbered_arm_by_arm_from_the_kerb() -> None:
    junction = two_lanes()
    assert [(arm.entrances, arm.exits) for arm in junction.arms] == [((0, 1), ()), ((2,), (0,)), ((3,), (1,))]
    assert [junction.vehicle_at(k) for k in range(4)] == ["a0.0", "a0.1", "a1", "a2"]
    assert (junction.ways, junction.control, junction.drivable) == (3, "yield", True)
    assert junction.leads(0, 1).turn is Turn.RIGHT
    assert junction.leads(1, 2).turn is Turn.LEFT
    assert junction.approach(1) == 39.0
    assert [m.key for m in junction.by_turn[1, Turn.LEFT]] == [(1, 1)]


def test_a_table_of_movements_may_be_partial() -> None:
    with pytest.raises(ScenarioError, match="direction 2 is none of entrance 0 of junction 't', its movements lead into 1"):
        two_lanes().leads(0, 2)


def test_who_comes_past_a_yield_sign_gives_way() -> None:
    junction = two_lanes()
    right, left, west, east = (0, 0), (1, 1), (2, 1), (3, 0)
    assert junction.conflicts == {(a, b) for a, b in junction.conflicts or () if (b, a) in (junction.conflicts or ())}
    assert {(right, east), (left, west), (left, east)} <= junction.yields.keys()
    assert not any(one in (west, east) for one, _ in junction.yields)
    assert (west, east) not in (junction.conflicts or ()), "they pass side by side"


def test_without_signs_and_at_an_all_way_stop_the_right_one_goes_first() -> None:
    for junction in (find("stop4"), signed(find("stop4"), *[Sign.NONE] * 4)):
        straight = {entrance: (entrance, (entrance + 2) % 4) for entrance in range(4)}
        for entrance, way in straight.items():
            from_the_right = straight[(entrance + 1) % 4]
            assert (way, from_the_right) in junction.yields
            assert (from_the_right, way) not in junction.yields
        assert ((0, 3), (2, 0)) in junction.yields, "a left turn lets oncoming traffic pass"
        assert ((2, 0), (0, 3)) not in junction.yields


def test_where_lights_rule_only_a_turn_across_oncoming_traffic_gives_way() -> None:
    junction = find("light4")
    assert ((0, 3), (2, 0)) in junction.yields
    assert not any((one[0], other[0]) not in junction.opposite for one, other in junction.yields)


@pytest.mark.parametrize(
    ("signs", "control"),
    [
        ([Sign.STOP] * 4, "stop"),
        ([Sign.LIGHTS] * 4, "lights"),
        ([Sign.NONE] * 4, "none"),
        ([Sign.YIELD, Sign.PRIORITY] * 2, "yield"),
        ([Sign.STOP, Sign.NONE] * 2, "partial"),
        ([Sign.STOP, Sign.LIGHTS] * 2, "partial"),
    ],
)
def test_control_of_a_junction_follows_from_its_entrances(signs: list[Sign], control: str) -> None:
    assert signed(find("stop4"), *signs).control == control


def test_junction_equality_ignores_the_map_path() -> None:
    one = find("stop4")
    assert replace(one, map="elsewhere.xodr") == one
    assert hash(replace(one, map="elsewhere.xodr")) == hash(one)
    assert replace(one, name="other") != one
    assert replace(one, left_hand=True) != one
    assert signed(one, *[Sign.NONE] * 4) != one


def test_inconsistent_parts_of_a_junction_are_refused() -> None:
    junction = two_lanes()
    with pytest.raises(MapError, match=r"numbered from 0, got \[0, 1, 7\]"):
        replace(junction, exits=(Exit(1), Exit(7)), entrances=junction.entrances[:3])
    with pytest.raises(MapError, match="4 entrances and 1 exits, and no room for a movement from 1 to 1"):
        replace(junction, exits=junction.exits[:1])
