"""Bends in which a car that follows the centre line leaves its lane: there the reference plans with the body that it sweeps."""

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.drivers import reference
from pytest_rvads.drivers.follower import AxlePath, Pace, axle_path, track
from pytest_rvads.drivers.interface import Autopilot, Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Pose, Segment
from pytest_rvads.geometry.sweep import CAR, plan, with_roads
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.lane import off_lane, off_route
from pytest_rvads.logic.conduct.room import leaves_room, room, stand_back
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration
from pytest_rvads.scenarios.ids import from_id
from pytest_rvads.scenarios.placing import started
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from tools.crossings import Layout, opendrive
from tools.make_maps import CROSSINGS


@pytest.mark.parametrize("name", names())
def test_a_car_follows_the_centre_line_at_every_builtin_junction(name: str) -> None:
    junction = find(name)
    assert not [key for key in junction.movements if axle_path(itinerary(junction, *key), Vehicle(), junction.lane_width)]


@pytest.mark.parametrize(("distance", "speed"), [(12.0, 5.0), (0.3, 0.0)])
def test_a_narrow_right_turn_is_driven_within_the_lane(tmp_path: Path, distance: float, speed: float) -> None:
    path = tmp_path / "narrow.xodr"
    path.write_text(opendrive(replace(CROSSINGS["stop4"], stop=5.6, lane_width=3.2, lane_offset=1.6)))
    junction = find("1", str(path))
    run = simulate(Case(Scenario(junction, "1000", distance=distance, speed=speed), Reference))
    assert run.station[-1, 0] > junction.movements[0, 1].length
    assert not off_lane(run, 0).any()
    assert not off_route(run, 0).any()


def test_a_wavy_approach_is_followed_as_smoothly_before_a_narrow_turn_as_before_a_wide_one(tmp_path: Path) -> None:
    """Points up to 2 cm aside every 30 cm turn the line by up to 8 degrees, not the road."""
    path = tmp_path / "narrow.xodr"
    path.write_text(opendrive(replace(CROSSINGS["stop4"], stop=5.6, lane_width=3.2, lane_offset=1.6)))
    junction = find("1", str(path))
    line = junction.way_in(0)
    stations = np.arange(0.0, line.length, 0.3)
    points, ahead = line.centre(stations)
    waves = 0.02 * np.sin(np.arange(len(stations)) ** 2)[:, None] * np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1)
    waves[stations > line.length - 15.0] = 0.0  # there a path is planned
    wavy = Segment(line.id, np.vstack((points + waves, line.points[-1])))
    entrances = (replace(junction.entrances[0], approach=wavy), *junction.entrances[1:])
    run = simulate(Case(Scenario(replace(junction, entrances=entrances), "1000", distance=60.0, speed=8.0), Reference))
    before = (run.need("station")[:, 0] < -20.0).nonzero()[0]
    x, y, heading = run.need("pose")[before, 0].T
    start = line.pose(0.0)
    aside = (y - start.y) * math.cos(start.heading) - (x - start.x) * math.sin(start.heading)
    assert np.abs(aside).max() < 0.05
    assert np.abs(heading - start.heading).max() < math.radians(2.0)


@pytest.mark.parametrize("side", ["approach", "exit"])
def test_a_bend_of_the_road_is_driven_within_a_narrow_lane(tmp_path: Path, side: str) -> None:
    """A car whose rear axle follows a circle of 10 m reaches 1.52 m to the outside, where a lane of 2.4 m allows 1.5 m."""
    path = tmp_path / "narrow.xodr"
    path.write_text(opendrive(Layout(stop=8.0, lane_width=2.4, lane_offset=1.2)))
    junction = find("1", str(path))
    angle = np.arange(0.0, math.pi / 2.0, 0.02)[:, None]
    arc = 10.0 * np.hstack((np.sin(angle), 1.0 - np.cos(angle))) + [18.0, 0.0]
    bend = np.vstack(([0.0, 0.0], arc, [28.0, 10.0], [28.0, 60.0]))
    entrances, exits = [*junction.entrances], [*junction.exits]
    if side == "approach":  # from its end upstream
        entrances[0] = replace(entrances[0], approach=turned(bend, junction.way_in(0).pose(junction.way_in(0).length), -1.0))
    else:
        exits[2] = replace(exits[2], road=turned(bend, junction.way_out(2).pose(0.0), 1.0))
    junction = replace(junction, entrances=tuple(entrances), exits=tuple(exits))
    # The other vehicle comes so late that the run goes on until the first one is behind the bend.
    run = simulate(Case(Scenario(junction, "2020", distance=[45.0, 20.0, 110.0, 20.0], speed=[4.0, 0.0, 0.0, 0.0]), Reference))
    assert run.station[-1, 0] > junction.movements[0, 2].length + 35.0
    assert not off_lane(run, 0).any()


def turned(points: np.ndarray, pose: Pose, ahead: float) -> Segment:
    """Return the line that leads away from a pose (`ahead` 1), or to it (-1), by points that begin at the origin along x."""
    cos, sin = ahead * math.cos(pose.heading), ahead * math.sin(pose.heading)
    moved = points @ np.array([[cos, sin], [-sin, cos]]) + [pose.x, pose.y]
    return Segment("bend", moved if ahead > 0.0 else moved[::-1])


def test_a_pace_of_the_rear_axle_holds_where_the_front_is_beyond_the_end_of_its_itinerary() -> None:
    way = itinerary(find("stop4"), 0, 1)
    path = AxlePath(way.path, (), (), (Pace(way.end, 1.0),), (way.pose(way.end),))
    assert track(way, 3.65, path).speed(way.end + 9.0) == 1.0


class Parked(Autopilot):
    """Stands wherever it starts."""

    def control(self, seen: Observation) -> Control:
        return Control(0.0, 1.0, 0.0)


