"""The JSON object of ``rvads map FILE --json``."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.network import Doubt, MapWarning, gathered
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import describe, read_map
from tools.crossings import Layout, opendrive

from .conftest import Read, Tree


def test_all_fields() -> None:
    path = path_of("light3")
    record = json.loads(json.dumps(describe(read_map(path))))
    (junction,) = record.pop("junctions")
    assert record == {"file": str(path), "warnings": []}
    rows = junction.pop("movements")
    assert {(m["lane"], m["exit_lane"]) for m in rows} == {(0, 0)}
    movements = {(m["entrance"], m["exit"]): (m["turn"], m["length"]) for m in rows}
    assert {key: turn for key, (turn, _) in movements.items()} == {
        (0, 1): "right",
        (0, 2): "left",
        (1, 0): "left",
        (1, 2): "straight",
        (2, 0): "right",
        (2, 1): "straight",
    }
    assert movements[1, 2][1] == 30.0
    assert junction == {
        "id": "1",
        "ways": 3,
        "control": "lights",
        "usable": True,
        "kind": "crossing",
        "usable_from": 120.0,
        "reason": None,
        "entrances": [
            {"entrance": k, "arm": k, "lane": 0, "sign": "lights", "setback": 0.0, "no_turn_on_red": False} for k in range(3)
        ],
        "arms": [{"entrances": 1, "exits": 1, "control": "lights", "speed_limits": []}] * 3,
        # In the order of movements 0-1, 0-2, 1-0, 1-2, 2-0, 2-1: those that merge, and the two left turns across each other
        # and across the straight one they meet. Right turns meet only whoever goes to the same exit.
        "conflicts": [[0, 5], [1, 2], [1, 3], [1, 5], [2, 4], [2, 5]],
        # On the same green the left turn from arm 1 lets oncoming traffic from arm 2 go.
        "yields": [[2, 4], [2, 5]],
        "undecided": [],
        "approach": [120.0, 120.0, 120.0],
        "right_of": [[0, 2], [1, 0]],
        "opposite": [[1, 2], [2, 1]],
        "crossings": [],
    }


def test_warnings_are_records(read: Read, tree: Tree) -> None:
    root = tree()
    signal = root.find("road/signals/signal")
    signal.set("orientation", "+")
    record = describe(read(root))
    assert [warning["kind"] for warning in record["warnings"]] == ["orientation"]
    assert record["warnings"][0]["junction"] == "1"
    assert record["junctions"][0]["control"] == "stop"


def test_an_arm_without_exit_is_one_way(read: Read) -> None:
    # The first arm loses its way out: exits lead to a sidewalk there.
    road_map = read(opendrive(Layout()).replace('id="-1" type="driving"', 'id="-1" type="sidewalk"', 1))
    (junction,) = describe(road_map)["junctions"]
    assert (junction["ways"], junction["control"], junction["usable"]) == (4, "stop", True)
    assert [(arm["entrances"], arm["exits"]) for arm in junction["arms"]] == [(1, 0), (1, 1), (1, 1), (1, 1)]
    assert {(m["arm"], m["exit_arm"]) for m in junction["movements"]} == {(i, k) for i in range(4) for k in (1, 2, 3) if i != k}


def test_connecting_roads_complete_the_table(read: Read, tree: Tree) -> None:
    root = tree()
    junction = root.find("junction")
    for row in junction.findall("connection")[::2]:
        junction.remove(row)
    (found,) = read(root).junctions
    assert found.usable


def test_connecting_roads_that_do_not_name_their_junction(read: Read) -> None:
    road_map = read(opendrive(Layout()).replace('junction="1" rule', 'junction="-1" rule'))
    (found,) = road_map.junctions
    assert found.usable
    assert {warning.kind for warning in road_map.warnings} == {"table"}


def test_reversed_lanes(read: Read, tree: Tree) -> None:
    """A one-way road whose two lanes both lead away: the arm has no entrance left, and nothing leads into its second lane."""
    root = tree()
    lane = root.find("road/lanes/laneSection/left/lane")
    lane.set("direction", "reversed")
    (found,) = read(root).junctions
    assert found.usable
    assert [(len(arm.entrances), len(arm.exits)) for arm in found.arms] == [(0, 1), (1, 1), (1, 1), (1, 1)]


def test_unusable_junctions_keep_ways_and_control(read: Read, tree: Tree) -> None:
    root = tree()
    for road in root.findall("road")[1:4]:
        lane = road.find("lanes/laneSection/left/lane")
        lane.set("type", "sidewalk")
    (junction,) = describe(read(root))["junctions"]
    assert (junction["ways"], junction["control"], junction["usable"]) == (4, "stop", False)
    assert junction["usable_from"] is None
    assert junction["reason"] == ("Traffic enters it from 1 of its 4 arms, and a usable junction has traffic from at least two.")
    assert {(m["arm"], m["exit_arm"]) for m in junction["movements"]} == {(0, 1), (0, 2), (0, 3)}


def test_dual_carriageways_are_one_arm(read: Read, tree: Tree) -> None:
    """An arm of two one-way roads side by side is one arm, with entrance and exit (the paper's entex)."""
    root = tree(lane_offset=4.6)
    arm = root.find("road")
    twin = ElementTree.fromstring(ElementTree.tostring(arm))
    twin.set("id", "50")
    for road, side in ((arm, "right"), (twin, "left")):
        for section in road.iter("laneSection"):
            section.remove(section.find(side))
    twin.remove(twin.find("objects"))
    twin.remove(twin.find("signals"))
    root.insert(1, twin)
    # Movements to exit 0 now end on the twin.
    for road in root.iter("road"):
        link = road.find("link/successor")
        if link is not None and link.get("elementType") == "road" and link.get("elementId") == "0":
            link.set("elementId", "50")
    (found,) = read(root).junctions
    assert found.usable, found.reason
    assert found.arms[0].ends == (("0", "start"), ("50", "start"))
    assert found.right_of == read(tree(lane_offset=4.6)).junctions[0].right_of


def test_table_and_links_are_compared(read: Read, tree: Tree) -> None:
    root = tree()
    junction = root.find("junction")
    junction.remove(junction.find("connection"))
    lane = root.findall("road")[-1].find("lanes/laneSection/right/lane")
    lane.find("link").remove(lane.find("link/predecessor"))
    road_map = read(root)
    assert road_map.report("1").usable
    (warning,) = road_map.warnings
    assert warning.kind == "table"
    assert "1 links into junction '1' are only in its table and 1 only in its roads" in warning.message


def test_a_lane_without_its_last_link_is_completed(read: Read, tree: Tree) -> None:
    root = tree()
    lane = root.findall("road")[-1].find("lanes/laneSection/right/lane")
    lane.find("link").remove(lane.find("link/successor"))
    road_map = read(root)
    assert road_map.report("1").usable
    assert [warning.kind for warning in road_map.warnings] == ["link"]


def test_both_sides_at_once_are_refused(read: Read, tree: Tree) -> None:
    root = tree()
    arm, *_, movement = root.findall("road")
    assert movement.get("junction") == "1"
    for name, left in (("left", 1), ("right", -1)):
        lane = arm.find(f"lanes/laneSection/{name}/lane")
        lane.set("direction", "reversed")
        assert lane.get("id") == str(left)
    arm.set("rule", "LHT")
    (found,) = read(root).junctions
    assert found.reason == "traffic keeps right on some of its roads and left on others"


@pytest.mark.parametrize(
    ("change", "words"), [('type="default"', None), ('type="virtual"', 'type "virtual"'), ('type="crossing"', 'type "crossing"')]
)
def test_types_of_junctions(read: Read, change: str, words: str | None) -> None:
    (found,) = read(opendrive(Layout()).replace('<junction id="1"', f'<junction {change} id="1"')).junctions
    assert found.ways == 4
    assert (found.reason or "").count(words or "x" * 99) == (words is not None)
    assert found.usable == (words is None)


def test_the_text_shows_lanes_control_and_who_gives_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a cross whose southern arm has a yield sign and whose western one has no entrance."""
    root = ElementTree.fromstring(opendrive(Layout()))
    for arm, road in enumerate(root.findall("road")[:4]):
        if arm == 0:
            road.find("signals/signal").set("type", "205")
        else:
            road.remove(road.find("signals"))
    root.findall("road")[3].find("lanes/laneSection/left/lane").set("type", "sidewalk")
    path = tmp_path / "cross.xodr"
    path.write_bytes(ElementTree.tostring(root))
    assert main(["map", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].split(maxsplit=3) == ["1", "4-way", "yield", "crossing; vehicles start up to 120 m before the line"]
    assert lines[3].strip() == (
        "arm 0: 1 lane in (entrance 0), 1 out, yield; arm 1: 1 lane in (entrance 1), 1 out, no sign; "
        "arm 2: 1 lane in (entrance 2), 1 out, no sign; arm 3: 0 lanes in, 1 out"
    )
    # From the south to both others by the sign; the eastern arm to the northern one, which lies on its right.
    assert lines[4].strip() == "gives way: arm 0 to 1, 2; arm 1 to 2"


@pytest.mark.parametrize("name", ["stop4", "4-way lights"])
def test_built_in_junctions_are_maps_by_name(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "map.svg"
    assert main(["map", name, "--json", "--svg", str(picture)]) == 0
    (junction,) = json.loads(capsys.readouterr().out)["junctions"]
    assert (junction["ways"], junction["control"]) == (4, "stop" if name == "stop4" else "lights")
    assert picture.read_text().startswith("<svg")
    assert main(["map", "stpo4"]) != 0
    assert "did you mean 'stop4'?" in capsys.readouterr().err


def test_lanes_have_one_name_everywhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The number of an entrance, as in `subject=` and messages of rules: arm 1 has the entrances 2 and 3."""
    lights = Layout(4, JunctionControl.LIGHTS, lanes=(((1, 2), (3,)),) * 4)
    root = ElementTree.fromstring(opendrive(lights))
    signals = root.findall("road")[1].find("signals")
    lit = {row.get("fromLane"): signal for signal in signals for row in signal.iter("validity")}
    signals.remove(lit["1"])
    path = tmp_path / "lanes.xodr"
    path.write_bytes(ElementTree.tostring(root))
    assert main(["map", str(path), "--svg", str(tmp_path / "map.svg")]) == 0
    out, err = capsys.readouterr()
    assert "arm 1: 2 lanes in (entrances 2 and 3), 1 out, lights at 1 of 2 (entrance 2), no sign at 1 of 2 (entrance 3);" in out
    assert "entrances 3 of junction '1' have no sign or light" in err
    assert ">3</text>" in (tmp_path / "map.svg").read_text()
    record = describe(read_map(path))
    bare = [lane for lane in record["junctions"][0]["entrances"] if lane["sign"] == "none"]
    assert [(lane["entrance"], lane["arm"], lane["lane"]) for lane in bare] == [(3, 1, 1)]
    ways = {(way["entrance"], way["arm"], way["lane"]) for way in record["junctions"][0]["movements"]}
    assert ways == {(2 * arm + lane, arm, lane) for arm in range(4) for lane in range(2)}


def test_equal_warnings_are_one_line_with_a_count(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of limits that can't be read; those of lanes that nobody drives on are not told."""
    root = ElementTree.fromstring(opendrive(Layout()))
    for road in root.findall("road")[:4]:
        for lane in road.iter("lane"):
            ElementTree.SubElement(lane, "speed", {"sOffset": "0", "max": "0", "unit": "mph"})
        side = road.find("lanes/laneSection/left")
        walk = ElementTree.SubElement(side, "lane", {"id": "2", "type": "sidewalk"})
        ElementTree.SubElement(walk, "speed", {"sOffset": "0", "max": "-1", "unit": "mph"})
    path = tmp_path / "zero.xodr"
    path.write_bytes(ElementTree.tostring(root))
    assert main(["map", str(path)]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("warning: a speed limit of road '0' was ignored: ")
    assert line.endswith("got '0 mph' (and 7 more such: road '1', road '2', road '3')")
    (record,) = describe(read_map(path))["warnings"]
    assert (record["kind"], record["road"], record["count"]) == ("speed", "0", 8)
    assert {other["road"] for other in record["more"]} == {"0", "1", "2", "3"}
    assert main(["map", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == [record]


def test_warnings_that_say_something_else_keep_their_lines() -> None:
    texts = ["lane 1.0.-1 is odd", "lane 'a b' is odd", "lanes 1.0.-1 and 2.0.-1 are odd", "lane 1.0.-1 is even"]
    warnings = [MapWarning(Doubt.LANE, text, str(k)) for k, text in enumerate(texts)]
    assert [record.get("count", 1) for record in gathered([*warnings, MapWarning(Doubt.GAP, texts[0])])] == [2, 1, 1, 1]
