"""The helper that follows an itinerary: on its way, at its speed, to a stop where it should."""

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from pytest_rvads.drivers.follower import BEND, Follower, Track
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import Vehicle, VehicleState, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate


class Steady(Follower):
    def target_speed(self, seen: Observation) -> float:
        return 8.0


def rear_axle_errors(run: Run, case: Scenario) -> np.ndarray:
    """Distance of the rear axle from the itinerary in every state [m]."""
    (itinerary,) = case.itineraries()
    errors = []
    for (x, y, yaw), station in zip(run.pose[:, 0], run.station[:, 0], strict=True):
        back = 3.65
        _, offset = itinerary.project(x - back * np.cos(yaw), y - back * np.sin(yaw), float(station) - back)
        errors.append(abs(offset))
    return np.array(errors)


@pytest.mark.parametrize(
    ("junction", "direction"),
    [(name, d) for name in ("stop4", "stop3", "paper_stop4") for d in (1, 2, 3) if "3" not in name or d < 3],
)
def test_the_rear_axle_stays_on_the_itinerary(junction: str, direction: int) -> None:
    ways = 3 if junction == "stop3" else 4
    case = Scenario(find(junction), [direction] + [0] * (ways - 1), distance=40, speed=8)
    run = simulate(Case(case, Steady))
    assert run.provenance["end"] == "left"
    # Pure pursuit cuts and overshoots by 0.13 to 0.19 m on turns of radius 6 to 19 m.
    assert rear_axle_errors(run, case).max() < 0.35


def test_it_holds_its_speed_on_the_straight_and_slows_down_in_bends() -> None:
    straight = simulate(Case(Scenario(find("stop4"), "2000", distance=60, speed=2), Steady))
    turning = simulate(Case(Scenario(find("stop4"), "1000", distance=60, speed=2), Steady))
    assert straight.speed[-300:, 0] == pytest.approx(8.0, abs=0.05)
    middle = int(np.argmin(np.abs(turning.station[:, 0] - 10.0)))
    v = turning.speed[middle, 0]
    # A right turn of an X with stop lines at 15 m and lanes at 1.75 m has a radius of 13.25 m.
    assert v**2 / 13.25 == pytest.approx(BEND, rel=0.1)


@pytest.mark.parametrize("distance", [10.0, 25.0, 60.0])
def test_a_target_of_zero_stops_where_the_helper_says(distance: float) -> None:
    class Stopper(Follower):
        def target_speed(self, seen: Observation) -> float:
            return min(8.0, self.stopping_speed(seen.itinerary.line - 0.5 - seen.me.station))

    run = simulate(Case(Scenario(find("stop4"), "2000", distance=distance, speed=5, duration=25), Stopper))
    assert abs(run.speed[-1, 0]) < 1e-6
    assert -1.0 < run.station[-1, 0] <= 0.0
    assert (run.station[-500:] == run.station[-1]).all()


def test_a_new_target_is_reached_with_the_vehicles_means() -> None:
    class Sudden(Follower):
        def target_speed(self, seen: Observation) -> float:
            return 0.0 if seen.time >= 3.0 else 12.0

    run = simulate(Case(Scenario(find("stop4"), "2000", distance=110, speed=5, duration=8), Sudden))
    change = np.diff(run.speed[:, 0]) / DT
    assert change.max() <= 3.0
    assert -change.min() <= 4.0 + 0.2
    assert run.speed[-1, 0] == pytest.approx(0.0, abs=1e-6)
    assert ((run.controls[..., :2] >= 0) & (run.controls[..., :2] <= 1)).all()
    assert (run.controls[..., 0] * run.controls[..., 1] == 0).all(), "never throttle and brake together"


def test_the_docstring_example_stops_and_a_constructor_need_not_call_the_helpers() -> None:
    class Ten(Follower):
        def __init__(self) -> None:
            self.own = 1

        def target_speed(self, seen: Observation) -> float:
            line = seen.itinerary.line - seen.me.station
            return self.stopping_speed(line - 0.5) if line > 0 else 5.0

    run = simulate(Case(Scenario(find("stop4"), "2000", distance=20, speed=5, duration=20), Ten))
    assert abs(run.speed[-1, 0]) < 1e-6
    assert run.zone[-1, 0] == 1