@pytest.fixture
def small(tmp_path: Path) -> Junction:
    """Left turns end beside a vehicle that stands across them at its line, outside the corridor of the front."""
    path = tmp_path / "small.xodr"
    path.write_text(opendrive(Layout(stop=2.5, lane_width=3.0, lane_offset=1.5)), encoding="utf-8")
    place = find("1", path)
    signs = (Sign.PRIORITY, Sign.PRIORITY, Sign.YIELD, Sign.PRIORITY)
    lanes = tuple(replace(lane, sign=sign) for lane, sign in zip(place.entrances, signs, strict=True))
    return replace(place, entrances=lanes)


@pytest.mark.extended
def test_a_sweeping_body_stops_before_it_touches_a_standing_vehicle(small: Junction, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "no_room", lambda *_: False)  # it enters without a look at the vehicle
    run = simulate(Case(Scenario(small, "3020", distance=0.3, subject=0, duration=20), Reference, traffic=Parked))
    assert run.collisions == ()
    assert run.speed[-1, 0] == 0.0
    assert run.zone[-1, 0] == Zone.JUNCTION


def test_no_entry_while_a_vehicle_at_its_line_leaves_no_room(small: Junction) -> None:
    run = simulate(Case(Scenario(small, "3020", distance=0.3, subject=0, duration=20), Reference, traffic=Parked))
    assert run.speed[-1, 0] == 0.0
    assert run.zone[-1, 0] <= Zone.ENTRANCE


@pytest.mark.parametrize("name", names())
def test_every_line_of_a_builtin_junction_leaves_room(name: str) -> None:
    assert not room(find(name))


def test_a_place_farther_from_the_line_leaves_room(small: Junction) -> None:
    """The left turn comes within 2.5 m of the line, where the standing body begins; 5 m before the line no body sweeps."""
    assert {pair for pair in room(small) if pair[0] == 2} >= {(2, (0, 3))}
    assert 0.0 < stand_back(small, 2) < 5.0
    assert leaves_room(small, 2, (0, 3)) <= stand_back(small, 2)


def test_a_vehicle_that_gives_way_stops_where_others_have_room(small: Junction) -> None:
    scenario = Scenario(small, "3020", distance=[12.0, 20.0, 12.0, 20.0], speed=4.0, duration=40)
    run = simulate(Case(scenario, partial(Reference, tie=0.5)))
    assert run.provenance["end"] == "left"
    assert run.collisions == ()
    assert check(run, "keep_clear").status == "PASS"


def test_a_start_in_a_bend_is_as_slow_as_the_planned_path_needs(shared: Path) -> None:
    """Faster, the wheels can't turn as the path demands, and the front swings out."""
    place = find("j_21657502", shared / "maps" / "durlacher-tor.xodr")
    slowed = started(configuration("S31", 3), place, 0, 1, 0)["speed"][1]
    code = tuple(2 if entrance == 1 else 0 for entrance in range(3))
    for speed, kept in ((slowed, True), (3.2, False)):
        run = simulate(Case(Scenario(place, code, distance=20.0, speed=speed), Reference))
        assert off_lane(run, 0).any() != kept


def test_a_path_keeps_the_lane_up_to_the_end_of_a_road_that_ends_in_a_bend(shared: Path) -> None:
    """Beyond the end no vehicle follows the centre line, so the path need not come back to it."""
    place = find("j_21657502", shared / "maps" / "durlacher-tor.xodr")
    course = with_roads(itinerary(place, 0, 1).course(place.lane_width, -10.0), -10.0, CAR)
    path = plan(course, CAR)
    assert path is not None
    assert not len(path.amiss)


def test_a_path_begins_where_the_axles_of_a_starting_vehicle_are(shared: Path) -> None:
    """There the approach turns by 80 degrees, so that front and rear axle are nearer to each other than along the centre line."""
    way = itinerary(find("j_21657515", shared / "maps" / "durlacher-tor.xodr"), 0, 2)
    path, start = axle_path(way, Vehicle(), 2.5, -0.3), way.placed(-0.3, 3.65)
    assert path is not None
    axle = start.x - 3.65 * math.cos(start.heading), start.y - 3.65 * math.sin(start.heading)
    assert path.poses[0] == pytest.approx((*axle, start.heading), abs=1e-6)


@pytest.mark.parametrize(
    ("file", "id", "key"),
    [
        ("durlacher-tor", "j_5921332287", (0, 1)),
        ("durlacher-tor", "j_25309804", (2, 0)),
        ("Town07", "967", (1, 0)),
    ],
)
def test_the_rear_axle_keeps_to_its_path(shared: Path, file: str, id: str, key: tuple[int, int]) -> None:
    """Pure pursuit with an aim near enough not to cut corners swung over where a vehicle starts in a bend."""
    junction = find(id, shared / "maps" / f"{file}.xodr")
    code = [0] * len(junction.entrances)
    code[key[0]] = next(d for (entrance, d), movement in junction.by_direction.items() if movement.key == key)
    run = simulate(Case(Scenario(junction, tuple(code), distance=0.3, duration=60), Reference))
    assert run.provenance["end"] == "left"
    assert not off_lane(run, 0).any()


def test_a_car_passes_beside_a_standing_vehicle_that_its_body_does_not_touch(shared: Path) -> None:
    """The body keeps 0.1 m to the vehicle at the line of the arm that it leaves by; the centre line of its front comes nearer."""
    case = from_id("durlacher_tor.j_1676908212-class19-as2222-s1-cfgS31", shared / "maps" / "durlacher-tor.xodr")
    driver = partial(Reference, tie=0.5)
    run = simulate(Case(case, driver, traffic=driver))
    assert run.provenance["end"] == "left"
    assert run.collisions == ()
