"""Centre lines never run backwards: overlaps and folds are cut, steps to the side become tapers, each told once with its size."""

import copy
import math
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.centre_lines import unfolded
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.support.errors import MapError

from .conftest import Read, Tree

SHARP, WITHIN = math.radians(120.0), 0.3
TAPER = 25**2 / 60
"""MUTCD 2009, table 6C-4: W S^2 / 60 at 25 mph, per metre of W."""


def sharpest(points: Any) -> float:
    """Return the largest angle between two pieces of a line of which the second begins within 0.3 m of the end of the first."""
    pieces = [(a, b) for a, b in zip(points.tolist(), points[1:].tolist(), strict=False) if a != b]
    worst = 0.0
    for i, (start, end) in enumerate(pieces):
        apart, heading = 0.0, math.atan2(end[1] - start[1], end[0] - start[0])
        for a, b in pieces[i + 1 :]:
            worst = max(worst, abs(math.remainder(math.atan2(b[1] - a[1], b[0] - a[0]) - heading, math.tau)))
            apart += math.dist(a, b)
            if apart > WITHIN:
                break
    return worst


def backward(junction: Junction) -> list[tuple[int, int]]:
    """Return the movements whose itineraries turn back."""
    return [key for key in junction.movements if sharpest(Itinerary.through(junction, *key).path.points) > SHARP]


def lengths(road_map: RoadMap) -> dict[tuple[int, int], float]:
    return {key: movement.length for key, movement in road_map.junction("1").movements.items()}


def messages(road_map: RoadMap, text: str) -> list[str]:
    return [warning.message for warning in road_map.warnings if text in warning.message]


def road(root: Element, id: str) -> Element:
    return next(road for road in root.findall("road") if road.get("id") == id)


def shift(road: Element, along: float, aside: float) -> None:
    """Move a road along its first piece, and to its left [m]."""
    shape = road.find("planView/geometry")
    heading = float(shape.get("hdg"))
    shape.set("x", repr(float(shape.get("x")) + along * math.cos(heading) - aside * math.sin(heading)))
    shape.set("y", repr(float(shape.get("y")) + along * math.sin(heading) + aside * math.cos(heading)))


def offset(road: Element, *steps: tuple[float, float]) -> None:
    """Begin a lane section with another lane offset at each of some stations [m]."""
    lanes = road.find("lanes")
    section, base = lanes.find("laneSection"), float(getattr(lanes.find("laneOffset"), "attrib", {"a": "0"})["a"])
    for lane in section.iter("lane"):
        link = lane.find("link")
        if link is None:
            link = SubElement(lane, "link")
        for tag in ("predecessor", "successor"):
            if link.find(tag) is None and lane.get("id") != "0":
                SubElement(link, tag, id=lane.get("id"))
    for s, aside in steps:
        new = copy.deepcopy(section)
        new.set("s", repr(s))
        lanes.append(new)
        SubElement(lanes, "laneOffset", s=repr(s), a=repr(base + aside), b="0", c="0", d="0")


@pytest.mark.extended
def test_no_itinerary_of_a_real_map_turns_back(shared: Path) -> None:
    turning_back = {}
    for file in sorted((shared / "maps").glob("*.xodr")):
        try:
            road_map = read_map(file)
        except MapError:
            continue
        for report in road_map.junctions:
            if report.usable:
                turning_back[file.stem, report.id] = backward(road_map.junction(report.id))
    assert len(turning_back) > 100
    assert {key: movements for key, movements in turning_back.items() if movements} == {}


def test_spikes_of_a_real_map_are_removed(shared: Path) -> None:
    """Road 97 has a lane section of 0.35 micrometres with a lane offset of 3.5 m; the road says that it is 24.05 m long."""
    junction = read_map(shared / "maps" / "onramp.xodr").junction("90")
    assert [junction.movements[key].length for key in ((1, 4), (2, 5))] == pytest.approx([24.046] * 2, abs=0.01)


