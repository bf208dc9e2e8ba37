"""The semantic model: zones, waiting times, signal plans, vehicles, runs."""

import math
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Run
from pytest_rvads.runs.states import STEADY, Agent, Colour, SignalPlan, Vehicle, Zone
from pytest_rvads.support.errors import MapError, ScenarioError


@pytest.fixture(scope="module")
def itinerary() -> Itinerary:
    return Itinerary.through(find("stop4"), 0, 3)


def run_of(zones: list[list[int]]) -> Run:
    junction = find("stop4")
    agents = tuple(Agent(f"a{k}", junction.movements[k, k + 1]) for k in range(len(zones[0])))
    return Run("made by hand", junction, agents, np.array(zones, dtype=np.int8), np.zeros((len(zones), 4), dtype=np.int8))


@given(st.floats(-119, 90))
@settings(derandomize=True, deadline=None)
def test_every_station_has_one_zone_and_zones_follow_each_other(itinerary: Itinerary, station: float) -> None:
    here, ahead = itinerary.zone(station), itinerary.zone(station + 1e-6)
    assert ahead - here in (0, 1), "no zone is skipped, none comes back"


def test_borders_are_half_open(itinerary: Itinerary) -> None:
    # The entrance vertex belongs to the road, the exit vertex to the next road; the zone begins 1 m before the line.
    assert itinerary.zone(-1.0 - 1e-9) is Zone.APPROACH
    assert itinerary.zone(-1.0) is Zone.ENTRANCE
    assert itinerary.zone(0.0) is Zone.ENTRANCE
    assert itinerary.zone(1e-9) is Zone.JUNCTION
    assert itinerary.zone(itinerary.length - 1e-9) is Zone.JUNCTION
    assert itinerary.zone(itinerary.length) is Zone.EXIT
    assert itinerary.zone(itinerary.end) is Zone.GONE


def test_a_line_before_the_vertex_widens_the_entrance_zone(itinerary: Itinerary) -> None:
    back = replace(itinerary, line=-4.0)
    assert back.zone(-5.0) is Zone.ENTRANCE
    assert back.zone(-5.1) is Zone.APPROACH
    assert back.start(10.0) == -14.0


def test_poses_and_projection_are_inverse(itinerary: Itinerary) -> None:
    for station in np.linspace(-50, 80, 27):
        x, y, heading = itinerary.pose(float(station))
        left = (x - 0.3 * math.sin(heading), y + 0.3 * math.cos(heading))
        found, offset = itinerary.project(*left, near=float(station) + 1.0)
        assert found == pytest.approx(station, abs=0.02)
        assert offset == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("beyond", [0.5, 3.0, 400.0])
def test_beyond_both_ends_a_line_goes_on_straight(itinerary: Itinerary, beyond: float) -> None:
    path = itinerary.path
    for station, end, sign in ((-beyond, path.points[0], -1.0), (path.length + beyond, path.points[-1], 1.0)):
        x, y, heading = path.pose(station)
        assert (x, y) == pytest.approx((end[0] + sign * beyond * math.cos(heading), end[1] + sign * beyond * math.sin(heading)))
        assert path.project(x, y, station) == pytest.approx((station, 0.0), abs=1e-6)


def test_a_recorded_junction_has_nowhere_to_drive() -> None:
    junction = find("stop4")
    recorded = replace(junction, movements={key: replace(m, path=None) for key, m in junction.movements.items()})
    with pytest.raises(MapError, match="recording without positions"):
        Itinerary.through(recorded, 0, 1)


def test_two_groups_show_the_recorded_plan() -> None:
    # One shows green 15, yellow 3, red 22 s; the other red 20, green 15, yellow 3, red 2 s, as recorded.
    plan = SignalPlan((frozenset({0, 2}), frozenset({1, 3})))

    def spans(entrance: int) -> list[tuple[str, float]]:
        colours = [plan.colours(t / 100, 4)[entrance] for t in range(4000)]
        cuts = [0, *(t for t in range(1, 4000) if colours[t] != colours[t - 1]), 4000]
        return [(colours[a].name, (b - a) / 100) for a, b in pairwise(cuts)]

    assert spans(0) == spans(2) == [("GREEN", 15.0), ("YELLOW", 3.0), ("RED", 22.0)]
    assert spans(1) == spans(3) == [("RED", 20.0), ("GREEN", 15.0), ("YELLOW", 3.0), ("RED", 2.0)]
    swapped = SignalPlan(plan.groups, 1)
    assert all(swapped.colours(t, 4)[0] == plan.colours(t, 4)[1] for t in np.arange(0, 80, 0.25))


