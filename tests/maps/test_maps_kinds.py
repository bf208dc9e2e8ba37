"""Junctions where ways cross, where they only come together, and where none meet: what is told and what is offered."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.choosing import choose
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.opendrive.writer import Layout
from pytest_rvads.support.errors import MapError


def allowing(*directions: int, approach: float = 120.0) -> Layout:
    """Return a junction without signs, one lane per arm: the direction that each allows, 1 to the right, 2 straight on."""
    return Layout(4, JunctionControl.NONE, lanes=tuple(((j,),) for j in directions), approach=approach)


# Of the second one, from the south and from the west all go east, from the east and from the north all go west.
LAYOUTS = {
    "free": allowing(1, 1, 1, 1),
    "joins": allowing(1, 2, 1, 2),
    "cross": allowing(2, 2, 2, 2, approach=33.0),
    "no": Layout(),
}


@pytest.fixture(scope="module")
def town(tmp_path_factory: pytest.TempPathFactory, write_town: Callable[..., Path]) -> Path:
    return write_town(tmp_path_factory.mktemp("maps") / "kinds.xodr", LAYOUTS, virtual=("no",))


def test_the_kind_is_told_by_the_conflicts(town: Path) -> None:
    assert [find(id, town).kind for id in ("free", "joins", "cross")] == ["conflict-free", "merging", "crossing"]
    assert {name: find(name).kind for name in names() if find(name).kind != "crossing"} == {"roundabout4": "merging"}
    place = find("joins", town)
    unknown = {key: replace(movement, path=None) for key, movement in place.movements.items()}
    assert replace(place, movements=unknown).kind is None, "it is not known where its lanes lie"


@pytest.mark.parametrize("wanted", ["*", "4-way none"])
def test_a_conflict_free_junction_is_left_out_and_told(town: Path, wanted: str) -> None:
    choice = choose(wanted, town)
    assert [place.id for place in choice.junctions] == ["joins", "cross"]
    (reason,) = (one.reason for one in choice.refused if one.junction == "free")
    assert reason.startswith("no two of its movements meet")


def test_a_conflict_free_junction_is_there_by_its_id(town: Path) -> None:
    assert [place.id for place in choose(["free", "*"], town).junctions] == ["free", "joins", "cross"]


def test_a_map_of_conflict_free_junctions_offers_none(tmp_path: Path, write_town: Callable[..., Path]) -> None:
    path = write_town(tmp_path / "free.xodr", {"1": LAYOUTS["free"]})
    with pytest.raises(MapError, match="no junction asked for can be used, the first of them: no two of its movements meet"):
        choose("*", path)
    assert main(["init", str(tmp_path / "tests"), "--map", str(path)]) == 2


def test_the_command_map_sums_up(town: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", str(town)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "kinds.xodr: 4 junctions",
        "  3 of 4 usable: 1 crossing, 1 merging, 1 conflict-free; vehicles start up to 120 m before the line",
    ]
    assert "   cross  4-way none    crossing; vehicles start up to 33 m before the line" in lines
    assert main(["map", str(town), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["junctions"]
    assert {one["id"]: one["kind"] for one in told} == {
        "free": "conflict-free",
        "joins": "merging",
        "cross": "crossing",
        "no": None,
    }


def test_tests_for_a_map_are_written_for_a_junction_where_ways_meet(
    town: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["init", "tests", "--map", str(town)]) == 0
    assert "@rvads.scenario('joins', " in Path("tests/test_rules.py").read_text("utf-8")
