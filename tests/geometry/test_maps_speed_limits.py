"""Speed limits that maps state: read, carried along ways, told, kept with runs."""

import json
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import pytest

import pytest_rvads as rvads
from pytest_rvads.cli import main
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.opendrive.map_file import speed_of
from pytest_rvads.geometry.segment import NO_LIMIT, SPEED_LIMIT
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.support.errors import MapError

from .conftest import Read, Tree

MPH = 1609.344 / 3600
"""An international mile has 1,609.344 m."""


def roads(root: Element) -> list[Element]:
    return [road for road in root.iter("road") if road.get("junction") == "-1"]


def state(road: Element, s: str, **speed: str) -> None:
    """Add a type of the road from station `s` on, with a speed limit where `speed` has its attributes."""
    part = SubElement(road, "type", s=s, type="town")
    if speed:
        SubElement(part, "speed", speed)


@pytest.fixture
def stop(tree: Tree) -> Element:
    """A 4-way all-way stop; road 0 leads south from its stopping line, its lane 1 leads in and its lane -1 out."""
    return tree()


@pytest.mark.parametrize(
    ("speed", "limit"),
    [
        ({"max": "13.9"}, 13.9),
        ({"max": "10", "unit": "m/s"}, 10.0),
        ({"max": "30", "unit": "mph"}, 30 * MPH),
        ({"max": "50", "unit": "km/h"}, 50 / 3.6),
        ({"max": " 5.0e+01 ", "unit": "KM/H"}, 50 / 3.6),
        ({"max": "no limit"}, NO_LIMIT),
        ({"max": "undefined"}, None),
        ({"max": ""}, None),
    ],
)
def test_limits_are_read_in_every_unit(stop: Element, read: Read, speed: dict[str, str], limit: float | None) -> None:
    for road in roads(stop):
        state(road, "0", **speed)
    road_map = read(stop)
    place = road_map.junction(road_map.junctions[0].id)
    assert [warning for warning in road_map.warnings if warning.kind == "speed"] == []
    for lane in place.entrances:
        assert lane.approach
        stated = [value for _, value in lane.approach.limits]
        assert stated == ([] if limit is None else [pytest.approx(limit, rel=1e-12)])


@pytest.mark.parametrize(
    "speed",
    [
        *({"max": value} for value in ("fast", "-3", "0", "nan", "inf", "1e400", "5,5")),
        {"max": "50", "unit": "knots"},
        {"max": "5", "unit": "0mph"},
        {"max": "50 mph", "unit": "mph"},
        {"max": "9" * 5000},
    ],
)
def test_unreadable_speed_limit_is_a_warning(stop: Element, read: Read, speed: dict[str, str]) -> None:
    state(roads(stop)[0], "0", **speed)
    road_map = read(stop)
    (warning,) = (warning for warning in road_map.warnings if warning.kind == "speed")
    assert "road '0'" in warning.message
    assert f"got {' '.join(speed.values())[:40]!r}" in warning.message
    assert road_map.junction(road_map.junctions[0].id).top_limit == SPEED_LIMIT


def test_a_limit_at_no_place_is_told_and_ignored(stop: Element, read: Read) -> None:
    state(roads(stop)[0], "here", max="8")
    (warning,) = (warning for warning in read(stop).warnings if warning.kind == "speed")
    assert warning.message == "a speed limit of road '0' was ignored: its place: s='here' of <type> is not a number"


def test_limits_change_along_a_road_in_both_directions(stop: Element, read: Read) -> None:
    road = roads(stop)[0]
    state(road, "50", max="20")
    state(road, "0", max="8")
    state(road, "80")
    road_map = read(stop)
    place = road_map.junction(road_map.junctions[0].id)
    key = next(key for key in place.movements if place.entrances[key[0]].arm == 0)
    way = itinerary(place, *key)
    assert [way.limit_at(-distance) for distance in (90, 79, 51, 49, 1)] == [SPEED_LIMIT, 20.0, 20.0, 8.0, 8.0]
    assert way.limit_at(way.length / 2) == 8.0, "in the junction the limit of the road that leads in goes on"
    assert way.limit_at(way.length + 5.0) == SPEED_LIMIT, "the other roads state none"
    assert [border for border, _ in way.limits[1:3]] == pytest.approx([-80.0, -50.0], abs=1e-6)
    key = next(key for key in place.movements if place.exits[key[1]].arm == 0)
    out = itinerary(place, *key)
    assert [out.limit_at(out.length + distance) for distance in (1, 49, 51)] == [8.0, 8.0, 20.0]


