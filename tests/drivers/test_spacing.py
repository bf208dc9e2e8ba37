"""When the reference autopilot brakes, and how hard: for the line, for who is ahead, for who crosses; by hand."""

import math
from typing import Any

import pytest

from pytest_rvads.drivers.follower import Track, lookahead, pursue
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.spacing import Stopping, behind_leader, can_stop, clear_of_bodies, clear_of_crossing, time_to
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Vehicle, VehicleState, Zone
from pytest_rvads.scenarios.scenario import Scenario

JUNCTION = find("stop4")
(STRAIGHT,) = Scenario(JUNCTION, "2000").itineraries()
"""From entrance 0 to exit 2."""
LENGTH = 4.6


def vehicle(entrance: int, turn: Turn, zone: Zone, station: float, speed: float, **more: Any) -> VehicleState:
    return VehicleState(f"a{entrance}", entrance, turn, zone, station, 0.0, 0.0, 0.0, speed, 0.0, LENGTH, 1.86)._replace(**more)


def sees(me: tuple[Zone, float, float], *others: VehicleState, created: int = 0, aggression: int = 1, **mine: Any) -> Observation:
    """What the driver from entrance 0 straight on sees: its own zone, station and speed, and the others."""
    state = vehicle(0, Turn.STRAIGHT, *me, **mine)
    return Observation(0.0, state, others, (), STRAIGHT, JUNCTION, Vehicle(), 11.176, aggression, created=created)


