"""The Junction Finder: by name, by map and id, by type, by nearest point."""

import math
import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.geometry.builtin import path_of
from pytest_rvads.geometry.finder import find, load, nearest
from pytest_rvads.geometry.opendrive.writer import Layout, opendrive
from pytest_rvads.geometry.road_map import describe, read_map
from pytest_rvads.geometry.yielding import Reason
from pytest_rvads.logic.check import check
from pytest_rvads.report.draw.map_picture import draw_map
from pytest_rvads.report.draw.picture import draw_ways
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import MapError, ScenarioError


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
