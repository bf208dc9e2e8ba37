"""Many junctions of a map: by id, by type, by kind, all of them, or a sample."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import Choice, Kinds, choose, choose_among, find
from pytest_rvads.support.errors import MapError
from tools.crossings import Layout

STOP, LIGHTS, NONE = JunctionControl.STOP, JunctionControl.LIGHTS, JunctionControl.NONE


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory, write_town: Callable[..., Path]) -> Path:
    """Four stops of four arms, the last with short approaches, two Ts with lights, one of five arms, two that can't be used."""
    four, three = Layout(4, STOP), Layout(3, LIGHTS)
    layouts = {"20": four, "7": three, "3": four, "11": four, "v4": four, "4": three, "5": Layout(5, NONE, stop=20.0)}
    layouts |= {"short": Layout(4, STOP, approach=30.0), "v3": three}
    return write_town(tmp_path_factory.mktemp("maps") / "town.xodr", layouts, virtual=("v4", "v3"))


def ids(choice: Choice) -> list[str]:
    return [junction.id for junction in choice.junctions]


def test_junctions_are_chosen_by_id_once_each(town: Path) -> None:
    assert ids(choose("7", town)) == ["7"]
    assert ids(choose(["7", "20", "7"], town)) == ["7", "20"], "each once"
    assert choose("7", town).junctions[0] is find("7", town)


def test_all_of_a_map_in_the_order_of_its_file(town: Path) -> None:
    choice = choose("*", town)
    assert ids(choice) == ["20", "7", "3", "11", "4", "5", "short"]
    assert [(one.junction, one.name, one.map, one.ways, one.control) for one in choice.refused] == [
        ("v4", "town.v4", str(town), 4, "stop"),
        ("v3", "town.v3", str(town), 3, "lights"),
    ]
    assert all('of type "virtual"' in one.reason for one in choice.refused)
    assert choice.passed_over == 0


def test_type_chooses_all_matching_junctions(town: Path) -> None:
    choice = choose("4-way stop", town)
    assert (ids(choice), [one.junction for one in choice.refused]) == (["20", "3", "11", "short"], ["v4"])
    assert ids(choose("4-way stop with 40 m of approach", town)) == ["20", "3", "11"]
    assert ids(choose(["3-way lights", "20"], town)) == ["7", "4", "20"]


def test_nearest_chooses_a_single_junction(town: Path) -> None:
    assert ids(choose("nearest to 810, 3", town)) == ["3"], "junctions stand 400 m apart"


@pytest.mark.parametrize(
    ("asked", "chosen", "refused"),
    [
        ({"control": "lights"}, ["7", "4"], ["v3"]),
        ({"arms": (3, 5)}, ["7", "4", "5"], ["v3"]),
        ({"control": ["stop", "none"], "arms": [4, 5]}, ["20", "3", "11", "5", "short"], ["v4"]),
        ({"approach": 40}, ["20", "7", "3", "11", "4", "5"], ["v4", "v3"]),
    ],
)
def test_kinds_choose_among_all(town: Path, asked: dict[str, Any], chosen: list[str], refused: list[str]) -> None:
    choice = choose("*", town, kinds=Kinds.of(asked))
    assert (ids(choice), [one.junction for one in choice.refused]) == (chosen, refused)


def test_kinds_choose_among_those_named(town: Path) -> None:
    choice = choose(["20", "7", "5"], town, kinds=Kinds.of({"arms": [3, 4]}))
    assert (ids(choice), choice.refused, choice.passed_over) == (["20", "7"], (), 0)


