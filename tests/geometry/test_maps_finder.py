"""The Junction Finder: by name, by map and id, by type, by nearest point; and kinds of junctions by how their ways meet."""

import json
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.cli import main
from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.finder import choose, find, load, names, nearest
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.road_map import describe, read_map
from pytest_rvads.logic.check import check
from pytest_rvads.report.map_picture import draw_map
from pytest_rvads.report.scene import draw_ways
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import MapError, ScenarioError
from tools.crossings import Layout, opendrive


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("4-way stop", "stop4"),
        ("4-way all-way stop", "stop4"),
        ("3-way stop", "stop3"),
        ("3-way lights", "light3"),
        ("4-way traffic lights", "light4"),
        ("4-Way Lights with 100 m of approach", "light4"),
        ("4-way stop with at least 40 m", "stop4"),
    ],
)
def test_types_among_the_built_in_maps(text: str, name: str) -> None:
    assert find(text).name == name


def test_unknown_names_are_corrected() -> None:
    with pytest.raises(MapError, match=r"unknown junction 'sotp4': the built-in ones are stop4, .*did you mean 'stop4'\?"):
        find("sotp4")
    with pytest.raises(MapError, match="no built-in junction fits '5-way stop'"):
        find("5-way stop")
    with pytest.raises(MapError, match="with 120 m of approach"):
        find("4-way stop with 200 m of approach")


def test_id_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "my-town 1.xodr"
    shutil.copy(path_of("light3"), path)
    junction = find("1", path)
    assert junction.name == "my_town_1.1"
    assert junction.id == "1"
    assert find("1", str(path)) is junction
    with pytest.raises(MapError, match=r"has no junction '2'; its 1 usable ones are 1"):
        find("2", path)


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "map.xodr"
    path.write_text(opendrive(Layout(4)), encoding="utf-8")
    assert find("1", path).ways == 4
    path.write_text(opendrive(Layout(5, stop=20.0)), encoding="utf-8")
    os.utime(path, ns=(1, 1))
    assert find("1", path).ways == 5
    assert load(path) is load(path)


def test_missing_map(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="map file 3 cannot be read"):
        find("1", 3)  # type: ignore[arg-type]
    with pytest.raises(MapError, match=r"the built-in ones are stop4, .* others need a map file"):
        find("nearest to 1, 2")
    with pytest.raises(MapError, match="does not exist"):
        find("1", tmp_path / "no.xodr")


def test_types_in_a_town(shared: Path) -> None:
    town = shared / "maps" / "Town07.xodr"
    assert find("169", town).name == "Town07.169"
    assert find("4-way all-way stop", town).id == "169"
    assert find("4-way lights with 30 m of approach", town).id == "68"
    # 146 comes first in the file, but its shortest approach ends 31 m before the stopping line.
    assert find("3-way stop with 40 m of approach", town).id == "260"
    with pytest.raises(
        MapError,
        match=r"no usable junction that fits '4-way lights with 40 m of approach'; it offers .*2 4-way lights with up to 34 m",
    ):
        find("4-way lights with 40 m of approach", town)
    assert sum(find("725", town).lanes) == 5  # two lanes lead in on one of four arms
    with pytest.raises(MapError, match=r"junction '453' .* cannot be used: it has 2 arms"):
        find("453", town)
    with pytest.raises(MapError, match=r"did you mean '169'\?"):
        find("1690", town)


def test_nearest_point(shared: Path) -> None:
    town = shared / "maps" / "Town07.xodr"
    for id in ("169", "68", "402"):
        arms = load(town).report(id).arms
        x, y = sum(a.x for a in arms) / len(arms), sum(a.y for a in arms) / len(arms)
        assert nearest(town, x + 5.0, y - 5.0).id == id
        assert find(f"nearest to {x + 5.0:.1f}, {y - 5.0:.1f}", town).id == find(f"Nearest ({x:.0f} {y:.0f})", town).id == id
    with pytest.raises(MapError, match="two finite coordinates"):
        nearest(town, float("nan"), 0.0)
    with pytest.raises(MapError, match=r"'1-2' is no coordinate, expected two numbers"):
        find("nearest to 1-2, 3", town)
    with pytest.raises(MapError, match="two finite coordinates"):
        find("nearest to 1e999, 3", town)


def test_nearest_in_a_map_without_usable_junction(shared: Path) -> None:
    with pytest.raises(MapError, match="none of its junctions is usable, `rvads map"):
        nearest(shared / "maps" / "direct_junction_simple.xodr", 0.0, 0.0)


RADIUS = 4.6
"""Of the U-turn in `with_uturn` [m]."""


@pytest.fixture
def with_uturn(tmp_path: Path) -> Path:
    """Return a map in which the first arm has a way back: a connecting road from its entrance lane to its exit lane."""
    root = ElementTree.fromstring(opendrive(Layout(lane_offset=4.6)))
    *_, last = root.findall("road")
    back = ElementTree.fromstring(ElementTree.tostring(last))
    back.set("id", "900")
    for name in ("predecessor", "successor"):
        back.find(f"link/{name}").attrib.update(elementId="0", contactPoint="start")
        back.find(f"lanes/laneSection/right/lane/link/{name}").set("id", "1" if name == "predecessor" else "-1")
    plan = back.find("planView")
    for shape in list(plan):
        plan.remove(shape)
    x, y, radius = -RADIUS, -15.0, RADIUS
    shape = ElementTree.SubElement(
        plan, "geometry", s="0", x=str(-x), y=str(y), hdg=str(math.pi / 2), length=str(math.pi * radius)
    )
    ElementTree.SubElement(shape, "arc", curvature=str(1 / radius))
    back.set("length", str(math.pi * radius))
    root.insert(list(root).index(last) + 1, back)
    row = ElementTree.SubElement(root.find("junction"), "connection", id="900", incomingRoad="0", connectingRoad="900")
    row.set("contactPoint", "start")
    ElementTree.SubElement(row, "laneLink", {"from": "1", "to": "-1"})
    path = tmp_path / "uturn.xodr"
    path.write_bytes(ElementTree.tostring(root))
    return path


