"""The Junction Finder: by name, by map and id, by type, by nearest point."""

import os
import shutil
from pathlib import Path

import pytest

from pytest_rvads.errors import MapError
from pytest_rvads.junctions.builtin import path_of
from pytest_rvads.junctions.finder import find, load, nearest
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.opendrive.writer import Layout, opendrive


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
        match=r"no usable junction that fits '4-way lights with 40 m of approach'; it offers .*1 4-way lights with up to 34 m",
    ):
        find("4-way lights with 40 m of approach", town)
    with pytest.raises(MapError, match=r"junction '725' .* cannot be used: .*entrance and"):
        find("725", town)
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
    with pytest.raises(MapError, match="none of its 1 junctions is usable"):
        nearest(shared / "maps" / "lane_offset_intersection.xodr", 0.0, 0.0)


def test_uturns_can_be_left_out(shared: Path) -> None:
    road_map = load(shared / "maps" / "Issue295a.xodr")
    report = road_map.report("1")
    assert "U-turn" in (report.reason or "")
    junction = road_map.junction("1", uturns=True)
    assert junction.control is JunctionControl.NONE
    assert all(entrance != exit for entrance, exit in junction.movements)
