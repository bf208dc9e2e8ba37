"""Whatever happens to a map, it is read or refused in one sentence; nothing else comes out, and what is read can be used."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.road_map import RoadMap, describe, read_map
from pytest_rvads.report.map_picture import draw_map
from pytest_rvads.support.errors import MapError
from tools.crossings import Layout, opendrive

from .mutations import QUICK, damaged

VALUES = [
    *("nan", "inf", "1e308", "-1e308", "1e9", "-5", "0", "", "x", "1e-12", "start", "end", "-1", "1", "2", "99"),
    *("road", "junction", "100000", "LHT", "none", "driving", "direct", "arcLength", "<b>", "\u202e", "a" * 2000),
]
SEEDS = [opendrive(Layout(3, JunctionControl.LIGHTS)), opendrive(Layout(4, setback=4.0, left_hand=True))]
FILES = (
    "sumo_t3",
    "simple_4way_intersection",
    "direct_junction_simple",
    "connected_junctions_simple",
    "lane_offset_intersection",
)


def seeds(shared: Path) -> list[bytes]:
    return [text.encode() for text in SEEDS] + [(shared / "maps" / f"{stem}.xodr").read_bytes() for stem in FILES]


def survive(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    try:
        road_map = read_map(path)
    except MapError as error:
        message = str(error)
    else:
        use(road_map)
        return
    assert "\n" not in message
    assert str(path) in message


def use(road_map: RoadMap) -> None:
    describe(road_map)
    draw_map(road_map)
    list(road_map.graph.roads())
    for report in road_map.junctions:
        if report.usable:
            assert road_map.junction(report.id).conflicts is not None


@pytest.mark.extended
@given(data=st.data())
@QUICK
def test_changed_elements(shared: Path, tmp_path: Path, data: st.DataObject) -> None:
    root = ElementTree.fromstring(data.draw(st.sampled_from(seeds(shared))))
    for _ in range(data.draw(st.integers(1, 5))):
        elements = list(root.iter())[1:]
        if not elements:
            break
        element = elements[data.draw(st.integers(0, len(elements) - 1))]
        what = data.draw(st.sampled_from(["set", "set", "set", "drop", "remove", "repeat"]))
        parent = next(p for p in root.iter() if any(child is element for child in p))
        if what in ("set", "drop") and element.attrib:
            name = data.draw(st.sampled_from(sorted(element.attrib)))
            if what == "drop":
                del element.attrib[name]
            else:
                element.set(name, data.draw(st.sampled_from(VALUES)))
        elif what == "remove":
            parent.remove(element)
        else:
            parent.append(element)
    survive(tmp_path / "map.xodr", ElementTree.tostring(root))


@given(data=st.data())
@QUICK
def test_changed_bytes(shared: Path, tmp_path: Path, data: st.DataObject) -> None:
    survive(tmp_path / "map.xodr", data.draw(damaged(data.draw(st.sampled_from(seeds(shared))))))