@pytest.mark.parametrize(
    ("distance", "speed", "time"),
    [
        (-1.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (9.0, 0.0, 3.0),  # still accelerating: 2 m/s^2 * (3 s)^2 / 2
        (25.0, 0.0, 5.0),  # 10 m/s are reached there
        (45.0, 0.0, 7.0),  # and kept for 20 m
        (5.0, 4.0, 1.0),
        (21.0, 4.0, 3.0),
        (41.0, 4.0, 5.0),
        (24.0, 12.0, 2.0),  # faster than the limit: it stays so
    ],
)
def test_the_time_to_a_place_at_two_metres_per_second_squared_up_to_ten(distance: float, speed: float, time: float) -> None:
    assert time_to(distance, speed, 2.0, 10.0) == pytest.approx(time)


def test_a_stop_needs_the_way_of_the_brakes_lag_and_of_the_braking() -> None:
    # At 8 m/s: 0.96 m until the brake answers, 10 m at 3.2 m/s^2, and 0.15 m to spare.
    for before, possible in ((11.12, True), (11.10, False)):
        assert can_stop(sees((Zone.APPROACH, -before, 8.0)), 3.2) is possible
    for station, speed, possible in ((-0.05, 0.0, True), (0.0, 0.1, True), (0.05, 0.0, False), (-0.05, 0.2, False)):
        assert can_stop(sees((Zone.ENTRANCE, station, speed)), 3.2) is possible


def ahead(gap: float, speed: float, zone: Zone = Zone.JUNCTION, turn: Turn = Turn.STRAIGHT) -> tuple[float, VehicleState]:
    """A station in the junction, and who drives into the same exit with its rear end `gap` ahead of it."""
    return 2.0, vehicle(0, turn, zone, 2.0 + gap + LENGTH, speed, name="leader")


@pytest.mark.parametrize(
    ("speed", "gap", "leader", "wanted"),
    [
        (4.0, 4.0, 4.0, 0.0),  # 2 m, and half a second's way more
        (6.0, 5.0, 6.0, 0.0),
        (6.0, 11.0, 0.0, 0.0),  # 2 m, 3 m in half a second, 6 m at 3 m/s^2
        (6.0, 2.0 + 20.0 / 3.0, 0.0, -2.0),  # safe are 5 m/s, which are to be reached in half a second
        (5.0, 11.0, 0.0, 2.0),
        (0.2, 1.9, 0.0, -math.inf),
        (0.2, 2.5, 0.0, (-1.5 + math.sqrt(5.25) - 0.2) / 0.5),
        (0.3, 1.9, 0.0, -0.6),
        (5.0, 1.0, 2.0, 2.0 * (-1.5 + 2.5 - 5.0)),
    ],
)
def test_who_follows_keeps_half_a_second_and_two_metres(speed: float, gap: float, leader: float, wanted: float) -> None:
    station, other = ahead(gap, leader)
    assert behind_leader(sees((Zone.JUNCTION, station, speed), other)) == pytest.approx(wanted)


def test_who_leads_is_ahead_on_the_way_into_the_same_exit() -> None:
    station, other = ahead(4.0, 1.0)
    me = (Zone.JUNCTION, station, 4.0)
    wanted = behind_leader(sees(me, other))
    assert wanted < 0.0
    assert behind_leader(sees(me, other._replace(zone=Zone.EXIT))) == wanted
    assert behind_leader(sees(me)) == math.inf
    for zone in (Zone.APPROACH, Zone.ENTRANCE):
        assert behind_leader(sees(me, other._replace(zone=zone))) == math.inf
    assert behind_leader(sees(me, other._replace(turn=Turn.RIGHT))) == math.inf, "into another exit"
    assert behind_leader(sees(me, other._replace(station=2.0))) == math.inf, "beside it, not ahead"
    far = vehicle(0, Turn.STRAIGHT, Zone.EXIT, 40.0, 4.0, name="far")
    assert behind_leader(sees(me, far, other)) == behind_leader(sees(me, other, far)) == wanted
    # From entrance 1 to the right it has as far to go to the common exit as one 10 m before it has.
    (right,) = JUNCTION.by_turn[1, Turn.RIGHT]
    joins = vehicle(1, Turn.RIGHT, Zone.JUNCTION, right.length - 10.0, 4.0)
    station = STRAIGHT.length - 10.0 - LENGTH - 4.0
    assert behind_leader(sees((Zone.JUNCTION, station, 4.0), joins)) == pytest.approx(0.0)


assert JUNCTION.stretches is not None
MINE, YOURS, _ = JUNCTION.stretches[(0, 2), (1, 3)]


def crossing(before: float, speed: float, **more: Any) -> VehicleState:
    """Who comes from entrance 1 straight on, so far before the place where the ways cross."""
    return vehicle(1, Turn.STRAIGHT, Zone.JUNCTION, YOURS.start - before, speed)._replace(**more)


@pytest.mark.parametrize(
    ("other", "created", "wanted"),
    [
        (crossing(4.0, 4.0), 0, -16.0 / 11.0),  # 1 s against 1.5 s: an even stop in 5.5 m
        (crossing(8.0, 4.0), 0, math.inf),
        (crossing(6.0, 4.0), 1, -16.0 / 11.0),  # at the same time: who was created first
        (crossing(6.0, 4.0), 0, math.inf),
        (crossing(1.4, 0.5), 0, -16.0 / 11.0),  # slower than 1 m/s counts as 1 m/s
        (crossing(1.6, 0.5), 0, math.inf),
        (crossing(-1.0, 0.0), 0, -16.0 / 11.0),  # it is there
        (crossing(4.0, 4.0, zone=Zone.ENTRANCE), 0, math.inf),
        (crossing(4.0, 4.0, zone=Zone.EXIT), 0, math.inf),
        (crossing(4.0, 4.0, turn=Turn.RIGHT), 0, math.inf),  # into the same exit: followed, not let through
        (crossing(YOURS.start - YOURS.end - LENGTH + 0.1, 4.0), 0, -16.0 / 11.0),  # its rear end is still there
        (crossing(YOURS.start - YOURS.end - LENGTH - 0.1, 4.0), 0, math.inf),
    ],
)
def test_who_is_first_where_ways_cross_is_let_through(other: VehicleState, created: int, wanted: float) -> None:
    seen = sees((Zone.JUNCTION, MINE.start - 6.0, 4.0), other, created=created)
    assert clear_of_crossing(seen) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("before", "speed", "wanted"),
    [
        (10.0, 4.0, math.inf),  # 0.84 m/s^2 would do: too early to brake
        (7.5, 4.0, math.inf),  # 1.14 m/s^2
        (7.4, 4.0, -16.0 / 13.8),
        (0.55, 0.2, -math.inf),
        (0.55, 0.3, -0.45),  # at the place: an even stop on 0.1 m, and no creeping on
        (0.4, 1.0, -5.0),  # too late for the half metre: an even stop on 0.1 m
        (0.0, 4.0, math.inf),  # it is there itself
    ],
)
def test_yielding_vehicle_stops_half_a_metre_before_the_conflict(before: float, speed: float, wanted: float) -> None:
    seen = sees((Zone.JUNCTION, MINE.start - before, speed), crossing(-1.0, 0.0))
    assert clear_of_crossing(seen) == pytest.approx(wanted)


