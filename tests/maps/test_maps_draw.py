"""Pictures of junctions: well-formed, complete, and safe with strange names."""

import math
import re
from xml.etree import ElementTree

import pytest

from pytest_rvads.draw.map_picture import draw_map
from pytest_rvads.draw.svg import wrap
from pytest_rvads.junctions.builtin import path_of
from pytest_rvads.junctions.finder import names
from pytest_rvads.junctions.road_map import read_map
from pytest_rvads.opendrive.writer import Layout, opendrive

from .conftest import Read

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize("name", names())
def test_a_panel_shows_movements_entrances_signs_and_lines(name: str) -> None:
    road_map = read_map(path_of(name))
    root = ElementTree.fromstring(draw_map(road_map))
    (panel,) = root.findall(f"{SVG}svg")
    ways = int(name[-1])
    marked = [path.get("marker-end") for path in panel.iter(f"{SVG}path")]
    assert sum(mark in ("url(#left)", "url(#straight)", "url(#right)") for mark in marked) == ways * (ways - 1)
    assert [text.text for text in panel.iter(f"{SVG}text")] == [*(str(i) for i in range(ways)), "10 m"]
    assert sum(path.get("stroke") == "#c00" for path in panel.iter(f"{SVG}path")) == ways
    assert len(list(panel.iter(f"{SVG}polygon"))) == (ways if "stop" in name else 0)


def test_entrance_numbers_stand_where_the_entrances_are() -> None:
    root = ElementTree.fromstring(draw_map(read_map(path_of("stop4"))))
    (panel,) = root.findall(f"{SVG}svg")
    places = {text.text: (float(text.get("x")), float(text.get("y"))) for text in panel.iter(f"{SVG}text")}
    # South, east, north, west; y runs down in SVG.
    assert places["0"][1] > 180 > places["2"][1]
    assert places["1"][0] > 180 > places["3"][0]
    assert places["0"][0] > 180 > places["2"][0]


def test_the_scale_is_true() -> None:
    """A straight movement of stop4 is 30 m long."""
    (panel,) = ElementTree.fromstring(draw_map(read_map(path_of("stop4")))).findall(f"{SVG}svg")
    bar = next(path for path in panel.iter(f"{SVG}path") if path.get("stroke") == "#333")
    ten = float(bar.get("d").partition("h")[2].partition("m")[0])
    straight = next(path for path in panel.iter() if path.get("marker-end") == "url(#straight)")
    places = [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", straight.get("points") or straight.get("d"))]
    assert math.dist(places[:2], places[-2:]) == pytest.approx(3 * ten, abs=0.5)


def test_unusable_junctions_are_drawn_with_their_reason(read: Read) -> None:
    road_map = read(opendrive(Layout()).replace('<junction id="1"', '<junction type="virtual" id="1"'))
    text = draw_map(road_map)
    ElementTree.fromstring(text)
    assert "not usable" in text
    assert "It is of type" in text or "it is of type" in text


def test_strange_names_are_escaped(read: Read) -> None:
    content = (
        opendrive(Layout())
        .replace('junction="1" rule', 'junction="&lt;b&gt;&amp;" rule')
        .replace('elementId="1" />', 'elementId="&lt;b&gt;&amp;" />')
    )
    road_map = read(content.replace('<junction id="1"', '<junction id="&lt;b&gt;&amp;"'), name="a<&b.xodr")
    text = draw_map(road_map)
    ElementTree.fromstring(text)
    assert "junction &lt;b&gt;&amp;" in text


def test_a_junction_without_lanes(read: Read) -> None:
    text = draw_map(read('<OpenDRIVE><junction id="1"/></OpenDRIVE>'))
    ElementTree.fromstring(text)
    assert "nothing to draw" in text


def test_wrap_keeps_every_word() -> None:
    content = "one two " + "x" * 25 + " three"
    lines = wrap(content, 10)
    assert max(map(len, lines)) <= 10
    assert "".join(lines).replace(" ", "") == content.replace(" ", "")
