"""Pictures of junctions: well-formed, complete, and safe with strange names."""

import math
import re
from xml.etree import ElementTree

import pytest

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import names
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.report.map_picture import draw_map
from pytest_rvads.report.svg import arrow, wrap
from tools.crossings import Layout, opendrive

from .conftest import Read

SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize("name", names())
def test_panels_show_movements_entrances_signs_and_lines(name: str) -> None:
    road_map = read_map(path_of(name))
    root = ElementTree.fromstring(draw_map(road_map))
    panels = root.findall(f"{SVG}svg")
    assert len(panels) == len(road_map.junctions)
    for panel, report in zip(panels, road_map.junctions, strict=True):
        marked = [path.get("marker-end") for path in panel.iter(f"{SVG}path")]
        assert sum(mark in ("url(#left)", "url(#straight)", "url(#right)") for mark in marked) == len(report.movements)
        numbers = [str(k) for k in range(len(report.entrances))]
        assert [text.text for text in panel.iter(f"{SVG}text")] == [*numbers, "10 m"]
        assert sum(path.get("stroke") == "#c00" for path in panel.iter(f"{SVG}path")) == len(report.entrances)
        kinds = [(path.get("class") or "").removeprefix("sign ") for path in panel.iter(f"{SVG}path")]
        for kind in (Sign.STOP, Sign.YIELD, Sign.PRIORITY):
            assert kinds.count(kind) == report.signs.count(kind)
        assert len([rect for rect in panel.iter(f"{SVG}rect") if rect.get("fill") == "#222"]) == report.signs.count(Sign.LIGHTS)
        arrows = sum(path.get("class") == "arrow" for path in panel.iter(f"{SVG}path"))
        assert arrows == {"lanes4": 8, "roundabout4": 1}.get(name, 0), "where not every exit can be reached"


def test_signs_have_the_shape_of_their_kind() -> None:
    shown = ElementTree.fromstring(draw_map(read_map(path_of("stop4"))))
    legend = {path.get("class"): path.get("d") for path in shown.findall(f"{SVG}path") if path.get("class")}
    corners = {kind: re.findall(r"[-\d.]+ ([-\d.]+)", d or "") for kind, d in legend.items()}
    assert {kind: len(found) for kind, found in corners.items()} == {"sign stop": 8, "sign yield": 3, "sign priority": 4}
    down = sorted(map(float, corners["sign yield"]))
    assert down[0] == down[1] < down[2], "a yield sign stands on its corner"


def test_lanes_have_marks_and_arrows_of_their_movements() -> None:
    (panel,) = ElementTree.fromstring(draw_map(read_map(path_of("lanes4")))).findall(f"{SVG}svg")
    white = [path for path in panel.iter(f"{SVG}path") if path.get("stroke") == "#fff"]
    broken = [path for path in white if path.get("stroke-dasharray")]
    assert (len(white), len(broken)) == (4 * 4, 4), "two kerbs, a centre line and one between two lanes, on each of four arms"
    arrows = [path.get("d") for path in panel.iter(f"{SVG}path") if path.get("class") == "arrow"]
    right_and_straight, left = arrow({Turn.RIGHT, Turn.STRAIGHT}), arrow({Turn.LEFT})
    assert arrows == [right_and_straight, left] * 4


def test_who_gives_way_is_said_and_dashed() -> None:
    """An X without signs: right before left, and left turns give way to oncoming traffic; right turns to nobody."""
    root = ElementTree.fromstring(draw_map(read_map(path_of("right4"))))
    (panel,) = root.findall(f"{SVG}svg")
    told = [text.text for text in root.findall(f"{SVG}text")]
    assert "gives way, right before left: 0 to 1, 1 to 2, 2 to 3, 3 to 0" in told
    assert "gives way, turning left: 0 to 2, 1 to 3, 2 to 0, 3 to 1" in told
    dashed = [path.get("marker-end") for path in panel.iter(f"{SVG}path") if path.get("stroke-dasharray") == "5 3"]
    assert {mark: dashed.count(mark) for mark in dashed} == {"url(#straight)": 4, "url(#left)": 4}
    at_stops = " ".join(
        text.text or "" for text in ElementTree.fromstring(draw_map(read_map(path_of("stop4")))).iter(f"{SVG}text")
    )
    assert "gives way in a tie, right before left: 0 to 1" in at_stops
    protected = " ".join(
        text.text or "" for text in ElementTree.fromstring(draw_map(read_map(path_of("lanes4")))).iter(f"{SVG}text")
    )
    assert "turning left:" not in protected, "left turns have green alone"


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
    assert "of type" in text
    assert "gives way" not in text.partition("not usable")[2]


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