def body(ahead: float, left: float = 0.0, speed: float = 0.0, turned: float = 0.0, zone: Zone = Zone.JUNCTION) -> VehicleState:
    """A vehicle with the middle of its rear bumper so far ahead of the start of the approach, and beside the centre line."""
    x, y, heading = STRAIGHT.pose(-40.0)
    x, y = x + ahead * math.cos(heading) - left * math.sin(heading), y + ahead * math.sin(heading) + left * math.cos(heading)
    heading += turned
    x, y = x + LENGTH * math.cos(heading), y + LENGTH * math.sin(heading)
    return vehicle(2, Turn.STRAIGHT, zone, -40.0, speed, x=x, y=y, heading=heading)


def room(other: VehicleState, speed: float = 6.0) -> float:
    """What it does about a body when it is 40 m before the junction."""
    x, y, heading = STRAIGHT.pose(-40.0)
    seen = sees((Zone.APPROACH, -40.0, speed), other, x=x, y=y, heading=heading)
    return clear_of_bodies(seen, Track(STRAIGHT, 3.65))


def test_a_body_in_the_way_is_not_driven_into() -> None:
    """Places of the way are a metre apart; 2.21 m of it, own half width and 0.35 m before the body, must stay free."""
    # The bumper at 10.5 m blocks from the place after 9.22 m on, the eighth one after the first: a gap of 8 to 9 m.
    wanted = room(body(10.5))
    assert wanted in [pytest.approx(2.0 * (-1.5 + math.sqrt(2.25 + 6.0 * (gap - 2.0)) - 6.0)) for gap in (8.0, 9.0)]
    assert room(body(10.5, zone=Zone.APPROACH)) == math.inf, "a body that stands before the junction is another function's"
    assert room(body(10.5), speed=0.0) == math.inf, "3 m are looked at when it stands"
    assert room(body(-12.0)) == math.inf, "behind"
    # At 6 m/s it looks 12 m ahead: 3 m, half a second's way and 6 m of braking at 3 m/s^2.
    assert [room(body(rear)) < math.inf for rear in (11.5, 15.0)] == [True, False]
    assert room(body(5.5, turned=math.pi)) < 0.0, "nose to nose, 0.9 m ahead"
    # Beside: half of each width, and 0.35 m between them.
    for left, free in ((2.2, False), (-2.2, False), (2.22, True), (-2.22, True)):
        assert (room(body(8.0, left)) == math.inf) is free
    assert room(body(8.0, speed=3.0)) > room(body(8.0)), "it drives on"
    assert room(body(8.0, speed=3.0, turned=math.pi / 2)) == pytest.approx(room(body(8.0, turned=math.pi / 2))), "across"
    assert room(body(8.0, speed=-3.0)) == room(body(8.0)), "backing up is taken for standing"


@pytest.mark.parametrize(
    ("station", "speed", "wanted"),
    [
        (-20.35, 6.0, 0.5 + 20.0 * 0.5),  # 0.9 m/s^2 would do: too early
        (-0.35, 0.2, -math.inf),
        (-0.6, 0.2, -math.inf),  # in the entrance zone and hardly moving
    ],
)
def test_deceleration_before_the_start_of_a_stop(station: float, speed: float, wanted: float) -> None:
    zone = Zone.ENTRANCE if station > -1.0 else Zone.APPROACH
    assert Stopping().acceleration(sees((zone, station, speed))) == pytest.approx(wanted)


