"""Movements on which no car keeps its lane are told, and stay as they are."""

import math
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.geometry.road_map import read_map
from pytest_rvads.geometry.segment import LEAST_RADIUS, least_radius
from pytest_rvads.geometry.sweep import CAR
from pytest_rvads.runs.states import Vehicle, usual_body
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection
from pytest_rvads.support.errors import ScenarioError
from tools.crossings import Layout, opendrive

from .conftest import Read

RIGHT = {(0, 1), (1, 2), (2, 3), (3, 0)}


def test_usual_car_equals_the_default_vehicle() -> None:
    assert Vehicle().body == CAR == usual_body(CAR.length, CAR.width)
    assert Vehicle().turning_radius == pytest.approx(LEAST_RADIUS)


@pytest.mark.parametrize("radius", [2.5, 3.8, 4.0, 8.0])
def test_the_radius_of_an_arc_is_measured(radius: float) -> None:
    """A right turn of 120 degrees after 3 m of straight road: at least 5 m of arc."""
    angle = np.linspace(0.0, math.radians(120.0), 61)
    arc = np.column_stack([radius * np.sin(angle), radius * np.cos(angle) - radius])
    assert least_radius(np.vstack([[[-3.0, 0.0]], arc])) == pytest.approx(radius, rel=0.01)


def excess(radius: float, lane_width: float) -> float:
    """How far a car reaches over what keep_lane allows [m], on the best of some paths of straight road, arc, straight road.

    The centre line leads east to the origin, turns right through a quarter circle, and leads south. All paths of the rear axle
    are parallel to its straight parts.
    """
    quarter = np.linspace(0.0, math.pi / 2, 31)
    best = math.inf
    for turning, out, back in product((3.87, 4.4, 5.0), np.arange(-0.2, 1.0, 0.15), np.arange(-0.2, 1.0, 0.15)):
        x, y = radius + back - turning, out - turning
        east, south = np.arange(-12.0, x, 0.2), np.arange(y, -12.0, -0.2)
        axle = np.vstack([
            np.column_stack([east, out + 0 * east]),
            np.column_stack([x + turning * np.sin(quarter), y + turning * np.cos(quarter)]),
            np.column_stack([x + turning + 0 * south, south]),
        ])  # fmt: skip
        heading = -np.concatenate([0 * east, quarter, 0 * south + math.pi / 2])
        worst = 0.0
        for ahead, left in ((3.65, 0.0), (3.65, 0.93), (3.65, -0.93), (-0.95, 0.93), (-0.95, -0.93)):
            x_spot = axle[:, 0] + ahead * np.cos(heading) - left * np.sin(heading)
            y_spot = axle[:, 1] + ahead * np.sin(heading) + left * np.cos(heading)
            at_arc = (x_spot > 0.0) & (y_spot > -radius)
            lines = np.minimum(
                np.where(x_spot <= 0.0, abs(y_spot), np.inf), np.where(y_spot <= -radius, abs(x_spot - radius), np.inf)
            )
            apart = np.where(at_arc, abs(np.hypot(x_spot, y_spot + radius) - radius), lines)
            worst = max(worst, (apart * (at_arc if left == 0.0 else ~at_arc)).max())
        best = min(best, worst)
    return best - lane_width / 2 - 0.3


@pytest.mark.parametrize(
    ("radius", "lane_width", "tight"),
    [(1.25, 2.5, True), (1.25, 3.5, False), (2.0, 2.3, True), (2.0, 3.2, False), (3.25, 3.1, False)],
)
def test_a_bend_is_too_tight_where_the_best_arc_is_over(read: Read, radius: float, lane_width: float, tight: bool) -> None:
    """A better path than the best arc may be none, so that only clear cases are held: by 20 cm too tight, by 6 cm wide enough."""
    over = excess(radius, lane_width)
    assert over > 0.2 if tight else over < -0.06
    layout = Layout(stop=radius + lane_width / 2, lane_width=lane_width, lane_offset=lane_width / 2)
    assert set(read(opendrive(layout)).junction("1").tight) & RIGHT == (RIGHT if tight else set())


@pytest.mark.parametrize(("name", "count"), [pytest.param("durlacher-tor", 10, marks=pytest.mark.extended), ("sumo_skew4", 0)])
def test_a_junction_is_told_once_where_no_car_keeps_its_lane(shared: Path, name: str, count: int) -> None:
    """The car of the reference keeps its lane in the right turn of sumo_skew4, of 120 degrees and 1.7 m."""
    doubts = read_map(shared / "maps" / f"{name}.xodr").bends
    assert len(doubts) == len({doubt.junction for doubt in doubts}) == count


def test_covers_of_pairs_leave_out_movements_on_which_no_car_keeps_its_lane(read: Read) -> None:
    """Right turns have a radius of 1.25 m in lanes of 2.5 m; where nothing else leads from an entrance, nobody stands."""
    place = read(opendrive(Layout(stop=2.5, lane_width=2.5, lane_offset=1.25))).junction("1")
    assert place.tight.keys() == RIGHT
    points = grid("C", 4, place.control)
    for cover, chosen in (("conflicts", {2, 3}), ("pairs", {2, 3}), ("class", {1, 2, 3})):
        selection = Selection(place, points, cover)
        assert {direction for scenario in selection for direction in scenario.directions} == chosen
        assert len(selection.too_tight) == (0 if cover == "class" else 4)
    right = replace(place, movements={key: m for key, m in place.movements.items() if key[0] or m.turn == "right"})
    assert all(scenario.directions[0] == 0 for scenario in Selection(right, points, "conflicts"))
    with pytest.raises(ScenarioError, match="no movement on which a car can keep its lane leads from entrance 0"):
        list(Selection(right, points, "conflicts", subject=0))
