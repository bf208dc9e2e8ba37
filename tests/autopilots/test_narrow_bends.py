"""Bends in which a car that follows the centre line leaves its lane: there the reference plans with the body that it sweeps."""

from dataclasses import replace
from pathlib import Path

import pytest

from pytest_rvads.conduct.lane import off_lane, off_route
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.swept import axle_path
from pytest_rvads.drivers.way_ahead import track
from pytest_rvads.junctions.builtin import CROSSINGS
from pytest_rvads.junctions.finder import find, names
from pytest_rvads.opendrive.writer import opendrive
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate


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


def test_a_pace_of_the_rear_axle_holds_where_the_front_is_beyond_the_end_of_its_itinerary() -> None:
    way = itinerary(find("stop4"), 0, 1)
    assert track(way, 3.65, ((way.end, 1.0),)).speed(way.end + 9.0) == 1.0
