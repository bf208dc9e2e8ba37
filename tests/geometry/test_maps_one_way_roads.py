"""Maps as netconvert writes them: every direction a road of its own, with several lanes, turn lanes and lights per lane."""

import math
from itertools import pairwise
from xml.etree.ElementTree import Element, SubElement

import pytest

from pytest_rvads.geometry.road_map import RoadMap

from .conftest import Read

WIDTH = 3.2
Point = tuple[float, float]
Place = tuple[float, float, float]
"""Point and heading."""


def frame(root: Element, id: str, start: Place, length: float, inside: str, lanes: int) -> Element:
    """Add a one-way road and return its only geometry, still without shape."""
    element = SubElement(root, "road", id=id, length=str(length), junction=inside, rule="RHT")
    shape = SubElement(SubElement(element, "planView"), "geometry", s="0", length=str(length))
    shape.attrib.update(zip(("x", "y", "hdg"), map(str, start), strict=True))
    right = SubElement(SubElement(SubElement(element, "lanes"), "laneSection", s="0"), "right")
    for lane in range(-1, -lanes - 1, -1):
        SubElement(SubElement(right, "lane", id=str(lane), type="driving"), "width", sOffset="0", a=str(WIDTH))
    SubElement(element, "signals")
    return shape


def road(root: Element, id: str, one: Point, two: Point, lanes: int) -> None:
    """Add a straight one-way road; its reference line is the left border of its lanes."""
    heading = math.atan2(two[1] - one[1], two[0] - one[0])
    SubElement(frame(root, id, (*one, heading), math.dist(one, two), "-1", lanes), "line")


def bend(root: Element, id: str, one: Place, two: Place, inside: str) -> Element:
    """Add a connecting road of one lane along a cubic with these ends, and return it."""
    turn, far = two[2] - one[2], math.dist(one[:2], two[:2])
    towards = math.atan2(two[1] - one[1], two[0] - one[0]) - one[2]
    rows = []
    for end, go, arrive in (
        (far * math.cos(towards), far, far * math.cos(turn)),
        (far * math.sin(towards), 0.0, far * math.sin(turn)),
    ):
        rows.append((0.0, go, 3 * end - 2 * go - arrive, go + arrive - 2 * end))
    places = [[sum(k * (i / 1000) ** n for n, k in enumerate(row)) for row in rows] for i in range(1001)]
    shape = frame(root, id, one, sum(math.dist(*pair) for pair in pairwise(places)), inside, 1)
    names = (f"{k}{axis}" for axis in "UV" for k in "abcd")
    SubElement(shape, "paramPoly3", dict(zip(names, map(str, [*rows[0], *rows[1]]), strict=True)), pRange="normalized")
    element = list(root)[-1]
    SubElement(element.find("lanes"), "laneOffset", s="0", a=str(WIDTH / 2), b="0", c="0", d="0")
    return element


def ways(root: Element, id: str, rows: list[tuple[str, int, str, int]]) -> None:
    """Add a junction with one connecting road per row: road and lane it comes from, road and lane it leads to."""
    junction = Element("junction", id=id)
    table = {element.get("id", ""): element for element in root.iter("road")}

    def centre(name: str, lane: int, *, end: bool) -> Place:
        shape = table[name].find("planView/geometry")
        x, y, heading, length = (float(shape.get(n)) for n in ("x", "y", "hdg", "length"))
        along, across = length * end, (abs(lane) - 0.5) * WIDTH
        ahead, aside = math.cos(heading), math.sin(heading)
        return x + along * ahead + across * aside, y + along * aside - across * ahead, heading

    for one, source, two, target in rows:
        name = f"{id}:{one}{source}{two}{target}"
        element = bend(root, name, centre(one, source, end=True), centre(two, target, end=False), id)
        link = SubElement(element, "link")
        SubElement(link, "predecessor", elementType="road", elementId=one, contactPoint="end")
        SubElement(link, "successor", elementType="road", elementId=two, contactPoint="start")
        links = SubElement(element.find("lanes/laneSection/right/lane"), "link")
        SubElement(links, "predecessor", id=str(source))
        SubElement(links, "successor", id=str(target))
        row = SubElement(junction, "connection", id=name, incomingRoad=one, connectingRoad=name, contactPoint="start")
        SubElement(row, "laneLink", {"from": str(source), "to": "-1"})
    root.append(junction)


def arm(root: Element, name: str, angle: float, apart: float) -> None:
    """Add the roads ``in`` and ``out`` of an arm, two lanes each, at this angle between them [degrees]."""
    for way, turn in (("in", apart), ("out", -apart)):
        out = math.radians(angle + turn / 2)
        x, y = 15 * math.cos(math.radians(angle)), 15 * math.sin(math.radians(angle))
        far = x + 100 * math.cos(out), y + 100 * math.sin(out)
        one, two = ((x, y), far) if way == "out" else (far, (x, y))
        road(root, f"{name}{way}", one, two, 2)


