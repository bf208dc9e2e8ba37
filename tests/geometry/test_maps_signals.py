"""From signals to entrances: the policy for signs, lights and stop lines, on one junction with one thing changed."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.traffic import RedLightRunner
from pytest_rvads.geometry.control import JunctionControl, MapObject, ObjectKind, Sign, sign_setback_of
from pytest_rvads.geometry.opendrive.records import Signal
from pytest_rvads.geometry.opendrive.signals import kind_of
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.support.errors import MapError
from tools.crossings import Layout, opendrive

from .conftest import Read, Tree


def signal(type: str, subtype: str = "-1", *, dynamic: bool = False) -> Signal:
    return Signal("1", "r", 0.0, 0.0, "+", False, type, subtype, dynamic, (), False)


@pytest.mark.parametrize(
    ("type", "subtype", "dynamic", "kind"),
    [
        ("206", "-1", False, ObjectKind.STOP),
        ("r1", "", False, ObjectKind.STOP),
        ("r1-1", "", False, ObjectKind.STOP),
        ("stop", "", False, ObjectKind.STOP),
        ("r1", "2", False, ObjectKind.YIELD),
        ("r1-2", "", False, ObjectKind.YIELD),
        ("205", "-1", False, ObjectKind.YIELD),
        ("301", "-1", False, ObjectKind.PRIORITY),
        ("306", "-1", False, ObjectKind.PRIORITY),
        ("274", "50", False, None),
        ("1000001", "-1", True, ObjectKind.LIGHT),
        ("1000001", "-1", False, None),
        ("1000011", "10", True, ObjectKind.LIGHT),
        ("1000020", "-1", True, ObjectKind.LIGHT),
        ("1000002", "-1", True, None),  # pedestrians
        ("1000007", "-1", True, None),
        ("1000013", "-1", True, None),  # bicycles
        ("", "", True, None),
        ("²", "", True, None),
        ("9" * 5000, "", True, None),
    ],
)
def test_kinds(type: str, subtype: str, dynamic: bool, kind: ObjectKind | None) -> None:
    assert kind_of(signal(type, subtype, dynamic=dynamic)) is kind


def road(root: Element, id: str) -> Element:
    return next(road for road in root.iter("road") if road.get("id") == id)


def sign(root: Element, arm: int) -> Element:
    return road(root, str(arm)).find("signals/signal")


def remove_sign(root: Element, arm: int) -> Element:
    signals = road(root, str(arm)).find("signals")
    element = signals.find("signal")
    signals.remove(element)
    return element


def set_validity(element: Element, *lanes: tuple[int, int]) -> None:
    for old in element.findall("validity"):
        element.remove(old)
    for low, high in lanes:
        SubElement(element, "validity", {"fromLane": str(low), "toLane": str(high)})


def control(read: Read, root: Element) -> JunctionControl:
    return read(root).report("1").control


def test_all_entrances_must_agree(read: Read, tree: Tree) -> None:
    root = tree()
    remove_sign(root, 2)
    road_map = read(root)
    assert road_map.report("1").control is JunctionControl.PARTIAL
    (warning,) = road_map.warnings
    assert "entrances 2 of junction '1' have no sign or light" in warning.message


def test_no_signs_no_control(read: Read, tree: Tree) -> None:
    assert control(read, tree(control=JunctionControl.NONE)) is JunctionControl.NONE


def test_validity_of_lane_0_is_only_the_pole_if_a_reference_names_the_sign(read: Read, tree: Tree) -> None:
    root = tree()
    set_validity(sign(root, 1), (0, 0))
    reference = {"id": sign(root, 1).get("id"), "s": "20", "t": "0", "orientation": "+"}
    SubElement(road(root, "2").find("signals"), "signalReference", reference)
    assert control(read, root) is JunctionControl.PARTIAL, "the reference is on another road, for another entrance"


def place(root: Element, arm: int, *, past: float, aside: float) -> None:
    """Let the sign of an arm name lane 0 alone, `past` behind the end of the incoming lane and `aside` right of it [m].

    The road of an arm begins at the junction and leads away, so lanes of positive ids lead in where traffic keeps right.
    """
    set_validity(sign(root, arm), (0, 0))
    left_hand = road(root, str(arm)).get("rule") == "LHT"
    sign(root, arm).set("s", str(-past))
    sign(root, arm).set("t", str(-1.75 - aside if left_hand else 1.75 + aside))


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize(
    ("past", "aside", "stops"),
    [(-0.3, 5.7, True), (-0.9, 3.0, True), (-1.5, 5.7, False), (-0.3, -5.7, False), (-0.3, 30.0, False)],
)
def test_a_sign_of_no_lane_is_for_the_lane_beside_whose_end_it_stands(
    read: Read, tree: Tree, past: float, aside: float, stops: bool, left_hand: bool
) -> None:
    """On the side of the kerb, and within a metre along the lane, as the unreferenced signs of RoadRunner stand."""
    root = tree(left_hand=left_hand)
    for arm in (0, 2):
        place(root, arm, past=past, aside=aside)
    road_map = read(root)
    assert road_map.report("1").signs == tuple(Sign.STOP if stops or arm in (1, 3) else Sign.NONE for arm in range(4))
    told = [warning.message for warning in road_map.warnings if "of lane 0 alone, which no reference names" in warning.message]
    assert [message.split(" (")[0] for message in told] == ["2 signs"] * stops


def test_a_sign_of_no_lane_on_a_connecting_road_is_for_all_lanes_of_the_arm(read: Read) -> None:
    lanes = (((1, 2), (3,)), ((1, 2, 3),), ((1, 2, 3),), ((1, 2, 3),))
    root = ElementTree.fromstring(opendrive(Layout(lanes=lanes)))
    for arm in range(4):
        element = remove_sign(root, arm) if arm < 2 else None
        if arm == 0:
            way = next(row.get("connectingRoad", "") for row in root.iter("connection") if row.get("incomingRoad") == "0")
            set_validity(element, (0, 0))
            element.set("s", "0.6")
            element.set("t", "-5.7")
            SubElement(road(root, way), "signals").append(element)
    report = read(root).report("1")
    signs = {arm: {sign for end, sign in zip(report.entrances, report.signs, strict=True) if end.arm == arm} for arm in range(4)}
    assert signs == {0: {Sign.STOP}, 1: {Sign.NONE}, 2: {Sign.STOP}, 3: {Sign.STOP}}


def mean(root: Element, arm: int, *priorities: str, **attributes: str) -> None:
    """Let the sign of an arm be of a catalogue that nobody knows, with ``<semantics>`` of these priorities."""
    sign(root, arm).attrib.update({"country": "XX", "type": "7", "subtype": "4", "name": "", **attributes})
    semantics = SubElement(sign(root, arm), "semantics")
    for priority in priorities:
        SubElement(semantics, "priority", {"type": priority})


@pytest.mark.parametrize(
    ("priorities", "attributes", "found"),
    [
        (("stop",), {}, Sign.STOP),
        (("stop", "4way"), {}, Sign.STOP),
        (("4Way",), {}, Sign.STOP),
        (("yield",), {}, Sign.YIELD),
        (("priorityRoad",), {}, Sign.PRIORITY),
        (("trafficLight",), {"dynamic": "yes"}, Sign.LIGHTS),
        (("noTurnOnRed", "trafficLight"), {"dynamic": "yes"}, Sign.LIGHTS),
        (("trafficLight",), {"dynamic": "yes", "name": "pedestrian light"}, Sign.NONE),
        (("priorityRoadEnd",), {}, Sign.NONE),
        (("priorityToTheRightRule",), {}, Sign.NONE),
        (("keepClearLine",), {}, Sign.NONE),
        (("yield",), {"type": "-1", "country": "", "name": "Sign_Stop"}, Sign.YIELD),
        (("yield",), {"type": "9999", "country": "DE"}, Sign.YIELD),
        (("yield",), {"type": "206", "country": "DE"}, Sign.STOP),
        (("yield",), {"type": "206", "country": "XX"}, Sign.YIELD),
        (("trafficLight",), {"type": "1000002", "country": "OpenDRIVE", "dynamic": "yes"}, Sign.NONE),
    ],
)
def test_semantics_decide_where_the_catalogue_is_unknown(
    read: Read, tree: Tree, priorities: tuple[str, ...], attributes: dict[str, str], found: Sign
) -> None:
    """OpenDRIVE 1.8, section 14.8: ``<priority type>`` says what a sign means, whatever the catalogue of its country."""
    root = tree()
    mean(root, 1, *priorities, **attributes)
    road_map = read(root)
    assert road_map.report("1").signs == (Sign.STOP, found, Sign.STOP, Sign.STOP)
    assert not any("unknown type" in warning.message for warning in road_map.warnings)


@pytest.mark.parametrize("priority", ["stopLine", "waitingLine"])
def test_lines_of_semantics_are_stopping_lines(read: Read, tree: Tree, priority: str) -> None:
    root = tree()
    lines(root, None)
    mean(root, 1, priority, s="0.6")
    assert read(root).report("1").setbacks == (0.0, pytest.approx(0.6), 0.0, 0.0)


def test_signals_of_unknown_type_at_entrances_are_counted(read: Read, tree: Tree) -> None:
    root = tree()
    for arm in (1, 2, 3):
        sign(root, arm).attrib.update({"country": "XX", "type": "7", "name": "board"})
    mean(root, 3, "likeNothing")
    sign(root, 2).set("s", "60.1")  # at no entrance
    SubElement(road(root, "0").find("signals"), "signal", sign(root, 0).attrib | {"id": "9", "type": "274", "country": "DE"})
    road_map = read(root)
    (message,) = [warning.message for warning in road_map.warnings if "of unknown type" in warning.message]
    assert message.startswith("2 signals of unknown type at entrances were ignored, first the signal")
    assert "country 'xx', type '7', name 'board'" in message
    assert road_map.report("1").setbacks == (0.0,) * 4


def test_a_sign_forbids_the_turn_on_red_at_its_entrance(tmp_path: Path, read: Read, tree: Tree) -> None:
    """Arms 1 and 3 have red first: at arm 1 a sign forbids the right turn on red, so `red` binds it, elsewhere `right_on_red`."""
    root = tree(control=JunctionControl.LIGHTS)
    mean(root, 1, "noTurnOnRed", "trafficLight")
    mean(root, 2, "turnOnRedAllowed", "trafficLight")
    place = read(root).junction("1")
    assert [lane.no_turn_on_red for lane in place.entrances] == [False, True, False, False]
    assert {lane.sign for lane in place.entrances} == {Sign.LIGHTS}
    assert place.rotations == (0,), "a rotation keeps signs"
    assert place.digest != read(tree(control=JunctionControl.LIGHTS)).junction("1").digest
    for code, binding, other in (("0100", "red", "right_on_red"), ("0001", "right_on_red", "red")):
        scenario = rvads.Scenario(place, code, distance=10.0, duration=40.0)
        run = rvads.simulate(rvads.Case(scenario, RedLightRunner))
        assert (rvads.check(run, binding).status, rvads.check(run, other).status) == ("FAIL", "NA")
        waiting = rvads.simulate(rvads.Case(scenario, rvads.Reference))
        assert (rvads.check(waiting, binding).status, rvads.check(waiting, other).status) == ("PASS", "NA")
        assert rvads.check(waiting, "progress").status == "PASS"
    rvads.files.save_run(run, tmp_path / "run.npz")
    assert rvads.files.load_run(tmp_path / "run.npz").junction == place


def test_sign_for_other_lanes_does_not_control_the_entrance(read: Read, tree: Tree) -> None:
    root = tree()
    set_validity(sign(root, 1), (-1, -1))  # the exit lane
    assert control(read, root) is JunctionControl.PARTIAL
    set_validity(sign(root, 1), (2, -2))
    assert control(read, root) is JunctionControl.STOP
    set_validity(sign(root, 1))
    assert control(read, root) is JunctionControl.STOP


def test_reference_on_a_connecting_road_stands_for_the_entrance(read: Read, tree: Tree) -> None:
    root = tree()
    element = remove_sign(root, 1)
    set_validity(element, (0, 0))
    SubElement(road(root, "1"), "signals").append(element)
    # Road 107 leads from entrance 1 to exit 3.
    signals = SubElement(road(root, "107"), "signals")
    SubElement(signals, "signalReference", {"id": "1", "s": "20", "t": "0", "orientation": "+"})
    report = read(root).report("1")
    assert report.control is JunctionControl.STOP


def test_far_side_masts_use_their_references(read: Read, tree: Tree) -> None:
    """The signal stands on arm 3, across the junction, and refers to the movements of entrance 1."""
    root = tree(control=JunctionControl.LIGHTS)
    element = remove_sign(root, 1)
    set_validity(element)
    road(root, "3").find("signals").append(element)
    remove_sign(root, 3) if road(root, "3").find("signals/signal").get("id") == "3" else None
    signals = SubElement(road(root, "107"), "signals")
    SubElement(signals, "signalReference", {"id": "1", "s": "1", "t": "0", "orientation": "+"})
    report = read(root).report("1")
    lit = {
        i for i, arm in enumerate(report.arms) for item in report.objects if item.kind == "light" and item.edge in arm.entrances
    }
    assert lit == {0, 1, 2}


def test_reference_to_a_missing_signal_is_a_warning(read: Read, tree: Tree) -> None:
    root = tree()
    SubElement(road(root, "1").find("signals"), "signalReference", {"id": "99", "s": "1", "t": "0", "orientation": "+"})
    road_map = read(root)
    assert [warning.kind for warning in road_map.warnings] == ["signal"]
    assert road_map.report("1").control is JunctionControl.STOP


@pytest.mark.parametrize(("s", "found"), [("0", True), ("49.9", True), ("51", False), ("119", False)])
def test_signs_count_near_the_junction_only(read: Read, tree: Tree, s: str, found: bool) -> None:
    root = tree()
    sign(root, 0).set("s", s)
    assert (control(read, root) is JunctionControl.STOP) == found


def test_lights_above_stop_signs_are_lights(read: Read, tree: Tree) -> None:
    root = tree(control=JunctionControl.LIGHTS)
    other = tree()
    for arm in range(4):
        element = sign(other, arm)
        element.set("id", f"stop{arm}")
        road(root, str(arm)).find("signals").append(element)
    assert control(read, root) is JunctionControl.LIGHTS


def lines(root: Element, s: str | None) -> None:
    """Move all stop lines to station `s`, or take them away."""
    for arm in range(4):
        objects = road(root, str(arm)).find("objects")
        for element in list(objects):
            element.set("s", s or "0")
            if s is None:
                objects.remove(element)


@pytest.mark.parametrize(
    ("line", "sign_at", "setback", "posted"),
    [("4", "2", 4.0, 2.0), (None, "2", 0.0, 2.0), ("11", "2", 0.0, 2.0), ("11", "12", 0.0, None), ("2", "2", 2.0, None)],
)
def test_the_stopping_line(read: Read, tree: Tree, line: str | None, sign_at: str, setback: float, posted: float | None) -> None:
    """The marked line within 10 m, else the vertex; a sign is none, and is kept where it does not stand at the line."""
    root = tree()
    lines(root, line)
    for arm in range(4):
        sign(root, arm).set("s", sign_at)
    report = read(root).report("1")
    assert report.setbacks == pytest.approx((setback,) * 4, abs=1e-6)
    assert report.sign_setbacks == (pytest.approx((posted,) * 4, abs=1e-6) if posted is not None else (None,) * 4)


def test_of_two_stop_signs_the_nearer_counts() -> None:
    signs = [MapObject(f"s{back:g}", ObjectKind.STOP, "1", "e", 50.0 - back, back) for back in (8.0, 2.0)]
    assert sign_setback_of(signs) == 2.0
    line = MapObject("line", ObjectKind.LINE, "1", "e", 42.0, 8.0)
    assert sign_setback_of([*signs, line]) == 2.0, "though the farther one stands at the line"


def test_lights_set_no_stopping_line_and_lines_set_no_control(read: Read, tree: Tree) -> None:
    root = tree(control=JunctionControl.LIGHTS, setback=3.0)
    lines(root, None)
    assert read(root).report("1").setbacks == (0.0,) * 4
    root = tree(setback=3.0)
    for arm in range(4):
        remove_sign(root, arm)
    report = read(root).report("1")
    assert report.control is JunctionControl.NONE
    assert report.setbacks == pytest.approx((3.0,) * 4, abs=1e-6)


def test_stop_line_as_a_signal(read: Read, tree: Tree) -> None:
    root = tree()
    lines(root, None)
    attributes = {
        "id": "l",
        "name": "Haltlinie",
        "s": "5",
        "t": "0",
        "orientation": "+",
        "dynamic": "no",
        "type": "294",
        "subtype": "-1",
    }
    SubElement(road(root, "2").find("signals"), "signal", attributes)
    assert read(root).report("1").setbacks == pytest.approx((0.0, 0.0, 5.0, 0.0), abs=1e-6)


def test_controllers_count_when_their_entrances_are_opposite(read: Read, tree: Tree) -> None:
    def groups(*controllers: tuple[str, ...]) -> tuple[frozenset[int], ...]:
        root = tree(control=JunctionControl.LIGHTS)
        for old in root.findall("controller"):
            root.remove(old)
        for i, signals in enumerate(controllers):
            element = SubElement(root, "controller", {"id": f"c{i}"})
            for signal in signals:
                SubElement(element, "control", {"signalId": signal})
        return read(root).report("1").phase_groups

    usual = (frozenset({0, 2}), frozenset({1, 3}))
    assert groups() == usual
    assert groups(("0",), ("1",), ("2",), ("3",)) == usual  # one per signal says nothing (CARLA)
    assert groups(("0", "1", "2", "3")) == usual  # nor does one for all (SUMO)
    assert groups(("0", "1"), ("2", "3")) == usual  # neighbours cannot have green together
    assert groups(("1", "3"), ("0",), ("2",)) == (frozenset({0}), frozenset({1, 3}), frozenset({2}))


def test_sides_are_assumed_from_the_other_roads(read: Read, tree: Tree) -> None:
    root = tree(left_hand=True)
    for element in list(root.iter("road"))[4:]:
        del element.attrib["rule"]
    road_map = read(root)
    assert road_map.report("1").usable
    assert road_map.report("1").left_hand
    assert [warning.kind for warning in road_map.warnings] == ["side"]


def test_a_road_without_rule_keeps_right(read: Read, tree: Tree) -> None:
    root = tree()
    for element in root.iter("road"):
        del element.attrib["rule"]
    road_map = read(root)
    assert not road_map.report("1").left_hand
    assert road_map.warnings == ()


def test_other_units_are_a_doubt(read: Read, tree: Tree) -> None:
    root = tree()
    SubElement(root.find("header"), "geoReference").text = "+proj=tmerc +units=us-ft"
    assert [warning.kind for warning in read(root).warnings] == ["units"]


def lost(road_map: RoadMap) -> list[str]:
    return [warning.message for warning in road_map.warnings if "for no entrance" in warning.message]


def test_signs_for_no_entrance_are_counted(read: Read, tree: Tree) -> None:
    root = tree()
    assert lost(read(root)) == []
    sign(root, 0).set("s", "119")
    sign(root, 1).set("s", "60.1")
    set_validity(sign(root, 2), (0, 0))
    sign(root, 2).set("s", "1.5")
    assert lost(read(root)) == [
        "3 of 4 signs and lights are for no entrance: 2 of them stand near no end of a road where lanes lead into a junction"
    ]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda element: element.attrib.pop("s"), "has no attribute 's'"),
        (lambda element: element.set("t", "left"), "t='left' of <signal> is not a number"),
        (lambda element: SubElement(element, "validity", {"fromLane": "x", "toLane": "1"}), "fromLane='x'"),
    ],
)
def test_broken_signal_leaves_the_other_signals(read: Read, tree: Tree, change: Callable[[Element], object], words: str) -> None:
    root = tree()
    change(sign(root, 2))
    road_map = read(root)
    assert [one.value for one in road_map.report("1").signs] == ["stop", "stop", "none", "stop"]
    (message,) = [warning.message for warning in road_map.warnings if "was left out" in warning.message]
    assert message.startswith("the signal '2' of road '2' was left out: ")
    assert words in message


def test_a_light_on_the_far_side_is_for_who_comes_straight_on(read: Read, tree: Tree) -> None:
    """Road 2, opposite of road 0, gets a light for its exit lane, and nothing refers to it."""
    root = tree(control=JunctionControl.LIGHTS)
    element = remove_sign(root, 0)
    element.set("s", "0")
    set_validity(element, (-1, -1))
    road(root, "2").find("signals").append(element)
    road_map = read(root)
    assert road_map.report("1").control is JunctionControl.LIGHTS
    assert lost(road_map) == []
    assert [item.edge for item in road_map.report("1").objects if item.id == "0" and item.kind == "light"] == ["0.0.1"]


def test_priorities_that_the_file_states(read: Read, tree: Tree) -> None:
    """Road 3 gets priority over road 0, which lies to its right: counter-clockwise roads lie in the south, east, north, west."""
    root = tree()
    plain = read(root).junction("1")
    SubElement(root.find("junction"), "priority", {"high": "3", "low": "0"})
    stated = read(root, "stated.xodr").junction("1")
    # Straight from arm 0 and straight from arm 3.
    assert ((3, 1), (0, 2)) in plain.yields
    assert ((0, 2), (3, 1)) in stated.yields
    assert ((3, 1), (0, 2)) not in stated.yields
    SubElement(root.find("junction"), "priority", {"high": "77", "low": "0"})
    assert any("states a priority of road '77', which does not exist" in w.message for w in read(root, "wrong.xodr").warnings)


def test_duplicate_lane_id_costs_one_lane(read: Read, tree: Tree) -> None:
    root = tree()
    side = road(root, "0").find("lanes/laneSection/left")
    twin = SubElement(side, "lane", {"id": "1", "type": "sidewalk"})
    SubElement(twin, "width", {"sOffset": "0", "a": "2", "b": "0", "c": "0", "d": "0"})
    road_map = read(root)
    assert road_map.report("1").usable
    assert [w.message for w in road_map.warnings] == [
        "road '0' has two lanes with id 1 in one section; the sidewalk lane was left out"
    ]
    twin.set("type", "driving")
    with pytest.raises(MapError, match="two lanes with id 1 that are driven on"):
        read(root)