def test_a_limit_of_a_lane_comes_before_that_of_its_road(stop: Element, read: Read) -> None:
    road = roads(stop)[0]
    state(road, "0", max="20")
    lane = next(lane for lane in road.iter("lane") if lane.get("id") == "1")
    SubElement(lane, "speed", sOffset="0", max="36", unit="km/h")
    SubElement(lane, "speed", sOffset="30", max="undefined")
    road_map = read(stop)
    place = road_map.junction(road_map.junctions[0].id)
    approach = next(lane.approach for lane in place.entrances if lane.arm == 0)
    assert approach
    assert [limit for _, limit in approach.limits] == [20.0, 10.0]
    assert approach.length - approach.limits[1][0] == pytest.approx(30.0, abs=1e-6)
    assert [exit.road.limits for exit in place.exits if exit.arm == 0 and exit.road] == [((0.0, 20.0),)]


def test_parts_of_a_line_keep_their_limits() -> None:
    line = find("stop4").limited(8.0).way_in(0)
    whole = rvads.find("stop4").way_in(0)
    joined = line.head(30.0).then(whole.tail(whole.length - 30.0))
    assert joined
    assert joined.limits == ((0.0, 8.0), (30.0, None))
    assert joined.tail(joined.length - 10.0).limits == ((0.0, 8.0), (20.0, None))
    assert joined.tail(10.0).limits == ((0.0, None),)
    assert joined.head(30.0).limits == ((0.0, 8.0),)


def test_speed_limit_is_part_of_the_junction() -> None:
    place = find("stop4")
    slow = place.limited(8.0)
    assert (place.top_limit, slow.top_limit) == (SPEED_LIMIT, 8.0)
    assert slow != place
    assert slow.limited(None) == place
    assert place.limited(8.0) is slow


def test_maps_tell_their_limits(stop: Element, read: Read, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for road, speed in zip(roads(stop)[:3], ("8", "no limit", "8"), strict=True):
        state(road, "0", max=speed)
    read(stop)
    assert main(["map", str(tmp_path / "map.xodr")]) == 0
    text = capsys.readouterr().out
    assert "arm 0: 1 lane in, 1 out, stop, limit 8.0 m/s; arm 1: 1 lane in, 1 out, stop, no limit;" in text
    assert "arm 3: 1 lane in, 1 out, stop\n" in text
    assert main(["map", "--json", str(tmp_path / "map.xodr")]) == 0
    arms: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["junctions"][0]["arms"]
    assert [arm["speed_limits"] for arm in arms] == [[8.0], [NO_LIMIT], [8.0], []]


def test_files_of_runs_keep_limits(tmp_path: Path) -> None:
    place = find("stop4").limited(8.0)
    run = rvads.simulate(rvads.Case(rvads.Scenario(place, "2000", duration=0.1), rvads.Reference))
    rvads.files.save_run(run, tmp_path / "run.npz")
    again = rvads.files.load_run(tmp_path / "run.npz")
    assert again == run
    assert again.junction.top_limit == 8.0


@pytest.mark.parametrize(
    ("text", "speed"), [("30mph", 30 * MPH), ("50 km/h", 50 / 3.6), ("13.9", 13.9), ("13.9 M/S", 13.9), ("1e1mph", 10 * MPH)]
)
def test_speeds_are_written_with_units(text: str, speed: float) -> None:
    assert speed_of(text, "it") == pytest.approx(speed, rel=1e-12)


@pytest.mark.parametrize("text", ["0", "-5", "5 ells", "mph", "999", "1e9"])
def test_invalid_speed_is_refused(text: str) -> None:
    with pytest.raises(MapError, match=f"it must be a speed above 0 such as 30mph, .*, got '{text}'"):
        speed_of(text, "it")
