"""Junctions whose ways lead into each other are one; links that name the wrong end of a road are moved to the other end."""

import copy
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import RoadMap, read_map

from .conftest import Read, Tree


def relations(junction: Junction) -> tuple[Any, ...]:
    """Return all that a run can depend on but the lines themselves."""
    ways = {key: (movement.turn, round(movement.length, 2)) for key, movement in junction.movements.items()}
    return junction.arms, junction.control, ways, junction.conflicts, junction.yields


def halve(root: Element, junction: str = "2") -> None:
    """Cut every connecting road, which is a straight line or an arc, in two, and put the second halves into another junction."""
    other = SubElement(root, "junction", id=junction, name="second")
    for road in [road for road in root.findall("road") if road.get("junction") == "1"]:
        length, shape = float(road.get("length")) / 2, road.find("planView/geometry")
        second = copy.deepcopy(road)
        second.set("id", f"{road.get('id')}b")
        second.set("junction", junction)
        rest = second.find("planView/geometry")
        arc = shape.find("arc")
        turn = 0.0 if arc is None else float(arc.get("curvature")) * length
        heading, chord = float(shape.get("hdg")), length * (math.sin(turn / 2) / (turn / 2) if turn else 1.0)
        rest.set("x", repr(float(shape.get("x")) + chord * math.cos(heading + turn / 2)))
        rest.set("y", repr(float(shape.get("y")) + chord * math.sin(heading + turn / 2)))
        rest.set("hdg", repr(heading + turn))
        for element in (road, second, shape, rest):
            element.set("length", repr(length))
        for one, tag, end, beyond in ((road, "successor", "start", second), (second, "predecessor", "end", road)):
            one.find(f"link/{tag}").attrib.update(elementId=beyond.get("id"), contactPoint=end)
            for lane in one.iter("lane"):
                if lane.find(f"link/{tag}") is not None:
                    lane.find(f"link/{tag}").set("id", lane.get("id"))
        root.insert(0, second)
        row = SubElement(other, "connection", id=road.get("id"), incomingRoad=road.get("id"), contactPoint="start")
        row.set("connectingRoad", second.get("id"))
        SubElement(row, "laneLink", {"from": "-1", "to": "-1"})


@pytest.mark.parametrize("control", [JunctionControl.STOP, JunctionControl.LIGHTS, JunctionControl.NONE])
@pytest.mark.parametrize("ways", [3, 4])
def test_cluster_is_the_junction_that_was_cut_in_two(read: Read, tree: Tree, control: JunctionControl, ways: int) -> None:
    whole, root = read(tree(control=control, ways=ways)).junction("1"), tree(control=control, ways=ways)
    halve(root)
    road_map = read(root)
    assert [report.id for report in road_map.junctions] == ["1+2"]
    assert relations(road_map.junction("1+2")) == relations(whole)
    messages = [warning.message for warning in road_map.warnings if warning.kind == "table"]
    assert messages == [
        "the ways of junctions '1' and '2' lead into each other without a road between; they were read as one, '1+2'"
    ]


def test_clusters_are_kept_apart_on_request(tmp_path: Path, tree: Tree, capsys: pytest.CaptureFixture[str]) -> None:
    root, path = tree(), tmp_path / "map.xodr"
    halve(root)
    path.write_bytes(ElementTree.tostring(root))
    reports = read_map(path, clusters=False).junctions
    assert [(report.id, report.usable) for report in reports] == [("1", False), ("2", False)]
    assert all("is itself part of junction" in (report.reason or "") for report in reports)
    assert main(["map", str(path)]) == 0
    assert "1+2" in capsys.readouterr().out


def test_cluster_of_too_few_arms_stays_apart(shared: Path) -> None:
    """Two junctions in a row on one road: together they have two arms."""
    reports = read_map(shared / "maps" / "connected_junctions_simple.xodr").junctions
    assert [report.id for report in reports] == ["100", "200"]


def test_road_between_two_junctions_lies_outside_whatever_a_table_says(shared: Path) -> None:
    """The writer's tables name two roads as connecting that have a junction at their ends."""
    road_map = read_map(shared / "maps" / "durlacher-tor.xodr")
    for id, arms in (("j_21498803", 4), ("j_2629797073", 4)):
        assert (road_map.report(id).reason, road_map.report(id).ways) == (None, arms)


def misname(root: Element, arm: str) -> None:
    """Let the links of connecting roads to an arm name its far end, and the lane that begins there."""
    for road in root.findall("road"):
        link = road.find("link/successor")
        if road.get("junction") == "1" and link is not None and link.get("elementId") == arm:
            link.set("contactPoint", "end")
            for lane in road.iter("lane"):
                if lane.find("link/successor") is not None:
                    lane.find("link/successor").set("id", "1")


def wrong_ends(road_map: RoadMap) -> int:
    return sum("names the wrong end of a road" in warning.message for warning in road_map.warnings)


@pytest.mark.parametrize("gap", [0.0, 0.4])
def test_link_to_the_wrong_end_of_a_road_is_moved_to_the_other_end(read: Read, tree: Tree, gap: float) -> None:
    whole, root = tree(), tree()
    for each in (whole, root):
        shape = each.find("road[@id='2']/planView/geometry")
        shape.set("y", repr(float(shape.get("y")) + gap))
    misname(root, "2")
    road_map = read(root)
    assert relations(road_map.junction("1")) == relations(read(whole).junction("1"))
    assert wrong_ends(road_map) == 3


def test_link_to_the_wrong_end_stays_where_the_other_end_is_too_far_away(read: Read, tree: Tree) -> None:
    root = tree()
    shape = root.find("road[@id='2']/planView/geometry")
    shape.set("y", repr(float(shape.get("y")) + 0.6))
    misname(root, "2")
    road_map = read(root)
    assert wrong_ends(road_map) == 0
    assert not road_map.report("1").usable


def test_wrong_contact_point_of_a_connecting_road_is_turned(read: Read, tree: Tree) -> None:
    """The lanes are right, so that no traffic passes the links; 0.4 m are too much to link lanes by their geometry alone."""
    whole, root = tree(), tree()
    for each in (whole, root):
        shape = each.find("road[@id='2']/planView/geometry")
        shape.set("y", repr(float(shape.get("y")) + 0.4))
    for road in root.findall("road"):
        link = road.find("link/successor")
        if road.get("junction") == "1" and link.get("elementId") == "2":
            link.set("contactPoint", "end")
    road_map = read(root)
    assert relations(road_map.junction("1")) == relations(read(whole).junction("1"))
    assert wrong_ends(road_map) == 3