@pytest.mark.parametrize("left_hand", [False, True])
def test_overlap_is_cut_from_the_movements(read: Read, tree: Tree, left_hand: bool) -> None:
    before, root = lengths(read(tree(left_hand=left_hand))), tree(left_hand=left_hand)
    shift(road(root, "0"), -0.6, 0.0)
    road_map = read(root)
    assert road_map.report("1").approach == pytest.approx((120.0,) * 4, abs=1e-6)
    assert backward(road_map.junction("1")) == []
    after = lengths(road_map)
    for key in before:
        # Turns begin or end straight enough for 0.6 m along the road to be 0.6 m along the movement.
        assert before[key] - after[key] == pytest.approx(0.6 if 0 in key else 0.0, abs=0.03 if 0 in key else 1e-3)
    assert len(messages(road_map, "by 0.60 m and was cut")) == 6
    assert Counter(warning.kind for warning in road_map.warnings) == {"gap": 6}


def test_speed_limit_behind_a_cut_overlap_begins_where_the_map_says(read: Read, tree: Tree) -> None:
    root = tree()
    for connecting in root.iterfind("road[@junction='1']"):
        for s, speed in (("0", "8"), ("2.6", "5")):
            SubElement(SubElement(connecting, "type", s=s, type="town"), "speed", max=speed)
    shift(road(root, "0"), -0.6, 0.0)
    junction = read(root).junction("1")
    limits = {key: dict(movement.path.limits) for key, movement in junction.movements.items() if movement.path}
    assert all(list(stated.values()) == [8.0, 5.0] for stated in limits.values())
    borders = {key: list(stated)[1] for key, stated in limits.items()}
    assert [borders[key] for key in borders if key[0] == 0] == pytest.approx([2.0] * 3, abs=1e-3), "0.6 m nearer"
    assert borders[1, 3] == pytest.approx(2.6, abs=1e-3), "this movement does not touch road 0"


@pytest.mark.parametrize("aside", [-0.9, -0.5, 0.15, 0.9])
def test_step_to_the_side_is_blended(read: Read, tree: Tree, aside: float) -> None:
    whole, root = read(tree()).junction("1"), tree()
    shift(road(root, "0"), 0.0, aside)
    road_map = read(root)
    junction = road_map.junction("1")
    assert backward(junction) == []
    for key, movement in junction.movements.items():
        line, plain = movement.path.points, whole.movements[key].path
        distance = np.array([abs(plain.project(x, y, plain.length / 2, 40.0)[1]) for x, y in line])
        far = np.minimum(*(np.hypot(*(line - end).T) for end in (line[0], line[-1]))) > TAPER * abs(aside)
        assert distance.max() == pytest.approx(abs(aside) if 0 in key else 0.0, abs=1e-2)
        assert distance[far].max(initial=0.0) < 5e-3  # what curves are sampled within
        assert sharpest(line) < math.radians(25.0)
    assert len(messages(road_map, f"lies {abs(aside):.2f} m beside lane 0.0.")) == 6
    assert len(road_map.warnings) == 6


@pytest.mark.parametrize("aside", [0.05, -0.05])
def test_small_step_stays_as_it_is(read: Read, tree: Tree, aside: float) -> None:
    before, root = lengths(read(tree())), tree()
    shift(road(root, "0"), 0.0, aside)
    road_map = read(root)
    assert lengths(road_map) == pytest.approx(before, abs=1e-3)
    assert road_map.warnings == ()


def test_step_of_more_than_a_metre_on_an_approach_ends_the_approach(read: Read, tree: Tree) -> None:
    root = tree()
    offset(road(root, "0"), (40.0, 1.2))
    offset(road(root, "1"), (40.0, 0.8))
    road_map = read(root)
    assert road_map.report("1").approach == pytest.approx((40.0, 120.0, 120.0, 120.0), abs=0.1)
    assert backward(road_map.junction("1")) == []
    assert len(messages(road_map, "1.20 m apart; the link was left out")) == 2
    assert len(messages(road_map, "jumps by 0.80 m between two lane sections; it was blended over up to 8.3 m")) == 2


def test_step_of_more_than_a_metre_in_a_junction_costs_the_movement(read: Read, tree: Tree) -> None:
    root = tree()
    offset(road(root, "102"), (12.0, 1.2), (18.0, 0.6), (24.0, 0.0))
    offset(road(root, "101"), (9.0, 0.8))
    road_map = read(root)
    assert set(lengths(read(tree()))) - set(lengths(road_map)) == {(0, 2)}
    assert backward(road_map.junction("1")) == []
    assert len(messages(road_map, "1 of 12 movements of junction '1' are left out")) == 1
    assert len(messages(road_map, "jumps by 0.80 m")) == 1