def test_a_stop_begins_at_a_comfortable_deceleration_and_goes_on_evenly() -> None:
    # At 6 m/s, 2.3 m/s^2 take 7.83 m, and the brake's lag another 0.72 m; the line to stop at is 0.35 m before the vertex.
    for before, begins in ((8.53, True), (8.57, False)):
        wanted = Stopping().acceleration(sees((Zone.APPROACH, -before - 0.35, 6.0)))
        assert (wanted < 0.0) is begins
    # Who still accelerates has the speed of 0.25 s later to get rid of: 6.5 m/s, 9.18 m and 0.78 m.
    for before, begins in ((9.94, True), (9.98, False)):
        wanted = Stopping().acceleration(sees((Zone.APPROACH, -before - 0.35, 6.0), acceleration=2.0))
        assert (wanted < 0.0) is begins
    stop = Stopping()
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 6.0))) == pytest.approx(-36.0 / 16.0)
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 4.0))) == pytest.approx(-1.0), "it has begun"
    stop.reset()
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 4.0))) > 0.0, "and is forgotten"
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 6.0))) < 0.0
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 3.05))) == pytest.approx(-(3.05**2) / 16.0), "0.58 m/s^2"
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 3.0))) == 0.0, "0.56 m/s^2, less than a quarter: hardly anything to do"
    assert stop.acceleration(sees((Zone.APPROACH, -8.35, 4.0))) > 0.0


@pytest.mark.parametrize(("aggression", "full"), [(1, 4.0), (2, 6.0), (3, 8.0)])
def test_late_stop_brakes_fully_and_impossible_stop_does_not_brake(aggression: int, full: float) -> None:
    resistance = 0.012 * 9.81 + 0.35 * 64.0 / 1500.0
    most = full + resistance
    for share, wanted in ((0.81, -full), (0.99, -full), (1.01, math.inf)):
        before = 64.0 / (2.0 * share * most)
        assert Stopping().acceleration(sees((Zone.APPROACH, -before, 8.0), aggression=aggression)) == pytest.approx(wanted)
    before = 64.0 / (2.0 * 0.79 * most)
    wanted = Stopping().acceleration(sees((Zone.APPROACH, -before, 8.0), aggression=aggression))
    assert wanted == pytest.approx(-min(64.0 / (2.0 * (before - 0.35)), full))


def test_lookahead_grows_with_speed() -> None:
    assert [lookahead(v) for v in (0.0, 2.0, 10.0)] == pytest.approx([2.5, 2.5, 5.0])


@pytest.mark.parametrize("heading", [0.0, 1.0, math.pi, -2.5])
def test_pure_pursuit_leads_the_rear_axle_along_a_circle(heading: float) -> None:
    """A circle of radius R through rear axle and aim, tangential to the vehicle, takes the angle atan(wheelbase / R)."""
    radius, wheelbase, back = 12.0, 2.7, 3.65
    cos, sin = math.cos(heading), math.sin(heading)
    me = vehicle(0, Turn.LEFT, Zone.JUNCTION, 0.0, 5.0, x=7.0 + back * cos, y=-3.0 + back * sin, heading=heading)
    for side in (1.0, -1.0):
        for angle in (0.1, 0.3, 1.0):
            along, left = radius * math.sin(angle), side * radius * (1.0 - math.cos(angle))
            x, y = 7.0 + along * cos - left * sin, -3.0 + along * sin + left * cos
            assert pursue(me, back, wheelbase, x, y) == pytest.approx(side * math.atan(wheelbase / radius))


def test_reference_brakes_for_leaders_and_crossing_vehicles() -> None:
    """At 8 m/s 40 m before the junction, and at 4 m/s in it: alone it keeps on."""
    x, y, heading = STRAIGHT.pose(-40.0)
    for aside, brakes in ((body(10.5), True), (body(10.5, left=3.5), False), (body(-20.0), False)):
        seen = sees((Zone.APPROACH, -40.0, 8.0), aside, x=x, y=y, heading=heading)
        assert (Reference().control(seen).brake > 0.0) is brakes
        assert Reference().control(seen._replace(others=())).brake == 0.0
    station, leader = ahead(3.0, 0.0)
    x, y, heading = STRAIGHT.pose(station)
    away: dict[str, Any] = {"x": x + 200.0, "y": y}
    for other, brakes in ((leader, True), (leader._replace(turn=Turn.RIGHT), False)):
        seen = sees((Zone.JUNCTION, station, 4.0), other._replace(**away), x=x, y=y, heading=heading)
        assert (Reference().control(seen).brake > 0.0) is brakes
    x, y, heading = STRAIGHT.pose(MINE.start - 6.0)
    for before, brakes in ((4.0, True), (8.0, False)):
        seen = sees((Zone.JUNCTION, MINE.start - 6.0, 4.0), crossing(before, 4.0, **away), x=x, y=y, heading=heading)
        assert (Reference().control(seen).brake > 0.0) is brakes
