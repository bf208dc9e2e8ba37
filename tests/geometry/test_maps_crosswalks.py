"""Crosswalks of map files: the arms that they lie over, the lines from kerb to kerb, islands and phases of lights."""

import math
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.cli import main
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.crosswalks import hull
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.network import Doubt
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import describe, read_map
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.report.map_picture import draw_map
from tools.crossings import Layout, opendrive
from tools.make_maps import CROSSINGS

from .conftest import Read, Tree

SVG = "{http://www.w3.org/2000/svg}"

CROSSED = {"zebra4": "yield4", "walk4": "light4"}
"""Per built-in junction with crosswalks, the junction that is the same without."""


@pytest.mark.parametrize("name", CROSSED)
def test_built_in_crosswalks_lie_over_every_arm_behind_the_stop_line(name: str) -> None:
    junction = find(name)
    assert [crosswalk.arm for crosswalk in junction.crossings] == [0, 1, 2, 3]
    for crosswalk in junction.crossings:
        line = junction.way_in(crosswalk.arm)
        x, y, heading = line.pose(line.length)
        ahead, right = np.array([math.cos(heading), math.sin(heading)]), np.array([math.sin(heading), -math.cos(heading)])
        behind, aside = (crosswalk.area - (x, y)) @ ahead, (crosswalk.area - (x, y)) @ right
        # 3 m wide, 1.5 m behind the stop line, 0.5 m beyond the lanes of 3.5 m on either side.
        assert (behind.min(), behind.max()) == pytest.approx((1.5, 4.5), abs=1e-6)
        assert (aside.min(), aside.max()) == pytest.approx((-5.75, 2.25), abs=1e-6)
        near, far = ((point - (x, y)) @ right for point in crosswalk.path.points)
        # The kerbs are those of the lanes of right turns, whose circles of 13.25 m have left the straight lanes by
        # 13.25 - sqrt(13.25^2 - 3^2) = 0.344 m in the middle of the crosswalk, at an angle of 13.1 degrees.
        kerb = 0.344 + 1.75 / math.cos(math.asin(3 / 13.25))
        assert (near, far) == pytest.approx((kerb, -3.5 - kerb), abs=0.03)
        assert crosswalk.middle == pytest.approx(crosswalk.path.length / 2, abs=0.01)
        assert crosswalk.island == 0.0


def test_built_in_crosswalks_cover_movements_where_these_cross_them() -> None:
    junction = find("zebra4")
    for (number, key), stretch in junction.covers.items():
        length = junction.movements[key].length
        assert junction.crossings[number].arm in key
        straight = (1.5, 4.5) if junction.crossings[number].arm == key[0] else (length - 4.5, length - 1.5)
        assert stretch == pytest.approx(straight, abs=0.2)
    assert len(junction.covers) == 24, "each of twelve movements leaves one arm and enters another one"


@pytest.mark.parametrize("name", CROSSED)
def test_junction_is_the_same_without_pedestrians(name: str) -> None:
    junction, plain = find(name), find(CROSSED[name])
    assert junction.digest == plain.digest
    assert junction.walked.digest != plain.digest
    assert [place for place in names() if find(place).crossings] == list(CROSSED)


def test_pedestrians_walk_while_vehicles_beside_them_have_green() -> None:
    assert [crosswalk.phase for crosswalk in find("zebra4").crossings] == [None] * 4
    junction = find("walk4")
    for crosswalk in junction.crossings:
        green = [key for key in junction.movements if junction.entrances[key[0]].phase == crosswalk.phase]
        over = {junction.movements[key].turn for key in green if crosswalk.arm in key}
        assert over == {Turn.RIGHT, Turn.LEFT}, "who goes straight drives beside the crosswalk"


def test_the_hull_of_points_has_their_outermost_corners() -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
    assert hull(np.array([*square[::2], (1.0, 0.5), (1.0, 0.0), *square[1::2], square[0]])).tolist() == [list(p) for p in square]
    assert len(hull(np.array([(0.0, 0.0), (1.0, 1.0), (3.0, 3.0)]))) < 3


