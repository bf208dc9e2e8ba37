"""Starts on approaches that are one lane upstream: behind each other, or not at all. And on approaches that bend."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.physics.body import start
from pytest_rvads.physics.engines import BulletWorld
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.satellites.campaigns.town import Plan, Request
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import configuration, explicit, forks, near, started
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.session.collection.cells import Unfit, runs_of
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import ScenarioError

PARTED, ONE = 9.0, 15.0
"""The lanes have their places up to so far before the vertex, and are one from so far on [m]."""


def turn_lane(begins: bool = False) -> Junction:
    """Return `lanes4` with a turn lane at entrance 0, that forks from the lane of entrance 1 or begins beside it."""
    place = find("lanes4")
    own, other = place.way_in(0), place.way_in(1)
    upstream = ONE if begins else other.length
    points = [
        *(other.pose(other.length - back)[:2] for back in (upstream, ONE)),
        *(own.pose(own.length - b)[:2] for b in (PARTED, 0)),
    ]
    lane = replace(place.entrances[0], approach=Segment("turn lane", np.array(points)))
    return replace(place, name="fork4", entrances=(lane, *place.entrances[1:]))


FORK = turn_lane()


def merge() -> Junction:
    """Return `lanes4` with an approach of entrance 0 that crosses the lane of entrance 1 on its way."""
    place = find("lanes4")
    own, other = place.way_in(0), place.way_in(1)
    across = own.points[-1] - other.points[-1]
    far = other.pose(other.length - 60.0)[:2] - 3.0 * across
    points = [far, *(own.pose(own.length - back)[:2] for back in (PARTED, 0))]
    lane = replace(place.entrances[0], approach=Segment("ramp", np.array(points)))
    return replace(place, name="merge4", entrances=(lane, *place.entrances[1:]))


MERGE = merge()


def scenario(*distances: float, speed: float = 0.0, followers: int = 0, place: Junction = FORK) -> Scenario:
    both = [place.directions(entrance)[0] for entrance in (0, 1)]
    near = [*distances, *[20.0] * 6]
    return Scenario(place, [*both, *[0] * 6], distance=near, speed=speed, followers=followers, duration=0.5)


@pytest.mark.parametrize("begins", [False, True])
def test_where_lanes_part_is_found_and_told_from_the_line(begins: bool) -> None:
    place = turn_lane(begins)
    ((entrances, distances),) = forks(place)
    assert entrances == (0, 1)
    for distance, entrance in zip(distances, place.entrances, strict=False):
        assert PARTED < distance + entrance.setback < ONE


@pytest.mark.parametrize("name", ["stop4", "light3", "lanes4", "roundabout4"])
def test_lanes_beside_each_other_are_no_fork_and_not_near(name: str) -> None:
    assert (forks(find(name)), near(find(name))) == ((), frozenset())


def test_vehicles_beside_each_other_and_behind_each_other_start() -> None:
    for distances, speed in (((3.0, 3.0), 5.0), ((3.0, 30.0), 10.0), ((30.0, 36.7), 0.0), ((60.0, 20.0), 10.0)):
        run = simulate(Case(scenario(*distances, speed=speed), Reference))
        assert (run.fault, run.collisions) == (None, ())


@pytest.mark.parametrize(
    ("distances", "speed", "says"),
    [
        (
            (20.0, 20.0),
            0.0,
            r"a0\.\d would start 0\.0 m behind a0\.\d, where 2\.0 m are needed: entrances 0 and 1 .* one lane from",
        ),
        ((30.0, 35.0), 0.0, r"a0\.1 would start [01]\.\d m behind a0\.0, where 2\.0 m"),
        ((30.0, 40.0), 10.0, r"a0\.1 would start 5\.\d m behind a0\.0, where 12\.0 m"),
        ((40.0, 30.0), 10.0, r"a0\.0 would start 4\.\d m behind a0\.1, where 12\.0 m"),
    ],
)
def test_too_close_in_one_lane_is_refused(distances: tuple[float, float], speed: float, says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        scenario(*distances, speed=speed).starts()


def test_followers_and_long_vehicles_count() -> None:
    near = scenario(3.0, 3.0)
    near.starts()
    with pytest.raises(ScenarioError, match=r"a0\.1\+1 would start 0\.0 m behind a0\.0\+1"):
        near.but(followers=1).starts()
    with pytest.raises(ScenarioError, match=r"where 2\.0 m are needed"):
        near.starts(lambda _: Vehicle(length=12.0))


def test_what_does_not_fit_is_left_out_of_a_test_and_the_rest_stays() -> None:
    selection = Selection(FORK, explicit([3.0, 20.0], 0.0, 8), scenarios=(scenario(3, 3).directions,))
    unfit = Unfit()
    runs = list(runs_of(selection, [None], unfit))
    assert ([scenario.distances[0] for scenario, _ in runs], unfit.count) == ([3.0], 1)


def refusal(scenario: Scenario) -> str:
    try:
        scenario.starts()
    except ScenarioError as error:
        return str(error)
    return ""


def test_starts_on_approaches_that_converge_are_refused_where_bodies_touch_in_an_engine() -> None:
    pytest.importorskip("pybullet")
    assert (forks(MERGE), near(MERGE)) == ((), {(0, 1)})
    vehicle, refused = Vehicle(), []
    for distances in product(np.arange(0.0, 50.0, 4.0), repeat=2):
        case = scenario(*distances, place=MERGE)
        ways = zip(case.itineraries(), distances, strict=True)
        world = BulletWorld([vehicle] * 2, [start(way, way.start(distance), 0.0, vehicle) for way, distance in ways])
        refused.append(bool(refusal(case)))
        assert refused[-1] == bool(world.contacts()), distances
        world.close()
    assert 5 < sum(refused) < len(refused) - 5


def test_followers_on_converging_approaches_must_not_overlap() -> None:
    apart = scenario(10.0, 15.0, place=MERGE)
    assert refusal(apart) == ""
    assert refusal(apart.but(followers=1)).startswith(
        "a0.0+1 and a0.1 would start inside each other, where the approaches of entrances 0 and 1 of junction 'merge4' converge"
    )


def test_starts_inside_each_other_are_left_out_of_a_town_with_the_reason() -> None:
    plan = Plan([MERGE], Request(Reference, occupancy="lanes", followers=(2,)))
    left_out = plan.left_out(MERGE)
    assert left_out is not None
    assert (left_out.scenarios > 0, "would start inside each other" in left_out.reason) == (True, True)
    assert all(refusal(planned.case.scenario) == "" for planned in plan)


LATERAL, BRAKING = 2.5, 2.0
"""What the reference takes bends with, and brakes with before them [m/s^2]."""


def bent(radius: float, straight: float) -> Junction:
    """Return the all-way stop with approaches that turn left by 90 degrees, and lead straight on up to the entrance vertex."""
    angle = np.arange(0.0, math.pi / 2.0, 0.01)[:, None]
    arc = radius * np.hstack((np.sin(angle), 1.0 - np.cos(angle)))
    approach = Segment("bent", np.vstack(([-60.0, 0.0], arc, [radius, radius], [radius, radius + straight])))
    place = find("stop4")
    return replace(place, entrances=tuple(replace(lane, approach=approach) for lane in place.entrances))


def speeds(place: Junction, label: str, subject: int | None = None, followers: int = 0) -> tuple[float, ...]:
    start: tuple[float, ...] = started(configuration(label, 4), place, 0, subject, followers)["speed"]
    return start


def test_a_start_in_a_bend_is_as_slow_as_the_bend_is_taken() -> None:
    place = bent(10.0, 14.0 - find("stop4").setbacks[0])  # D starts 20 m before the line, 6 m before the end of the bend
    assert speeds(place, "D") == pytest.approx((math.sqrt(LATERAL * 10.0),) * 4, rel=0.02)


def test_a_start_before_a_bend_leaves_room_to_brake() -> None:
    arc = 4.0 * math.pi / 2.0
    place = bent(4.0, 20.0 - 8.0 - arc - find("stop4").setbacks[0])  # D starts 8 m before the bend
    exact = math.sqrt(LATERAL * 4.0 + 2.0 * BRAKING * 8.0)  # bends are measured over 4 m, so that they begin 2 m later
    assert speeds(place, "D") == pytest.approx((exact,) * 4, rel=0.1)


def test_a_start_behind_a_bend_is_as_fast_as_asked() -> None:
    place = bent(4.0, 60.0)
    assert speeds(place, "D") == (10.0,) * 4
    assert speeds(place, "S21", 0) == (8.0,) * 4, "the subject starts 36 m before the line"


def test_a_queue_that_reaches_into_a_bend_starts_as_slowly_as_its_last_vehicle_must() -> None:
    place = bent(10.0, 32.0)
    assert speeds(place, "D") == (10.0,) * 4
    assert speeds(place, "D", followers=1) == pytest.approx((math.sqrt(LATERAL * 10.0),) * 4, rel=0.02)


@pytest.mark.parametrize("name", [name for name in names() if name != "roundabout4"])  # its ring is an approach that bends
def test_straight_approaches_slow_nobody(name: str) -> None:
    place = find(name)
    point = configuration("D", len(place.entrances))
    assert started(point, place, 0, None, 0)["speed"] == point.speeds
