"""Pedestrians that tests ask for: which pedestrians, and each of them once up to rotation, against rotations written by hand."""

from dataclasses import replace
from itertools import product
from typing import Any

import pytest

from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.pedestrians import DIFFERENCES, Crossed, Pedestrian, Walk, turns, walks_of
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.support.errors import ScenarioError
from tests.zebras import zebra

_Kind = tuple[tuple[int, ...], int | None, int]
"""Directions as they stand on the map, entrance of the subject, arm of the crosswalk."""


def at_arms(name: str, *arms: int) -> Junction:
    """A junction with one lane per arm and a crosswalk over each of the given arms."""
    place = zebra(name)
    return replace(place, crossings=tuple(place.crossings[arm] for arm in arms)).walked


def select(place: Junction, pedestrians: Any, **changes: Any) -> Selection:
    points = grid("C", len(place.entrances), place.control)
    return Selection(place, points, pedestrians=walks_of(pedestrians), **changes)


def kinds(selection: Selection) -> list[_Kind]:
    place = selection.place
    return [(s.placed, s.subject, place.crossings[s.pedestrians[0].crossing].arm) for s in selection]


def everything(ways: int, arms: tuple[int, ...], seats: list[int | None]) -> set[_Kind]:
    """All full scenarios with a crosswalk: digit d at arm a leads to arm a + d, over the crosswalks of both arms."""
    found: set[_Kind] = set()
    for code, seat, arm in product(product(range(1, ways), repeat=ways), seats, arms):
        over = {a for k, d in enumerate(code) for a in (k, (k + d) % ways) if seat in (None, k)}
        if arm in over:
            found.add((code, seat, arm))
    return found


def turned(kind: _Kind, by: int) -> _Kind:
    code, seat, arm = kind
    ways = len(code)
    return tuple(code[(k - by) % ways] for k in range(ways)), None if seat is None else (seat + by) % ways, (arm + by) % ways


@pytest.mark.parametrize("subject", [None, "all", 1])
@pytest.mark.parametrize(
    ("name", "arms"),
    [("stop3", (0,)), ("stop3", (0, 2)), ("stop3", (0, 1, 2)), ("stop4", (0, 2)), ("stop4", (1, 2, 3)), ("stop4", (0, 1, 2, 3))],
)
def test_every_scenario_with_a_crosswalk_has_exactly_one_representative(name: str, arms: tuple[int, ...], subject: Any) -> None:
    place = at_arms(name, *arms)
    ways = place.ways
    keeping = [by for by in range(ways) if {(arm + by) % ways for arm in arms} == set(arms)]
    if isinstance(subject, int):
        keeping = [0]  # every other rotation moves the subject to another entrance
    seats: list[int | None] = [*range(ways)] if subject == "all" else [subject]
    expected = {frozenset(turned(kind, by) for by in keeping) for kind in everything(ways, arms, seats)}
    found = kinds(select(place, {"difference": 0, "side": "near"}, subject=subject))
    orbits = [frozenset(turned(kind, by) for by in keeping) for kind in found]
    assert len(set(orbits)) == len(orbits)
    assert set(orbits) == expected