def test_a_track_knows_bends_before_they_come() -> None:
    (straight,) = Scenario(find("stop4"), "2000").itineraries()
    (right,) = Scenario(find("stop4"), "1000").itineraries()
    assert Track(straight, 3.65).speed(5.0) > 100
    track = Track(right, 3.65)
    limit = (BEND * 13.25) ** 0.5
    assert track.speed(10.0) == pytest.approx(limit, rel=0.03)
    assert track.speed(right.length + 2.0) == pytest.approx(limit, rel=0.03), "the rear axle is still in the bend"
    speeds = np.array([track.speed(s) for s in range(-60, 10)])
    assert (np.diff(speeds**2) / 2 >= -2.0 - 1e-9).all(), "within easy braking"
    assert track.speed(-40.0) > track.speed(-10.0) > limit
    places = track.places(3.2, 6.0)
    assert len(places) == 6
    assert places[0] == pytest.approx(right.pose(4.0)[:2])


def standing(speed: float, vehicle: Vehicle | None = None, aggression: int = 1) -> Observation:
    """What a driver sees 40 m before the junction, on its way straight on and alone."""
    case = Scenario(find("stop4"), "2000")
    (itinerary,) = case.itineraries()
    x, y, heading = itinerary.pose(-40.0)
    me = VehicleState("a0", 0, Turn.STRAIGHT, Zone.APPROACH, -40.0, x, y, heading, speed, 0.0, 4.6, 1.86)
    return Observation(0.0, me, (), (), itinerary, case.place, vehicle or Vehicle(), 11.176, aggression)


@pytest.mark.parametrize(
    ("speed", "target", "wanted"),
    [
        (0.29, 0.0, -math.inf),
        (0.31, 0.0, -1.24),
        (0.29, 0.1, -0.76),
        (3.0, 8.0, 20.0),
        (8.0, 3.0, -20.0),
    ],
)
def test_acceleration_is_four_times_the_speed_error_and_slow_vehicles_are_held(
    speed: float, target: float, wanted: float
) -> None:
    assert Steady().towards(standing(speed), target) == pytest.approx(wanted)


def test_it_brakes_for_a_bend_with_3_at_most() -> None:
    (right,) = Scenario(find("stop4"), "1000").itineraries()
    limit = (BEND * 13.25) ** 0.5
    for speed, wanted in ((12.0, -3.0), (6.0, 4.0 * (limit - 6.0)), (5.0, 4.0 * (limit - 5.0))):
        seen = standing(speed)._replace(itinerary=right)
        asked = Steady().towards(seen._replace(me=seen.me._replace(station=10.0)), 13.0)
        assert asked == pytest.approx(wanted, abs=0.4), "5.8 m/s, known to 0.1 m/s"


@pytest.mark.parametrize("target", [-0.1, math.inf, math.nan])
def test_target_speed_must_be_finite_and_not_negative(target: float) -> None:
    class Lost(Follower):
        def target_speed(self, seen: Observation) -> float:
            return target

    with pytest.raises(ValueError, match=r"target_speed returned .*, expected a finite speed of 0 m/s or more"):
        Lost().control(standing(5.0))


def test_pedals_yield_the_acceleration_asked_for_and_the_resistances() -> None:
    # At 10 m/s: 0.012 of the weight, and 35 N of drag on 1.5 t.
    resistance = 0.012 * 9.81 + 35.0 / 1500.0
    for wanted, throttle, brake in (
        (1.5, (1.5 + resistance) / 3.0, 0.0),
        (-resistance, 0.0, 0.0),
        (9.0, 1.0, 0.0),
        (-2.0, 0.0, (2.0 - resistance) / 6.0),
        (-9.0, 0.0, 1.0),
    ):
        given = Steady().drive(standing(10.0, aggression=2), wanted)
        assert (given.throttle, given.brake) == pytest.approx((throttle, brake))
        assert given.steering == pytest.approx(0.0, abs=1e-6), "on its way"