def crossed(root: ElementTree.Element, *objects: str, road: int = 0) -> ElementTree.Element:
    """Add objects to a road of a map."""
    element = root.findall("road")[road]
    group = element.find("objects")
    if group is None:
        group = ElementTree.SubElement(element, "objects")
    group.extend(map(ElementTree.fromstring, objects))
    return root


def corners(tag: str, *places: tuple[float, float], wrapped: bool = True) -> str:
    """Return an outline."""
    names = "st" if tag == "cornerRoad" else "uv"
    parts = "".join(f'<{tag} {names[0]}="{a!r}" {names[1]}="{b!r}" z="0" height="0"/>' for a, b in places)
    return f"<outlines><outline>{parts}</outline></outlines>" if wrapped else f"<outline>{parts}</outline>"


def painted(place: str, inside: str = "", id: str = "z") -> str:
    """Return a crosswalk."""
    return f'<object type="crosswalk" id="{id}" {place}>{inside}</object>'


RECTANGLE = [(2.0, 3.5), (2.0, -3.5), (5.0, -3.5), (5.0, 3.5)]
"""Station and lateral position of the corners of a crosswalk over the two lanes of an arm, 2 to 5 m before its vertex [m]."""
ALONG = [(u, v) for v, u in ((1.5, 3.5), (1.5, -3.5), (-1.5, -3.5), (-1.5, 3.5))]
"""The same around its middle, as along its length and to its left."""
TURNED = [(u * math.cos(0.3) + v * math.sin(0.3), v * math.cos(0.3) - u * math.sin(0.3)) for v, u in ALONG]
"""The same with axes turned by 0.3 rad from those of the road."""
FORMS = {
    "outline of road coordinates": painted('s="9" t="9"', corners("cornerRoad", *RECTANGLE, wrapped=False)),
    "outlines of road coordinates": painted('s="9" t="9" hdg="1"', corners("cornerRoad", *RECTANGLE)),
    "corners of the road in a circle": painted('s="2" t="0"', corners("cornerRoad", *RECTANGLE, RECTANGLE[0])),
    "corners around the place": painted(f's="3.5" t="0" hdg="{math.pi / 2}"', corners("cornerLocal", *ALONG)),
    "corners turned": painted('s="3.5" t="0" hdg="0.3" orientation="-"', corners("cornerLocal", *TURNED, wrapped=False)),
    "length and width": painted('s="3.5" t="0" hdg="0" length="3" width="7"'),
    "length across": painted(f's="3.5" t="0" hdg="{-math.pi / 2}" length="7" width="3"'),
    "too few corners": painted('s="3.5" t="0" length="3" width="7"', corners("cornerRoad", *RECTANGLE[:2])),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_give_the_same_crosswalk(read: Read, tree: Tree, form: str) -> None:
    road_map = read(crossed(tree(), FORMS[form]))
    assert road_map.warnings == ()
    (crosswalk,) = road_map.junction("1").crossings
    assert (crosswalk.id, crosswalk.arm, crosswalk.phase) == ("z", 0, None)
    # Arm 0 comes from the south, its vertices 15 m from the centre: the crosswalk lies 17 to 20 m south of the centre.
    wanted = sorted((x, y) for x in (-3.5, 3.5) for y in (-20.0, -17.0))
    assert np.array(sorted(crosswalk.area.round(6).tolist())) == pytest.approx(np.array(wanted), abs=1e-6)
    assert crosswalk.path.points == pytest.approx(np.array([(3.5, -18.5), (-3.5, -18.5)]), abs=1e-6)
    assert crosswalk.middle == pytest.approx(3.5)


def test_a_cross_path_is_the_crosswalk_of_its_road(read: Read, tree: Tree) -> None:
    """A road with a walkway of 3 m, from west to east over arm 0; the junction names the road (OpenDRIVE 1.8)."""
    root = tree()
    walkway = ElementTree.fromstring(
        '<road id="900" length="9" junction="1"><planView><geometry s="0" x="-4.5" y="-17" hdg="0" length="9"><line/></geometry>'
        '</planView><lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right><lane id="-1" type="walking">'
        '<width sOffset="0" a="3" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road>'
    )
    root.insert(4, walkway)
    path = ElementTree.SubElement(root.find("junction"), "crossPath", id="p", crossingRoad="900", roadAtStart="0", roadAtEnd="0")
    path.extend([ElementTree.Element("startLaneLink", {"s": "2", "from": "1", "to": "-1"})])
    (crosswalk,) = read(root).junction("1").crossings
    assert (crosswalk.id, crosswalk.arm) == ("p", 0)
    assert crosswalk.path.points == pytest.approx(np.array([(3.5, -18.5), (-3.5, -18.5)]), abs=1e-6)
    path.set("crossingRoad", "901")
    road_map = read(root)
    assert road_map.junction("1").crossings == ()
    assert [warning.message for warning in road_map.warnings] == [
        "the crossPath 'p' of junction '1' names road '901', which does not exist; it was left out"
    ]


BROKEN = {
    painted('t="0"'): "z' of road '0' was left out: <object> has no attribute 's', expected a number",
    painted('s="here" t="0"'): "z' of road '0' was left out: s='here' of <object> is not a number",
    painted('s="1" t="0" hdg="nan"'): "z' of road '0' was left out: hdg='nan' of <object> is not a finite number",
    painted('s="1" t="0"'): "z' of road '0' was left out: it has neither an outline of three corners nor a length and a width",
    painted('s="1" t="0" length="-3" width="7"'): "z' of road '0' was left out: it has neither an outline",
    painted('s="1"', corners("cornerRoad", *RECTANGLE).replace('t="', 'x="', 1)): "left out: <cornerRoad> has no attribute 't'",
    painted('s="1"', corners("cornerLocal", (0, 0), (1, 1), (4, 4))): "was left out: its painted area has 0.00 m^2, expected 0.5",
    painted('s="1" length="3" width="1e5"'): "was left out: its painted area is 100000 m wide, expected at most 100 m",
    painted('s="1e9" length="3" width="7"'): "z' of road '0' is at no junction: the nearest arm begins 999999",
    painted('s="60" length="3" width="7"'): "is at no junction: the nearest arm begins 59 m away, expected at most 15 m",
    painted(
        's="3" t="8" length="3" width="7"'
    ): "is at no junction: no movement leads over it within 15 m of an entrance or exit",
}
"""Per crosswalk that is broken or at no junction, words of the warning."""


@pytest.mark.parametrize("crosswalk", BROKEN)
def test_a_broken_crosswalk_costs_itself_alone(read: Read, tree: Tree, crosswalk: str) -> None:
    road_map = read(crossed(tree(crosswalk=3.0), crosswalk))
    assert [item.id for item in road_map.junction("1").crossings] == [f"crosswalk{arm}" for arm in range(4)]
    (warning,) = road_map.warnings
    assert (warning.kind, warning.road) == (Doubt.CROSSWALK, "0")
    assert BROKEN[crosswalk] in warning.message
    assert warning.message.startswith("the crosswalk 'z' of road '0' ")


def halves(step: float) -> tuple[str, str]:
    """Return crosswalks over the two lanes of an arm with a median: the lane in, and the lane out, that much farther off [m]."""
    box = 'length="3" width="3.5"'
    return painted(f's="3.5" t="4.6" {box}', id="in"), painted(f's="{3.5 + step}" t="-4.6" {box}', id="out")


def test_areas_in_one_line_are_one_crosswalk_with_an_island(read: Read, tree: Tree) -> None:
    """Lanes of 3.5 m, 4.6 m from the axis: 2 (4.6 - 1.75) = 5.7 m lie between the two."""
    for objects, name in (
        (halves(0.0), "in+out"),
        (halves(1.0), "in+out"),
        ([painted('s="3.5" t="0" length="3" width="13"')], "z"),
    ):
        (crosswalk,) = read(crossed(tree(lane_offset=4.6), *objects)).junction("1").crossings
        assert crosswalk.id == name
        assert crosswalk.island == pytest.approx(5.7, abs=0.05)
        assert crosswalk.path.length == pytest.approx(12.7, abs=0.1)
        assert crosswalk.middle == pytest.approx(6.35, abs=0.05)


def test_staggered_areas_are_two_crosswalks(read: Read, tree: Tree) -> None:
    junction = read(crossed(tree(lane_offset=4.6), *halves(4.0))).junction("1")
    lane_in, lane_out = junction.crossings
    assert [(c.id, c.arm, c.island, c.path.length) for c in (lane_in, lane_out)] == [
        ("in", 0, 0.0, pytest.approx(3.5)),
        ("out", 0, 0.0, pytest.approx(3.5)),
    ]
    assert (lane_in.middle, lane_out.middle) == (pytest.approx(3.5), 0.0), "each is a half"
    assert {key[0] for number, key in junction.covers if number == 0} == {0}
    assert {key[1] for number, key in junction.covers if number == 1} == {0}


def test_a_median_on_which_nobody_can_wait_is_no_island(read: Read, tree: Tree) -> None:
    for offset, island in ((2.6, 0.0), (2.7, 1.9)):  # 2 (2.6 - 1.75) = 1.7 m
        crosswalks = read(tree(lane_offset=offset, crosswalk=3.0)).junction("1").crossings
        assert [crosswalk.island for crosswalk in crosswalks] == pytest.approx([island] * 4, abs=0.05)


def test_the_kerb_is_behind_the_shoulder(read: Read, tree: Tree) -> None:
    """Beside the lane in lie a shoulder of 1.2 m and a sidewalk of 2 m, beside the lane out a sidewalk alone."""
    root = crossed(tree(), painted('s="3.5" t="0" length="3" width="12"'))
    section = root.find("road/lanes/laneSection")
    for side, lanes in (("left", {3: ("sidewalk", 2), 2: ("shoulder", 1.2)}), ("right", {-2: ("sidewalk", 2)})):
        for id, (type, width) in lanes.items():
            lane = ElementTree.SubElement(section.find(side), "lane", id=str(id), type=type)
            ElementTree.SubElement(lane, "width", sOffset="0", a=str(width), b="0", c="0", d="0")
    (crosswalk,) = read(root).junction("1").crossings
    assert crosswalk.path.points[:, 0] == pytest.approx((4.7, -3.5), abs=1e-6)
    assert crosswalk.middle == pytest.approx(4.7)


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize("ways", range(3, 9))
def test_any_arm_has_its_crosswalk(read: Read, ways: int, left_hand: bool) -> None:
    """The near side is the side of the entrance, and the crosswalk leads straight across the arm."""
    layout = Layout(ways, JunctionControl.LIGHTS, stop=25.0, setback=6.0, left_hand=left_hand, crosswalk=4.0)
    junction = read(opendrive(layout)).junction("1")
    assert [(crosswalk.id, crosswalk.arm) for crosswalk in junction.crossings] == [(f"crosswalk{k}", k) for k in range(ways)]
    for crosswalk, (entrances, _) in zip(junction.crossings, junction.arms, strict=True):
        x, y, heading = junction.entrances[entrances[0]].stop_line
        near, far = ((point - (x, y)) @ (math.sin(heading), -math.cos(heading)) for point in crosswalk.path.points)
        # To the right of the middle of the lane: half the lane, or beyond the lane of the other direction.
        assert (near, far) == pytest.approx((-1.75, 5.25) if left_hand else (1.75, -5.25), abs=0.01)
        behind = (crosswalk.area - (x, y)) @ (math.cos(heading), math.sin(heading))
        assert (behind.min(), behind.max()) == pytest.approx((1.5, 5.5))
        # With 5 or 7 arms every arm faces two others, so that all have green together, and nobody can walk meanwhile.
        own = junction.entrances[entrances[0]].phase
        assert crosswalk.phase is None if len(junction.phase_groups) == 1 else crosswalk.phase not in (None, own)


def test_pedestrians_wait_for_arrows_across_their_way(read: Read) -> None:
    """At lanes4 the left turns of the neighbour arm lead over a crosswalk with an arrow; who goes straight there passes it."""
    junction = read(opendrive(replace(CROSSINGS["lanes4"], crosswalk=3.0))).junction("1")
    groups = [{(junction.entrances[k].arm, junction.entrances[k].lane) for k in group} for group in junction.phase_groups]
    walking = [groups[crosswalk.phase] for crosswalk in junction.crossings if crosswalk.phase is not None]
    assert walking == [{(1, 0), (3, 0)}, {(0, 0), (2, 0)}] * 2


def test_pedestrians_at_a_t_walk_with_the_road_beside_them(read: Read) -> None:
    junction = read(opendrive(Layout(3, JunctionControl.LIGHTS, crosswalk=3.0))).junction("1")
    assert junction.phase_groups == ({0}, {1, 2})
    assert [crosswalk.phase for crosswalk in junction.crossings] == [1, 0, 0]


def test_a_controller_with_lights_for_pedestrians_decides(read: Read) -> None:
    """Pedestrians over arm 0 of lanes4 walk with arms 1 and 3, or with their left turns if the lights share a controller."""
    root = ElementTree.fromstring(opendrive(replace(CROSSINGS["lanes4"], crosswalk=3.0)))
    controllers = {element.get("id"): element for element in root.findall("controller")}

    def phase() -> int | None:
        return read(root).junction("1").crossings[0].phase

    assert phase() == 2
    for control in controllers["2"].findall("control[@type='pedestrian']"):
        controllers["2"].remove(control)
    assert phase() == 2, "no controller, but vehicles that go straight beside the crosswalk"
    left = ElementTree.SubElement(controllers["3"], "control", signalId="walk0.right", type="pedestrian")
    assert phase() == 3
    ElementTree.SubElement(controllers["3"], "control", signalId="1")
    assert phase() == 2, "a controller of two phases says nothing"
    controllers["3"].remove(left)
    ElementTree.SubElement(controllers["0"], "control", signalId="walk0.left", type="pedestrian")
    assert phase() == 2, "nobody walks while vehicles come from the arm"


def test_pedestrians_before_an_arm_without_light_have_none(read: Read, tree: Tree) -> None:
    root = tree(control=JunctionControl.LIGHTS, crosswalk=3.0)
    signals = root.find("road/signals")
    signals.remove(signals.find("signal[@id='0']"))
    junction = read(root).junction("1")
    assert junction.control is JunctionControl.PARTIAL
    assert [crosswalk.phase is None for crosswalk in junction.crossings] == [True, False, False, False]


def test_report_of_crosswalks(read: Read, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layout = replace(CROSSINGS["walk4"], lane_offset=4.6)
    path = tmp_path / "walk.xodr"
    path.write_text(opendrive(layout), encoding="utf-8")
    (junction,) = describe(read_map(path))["junctions"]
    crosswalk = junction["crossings"][0]
    assert (crosswalk["id"], crosswalk["arm"], crosswalk["phase"], crosswalk["green"]) == ("crosswalk0", 0, 1, [1, 3])
    assert sorted(crosswalk["corners"]) == [[-6.85, -13.5], [-6.85, -10.5], [6.85, -13.5], [6.85, -10.5]]
    assert crosswalk["behind_line"] == pytest.approx(1.5, abs=1e-3)
    (lane_in,), (lane_out,) = crosswalk["entrances"], crosswalk["exits"]
    assert (lane_in["lane"], lane_in["from"]) == (0, pytest.approx(1.5, abs=2e-3))
    assert (lane_out["lane"], lane_out["to"]) == (0, pytest.approx(-1.5, abs=2e-3))
    straight = [k for k, way in enumerate(junction["movements"]) if way["turn"] == "straight"]
    ways = {way["movement"]: (way["from"], way["to"]) for way in crosswalk["movements"]}
    arms = {k: (junction["movements"][k]["entrance"], junction["movements"][k]["exit"]) for k in ways}
    assert sorted(arms.values()) == [(0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0)]
    assert [ways[k] for k in straight if k in ways] == [
        pytest.approx((1.5, 4.5), abs=2e-3),
        pytest.approx((25.5, 28.5), abs=2e-3),
    ]
    assert main(["map", str(path)]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert lines[2] == "4 crosswalks at 1 junction"
    long = f"{crosswalk['length']:.1f} m long, 1.5 m behind the stopping line, island of 5.7 m, walk with the green of"
    assert lines[-1] == f"crosswalks: arms 0 and 2: {long} arms 1 and 3; arms 1 and 3: {long} arms 0 and 2"
    # The circles of right turns have 15 - 4.6 = 10.4 m and have left the straight lanes by 10.4 - sqrt(10.4^2 - 3^2) = 0.442 m.
    kerb = 4.6 + 0.442 + 1.75 / math.cos(math.asin(3 / 10.4))
    assert crosswalk["length"] == pytest.approx(2 * kerb, abs=0.06)


def test_picture_of_crosswalks() -> None:
    """A panel shows 15 m of junction and 18 m of road on either side of the centre; stripes span the crosswalk."""
    panel = ElementTree.fromstring(draw_map(read_map(path_of("zebra4"))))
    stripes = [path for path in panel.iter(f"{SVG}path") if path.get("class") == "crosswalk"]
    assert len(stripes) == 4
    scale = 360 / 2 / (15 + 18)
    for path in stripes:
        assert float(path.get("stroke-width", "")) == pytest.approx(3.0 * scale, abs=0.1)
        x0, y0, x1, y1 = map(float, re.findall(r"[\d.]+", path.get("d", "")))
        assert math.dist((x0, y0), (x1, y1)) == pytest.approx(7.8 * scale, abs=0.3)
        assert math.dist((180, 180), ((x0 + x1) / 2, (y0 + y1) / 2)) == pytest.approx(12.0 * scale, abs=0.2)


def reference(road: ElementTree.Element, s: float) -> tuple[float, float, float]:
    """Return point and heading of a reference line of lines, arcs, spirals and parametric cubics, by steps of a millimetre."""
    pieces = [(float(piece.get("s", "")), piece) for piece in road.iter("geometry")]
    start, piece = max((row for row in pieces if row[0] <= max(s, 0.0)), key=lambda row: row[0])
    x, y, heading, length = (float(piece.get(name, "")) for name in ("x", "y", "hdg", "length"))
    along = np.linspace(0.0, s - start, max(int((s - start) * 1000), 1) + 1)
    (kind,) = piece
    value = {name: float(text) for name, text in kind.items() if name != "pRange"}
    if kind.tag == "paramPoly3":
        p = along if kind.get("pRange") == "arcLength" else along / length
        u, v = (value[f"a{w}"] + p * (value[f"b{w}"] + p * (value[f"c{w}"] + p * value[f"d{w}"])) for w in "UV")
        turn = math.atan2(v[-1] - v[-2], u[-1] - u[-2]) if len(u) > 1 and s > start else 0.0
    else:
        first = value.get("curvature", value.get("curvStart", 0.0))
        rate = (value.get("curvEnd", first) - first) / length
        middle = (along[1:] + along[:-1]) / 2
        turned = first * middle + rate * middle**2 / 2
        u, v = (np.cumsum(np.concatenate(([0.0], part * np.diff(along)))) for part in (np.cos(turned), np.sin(turned)))
        turn = first * along[-1] + rate * along[-1] ** 2 / 2
    cos, sin = math.cos(heading), math.sin(heading)
    return x + u[-1] * cos - v[-1] * sin, y + u[-1] * sin + v[-1] * cos, heading + turn


def counted(root: ElementTree.Element) -> dict[tuple[str, str], list[NDArray[np.float64]]]:
    """Return, per road and its end at a junction, the areas of the crosswalks whose middle is nearest to this end."""
    if root.find("road/objects/object[@type='crosswalk']") is None:
        return {}
    roads = {road.get("id", ""): road for road in root.iter("road")}
    ends = {}
    for id, road in roads.items():
        for tag, name, s in (("predecessor", "start", 0.0), ("successor", "end", float(road.get("length", "")))):
            link = road.find(f"link/{tag}")
            if link is not None and link.get("elementType") == "junction":
                ends[id, name] = reference(road, s)[:2]
    areas: dict[tuple[str, str], list[NDArray[np.float64]]] = {}
    for road in roads.values():
        for element in road.iter("object"):
            if element.get("type") != "crosswalk":
                continue
            x, y, heading = reference(road, float(element.get("s", "")))
            t, turn = float(element.get("t", "")), float(element.get("hdg", ""))
            points = []
            for corner in element.iter("cornerLocal"):
                u, v = float(corner.get("u", "")), float(corner.get("v", ""))
                cos, sin = math.cos(heading + turn), math.sin(heading + turn)
                points.append((x - t * math.sin(heading) + u * cos - v * sin, y + t * math.cos(heading) + u * sin + v * cos))
            for corner in element.iter("cornerRoad"):
                cx, cy, direction = reference(road, float(corner.get("s", "")))
                aside = float(corner.get("t", ""))
                points.append((cx - aside * math.sin(direction), cy + aside * math.cos(direction)))
            area = np.array(list(dict.fromkeys(points)))
            middle = area.mean(axis=0)
            areas.setdefault(min(ends, key=lambda end: math.dist(ends[end], middle)), []).append(area)
    return areas


MAPS = sorted((Path(__file__).parents[3] / "shared" / "maps").glob("*.xodr"))


@pytest.mark.skipif(not MAPS, reason="the maps of others are not here")
@pytest.mark.parametrize("path", MAPS, ids=lambda path: path.stem)
def test_crosswalks_of_the_maps_of_others_are_those_of_their_files(path: Path) -> None:
    """Held against a count from the XML alone: the end of a road at a junction that is nearest to each crosswalk."""
    root = ElementTree.parse(path).getroot()
    if root.find("junction") is None:
        return
    road_map, areas = read_map(path), counted(root)
    found: dict[tuple[str, str], list[NDArray[np.float64]]] = {}
    for id, crosswalks in road_map.crossings.items():
        for crosswalk in crosswalks:
            for end in road_map.report(id).arms[crosswalk.arm].ends:
                found.setdefault(end, []).append(crosswalk.area)
    assert {end: len(parts) for end, parts in found.items()} == {end: len(parts) for end, parts in areas.items()}
    for end, (area,) in found.items():
        for corner in area:
            assert min(math.dist(corner, other) for other in areas[end][0]) < 0.01
    assert not [warning for warning in road_map.warnings if warning.kind == Doubt.CROSSWALK]
    for report in road_map.junctions:
        if report.usable:
            assert len(road_map.junction(report.id).crossings) == len(road_map.crossings.get(report.id, ()))
    expected = {"Town04": 27, "Town07": 7, "intersection_3_5m_width_crosswalk": 4}
    assert sum(map(len, areas.values())) == expected.get(path.stem, 0)
