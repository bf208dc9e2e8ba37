"""What writers leave out of a file is completed where only one answer is possible, each time with a warning."""

import copy
import math
from collections import Counter
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import pytest

from pytest_rvads.geometry.control import JunctionControl

from .conftest import Read, Tree


def arms(root: Element) -> list[Element]:
    return [road for road in root.findall("road") if road.get("junction") == "-1"]


def connecting(root: Element) -> list[Element]:
    return [road for road in root.findall("road") if road.get("junction") != "-1"]


def drop(parents: list[Element], tag: str) -> None:
    for parent in parents:
        for child in parent.findall(tag):
            parent.remove(child)


def lane_links(root: Element) -> None:
    drop(list(root.iter("lane")), "link")
    drop(list(root.iter("connection")), "laneLink")


def contacts_of_roads(root: Element) -> None:
    for road in connecting(root):
        for link in road.find("link"):
            link.attrib.pop("contactPoint", None)


def contacts(root: Element) -> None:
    contacts_of_roads(root)
    for row in root.iter("connection"):
        del row.attrib["contactPoint"]


def links_of_connecting_roads(root: Element) -> None:
    drop(connecting(root), "link")


def links_of_roads(root: Element) -> None:
    drop(root.findall("road"), "link")


def contacts_and_lane_links(root: Element) -> None:
    contacts(root)
    lane_links(root)


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize(
    "missing", [lane_links, contacts_of_roads, contacts, links_of_connecting_roads, links_of_roads, contacts_and_lane_links]
)
def test_missing_links_are_completed(read: Read, tree: Tree, missing: Any, left_hand: bool) -> None:
    whole, root = read(tree(ways=5, stop=25, left_hand=left_hand)).report("1"), tree(ways=5, stop=25, left_hand=left_hand)
    missing(root)
    road_map = read(root)
    report = road_map.report("1")
    assert report.usable, report.reason
    assert [way[:4] for way in report.movements] == [way[:4] for way in whole.movements]
    assert (report.right_of, report.control) == (whole.right_of, whole.control)
    assert {warning.kind for warning in road_map.warnings} >= {"link"}


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize("tag", ["successor", "predecessor"])
@pytest.mark.parametrize("arms", [(2,), (0, 3)])
def test_lanes_meet_although_the_contact_point_is_wrong_and_the_lane_link_is_missing(
    read: Read, tree: Tree, tag: str, arms: tuple[int, ...], left_hand: bool
) -> None:
    """Roads of arms begin at the junction: their end is 120 m away, and the lanes meet exactly at their start."""
    root = tree(left_hand=left_hand)
    whole = read(root)
    for way in connecting(root):
        link = way.find(f"link/{tag}")
        if link.get("elementId") in [str(arm) for arm in arms]:
            link.set("contactPoint", "end")
            drop([lane.find("link") for lane in way.iter("lane") if lane.find("link") is not None], tag)
            if tag == "predecessor":
                drop([row for row in root.iter("connection") if row.get("connectingRoad") == way.get("id")], "laneLink")
    road_map = read(root)
    movements = [{(way.entrance, way.exit, way.turn) for way in found.report("1").movements} for found in (whole, road_map)]
    assert movements[0] == movements[1], "all twelve"
    assert {warning.kind for warning in road_map.warnings} == {"link"}
    assert all("lanes meet without a lane link" in warning.message for warning in road_map.warnings)


def test_a_connecting_road_that_leads_nowhere_is_told(read: Read, tree: Tree) -> None:
    root = tree()
    way = next(way for way in connecting(root) if way.find("link/successor").get("elementId") == "2")
    drop([way.find("link"), *(lane.find("link") for lane in way.iter("lane") if lane.find("link") is not None)], "successor")
    for shape in way.iter("geometry"):
        shape.set("y", str(float(shape.get("y", "0")) + 0.5))  # the gap is too wide for a repair, and a mistake of its start
    road_map = read(root)
    assert len(road_map.report("1").movements) == 11
    (message,) = [warning.message for warning in road_map.warnings if warning.kind == "link"]
    assert message == f"lane {way.get('id')}.0.-1 in junction '1' leads nowhere, so no movement uses it"


@pytest.mark.parametrize("attributes", [{}, {"id": ""}])
def test_an_empty_link_of_a_lane_is_no_link(read: Read, tree: Tree, attributes: dict[str, str]) -> None:
    root = tree()
    lanes = list(arms(root)[0].iter("lane"))
    for lane in lanes:
        link = lane.find("link")
        SubElement(SubElement(lane, "link") if link is None else link, "predecessor", attributes)
    SubElement(root.find("junction/connection"), "laneLink")
    road_map = read(root)
    assert len(road_map.report("1").movements) == 12
    assert [(warning.kind, "names no lane" in warning.message) for warning in road_map.warnings] == [("link", True)] * 2


def test_lanes_with_a_gap_are_not_linked(read: Read, tree: Tree) -> None:
    """The first arm lies 0.2 m beside its place: nothing tells that it belongs there."""
    root = tree()
    lane_links(root)
    shape = arms(root)[0].find("planView/geometry")
    heading = float(shape.get("hdg"))
    shape.set("x", repr(float(shape.get("x")) - 0.2 * math.sin(heading)))
    shape.set("y", repr(float(shape.get("y")) + 0.2 * math.cos(heading)))
    report = read(root).report("1")
    assert report.ways == 3