@pytest.mark.parametrize(
    ("wanted", "kinds", "says"),
    [
        ("v4", None, r"junction 'v4' of map file .* cannot be used: it is of type \"virtual\""),
        ("40", None, r"has no junction '40'; its 7 usable ones are 20, .*did you mean '4'\?"),
        (["20", "6-way stop"], None, r"no usable junction that fits '6-way stop'; it offers 4 4-way stop with up to 120 m"),
        ("*", {"arms": 6, "control": "stop"}, r"fits '\*' and is of the kinds asked for \(stop, 6 arms\); it offers 4 4-way"),
        (["20", "3"], {"control": "lights"}, r"none of '20', '3' is of the kinds asked for \(lights\): name others"),
        ([], None, r"no junction was asked for: name some, or take '\*' for all of a map"),
        (["20", 3], None, "takes names, ids or types of junctions as texts, such as '\\*' or '4-way stop', got 3"),
    ],
)
def test_what_can_not_be_chosen_is_refused(town: Path, wanted: Any, kinds: dict[str, Any] | None, says: str) -> None:
    with pytest.raises(MapError, match=says):
        choose(wanted, town, kinds=Kinds.of(kinds) if kinds else None)


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"control": "light"}, "control of kinds of junctions must be one or several of stop, lights, .*, got 'light'"),
        ({"control": []}, r"control of kinds of junctions must be .*, got \[\]"),
        ({"arms": 2}, "arms of kinds of junctions must be numbers from 3 to 8, one or several, got 2"),
        ({"arms": True}, "got True"),
        ({"arms": [[4]]}, r"got \[\[4\]\]"),
        ({"approach": -1}, "approach of kinds of junctions must be a length in metres, 0 or more, got -1"),
        ({"approach": float("nan")}, "got nan"),
        ({"arm": 4}, r"told by control, arms, approach, got 'arm'; did you mean 'arms'\?"),
        ({4: "arms"}, "told by control, arms, approach, got 4"),
        ({}, "kinds of junctions are empty: tell them by control, arms, approach, or leave them out"),
        ("stop", r"kinds of junctions are a dict such as \{'control': 'stop', 'arms': \(3, 4\)\}, got 'stop'"),
    ],
)
def test_invalid_kinds_are_refused(asked: Any, says: str) -> None:
    with pytest.raises(MapError, match=says):
        Kinds.of(asked)


def test_a_limit_takes_as_evenly_as_possible_from_every_kind(town: Path) -> None:
    """There are three kinds: four stops of four arms, two Ts with lights, one of five arms with neither."""
    for seed in range(20):
        choice = choose("*", town, limit=3, seed=seed)
        assert {(junction.ways, junction.control) for junction in choice.junctions} == {(4, STOP), (3, LIGHTS), (5, NONE)}
        assert choice.passed_over == 4
        five = choose("*", town, limit=5, seed=seed)
        assert sorted(junction.ways for junction in five.junctions) == [3, 3, 4, 4, 5], "there is one of five arms only"
        order = ids(choose("*", town))
        assert sorted(ids(five), key=order.index) == ids(five), "they stay in the order of the file"
    assert len({ids(choose("*", town, limit=3, seed=seed))[0] for seed in range(20)}) > 1, "seeds differ"
    assert choose("*", town, limit=7).passed_over == 0
    assert ids(choose("*", town, limit=70)) == ids(choose("*", town))


@pytest.mark.parametrize("limit", [0, -1, True, 2.0, "2"])
def test_a_limit_is_a_number_of_junctions(town: Path, limit: Any) -> None:
    with pytest.raises(MapError, match=f"limit must be a whole number of junctions, 1 or more, got {limit!r}"):
        choose("*", town, limit=limit)


def test_built_in_junctions_are_chosen_without_a_map() -> None:
    every = choose("*").junctions
    assert {junction.name for junction in every} >= {"stop4", "light3", "lanes4", "roundabout4"}
    assert all(junction.map is None for junction in every)
    assert [junction.name for junction in choose("4-way stop").junctions] == ["stop4"], "one: others are variants of it"
    assert {junction.name for junction in choose("*", kinds=Kinds.of({"control": "stop"})).junctions} == {
        "stop4",
        "stop3",
        "paper_stop4",
    }


def test_junctions_of_several_maps_share_a_limit(town: Path) -> None:
    choice = choose_among([("stop4", None), ("*", town)], limit=3)
    assert {junction.ways for junction in choice.junctions} == {3, 4, 5}
    assert choice.passed_over == 5


def test_all_junctions_of_a_real_town(shared: Path) -> None:
    """Counted by hand in the table of `rvads map`: 25 usable ones, six that join two roads only.

    In three of the 25 every exit is reached from one entrance alone.
    """
    file = shared / "maps" / "Town07.xodr"
    choice = choose("*", file)
    assert (len(choice.junctions), len(choice.refused)) == (22, 9)
    assert Counter(one.reason.partition(",")[0] for one in choice.refused) == {
        "it has 2 arms": 6,
        "no two of its movements meet": 3,
    }
    assert len(choose("3-way stop", file).junctions) == 5
    assert {(j.ways, j.control) for j in choose("*", file, limit=6).junctions} == {(j.ways, j.control) for j in choice.junctions}