@pytest.mark.parametrize(("brake", "share"), [((4.0, 6.0, 8.0), 0.625), ((2.4, 6.0, 8.0), 1.0), ((2.0, 6.0, 8.0), 1.0)])
def test_who_is_held_brakes_with_2_5(brake: tuple[float, float, float], share: float) -> None:
    for speed in (0.0, 0.29):
        assert Steady().drive(standing(speed, Vehicle(brake=brake)), -math.inf).brake == pytest.approx(share)
    assert Steady().drive(standing(0.31, Vehicle(brake=brake)), -math.inf).brake == 1.0, "still moving: all there is"


def test_standing_vehicle_keeps_its_steering() -> None:
    aside = standing(0.2)
    aside = aside._replace(me=aside.me._replace(y=aside.me.y + 0.5, x=aside.me.x + 0.5))
    pilot = Steady()
    assert pilot.drive(aside._replace(me=aside.me._replace(speed=0.01)), -math.inf).steering == 0.0
    turned = pilot.drive(aside, -math.inf).steering
    assert abs(turned) > 0.01
    back = standing(0.0)
    assert pilot.drive(back, -math.inf).steering == turned
    assert pilot.drive(back._replace(me=back.me._replace(speed=0.2)), -math.inf).steering == pytest.approx(0.0, abs=1e-6)


class Way:
    """40 m: a bend of radius 10 m to the left on a part of it, straight on before and after."""

    origin = 0.0
    end = 40.0
    limits = ()

    def __init__(self, begin: float, end: float) -> None:
        self.begin, self.over = begin, end

    def pose(self, station: float) -> Pose:
        turned = (min(max(station, self.begin), self.over) - self.begin) / 10.0
        past = max(station - self.over, 0.0)
        x = min(station, self.begin) + 10.0 * math.sin(turned) + past * math.cos(turned)
        return Pose(x, 10.0 * (1.0 - math.cos(turned)) + past * math.sin(turned), turned)


def test_a_bend_is_where_chords_four_metres_apart_differ() -> None:
    track = Track(cast(Any, Way(20.0, 60.0)), 0.0)
    # 23 m on the chords are those from 20 to 22 m and from 24 to 26 m: 0.4 rad, as anywhere in the bend. A metre before the
    # first one is from 19 to 21 m, of which half is straight: 0.375 rad.
    assert track.speed(30.5) == pytest.approx(5.0, rel=1e-3)
    assert track.speed(23.5) == pytest.approx(5.0, rel=1e-3)
    assert track.speed(22.5) == pytest.approx((BEND * 4.0 / 0.375) ** 0.5, rel=1e-3)
    assert track.speed(21.5) ** 2 - track.speed(22.5) ** 2 == pytest.approx(4.0), "a metre at 2 m/s^2"


def test_a_bend_at_the_start_is_none_at_the_end() -> None:
    track = Track(cast(Any, Way(-20.0, 10.0)), 0.0)
    assert track.speed(0.5) == pytest.approx(5.0, rel=1e-3)
    assert track.speed(40.5) == math.inf


def test_places_of_a_way_reach_to_its_end() -> None:
    track = Track(cast(Any, Way(100.0, 100.0)), 0.0)
    assert track.places(37.5, 10.0) == [(38.0, 0.0), (39.0, 0.0), (40.0, 0.0)]
    assert track.places(37.0, 2.0) == [(38.0, 0.0), (39.0, 0.0)]
    assert track.places(-5.0, 2.5) == [(0.0, 0.0), (1.0, 0.0)]


@pytest.mark.parametrize(("file", "id", "code"), [("Town07", "907", "112"), ("sumo_skew4", "1", "1000")])
def test_narrow_bends_are_driven_by_the_rear_axle(shared: Path, file: str, id: str, code: str) -> None:
    """With the front followed instead, one ran into who waited beside its lane, the other one left its route."""
    junction = find(id, shared / "maps" / f"{file}.xodr")
    distances = [min(20.0, junction.approach(entrance) - 0.1) for entrance in range(len(junction.entrances))]
    run = simulate(Case(Scenario(junction, code, distance=distances), Reference))
    assert (run.provenance["end"], run.collisions) == ("left", ())