def cross(apart: float = 0.0) -> Element:
    """A cross of two lanes per direction: straight and right from the lane at the kerb (-2), left from the other one (-1)."""
    root = Element("OpenDRIVE")
    for number, name in enumerate("senw"):
        arm(root, name, 90.0 * number - 90.0, apart)
    rows = []
    for k, name in enumerate("senw"):
        right, ahead, left = ("senw"[(k + d) % 4] for d in (1, 2, 3))
        rows += [(f"{name}in", -2, f"{right}out", -2), (f"{name}in", -2, f"{ahead}out", -2), (f"{name}in", -1, f"{left}out", -1)]
    ways(root, "1", rows)
    return root


def light(root: Element, name: str, lane: int, subtype: str) -> None:
    element = next(road for road in root.iter("road") if road.get("id") == name)
    attributes = {"id": f"{name}{lane}{subtype}", "s": "99", "t": "-1", "orientation": "+", "dynamic": "yes"}
    signal = SubElement(element.find("signals"), "signal", {**attributes, "type": "1000011", "subtype": subtype})
    SubElement(signal, "validity", fromLane=str(lane), toLane=str(lane))


def lanes(road_map: RoadMap, id: str = "1") -> list[tuple[int, int]]:
    return [(len(arm.entrances), len(arm.exits)) for arm in road_map.report(id).arms]


def test_both_directions_are_one_arm(read: Read) -> None:
    road_map = read(cross())
    assert lanes(road_map) == [(2, 2)] * 4
    junction = road_map.junction("1")
    # Lane 0 lies at the kerb, and leads right and straight on; lane 1 leads left into the inner lane.
    assert [sorted(junction.directions(k)) for k in range(2)] == [[1, 2], [3]]
    assert [(m.turn.value, junction.exits[m.exit].lane) for m in (junction.leads(0, 1), junction.leads(1, 3))] == [
        ("right", 0),
        ("left", 1),
    ]


@pytest.mark.parametrize(("apart", "arms"), [(20.0, 4), (60.0, 8)])
def test_diverging_one_way_streets_are_two_arms(read: Read, apart: float, arms: int) -> None:
    found = lanes(read(cross(apart)))
    assert len(found) == arms
    assert all((one > 0) + (two > 0) == 8 // arms for one, two in found)


def test_lights_per_lane_give_the_turn_across_a_phase_of_its_own(read: Read) -> None:
    root = cross()
    for name in "senw":
        light(root, f"{name}in", -2, "50")
        light(root, f"{name}in", -1, "10")
    report = read(root).report("1")
    assert report.control == "lights"
    # Entrances by arm: 0 and 1 in the south, 4 and 5 in the north; the odd ones are the lanes for the left turn.
    assert set(report.phase_groups) == {frozenset(group) for group in ({0, 4}, {1, 5}, {2, 6}, {3, 7})}


def test_lanes_that_sumo_counted_from_the_kerb(read: Read) -> None:
    """Up to 1.15 netconvert wrote its own numbers: 0 for lane -2 and 1 for lane -1 of a road of two."""
    root = cross()
    for name in "senw":
        light(root, f"{name}in", 0, "50")
        light(root, f"{name}in", 1, "10")
    road_map = read(root)
    edges = {item.id: item.edge for item in road_map.report("1").objects}
    assert (edges["sin050"], edges["sin110"]) == ("sin.0.-2", "sin.0.-1")
    assert road_map.report("1").control == "lights"
    assert not [warning for warning in road_map.warnings if warning.kind == "signal"]


def test_an_approach_goes_on_through_the_beginning_of_turn_lanes(read: Read) -> None:
    """The southern road gets its second lane 20 m before the junction, by a `<junction>` of two arms."""
    root = cross()
    short = next(road for road in root.iter("road") if road.get("id") == "sin")
    plan = short.find("planView/geometry")
    short.set("length", "20")
    plan.attrib.update(y="-35", length="20")
    road(root, "before", (0.0, -115.0), (0.0, -37.0), 1)
    back = next(road for road in root.iter("road") if road.get("id") == "sout")
    back.set("length", "20")
    back.find("planView/geometry").set("length", "20")
    road(root, "after", (0.0, -37.0), (0.0, -115.0), 1)
    ways(root, "2", [("before", -1, "sin", -1), ("before", -1, "sin", -2), ("sout", -1, "after", -1), ("sout", -2, "after", -1)])
    road_map = read(root)
    assert road_map.joints == {"2"}
    kerb, inner = road_map.report("1").approach[:2]
    assert inner == pytest.approx(20 + 2 + 78, abs=0.01)
    assert 0 < kerb - (20 + math.hypot(2, WIDTH) + 78) < 1, "a little more than straight across"
    assert road_map.report("2").reason == "it has 2 arms, and only junctions of 3 to 8 arms can be used"


def test_a_gap_costs_the_movements_across_it(read: Read) -> None:
    root = cross()
    inside = next(road for road in root.iter("road") if road.get("id") == "1:sin-2eout-2")
    shape = inside.find("planView/geometry")
    shape.set("x", str(float(shape.get("x", "")) + 1.5))
    road_map = read(root)
    junction = road_map.junction("1")
    assert junction.directions(0) == (2,)
    assert any("1 of 12 movements of junction '1' are left out: lanes" in warning.message for warning in road_map.warnings)
