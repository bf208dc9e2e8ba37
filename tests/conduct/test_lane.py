"""Keeping to the lane and to the route: offsets by hand, both hands, both sides."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.drivers.follower import Follower
from pytest_rvads.drivers.interface import Control, Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.lane import beside, off_lane, off_route
from pytest_rvads.physics.body import Body, Motion
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run, save_run
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import RunError
from tools.crossings import Layout, opendrive

Make = Callable[..., Run]
# Lanes of the built-in maps are 3.5 m wide, a body 1.86 m: 0.3 m over the border is 1.75 + 0.3 - 0.93 m beside the centre.
ALLOWED = 1.12


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("direction", [1, 2, 3])
def test_a_body_may_reach_over_the_border_by_the_tolerance(drive: Make, direction: int, side: int) -> None:
    def kept(offset: float) -> bool:
        run = drive("stop4", {0: (direction, -30.0, [(0, 8.0)], side * offset)}, 300)
        assert (run.zone[:, 0] <= Zone.ENTRANCE).all()
        return not off_lane(run, 0).any()

    assert kept(ALLOWED - 0.02)
    assert not kept(ALLOWED + 0.02)


def test_in_the_junction_the_front_counts(drive: Make) -> None:
    def states(offset: float) -> np.ndarray:
        run = drive("stop4", {0: (2, 6.0, [(0, 8.0)], offset)}, 200)
        assert (run.zone[:, 0] == Zone.JUNCTION).all()
        return off_lane(run, 0)

    assert not states(1.75 + 0.3 - 0.02).any()
    assert states(1.75 + 0.3 + 0.02).all()


def test_a_vehicle_across_its_lane_is_out_of_it_though_its_front_is_on_the_centre_line(drive: Make) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 0.0)])}, 5)
    pose = run.need("pose").copy()
    pose[:, 0, 2] += np.pi / 2
    assert off_lane(replace(run, pose=pose), 0).all()
    pose[:, 0, 2] += np.pi / 2 - 0.05  # nearly the wrong way round, in the middle of the lane
    assert not off_lane(replace(run, pose=pose), 0).any(), "the direction is no matter of lanes"


def test_body_within_a_lane_that_steps_aside_is_in_its_lane(shared: Path) -> None:
    """The iteration for the nearest point of the centre line ends on a piece that is not the nearest piece."""
    junction = find("j_14892149", shared / "maps" / "durlacher-tor.xodr")
    code = [0] * len(junction.entrances)
    code[8] = next(d for (entrance, d), movement in junction.by_direction.items() if entrance == 8 and movement.exit == 3)
    run = simulate(Case(Scenario(junction, tuple(code), distance=20.0, duration=60), Reference))
    assert run.provenance["end"] == "left"
    assert not off_lane(run, 0).any()


def test_vehicle_out_of_the_run_leaves_no_lane(drive: Make) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 0.0)], 2.0)}, 5)
    gone = replace(run, zone=np.full_like(run.zone, Zone.GONE))
    assert off_lane(run, 0).all()
    assert not off_lane(gone, 0).any()


class Beside(Follower):
    """Drives beside the centre line."""

    offset = 0.0

    def target_speed(self, seen: Observation) -> float:
        return 6.0

    def steer(self, seen: Observation) -> float:
        _, _, heading = seen.itinerary.pose(seen.me.station)
        offset = self.offset * min(seen.time / 6.0, 1.0)  # little by little, so that it doesn't swing over
        left = -np.sin(heading) * offset, np.cos(heading) * offset
        steering = super().steer(seen._replace(me=seen.me._replace(x=seen.me.x - left[0], y=seen.me.y - left[1])))
        return float(steering)


@pytest.mark.parametrize("offset", [2.1, -2.1])
def test_in_the_wrong_lane_all_the_way(offset: float) -> None:
    pilot = type("Wrong", (Beside,), {"offset": offset})
    run = simulate(Case(Scenario(find("light4"), "2000", distance=40, duration=25), pilot))
    assert run.provenance["end"] == "left"
    verdict = check(run, "keep_lane")
    assert (verdict.status, verdict.responsible) == ("FAIL", ("a0",))
    assert check(run, "on_route").status == "PASS"


@pytest.mark.parametrize("code", ["1111", "2222", "3333"])
def test_a_good_driver_keeps_its_lane(code: str) -> None:
    run = simulate(Case(Scenario(find("stop4"), code, distance=30, speed=8), Reference))
    for rule in ("keep_lane", "on_route"):
        assert check(run, rule).status == "PASS"


@pytest.fixture(scope="module")
def tight(tmp_path_factory: pytest.TempPathFactory) -> Junction:
    """Right turns from a stopping line 2.5 m before the centre to another one: their radius is 2.5 m less half a lane, 1.25 m."""
    path = tmp_path_factory.mktemp("map") / "tight.xodr"
    path.write_text(opendrive(Layout(stop=2.5, lane_width=2.5, lane_offset=1.25)), encoding="utf-8")
    return find("1", path)


@pytest.fixture
def wider(tmp_path: Path) -> Junction:
    """Right turns with a radius of 3.25 m in lanes of 3.5 m."""
    path = tmp_path / "wider.xodr"
    path.write_text(opendrive(Layout(stop=5.0)), encoding="utf-8")
    return find("1", path)


def test_a_bend_without_a_path_that_keeps_the_lane_makes_keep_lane_unavoidable(tight: Junction, drive: Make) -> None:
    """A car of 2.7 m wheelbase and 0.61 rad needs 2.7 / tan(0.61) = 3.9 m.

    Radii are measured over 4 m, in which the movement turns by a right angle: 4 m / (pi / 2) = 2.5 m.
    """
    run = drive(tight, {0: (1, 1.0, [(0, 1.0)], 2.1)}, 100)
    verdict = check(run, "keep_lane")
    assert (verdict.status, verdict.unavoidable) == ("FAIL", True)
    assert "the bend is too tight for the vehicle" in verdict.message
    assert "through a bend with a radius of 2.5 m, as a0 can't steer below 3.9 m" in verdict.explanation


def test_leaving_the_lane_is_unavoidable_only_without_a_path_inside_the_lane(wider: Junction, drive: Make) -> None:
    """A radius of 3.25 m is less than the 3.9 m of a car, but lanes of 3.5 m have room for a wider arc; not for one of 12 m."""
    run = drive(wider, {0: (1, 3.0, [(0, 1.0)], 2.1)}, 100)
    verdict = check(run, "keep_lane")
    assert (verdict.status, verdict.unavoidable) == ("FAIL", False)
    assert check(replace(run, facts=replace(run.facts, turning=(("a0", 12.0),))), "keep_lane").unavoidable


def test_on_the_roads_around_a_tight_bend_the_lane_is_kept(tight: Junction, drive: Make) -> None:
    for station in (-20.0, 12.0):  # before it, and with the rear 5 m behind it
        run = drive(tight, {0: (1, station, [(0, 1.0)], 2.0)}, 100)
        assert off_lane(run, 0).all()
        assert not check(run, "keep_lane").unavoidable


def test_reference_keeps_its_lane_where_a_wider_arc_fits_into_a_tight_bend(wider: Junction) -> None:
    run = simulate(Case(Scenario(wider, "1000", distance=20, subject=0), Reference, traffic=Reference))
    assert check(run, "keep_lane").status == "PASS"


def test_a_run_tells_who_steers_otherwise_than_a_usual_car_of_its_length(tight: Junction, tmp_path: Path) -> None:
    fleet = Fleet(Vehicle(), {"a1": Vehicle(steering_limit=0.4), "a2": Vehicle(length=9.2, front_axle=2.4, rear_axle=3.0)})
    run = simulate(Case(Scenario(tight, "2222", distance=5, duration=0.1), Reference, fleet=fleet))
    assert run.facts.turning == (("a1", pytest.approx(2.7 / np.tan(0.4))),), "twice as long, a usual car has twice the wheelbase"
    save_run(run, tmp_path / "run.npz")
    assert load_run(tmp_path / "run.npz") == run
    assert replace(run, facts=replace(run.facts, turning=())) != run


@pytest.mark.parametrize("side", [1, -1])
def test_leaving_the_route_is_the_driver_s_violation(side: int) -> None:
    class Lost(Follower):
        def control(self, seen: Observation) -> Control:
            return Control(0.5, 0.0, side * 0.2) if seen.time > 2.0 else super().control(seen)

    scenario = Scenario(find("light4"), "2020", distance=60, speed=8, subject=0)
    run = simulate(Case(scenario, Lost, traffic=Reference))
    assert (run.fault, run.provenance["end"]) == (None, "route")
    verdict = check(run, "on_route")
    assert (verdict.status, verdict.responsible, verdict.time) == ("FAIL", ("a0",), pytest.approx(run.duration))
    rest = check(run, "speed_limit")
    assert (rest.status, rest.provoked) == ("OPEN", False)
    assert "a0 left the route, which ended the run" in rest.message
    other = replace(run, facts=replace(run.facts, subject="a2"))
    assert (check(other, "on_route").status, check(other, "on_route").provoked) == ("FAIL", True)
    assert check(other, "speed_limit").status == "PASS", "what others do is not held against it"


def test_a_front_that_swings_out_is_on_the_route_while_the_rear_axle_is() -> None:
    path = Segment("straight", np.array([[0.0, 0.0], [100.0, 0.0]]))
    way = Itinerary(0, 2, Turn.STRAIGHT, path, 50.0, 20.0, 0.0)
    assert not beside(way, 30.0, 2.9, 0.0, -20.0, 4.6), "less than 3 m"
    assert beside(way, 30.0, 3.1, 0.0, -20.0, 4.6)
    assert beside(way, 30.0, -3.1, 0.0, -20.0, 4.6)
    # 3.68 m behind the front, the axle is 1.5 m to the side when the body is turned by 0.46 rad.
    assert not beside(way, 30.0, 3.1, 0.48, -20.0, 4.6)
    assert beside(way, 30.0, 3.1, 0.40, -20.0, 4.6)


@pytest.mark.parametrize(("turned", "strayed"), [(0.48, False), (0.40, True)])
def test_a_run_and_its_simulation_ask_for_the_rear_axle_as_well(drive: Make, turned: float, strayed: bool) -> None:
    """The front is 3.1 m beside its way; the axle is 3.68 m times the sine of the turn nearer to it: 1.4 or 1.67 m beside."""
    run = drive("stop4", {0: (2, -30.0, [(0, 0.0)], 3.1)}, 2)
    pose = run.need("pose").copy()
    pose[:, 0, 2] += turned
    assert off_route(replace(run, pose=pose), 0).all() == strayed
    x, y, heading = pose[0, 0]
    car, way = Vehicle(), Itinerary.through(run.junction, 0, 2)
    body = Body(run.agents[0], way, -30.0, car, 1)
    ahead = car.gravity_offset
    body.sample(Motion(x - ahead * np.cos(heading), y - ahead * np.sin(heading), heading, 1.0, 0.0, 0.0))
    assert body.strayed == strayed


def test_lane_predicates_require_a_geometry(drive: Make, topology: Callable[[Junction], Junction]) -> None:
    run = drive("stop4", {0: (2, -30.0, [(0, 8.0)])}, 5)
    bare = replace(run, junction=topology(run.junction))
    for predicate in (off_lane, off_route):
        with pytest.raises(RunError, match="no geometry"):
            predicate(bare, 0)