def test_uturns_are_left_out_and_told_unless_asked_for(with_uturn: Path) -> None:
    path = with_uturn
    road_map = load(path)
    assert any(warning.message == "1 U-turn of junction '1' is left out" for warning in road_map.warnings)
    plain, whole = road_map.junction("1"), road_map.junction("1", uturns=True)
    assert set(whole.movements) - set(plain.movements) == {(0, 0)}
    assert set(read_map(path, uturns=True).junction("1").movements) == set(whole.movements)
    assert whole.leads(0, 4).turn == "left"
    assert whole.leads(0, 4).length == pytest.approx(math.pi * RADIUS, abs=0.01)
    assert whole.yields[(0, 0), (2, 0)] is Reason.TURN, "oncoming traffic goes first, as for a left turn"
    with pytest.raises(ScenarioError, match="direction 4 is none of entrance 0"):
        plain.leads(0, 4)


def test_uturns_have_a_word_of_their_own_in_json_pictures_and_explanations(with_uturn: Path) -> None:
    plain, whole = read_map(with_uturn), read_map(with_uturn, uturns=True)
    (junction,) = describe(whole)["junctions"]
    assert [(m["entrance"], m["exit"]) for m in junction["movements"] if m["turn"] == "U-turn"] == [(0, 0)]
    place = whole.junction("1")
    for picture, without in ((draw_map(whole), draw_map(plain)), (draw_ways(place), draw_ways(plain.junction("1")))):
        assert (">U-turn<" in picture, ">U-turn<" in without) == (True, False)

    class Runner(Follower):
        def target_speed(self, seen: Observation) -> float:
            return 11.0

    verdict = check(simulate(Case(Scenario(place, "4000", distance=5.0, speed=11.0, duration=2.0), Runner)), "full_stop")
    assert "a0 @ entrance 0, U-turn" in verdict.explanation


def turned_back(*arms: int, lanes: int = 2) -> bytes:
    """Return a map whose lane beside the median only leads back, on some arms; with one lane per arm the arm has no other."""
    allowed = [((1, 2, 3),) if arm not in arms else ((3,),) if lanes == 1 else ((1, 2), (3,)) for arm in range(4)]
    root = ElementTree.fromstring(opendrive(Layout(4, JunctionControl.NONE, lanes=tuple(allowed))))
    roads = {road.get("id"): road for road in root.iter("road")}
    for row in root.iter("connection"):
        road = roads[row.get("connectingRoad")]
        ends = [int(road.find(f"link/{tag}").get("elementId")) for tag in ("predecessor", "successor")]
        if ends[0] in arms and (ends[1] - ends[0]) % 4 == 3:
            road.find("link/successor").set("elementId", str(ends[0]))
            (shape,) = road.iter("geometry")
            x, y = float(shape.get("x")), float(shape.get("y"))
            aside = abs(x if abs(y) == 15.0 else y) + 1.75  # the lane out lies 1.75 m beside the middle of its arm
            shape[:] = []
            ElementTree.SubElement(shape, "arc", curvature=str(2.0 / aside))
            for element in (shape, road):
                element.set("length", str(math.pi * aside / 2.0))
    return ElementTree.tostring(root)


@pytest.mark.parametrize(("arms", "lanes"), [((0,), 2), ((2,), 2), ((0, 1, 2, 3), 2), ((1,), 1)])
def test_lane_that_only_leads_back_is_no_entrance(
    tmp_path: Path, arms: tuple[int, ...], lanes: int, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "back.xodr"
    path.write_bytes(turned_back(*arms, lanes=lanes))
    assert main(["map", str(path), "--json", "--svg", str(tmp_path / "back.svg")]) == 0
    (junction,) = json.loads(capsys.readouterr().out)["junctions"]
    assert (junction["ways"], junction["control"], junction["usable"]) == (4, "none", True)
    assert [arm["entrances"] for arm in junction["arms"]] == [lanes - 1 if arm in arms else 1 for arm in range(4)]
    assert len(junction["movements"]) == sum(3 if arm not in arms else 2 * (lanes - 1) for arm in range(4))
    (message,) = [warning.message for warning in read_map(path).warnings if "U-turn" in warning.message]
    assert message.startswith(f"{len(arms)} U-turn")
    assert "no traffic enters by" in message
    place = read_map(path, uturns=True).junction("1")
    assert len(place.entrances) == 4 - len(arms) + lanes * len(arms)
    assert main(["town", str(path), "--autopilot", "reference", "--sample", "1", "-j", "1", "-o", str(tmp_path / "town")]) == 0


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
    assert [line.split()[0] for line in lines if "-way " in line] == ["cross", "free", "joins", "no"], "sorted"
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