def test_representatives_are_the_least_and_counted_by_hand() -> None:
    """81 scenarios with 4 crosswalks under 4 rotations, none of which keeps a crosswalk; a subject drives over two of them."""
    place = at_arms("stop4", 0, 1, 2, 3)
    alone, seated = (kinds(select(place, {"difference": 0, "side": "near"}, subject=subject)) for subject in (None, "all"))
    assert (len(alone), len(seated)) == (81 * 4 // 4, 81 * 4 * 2 // 4)
    assert all(kind == min((turned(kind, by) for by in range(4)), key=str) for kind in (*alone, *seated))


def test_rotations_keep_crosswalks_signs_and_lights() -> None:
    quarter = [(k, tuple((number + k) % 4 for number in range(4))) for k in range(4)]
    lit = find("walk4").walked
    assert list(turns(at_arms("stop4", 0, 1, 2, 3))) == quarter
    assert list(turns(lit)) == quarter, "a quarter turn takes each crosswalk to the other phase, and the phase with it"
    assert list(turns(find("zebra4").walked)) == quarter[::2]
    odd = replace(lit.unwalked, crossings=tuple(replace(crosswalk, phase=0) for crosswalk in lit.crossings))
    assert list(turns(odd.walked)) == quarter[::2]
    assert list(turns(at_arms("stop4", 0, 1))) == [(0, (0, 1))]
    assert list(turns(at_arms("stop4", 2, 0))) == [(0, (0, 1)), (2, (1, 0))]


def test_count_is_the_greatest_possible_number() -> None:
    for place, subject, cover in product(
        (at_arms("stop3", 0, 1, 2), at_arms("stop3", 0, 2)), (None, "all", 0), ("class", "conflicts", "scenario", "rotation")
    ):
        selection = select(place, ["steady", Pedestrian(0, Side.FAR, "darts")], subject=subject, cover=cover)
        selection = replace(selection, pedestrians=selection.pedestrians[::9])
        listed = list(selection)
        assert 0 < len(listed) == len({s.name for s in listed}) <= selection.count()
    selection = select(at_arms("stop4", 0, 1, 2, 3), {"difference": [0, 1]}, subject="all")
    assert len(list(selection)) == selection.count() == 162 * 2 * 2


def test_the_order_of_pedestrians_changes_no_item() -> None:
    place = find("zebra4")
    asked: list[Any] = ["darts", Pedestrian(1, Side.NEAR, "steady", 1.25), {"behaviour": ["stops", "waits"], "difference": -0.5}]
    forth, back = ({s.name for s in select(place.walked, order, subject="all", classes=(3, 7))} for order in (asked, asked[::-1]))
    assert forth == back
    assert len(forth) == len([*select(place.walked, asked, subject="all", classes=(3, 7))])


def test_a_named_crosswalk_meets_every_arm_of_a_class() -> None:
    """Three rotations of class 1 bring another arm to the crosswalk; a rotation by hand shows that these four are all."""
    place = at_arms("stop4", 0, 1, 2, 3)
    found = kinds(select(place, Pedestrian(2), classes=(2,)))
    assert sorted(found) == sorted((*turned(((1, 1, 1, 2), None, 2), by)[:2], 2) for by in range(4))


def test_a_pedestrian_walks_where_the_subject_drives() -> None:
    place = find("zebra4").walked
    names = [
        s.name.partition("-as")[2]
        for s in select(place, Pedestrian(1, Side.FAR, "darts", -0.5), subject=0, scenarios=((1, 2, 2, 2), (2, 2, 2, 2)))
    ]
    assert names == ["1222-s0-w1f.darts.e0.50-cfgC"], "only the turn to the right leads over crosswalk 1"


def test_conflicts_cover_every_movement_over_a_crosswalk() -> None:
    """The turn from arm 0 to arm 1 conflicts with nothing, so that only a crosswalk asks for it."""
    place = at_arms("stop4", 0, 1, 2, 3)
    few = replace(place, movements={key: place.movements[key] for key in [(0, 1), (0, 2), (1, 3)]})
    assert [s.placed for s in Selection(few, grid("C", 4, few.control), cover="conflicts")] == [(2, 2, 0, 0)]
    found = {s.placed for s in select(few, {"difference": 0}, cover="conflicts")}
    assert {code[0] for code in found} == {1, 2}
    sides = [
        (s.placed[0], s.pedestrians[0].crossing, s.pedestrians[0].side)
        for s in select(few, "steady", cover="conflicts", subject=0)
    ]
    assert set(sides) == {(turn, arm, side) for turn in (1, 2) for arm in (0, turn) for side in Side}


def test_early_pedestrians_are_left_out() -> None:
    """From rest at the line, 4 s early: the near-side runner needs less than 1 s to the lane and 2.8 s for 7 m."""
    selection = select(find("zebra4").walked, {"behaviour": "darts", "difference": [-4, 4]}, subject=0, scenarios=((2, 2, 2, 2),))
    selection = replace(selection, configurations=grid("A", 4, selection.place.control))
    reasons: list[ScenarioError] = []
    late = list(selection.fitting(reasons.append))
    assert {s.pedestrians[0].difference for s in late} >= {4.0}
    assert reasons
    assert all(isinstance(reason, Crossed) for reason in reasons)
    assert len(late) + len(reasons) == len(list(selection))


def test_asked_pedestrians_in_every_form() -> None:
    assert walks_of(None) == ()
    steady = walks_of("steady")
    assert len(steady) == 2 * len(DIFFERENCES) == 34
    assert all(walk.everywhere for walk in steady)
    assert walks_of(["steady", {"behaviour": "steady"}]) == steady
    assert walks_of(Pedestrian(3, Side.FAR)) == (Walk(Pedestrian(3, Side.FAR)),)
    by_field = walks_of({"crossing": [0, 2], "side": "far", "behaviour": "darts", "difference": 0.5})
    assert by_field == tuple(Walk(Pedestrian(k, Side.FAR, "darts", 0.5)) for k in (0, 2))
    hidden = walks_of({"behaviour": ["hidden", "steady"], "difference": 0})
    assert [(w.pedestrian.behaviour, w.pedestrian.side) for w in hidden] == [
        ("hidden", "near"),
        ("steady", "near"),
        ("steady", "far"),
    ]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("stedy", "pedestrians have the behaviours steady, .* got 'stedy'; did you mean 'steady'"),
        ([], "pedestrians is empty: name a behaviour, such as 'steady', or leave it out"),
        (3, r"pedestrians takes names of behaviours, rvads.Pedestrian\(...\) or dicts of its fields, one or several, got 3"),
        ([["steady"]], "pedestrians takes names of behaviours"),
        ({"sides": "near"}, "pedestrians have crossing, side, behaviour, difference, got 'sides'; did you mean 'side'"),
        ({"side": []}, r"pedestrians are given by values or lists of at least one value, got \{'side': \[\]\}"),
        ({"side": "left"}, "side must be one of near, far, got 'left'"),
        ({"behaviour": [["steady"]]}, r"pedestrians have the behaviours steady, .* got \['steady'\]"),
        ({"behaviour": "hidden", "side": "far"}, "comes from the near side"),
        ({"difference": "late"}, "difference must be a finite number of seconds, got 'late'"),
        ({"crossing": -1}, "crossing must be the number of a crosswalk, 0 or more, got -1"),
    ],
)
def test_wrong_pedestrians_are_refused_in_a_sentence(value: Any, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        walks_of(value)


def test_missing_crosswalks_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match="junction 'stop4' has no crosswalk for pedestrians: choose a junction with crosswalks"
    ):
        select(find("stop4"), "steady")
    with pytest.raises(ScenarioError, match="junction 'zebra4' has no crosswalk 4: its crosswalks are 0 to 3"):
        select(find("zebra4").walked, Pedestrian(4))