@given(st.integers(1, 4), st.floats(0, 500))
@settings(derandomize=True, deadline=None)
def test_never_two_groups_move(count: int, time: float) -> None:
    plan = SignalPlan(tuple(frozenset({g}) for g in range(count)))
    assert sum(c is not Colour.RED for c in plan.colours(time, count)) <= 1
    assert plan.colours(time, count + 1)[count] is Colour.NONE, "an entrance in no group has no light"
    assert plan.colours(round(time, 2), count) == plan.colours(round(time, 2) + 20.0 * count, count)


@pytest.mark.parametrize(("length", "walk"), [(7.0, 8.0), (7.5, 7.0), (12.0, 4.0), (40.0, 4.0)])
def test_pedestrian_light_leaves_time_to_finish(length: float, walk: float) -> None:
    """WALK ends as long before the end of green as the crossing takes at 1.07 m/s: 6.5 s for 7 m. It lasts at least 4 s."""
    plan = SignalPlan((frozenset({0, 2}), frozenset({1, 3})), walks=((4, 1, length), (5, 0, length)))
    for time in np.arange(0.0, 80.0, 0.25).tolist():
        lights, within = plan.colours(time, 6), (time - 20.0) % 40.0
        green = Colour.GREEN if within < walk else Colour.YELLOW if within < 15.0 else Colour.RED
        assert lights[4] is green
        assert plan.colours(time, 6)[5] is plan.colours(time + 20.0, 6)[4]
        assert plan.colours(time, 4) == lights[:4] == SignalPlan(plan.groups).colours(time, 4)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_between_looks_at_the_lights_no_colour_changes(count: int) -> None:
    plan, every = SignalPlan(tuple(frozenset({g}) for g in range(count)), count - 1), round(STEADY / DT)
    for step in range(round(20.0 * count / DT) + every):
        assert plan.colours(step * DT, count) == plan.colours(step // every * every * DT, count)


@given(st.lists(st.lists(st.integers(0, 4), min_size=2, max_size=2), min_size=1, max_size=60))
@settings(derandomize=True, deadline=None)
def test_waiting_counts_ticks_at_the_entrance(zones: list[list[int]]) -> None:
    waits = wt(run_of(zones))
    for column in range(2):
        expected = 0
        for tick, row in enumerate(zones):
            expected = expected + 1 if tick and row[column] == Zone.ENTRANCE else 0
            assert waits[tick, column] == expected


def test_the_hash_tells_runs_apart() -> None:
    one, same, other = run_of([[0, 1], [1, 2]]), run_of([[0, 1], [1, 2]]), run_of([[0, 1], [1, 1]])
    assert one.hash == same.hash != other.hash
    assert replace(one, station=np.zeros((2, 2))).hash != one.hash
    assert one.entry(0) is None
    assert one.entry(1) == 0.01


@pytest.mark.parametrize("name", [f.name for f in fields(Vehicle) if f.name not in ("brake", "kind")])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "3"])
def test_vehicle_parameters_are_checked(name: str, value: object) -> None:
    with pytest.raises(ScenarioError, match=rf"vehicle parameter {name} must be a positive number"):
        Vehicle(**{name: value})  # type: ignore[arg-type]


def test_vehicles_that_do_not_fit_together() -> None:
    with pytest.raises(ScenarioError, match="does not fit into a body"):
        Vehicle(length=2.0)
    with pytest.raises(ScenarioError, match="does not fit into a body"):
        Vehicle(length=Vehicle().wheelbase)
    with pytest.raises(ScenarioError, match="aggression 1, 2 and 3"):
        Vehicle(brake=(4.0, 6.0))  # type: ignore[arg-type]


def test_axles_lie_within_the_body() -> None:
    car = Vehicle()
    assert car.wheelbase == pytest.approx(2.7)
    # Overhangs are equal, so the rear axle lies half a wheelbase behind the middle of the body.
    assert car.rear_axle_offset == pytest.approx(car.length / 2 + car.wheelbase / 2)
    assert car.gravity_offset == pytest.approx(car.rear_axle_offset - car.rear_axle)
