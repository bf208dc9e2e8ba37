"""Each rule of the Lanelet2 reader on a crossing of four roads written by hand."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.cli import main
from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.satellites.lanelet2.lanelet_map import plane_of_utm, projected
from pytest_rvads.support.errors import MapError

from .lanelet_files import Crossing, Osm, place

Read = Callable[[Osm], RoadMap]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    return lambda osm: read_map(osm.write(tmp_path / "cross.osm"))


def only(road_map: RoadMap) -> JunctionReport:
    (report,) = road_map.junctions
    assert report.usable, report.reason
    return report


def signs(report: JunctionReport) -> dict[str, str]:
    """Return the sign per entrance lanelet."""
    return {end.edge: sign.value for end, sign in zip(report.entrances, report.signs, strict=True)}


def doubts(road_map: RoadMap, kind: str) -> list[str]:
    return [warning.message for warning in road_map.warnings if warning.kind == kind]


def test_crossing_has_four_arms_and_no_doubts(read: Read) -> None:
    road_map = read(Crossing())
    report = only(road_map)
    assert (report.ways, len(report.entrances), len(report.exits), len(report.movements)) == (4, 4, 4, 12)
    assert not report.left_hand
    assert report.control == "none"
    assert sorted(way.turn for way in report.movements) == ["left"] * 4 + ["right"] * 4 + ["straight"] * 4
    assert not road_map.warnings


# Values of pyproj 3.7.2 (PROJ 9.5.1): EPSG:32631 minus its value at (0, 0), and +proj=tmerc +lat_0=49 +lon_0=8.4 +k=1.
@pytest.mark.parametrize(
    ("place", "metres"),
    [
        ((0.009, 0.009), (1002.8583, 996.1366)),
        ((0.0081, 0.0095), (1058.5714, 896.5225)),
        ((0.09, -0.05), (-5571.1472, 9961.9106)),
    ],
)
def test_degrees_near_zero_are_the_metres_of_a_data_set(place: tuple[float, float], metres: tuple[float, float]) -> None:
    assert projected(np.array([place[0]]), np.array([place[1]]))[0] == pytest.approx(metres, abs=1e-3)


@pytest.mark.parametrize(
    ("place", "metres"),
    [((49.01, 8.41), (731.5714, 1112.1465)), ((48.995, 8.39), (-731.7912, -556.0003)), ((48.7, 8.9), (36805.0613, -33241.4004))],
)
def test_degrees_are_projected_about_the_median(place: tuple[float, float], metres: tuple[float, float]) -> None:
    latitude, longitude = np.array([49.0, place[0], 49.0, 49.0]), np.array([8.4, place[1], 8.4, 8.4])
    assert projected(latitude, longitude)[1] == pytest.approx(metres, abs=1e-3)


# Values of pyproj 3.7.2 (PROJ 9.5.1): EPSG:32632 and EPSG:32756, and +proj=tmerc +k=1 about the origin.
@pytest.mark.parametrize(
    ("origin", "utm", "metres"),
    [
        ((50.78, 6.07), 293450.3146 + 5629453.6692j, 0.0),
        ((50.78, 6.07), 293351.2066 + 5629624.6182j, -105.7903 + 166.8672j),
        ((50.78, 6.07), 293719.0383 + 5629108.9859j, 282.1345 - 333.7245j),
        ((-33.87, 151.21), 334622.6465 + 6250708.7220j, 185.0484 - 110.9218j),
    ],
)
def test_coordinates_of_utm_are_turned_and_shifted(origin: tuple[float, float], utm: complex, metres: complex) -> None:
    turn, utm_of_origin = plane_of_utm(origin)
    assert abs(turn * (utm - utm_of_origin) - metres) < 2e-3


def test_local_coordinates_go_before_degrees(read: Read) -> None:
    crossing = Crossing()
    before = read(crossing).graph.edges[crossing.entries[0]].points
    for id in crossing.nodes.values():
        crossing.elements[id].set("lat", "")
        crossing.elements[id].set("lon", "0")
    assert np.array_equal(read(crossing).graph.edges[crossing.entries[0]].points, before)
    assert before[0] == pytest.approx(place(0, 60.0, 1.75))


def test_direction_follows_the_roles_whatever_the_order_of_nodes(read: Read) -> None:
    crossing = Crossing()
    points = {id: edge.points for id, edge in read(crossing).graph.edges.items()}
    ways = [id for id, element in crossing.elements.items() if element.tag == "way"]
    for way in ways[::2]:
        crossing.turn(way)
    turned = read(crossing).graph.edges
    assert turned.keys() == points.keys()
    assert all(np.allclose(turned[id].points, points[id]) for id in points)


def test_bound_of_several_ways_is_joined_in_any_order(read: Read) -> None:
    crossing = Crossing()
    entrance = crossing.entries[0]
    points = read(crossing).graph.edges[entrance].points
    crossing.drop(entrance)
    stations = [60.0, 47.0, 31.0, 10.0]
    parts = [crossing.way([place(0, a, 3.5), place(0, b, 3.5)]) for a, b in pairwise(stations)]
    crossing.turn(parts[1])
    crossing.turn(parts[2])
    joined = crossing.lanelet(crossing.middles[0], [parts[1], parts[0], parts[2]])
    road_map = read(crossing)
    assert np.allclose(road_map.graph.edges[joined].points, points)
    assert only(road_map).ways == 4


def test_bound_of_ways_that_do_not_meet_leaves_the_lanelet_out(read: Read) -> None:
    crossing = Crossing()
    far = crossing.way([(200.0, 0.0), (210.0, 0.0)])
    broken = crossing.lanelet(crossing.middles[0], [crossing.middles[1], far])
    assert broken in doubts(read(crossing), "lane")[0]


def test_deleted_elements_are_left_out(read: Read) -> None:
    crossing = Crossing()
    crossing.elements[crossing.movements[0, 1]].set("action", "delete")
    crossing.elements[crossing.movements[1, 2]].set("visible", "false")
    assert len(only(read(crossing)).movements) == 10


@pytest.mark.parametrize(
    ("tags", "drivable"),
    [
        ({"subtype": "stairs"}, False),
        ({"subtype": "bus_lane"}, False),
        ({"subtype": "play_street"}, True),
        ({"subtype": "crosswalk", "participant:vehicle": "yes"}, True),
        ({"subtype": "road", "participant:pedestrian": "yes"}, False),
        ({"subtype": "bus_lane", "participant:vehicle:bus": "yes", "participant:vehicle:car": "yes"}, True),
    ],
)
def test_participants_go_before_the_subtype(read: Read, tags: dict[str, str], drivable: bool) -> None:
    crossing = Crossing()
    for key, value in tags.items():
        crossing.change(crossing.movements[0, 1], key, value)
    road_map = read(crossing)
    assert len(only(road_map).movements) == (12 if drivable else 11)
    assert doubts(road_map, "lane") == (
        [] if drivable else [f"lanelets that no car drives on were left out: 1 {tags['subtype']}"]
    )


def test_two_way_lanelet_leads_in_and_out(read: Read) -> None:
    crossing = Crossing()
    crossing.drop(crossing.exits[0])
    crossing.change(crossing.entries[0], "one_way", "no")
    back = crossing.way([place(1, 10.0, 0.0), place(0, 10.0, 3.5)])
    crossing.drop(crossing.movements[1, 0])
    kerb = crossing.way([place(1, 10.0, 3.5), place(0, 10.0, 0.0)])
    crossing.lanelet(kerb, back)
    edges = read(crossing).graph.edges
    forward, backward = edges[crossing.entries[0]], edges[f"{crossing.entries[0]}:back"]
    assert np.allclose(forward.points, backward.points[::-1])


def test_lanelets_that_share_no_nodes_are_linked_where_they_meet(read: Read) -> None:
    def moved(gap: float) -> int:
        crossing = Crossing()
        crossing.drop(crossing.entries[0])
        ways = [crossing.way([place(0, 60.0, aside), place(0, 10.0 + gap, aside)]) for aside in (0.0, 3.5)]
        id = crossing.lanelet(ways[0], ways[1])
        return len(read(crossing).graph.links.succ[id])

    assert moved(0.5) == 3
    assert moved(0.7) == 0


def test_shared_ways_say_that_traffic_keeps_left(read: Read) -> None:
    crossing = Crossing(left_hand=True)
    report = only(read(crossing))
    assert report.left_hand
    assert report.ways == 4


def apart(*, left_hand: bool) -> Crossing:
    """Return a crossing whose opposite lanelets have a middle line each."""
    crossing = Crossing(left_hand=left_hand)
    role = "right" if left_hand else "left"
    for k, exit in enumerate(crossing.exits):
        own = crossing.way([place(k, 60.0, 0.0), place(k, 10.0, 0.0)])
        next(member for member in crossing.elements[exit] if member.get("role") == role).set("ref", own)
    return crossing


@pytest.mark.parametrize("left_hand", [False, True])
def test_without_shared_ways_the_lanes_out_say_on_which_side_traffic_keeps(read: Read, left_hand: bool) -> None:
    road_map = read(apart(left_hand=left_hand))
    assert only(road_map).left_hand == left_hand
    (doubt,) = doubts(road_map, "side")
    assert f"{'left' if left_hand else 'right'} was taken" in doubt


def test_environment_states_the_side_of_traffic(read: Read, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RVADS_HAND", "left")
    road_map = read(Crossing())
    assert only(road_map).left_hand
    assert doubts(road_map, "side") == [
        "traffic keeps left, as --hand or RVADS_HAND says, though 4 bounds between opposite lanelets say right"
    ]
    assert not doubts(read(Crossing(left_hand=True)), "side")
    monkeypatch.setenv("RVADS_HAND", "port")
    with pytest.raises(MapError, match="RVADS_HAND must be left or right, got 'port'"):
        read(Crossing())


def test_intersection_area_names_the_junction(read: Read) -> None:
    crossing = Crossing()
    for movement in crossing.movements.values():
        crossing.change(movement, "intersection_area", "777")
    assert only(read(crossing)).id == "777"


def test_junction_is_named_after_its_first_lanelet(read: Read) -> None:
    crossing = Crossing()
    assert only(read(crossing)).id == f"J{crossing.movements[0, 1]}"


@pytest.mark.parametrize("inside", [True, False])
def test_lights_are_referred_to_inside_or_before_the_junction(read: Read, inside: bool) -> None:
    crossing = Crossing()
    for k in range(4):
        referring = [id for (road, _), id in crossing.movements.items() if road == k] if inside else [crossing.entries[k]]
        crossing.regulate("traffic_light", [("ref_line", crossing.line(k, 1.0))], referring)
    report = only(read(crossing))
    assert report.control == "lights"
    assert report.setbacks == pytest.approx((1.0,) * 4)


def test_light_without_references_belongs_to_the_lane_under_its_line(read: Read) -> None:
    crossing = Crossing()
    light = crossing.regulate("traffic_light", [("ref_line", crossing.line(2, 1.0))])
    road_map = read(crossing)
    assert [id for id, sign in signs(only(road_map)).items() if sign == "lights"] == [crossing.entries[2]]
    assert f"lights and signs that no lanelet refers to were assigned by their stop lines: {light}" in doubts(road_map, "signal")


def test_lanelet_of_a_crosswalk_lies_over_its_arm(read: Read) -> None:
    crossing = Crossing()
    sides = [crossing.way([place(1, out, -6.0), place(1, out, 6.0)]) for out in (11.0, 14.0)]
    walk = crossing.lanelet(*sides, subtype="crosswalk")
    crossing.regulate("crosswalk", [("refers", walk)], [walk])
    line = crossing.way([place(1, 30.0, -6.0), place(1, 30.0, 6.0)])
    crossing.lanelet(line, line, subtype="crosswalk")
    road_map = read(crossing)
    (zebra,) = road_map.junction(only(road_map).id).crossings
    arm = next(k for k, arm in enumerate(only(road_map).arms) if crossing.entries[1] in arm.entrances)
    assert (zebra.id, zebra.arm) == (walk, arm)
    assert zebra.path.length == pytest.approx(7.0)  # two lanes of 3.5 m
    assert zebra.path.points[:, 1] == pytest.approx(12.5)
    assert zebra.path.points[0, 0] == pytest.approx(-3.5)  # vehicles from the north come in on the west side
    assert [warning.message for warning in road_map.warnings] == ["lanelets that no car drives on were left out: 1 crosswalk"]


def test_light_of_a_crosswalk_is_ignored(read: Read) -> None:
    crossing = Crossing()
    walk = crossing.lanelet(crossing.middles[0], crossing.middles[1], subtype="crosswalk")
    crossing.regulate("traffic_light", [("ref_line", crossing.line(2, 1.0))], [walk])
    road_map = read(crossing)
    assert only(road_map).control == "none"
    assert not doubts(road_map, "signal")


def test_all_way_stop_names_its_approaches(read: Read) -> None:
    crossing = Crossing()
    lines = [("ref_line", crossing.line(k, 2.0)) for k in range(4)]
    crossing.regulate("all_way_stop", [*(("yield", id) for id in crossing.entries), *lines])
    report = only(read(crossing))
    assert report.control == "stop"
    assert report.setbacks == pytest.approx((2.0,) * 4)
    assert report.sign_setbacks == (None,) * 4


@pytest.mark.parametrize(
    ("sign", "kind"), [("usR1-1", "stop"), ("de206", "stop"), ("usR1-2", "yield"), ("de205", "yield"), (None, "yield")]
)
def test_right_of_way_of_approaches_is_signs(read: Read, sign: str | None, kind: str) -> None:
    crossing = Crossing()
    names = [("yield", crossing.entries[1]), ("yield", crossing.entries[3])]
    names += [("right_of_way", crossing.entries[0]), ("right_of_way", crossing.entries[2])]
    if sign is not None:
        names.append(("refers", crossing.way([(5.0, 5.0), (5.5, 5.5)], type="traffic_sign", subtype=sign)))
    crossing.regulate("right_of_way", names)
    report = only(read(crossing))
    found = signs(report)
    assert [found[id] for id in crossing.entries] == ["priority", kind, "priority", kind]
    assert not report.stated


def test_right_of_way_inside_is_a_pair_of_movements(read: Read) -> None:
    crossing = Crossing()
    crossing.regulate("right_of_way", [("right_of_way", crossing.movements[0, 2]), ("yield", crossing.movements[1, 2])])
    report = only(read(crossing))
    edges = [end.edge for end in report.entrances]
    ((yielding, prior),) = report.stated
    assert (edges[prior[0]], edges[yielding[0]]) == (crossing.entries[0], crossing.entries[1])
    assert set(signs(report).values()) == {"none"}


def test_stop_sign_is_for_the_lanelet_that_refers_to_it(read: Read) -> None:
    crossing = Crossing()
    sign = crossing.way([(5.0, 5.0), (5.5, 5.5)], type="traffic_sign", subtype="stop_sign")
    crossing.regulate("traffic_sign", [("refers", sign)], [crossing.entries[3]])
    assert signs(only(read(crossing)))[crossing.entries[3]] == "stop"


@pytest.mark.parametrize(("distance", "setback"), [(0.0, 0.0), (3.0, 3.0), (24.0, 24.0), (26.0, 0.0), (-0.5, -0.5)])
def test_stop_line_without_references_counts_near_the_junction(read: Read, distance: float, setback: float) -> None:
    crossing = Crossing()
    crossing.line(1, distance)
    report = only(read(crossing))
    assert dict(zip((end.edge for end in report.entrances), report.setbacks, strict=True)) == pytest.approx(
        {id: setback if id == crossing.entries[1] else 0.0 for id in crossing.entries}
    )


def test_stop_line_of_a_light_may_lie_in_the_junction(read: Read) -> None:
    crossing = Crossing()
    lines = [crossing.line(k, -3.0) for k in range(4)]  # the lanelets in the junction begin 10 m before its centre
    for k, line in enumerate(lines):
        inside = [id for (road, _), id in crossing.movements.items() if road == k]
        crossing.regulate("traffic_light", [("ref_line", line)], inside)
    road_map = read(crossing)
    assert only(road_map).setbacks == pytest.approx((-3.0,) * 4, abs=0.01)
    assert not doubts(road_map, "signal")


def test_stop_line_behind_the_junction_is_a_doubt(read: Read) -> None:
    crossing = Crossing()
    line = crossing.way([place(2, 11.0, -0.2), place(2, 11.0, -3.3)], type="stop_line")
    crossing.regulate("traffic_light", [("ref_line", line)], [crossing.movements[0, 2]])
    road_map = read(crossing)
    assert set(only(road_map).setbacks) == {0.0}
    assert f"stop lines of lights or signs cross no lane into a junction: {line}" in doubts(road_map, "signal")


def test_elements_for_no_entrance_are_doubts(read: Read) -> None:
    crossing = Crossing()
    light = crossing.regulate("traffic_light", [], [crossing.exits[0]])
    crossing.regulate("detection_area", [])
    road_map = read(crossing)
    assert doubts(road_map, "signal") == [
        "regulatory elements that say nothing about junctions were left out: 1 detection_area",
        f"lights for no entrance of a junction were ignored: {light}",
    ]


@pytest.mark.parametrize(("text", "speed"), [("50", 50 / 3.6), ("50 km/h", 50 / 3.6), ("30mph", 13.4112), ("10 m/s", 10.0)])
def test_speed_limit_is_in_kilometres_per_hour_without_a_unit(read: Read, text: str, speed: float) -> None:
    crossing = Crossing()
    crossing.change(crossing.entries[0], "speed_limit", text)
    assert read(crossing).graph.edges[crossing.entries[0]].limits == ((0.0, pytest.approx(speed)),)


def test_unreadable_speed_limit_is_a_doubt(read: Read) -> None:
    crossing = Crossing()
    crossing.change(crossing.entries[0], "speed_limit", "fast")
    assert doubts(read(crossing), "speed")[0].startswith(f"the speed limit of lanelet {crossing.entries[0]!r} was ignored")


def test_roads_that_cross_without_nodes_are_cut_together(read: Read) -> None:
    osm = Osm()
    lanelets = []
    for k in (0, 1):
        ways = [osm.way([place(k, -100.0, aside), place(k, 100.0, aside)]) for aside in (3.5, 0.0, -3.5)]
        lanelets += [osm.lanelet(ways[1], ways[2]), osm.lanelet(ways[1], ways[0])]
    report = only(read(osm))
    assert (report.ways, len(report.entrances), len(report.exits), len(report.movements)) == (4, 4, 4, 4)
    # The outer crossings lie 1.75 m from the middle, other lanes are within 3 m of a lane there, and 15 m more are kept.
    assert report.approach == pytest.approx((100.0 - 1.75 - 3.0 - 15.0,) * 4, abs=0.8)


def test_turn_lanes_before_a_junction_are_no_junction(read: Read) -> None:
    crossing = Crossing()
    crossing.drop(crossing.entries[0])
    kerb = crossing.way([place(0, 30.0, 3.5), place(0, 10.0, 3.5)])
    middle = crossing.way([place(0, 30.0, 0.0), place(0, 10.0, 0.0)])
    beside = crossing.way([place(0, 30.0, 3.5), place(0, 10.0, 7.0)])
    outer = [crossing.way([place(0, 60.0, aside), place(0, 30.0, aside)]) for aside in (0.0, 3.5)]
    lane = crossing.lanelet(middle, kerb)
    stem = crossing.lanelet(outer[0], outer[1])
    # The lane beside begins with the same bounds as the other lane, and parts from it.
    begin = crossing.way([place(0, 30.0, 0.0), place(0, 10.0, 3.5)])
    turn = crossing.lanelet(begin, beside)
    goal = crossing.way([place(0, 10.0, 3.5), place(1, 10.0, 0.0)])
    border = crossing.way([place(0, 10.0, 7.0), place(1, 10.0, -3.5)])
    crossing.lanelet(goal, border)
    road_map = read(crossing)
    report = only(road_map)
    assert {lane, turn} <= {end.edge for end in report.entrances}
    assert report.ways == 4
    assert f"lanelets {lane}, {turn} only part or join lanes" in doubts(road_map, "table")[0]
    assert set(road_map.graph.links.succ[stem]) == {lane, turn}


def test_lengths_are_those_of_the_plan(read: Read) -> None:
    report = only(read(Crossing()))
    straight = [way.length for way in report.movements if way.turn == "straight"]
    assert straight == pytest.approx([20.0] * 4)
    right = [way.length for way in report.movements if way.turn == "right"]
    # A right turn is shorter than along its corner and longer than the chord.
    assert all(math.hypot(8.25, 8.25) < length < 16.5 for length in right)


def exchange(osm: Osm, *lanelets: str) -> None:
    """Exchange the left and the right bound of lanelets."""
    for member in (member for id in lanelets for member in osm.elements[id] if member.get("role") in ("left", "right")):
        member.set("role", "right" if member.get("role") == "left" else "left")


@pytest.mark.parametrize("left_hand", [False, True])
@pytest.mark.parametrize("roads", [(0,), (0, 1, 2)])
@pytest.mark.parametrize("kind", ["entries", "exits", "across"])
def test_lanelet_with_exchanged_bounds_is_turned_back(read: Read, left_hand: bool, roads: tuple[int, ...], kind: str) -> None:
    crossing = Crossing(left_hand=left_hand)
    lanelets = [crossing.movements[k, (k + 2) % 4] if kind == "across" else getattr(crossing, kind)[k] for k in roads]
    exchange(crossing, *lanelets)
    road_map = read(crossing)
    report = only(road_map)
    assert (report.ways, len(report.entrances), len(report.exits), len(report.movements)) == (4, 4, 4, 12)
    assert report.left_hand == left_hand
    (message,) = doubts(road_map, "side")
    assert message.endswith(f"were turned, left for right: {', '.join(sorted(lanelets, key=int))}")


def test_chain_of_lanelets_with_exchanged_bounds_is_turned_back(read: Read) -> None:
    crossing = Crossing()
    crossing.drop(crossing.entries[0])
    parts = []
    for far, near in ((60.0, 40.0), (40.0, 20.0), (20.0, 10.0)):
        parts.append(crossing.lanelet(*(crossing.way([place(0, far, y), place(0, near, y)]) for y in (0.0, 3.5))))
    exchange(crossing, *parts[1:])
    report = only(read(crossing))
    assert (report.ways, len(report.entrances), len(report.movements)) == (4, 4, 12)
    # Three lanelets of 20 m, 20 m and 10 m.
    assert max(report.approach) == pytest.approx(50.0)


def test_side_is_that_of_most_evidence(read: Read) -> None:
    """A two-way street that nothing leads to has a shared bound on its wrong side."""
    crossing = Crossing()
    middle, *kerbs = (crossing.way([(200.0, y), (220.0, y)]) for y in (0.0, 3.5, -3.5))
    crossing.lanelet(kerbs[1], middle)
    crossing.lanelet(kerbs[0], middle)
    road_map = read(crossing)
    assert not only(road_map).left_hand
    # The middle lines of the four arms, and the four lanes out beside lanes in, against the bound of the street.
    assert doubts(road_map, "side")[0].startswith("8 of 9 votes")
    assert middle in doubts(road_map, "side")[0]


@pytest.mark.parametrize("number", range(4))
def test_exchanged_lane_beside_lanes_of_one_way_decides_no_side(read: Read, number: int) -> None:
    """Two one-way roads of two lanes cross without a node, so that a lanelet leads to the junction and away from it."""
    roads, lanes = Osm(), []
    for road, aside in product((0, 1), (0.0, -4.0)):
        lines = [[place(road, -60.0, aside + by), place(road, 60.0, aside + by)] for by in (3.5, 0.0)]
        lanes.append(roads.lanelet(*(roads.way(line) for line in lines)))
    assert not only(read(roads)).left_hand
    exchange(roads, lanes[number])
    assert not only(read(roads)).left_hand
    assert "right was taken" in doubts(read(roads), "side")[0]


@pytest.mark.parametrize("tags", [{}, {"turn_direction": "left"}, {"turn_direction": "u_turn"}], ids=str)
@pytest.mark.parametrize(("outer", "out"), [(7.0, -3.5), (7.0, -7.0), (3.5, -3.5)])
def test_u_turn_is_left_out_with_a_warning(read: Read, tags: dict[str, str], outer: float, out: float) -> None:
    """From a lane of its own into the lane out, into a lane out of its own, or from the lane in into the neighbouring lane."""
    crossing = Crossing()
    for left, right in ((3.5, 7.0), (-3.5, -7.0)):
        if right in (outer, out):  # a lane in, or out, beside those of the crossing
            lines = [[place(0, 60.0, y), place(0, 10.0, y)] for y in (left, right)]
            crossing.lanelet(*(crossing.way(line if right > 0 else line[::-1]) for line in lines))
    bounds = [(outer - 3.5, out + 3.5, 2.0), (outer, out, 6.0)]
    lines = [
        [place(0, 10.0, start), *(place(0, 10.0 - deep, y) for y in (start * 0.6, end * 0.6 - 0.01)), place(0, 10.0, end)]
        for start, end, deep in bounds
    ]
    crossing.lanelet(*map(crossing.way, lines), **tags)
    road_map = read(crossing)
    report = only(road_map)
    assert (report.ways, len(report.entrances), len(report.movements)) == (4, 4, 12)
    own = ", and no traffic enters by 1 lane without another way" if outer > 3.5 else ""
    assert doubts(road_map, "table")[-1].startswith(f"1 U-turn of junction {report.id!r} is left out{own}")


@pytest.mark.parametrize(("region", "left"), [("gb", True), ("jp", True), ("cn", False), ("de", False)])
def test_region_decides_where_nothing_else_does(read: Read, region: str, left: bool) -> None:
    osm = Osm()
    for k in (0, 1):
        # A one-way street: no lane has an opposite lane beside it.
        ways = [osm.way([place(k, -100.0, aside), place(k, 100.0, aside)]) for aside in (1.75, -1.75)]
        osm.change(osm.lanelet(*ways), "region", region)
    road_map = read(osm)
    assert [report.left_hand for report in road_map.junctions] == [left]
    assert not doubts(road_map, "side")


def test_text_tells_the_side_where_traffic_keeps_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for left_hand in (True, False):
        main(["map", str(Crossing(left_hand=left_hand).write(tmp_path / "cross.osm"))])
        assert ("traffic keeps left" in capsys.readouterr().out) == left_hand


def dedicated(osm: Crossing, stations: Sequence[float], **tags: str) -> list[str]:
    """Add a lane beside the way from road 0 to the next road on its right hand, which shares no lanelet with other ways.

    The lane turns from the right of the lane in to the right of the lane out, in a lanelet per two stations along the turn.
    """
    lines = [corner(side, stations) for side in (3.5, 7.0)]
    turns = [osm.lanelet(*(osm.way(line[k : k + 2]) for line in lines), **tags) for k in range(len(stations) - 1)]
    before = osm.lanelet(*(osm.way([place(0, 60.0, side), place(0, 10.0, side)]) for side in (3.5, 7.0)))
    after = osm.lanelet(*(osm.way([place(1, 10.0, -side), place(1, 60.0, -side)]) for side in (3.5, 7.0)))
    return [before, *turns, after]


def corner(side: float, stations: Sequence[float]) -> list[tuple[float, float]]:
    """Return points from road 0 to road 1 on a quarter of a circle about (10, 10)."""
    angles = [math.pi * 1.5 - share * math.pi / 2 for share in stations]
    return [(10.0 + (10.0 - side) * math.cos(angle), 10.0 + (10.0 - side) * math.sin(angle)) for angle in angles]


@pytest.mark.parametrize("stations", [(0.0, 1.0), (0.0, 0.5, 1.0), (0.0, 0.3, 0.7, 1.0)])
@pytest.mark.parametrize("tags", [{}, {"turn_direction": "right"}])
def test_turn_lane_of_its_own_is_a_movement(read: Read, stations: tuple[float, ...], tags: dict[str, str]) -> None:
    crossing = Crossing()
    before, *turns, after = dedicated(crossing, stations, **tags)
    crossing.regulate("traffic_light", [], turns)
    report = only(read(crossing))
    assert (report.ways, len(report.entrances), len(report.exits), len(report.movements)) == (4, 5, 5, 13)
    (way,) = [way for way in report.movements if way.path.entrance == before]
    assert (way.turn, way.path.edges, way.path.exit) == ("right", tuple(turns), after)
    assert signs(report)[before] == "lights"


def test_tag_of_a_straight_lane_makes_no_junction(read: Read) -> None:
    crossing = Crossing()
    for k in range(4):
        crossing.change(crossing.entries[k], "turn_direction", "straight")
    # A road beside the junction, and far from it.
    for y in (40.0, 400.0):
        for x in (100.0, 120.0, 140.0):
            crossing.lanelet(*(crossing.way([(x, y + s), (x + 20.0, y + s)]) for s in (1.75, -1.75)), turn_direction="straight")
    report = only(read(crossing))
    assert (report.ways, len(report.entrances), len(report.movements)) == (4, 4, 12)


def test_refusal_counts_lanelets_of_an_unknown_subtype(read: Read) -> None:
    crossing = Crossing()
    lanelets = [*crossing.entries, *crossing.exits, *crossing.movements.values()]
    for id in lanelets:
        crossing.change(id, "subtype", "raod")
    with pytest.raises(MapError, match=r"none that a car can drive on.*of an unknown subtype were left out: 20 raod"):
        read(crossing)
    crossing = Crossing()
    for id in crossing.movements.values():
        crossing.change(id, "subtype", "raod")
    with pytest.raises(MapError, match=r"offers nothing to test.*of an unknown subtype were left out: 12 raod"):
        read(crossing)