def test_reference_to_a_missing_junction_is_a_warning(read: Read, tree: Tree) -> None:
    root = tree()
    for arm in arms(root):
        arm.set("junction", "0")
    road_map = read(root)
    assert road_map.report("1").usable
    assert Counter(warning.kind for warning in road_map.warnings) == {"link": 4}
    assert "junction '0', which does not exist" in road_map.warnings[0].message


@pytest.mark.parametrize("what", ["planView", "length", "connecting"])
def test_a_road_without_a_place_makes_its_junction_unusable(read: Read, tree: Tree, what: str) -> None:
    """It is left out, and the rest of the map can be used; the junction must not become a T."""
    root = tree()
    road = (connecting if what == "connecting" else arms)(root)[0]
    if what == "length":
        road.set("length", "0")
    else:
        drop([road], "planView")
    road_map = read(root)
    assert road_map.warnings[0].kind == "length"
    assert f"road '{road.get('id')}' has lanes but no " in road_map.warnings[0].message
    assert f"road '{road.get('id')}', which belongs to it or leads to it, has no geometry" in (road_map.report("1").reason or "")


def split(root: Element, near: float, signal: float) -> None:
    """Cut every arm `near` metres before the junction; its signals stand on the road behind, `signal` metres from the cut."""
    for arm in arms(root):
        far = copy.deepcopy(arm)
        far.set("id", f"far{arm.get('id')}")
        shape, moved = arm.find("planView/geometry"), far.find("planView/geometry")
        heading = float(shape.get("hdg"))
        moved.set("x", repr(float(shape.get("x")) + near * math.cos(heading)))
        moved.set("y", repr(float(shape.get("y")) + near * math.sin(heading)))
        for part in (arm, shape):
            part.set("length", repr(near))
        for part in (far, moved):
            part.set("length", repr(120 - near))
        drop([far], "link")
        drop([far], "objects")
        drop([arm], "signals")
        for element in far.iter("signal"):
            element.set("s", repr(signal))
        to = {"elementType": "road", "contactPoint": "start"}
        SubElement(arm.find("link"), "successor", {**to, "elementId": far.get("id")})
        SubElement(SubElement(far, "link"), "predecessor", {**to, "elementId": arm.get("id"), "contactPoint": "end"})
        root.insert(0, far)


@pytest.mark.parametrize(
    ("near", "signal", "found"), [(4.0, 2.0, True), (4.0, 45.0, True), (4.0, 47.0, False), (60.0, 1.0, False)]
)
@pytest.mark.parametrize("control", [JunctionControl.STOP, JunctionControl.LIGHTS])
def test_signals_on_the_road_before_a_short_one(
    read: Read,
    tree: Tree,
    near: float,
    signal: float,
    found: bool,
    control: JunctionControl,
) -> None:
    """Within 50 m of the junction."""
    root = tree(control=control)
    split(root, near, signal)
    report = read(root).report("1")
    assert report.usable
    assert report.approach == pytest.approx((120.0,) * 4)
    assert report.control is (control if found else JunctionControl.NONE)


def typed(root: Element, **attributes: str) -> None:
    for element in root.iter("signal"):
        element.attrib.update(attributes)


@pytest.mark.parametrize(
    ("control", "attributes", "found"),
    [
        ("lights", {"type": "1.000.001"}, "lights"),
        ("lights", {"dynamic": "true"}, "lights"),
        ("lights", {"type": "-1", "name": "Signal_3Light_Post01"}, "lights"),
        ("lights", {"type": "", "name": "TrafficLight"}, "lights"),
        ("lights", {"type": "-1", "name": "PedestrianTrafficLight"}, "none"),
        ("lights", {"type": "1000002", "name": "TrafficLight"}, "none"),
        ("stop", {"type": "-1", "name": "Sign_Stop"}, "stop"),
        ("stop", {"type": "none", "name": "StopSign_02"}, "stop"),
        ("stop", {"type": "-1", "name": "BusStop"}, "none"),
        ("stop", {"type": "-1", "name": "Sign_NoStopping"}, "none"),
        ("stop", {"type": "601.1", "country": "GB"}, "stop"),
        ("stop", {"type": "B2", "country": "SE"}, "stop"),
        ("stop", {"type": "B2", "country": "PL"}, "none"),
        ("stop", {"type": "B-20", "country": "PL"}, "stop"),
        ("stop", {"type": "205"}, "yield"),
        ("stop", {"type": "R1", "subtype": "2", "country": "US"}, "yield"),
        ("stop", {"type": "R-1", "country": "ES"}, "yield"),  # what R1 means in Spain
        ("stop", {"type": "602", "country": "GB"}, "yield"),
        ("stop", {"type": "give_way"}, "yield"),
        ("stop", {"type": "-1", "name": "Sign_Yield"}, "yield"),
        ("stop", {"type": "306"}, "yield"),  # priority signs at all entrances: no stop sign, no light
        ("stop", {"type": "206", "country": "NO"}, "yield"),  # forkjorsvei, a priority road
        ("stop", {"type": "stop"}, "stop"),
        ("lights", {"type": "traffic_light", "dynamic": "no"}, "lights"),
        ("lights", {"type": "traffic_signals"}, "lights"),
        ("lights", {"type": "traffic_signals", "name": "pedestrian crossing"}, "none"),
    ],
)
def test_types_of_signals(read: Read, tree: Tree, control: str, attributes: dict[str, str], found: str) -> None:
    root = tree(control=JunctionControl(control))
    typed(root, **attributes)
    assert read(root).report("1").control == found