@pytest.mark.parametrize("out", [0.5, 3.5])
@pytest.mark.parametrize("at", ["102", "0"])
def test_spike_of_a_lane_section_without_length_is_removed(read: Read, tree: Tree, at: str, out: float) -> None:
    whole, root = read(tree()), tree()
    offset(road(root, at), (12.0, 0.0), (12.0 + 3.5e-7, 0.0))
    before, spike, after = road(root, at).findall("lanes/laneSection")
    for side in ("left", "right"):
        for section, tag in ((before, "successor"), (after, "predecessor")):
            for lane in section.iterfind(f"{side}/lane"):
                lane.find(f"link/{tag}").set("id", str(2 * int(lane.get("id"))))
        for lane in spike.findall(f"{side}/lane"):
            inner = SubElement(spike.find(side), "lane", id=lane.get("id"), type="none")
            SubElement(inner, "width", sOffset="0", a=repr(out), b="0", c="0", d="0")
            lane.set("id", str(2 * int(lane.get("id"))))
    road_map = read(root)
    assert lengths(road_map) == pytest.approx(lengths(whole), abs=1e-3)
    assert road_map.report("1").approach == pytest.approx(whole.report("1").approach, abs=1e-3)
    assert backward(road_map.junction("1")) == []
    (message,) = [warning.message for warning in road_map.warnings]
    assert f"has no length and its lanes jut out by {out:.2f} m" in message


@pytest.mark.parametrize("radius", [0.3, 1.0, 1.7, 3.0])
def test_lane_inside_of_a_tight_bend_does_not_fold(read: Read, tree: Tree, radius: float) -> None:
    """Lanes lie 1.75 m from the reference line, which turns by 90 degrees with a smaller radius, 20 m before the junction."""
    root = tree()
    plan, length = road(root, "0").find("planView"), math.pi / 2 * radius
    first = plan.find("geometry")
    x, y = float(first.get("x")), float(first.get("y"))
    first.set("length", "20")
    arc = SubElement(plan, "geometry", s="20", x=repr(x), y=repr(y - 20), hdg=repr(-math.pi / 2), length=repr(length))
    SubElement(arc, "arc", curvature=repr(1 / radius))
    end = SubElement(plan, "geometry", s=repr(20 + length), x=repr(x + radius), y=repr(y - 20 - radius), hdg="0", length="80")
    SubElement(end, "line")
    road(root, "0").set("length", repr(100 + length))
    road_map = read(root)
    junction = road_map.junction("1")
    assert backward(junction) == []
    # Both lanes are two straight lines of about 100 m with a corner between them.
    for line in (junction.entrances[0].approach, junction.exits[0].road):
        assert line.length == pytest.approx(100.0 + length, abs=5.0)
    assert len(messages(road_map, "runs backwards in a fold")) == (radius < 1.75)


@given(st.data())
@settings(derandomize=True, deadline=None, max_examples=100)
def test_line_of_any_shape_unfolds(data: st.DataObject) -> None:
    """The ends stay, nothing turns back, and nothing gets longer."""
    steps = data.draw(st.lists(st.tuples(st.floats(0.002, 2.0), st.floats(-3.1, 3.1)), min_size=2, max_size=30))
    headings = np.cumsum([turn for _, turn in steps])
    moves = np.array([size for size, _ in steps])[:, None] * np.column_stack((np.cos(headings), np.sin(headings)))
    points = np.vstack(([0.0, 0.0], np.cumsum(moves, axis=0)))
    line, cut = unfolded(np.column_stack((points, np.arange(len(points)))))
    assert sharpest(line[:, :2]) < SHARP + 1e-6
    assert (line[0, :2], line[-1, :2]) == (pytest.approx(points[0]), pytest.approx(points[-1]))
    assert (np.diff(line[:, 2]) > 0.0).all()
    assert cut >= -1e-9
    assert (cut > 0.0) == (sharpest(points) > SHARP)
