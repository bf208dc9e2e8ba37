"""Poses on tracks and anywhere on the map."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.graph import Track
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.geometry.road_map import RoadMap, read_map
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.support.errors import MapError

QUICK = settings(derandomize=True, deadline=None, max_examples=60)


@pytest.fixture(scope="module")
def stop4() -> RoadMap:
    return read_map(path_of("stop4"))


@given(data=st.data(), share=st.floats(0.01, 0.99), offset=st.floats(-1.5, 1.5), turn=st.floats(-1.0, 1.0))
@QUICK
def test_projection_inverts_placing(stop4: RoadMap, data: st.DataObject, share: float, offset: float, turn: float) -> None:
    entrance = data.draw(st.integers(0, 3))
    exit = (entrance + data.draw(st.integers(1, 3))) % 4
    track = stop4.track("1", entrance, exit)
    station = share * track.path.length
    x, y, heading = track.path.pose(station)
    pose = Pose(x - offset * math.sin(heading), y + offset * math.cos(heading), heading + turn)
    place = track.project(pose, near=station + 1.0)
    # The line is a polyline with corners of 0.05 rad at most, so off the line stations may slip a little there.
    assert place.station == pytest.approx(station, abs=0.1)
    assert place.offset == pytest.approx(offset, abs=0.01)
    assert place.heading_error == pytest.approx(turn, abs=0.06)
    segment = stop4.graph.segment(place.position.segment)
    assert math.dist(segment.pose(place.position.eta)[:2], track.path.pose(place.station)[:2]) < 0.01


def test_the_window_keeps_crossing_movements_apart(stop4: RoadMap) -> None:
    one, two = stop4.track("1", 0, 2), stop4.track("1", 1, 3)
    assert one.project(Pose(1.75, 1.75, 0.0), near=130.0).position.segment == one.segments[1].id
    assert two.project(Pose(1.75, 1.75, 0.0), near=130.0).position.segment == two.segments[1].id


def test_positions_pass_from_segment_to_segment(stop4: RoadMap) -> None:
    track = stop4.track("1", 0, 2)
    assert [s.id for s in track.segments][0::2] == ["0.0.1", "2.0.-1"]
    assert track.position(119.0).segment == "0.0.1"
    assert track.position(121.0).segment == track.segments[1].id
    assert track.position(151.0) == track.position(151.0)
    assert track.position(151.0).eta == pytest.approx(1.0)
    assert track.position(-3.0).eta == 0.0


def test_locate_prefers_the_lane_that_goes_the_same_way(stop4: RoadMap) -> None:
    # On the axis of the southern road both lanes are 1.75 m away.
    assert stop4.locator.locate(Pose(0.0, -60.0, math.pi / 2))[0].position.segment == "0.0.1"
    assert stop4.locator.locate(Pose(0.0, -60.0, -math.pi / 2))[0].position.segment == "0.0.-1"
    assert stop4.locator.locate(Pose(500.0, 500.0, 0.0)) == []


@given(data=st.data(), share=st.floats(0.0, 1.0))
@QUICK
def test_locate_finds_every_pose_on_a_lane(stop4: RoadMap, data: st.DataObject, share: float) -> None:
    id = data.draw(st.sampled_from(stop4.graph.segments))
    segment = stop4.graph.segment(id)
    places = {p.position.segment: p for p in stop4.locator.locate(segment.pose(share * segment.length))}
    assert id in places
    assert abs(places[id].offset) < 1e-6
    assert places[id].station == pytest.approx(share * segment.length, abs=1e-6)


def test_misuse(stop4: RoadMap) -> None:
    with pytest.raises(MapError, match="finite"):
        stop4.locator.locate(Pose(math.nan, 0.0, 0.0))
    with pytest.raises(MapError, match="reach must lie above 0 and up to 6 m"):
        stop4.locator.locate(Pose(0.0, 0.0, 0.0), reach=7.0)
    with pytest.raises(MapError, match="a track needs segments that follow one another"):
        Track([stop4.graph.segment("0.0.1"), stop4.graph.segment("2.0.1")])
    with pytest.raises(MapError, match="no movement from entrance 0 to exit 0"):
        stop4.track("1", 0, 0)
