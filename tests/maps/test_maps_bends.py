"""Movements that bend more tightly than a car steers are told, and stay as they are."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.errors import ScenarioError
from pytest_rvads.junctions.bends import LEAST_RADIUS, tight_bends
from pytest_rvads.junctions.graph import MetricGraph
from pytest_rvads.junctions.road_map import RoadMap, read_map
from pytest_rvads.opendrive.writer import Layout, opendrive
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection

from .conftest import Read


def bends(road_map: RoadMap) -> list[str]:
    return [warning.message for warning in road_map.warnings if warning.kind == "bend"]


def test_the_least_radius_is_that_of_the_car_that_drives() -> None:
    assert Vehicle().turning_radius == pytest.approx(LEAST_RADIUS)


@pytest.mark.parametrize("radius", [2.5, 3.8, 4.0, 8.0])
def test_the_radius_of_an_arc_is_measured(read: Read, radius: float) -> None:
    """A right turn of 120 degrees after 3 m of straight road, in the place of that of the first arm: at least 5 m of arc."""
    road_map = read(opendrive(Layout()))
    way = next(way for way in road_map.report("1").movements if way.turn == "right")
    angle = np.linspace(0.0, math.radians(120.0), 61)
    arc = np.column_stack([radius * np.sin(angle), radius * np.cos(angle) - radius])
    (edge,) = way.path.edges
    object.__setattr__(road_map.graph.edges[edge], "points", np.vstack([[[-3.0, 0.0]], arc]))
    found = tight_bends(road_map.graph, [way])
    assert [(round(r, 1), w) for r, w in found] == ([(radius, way)] if radius < LEAST_RADIUS else [])


def test_a_jag_is_no_bend(read: Read) -> None:
    """It turns by a right angle and back within 0.2 m."""
    road_map: RoadMap = read(opendrive(Layout()))
    graph: MetricGraph = road_map.graph
    way = next(way for way in road_map.report("1").movements if way.turn == "straight")
    (edge,) = way.path.edges
    object.__setattr__(graph.edges[edge], "points", np.array([[0, 0], [5, 0], [5, 0.2], [10, 0.2], [20, 0.2]], dtype=float))
    assert not tight_bends(graph, [way])


@pytest.mark.parametrize("name", ["sumo_skew4", "sumo_stop4"])
def test_a_skewed_junction_of_sumo_is_told(shared: Path, name: str) -> None:
    assert len(bends(read_map(shared / "maps" / f"{name}.xodr"))) == (name == "sumo_skew4")


def test_covers_of_pairs_leave_out_movements_that_no_car_can_follow(read: Read) -> None:
    """Right turns 5 m before the centre have a radius of 3.25 m; where nothing else leads from an entrance, nobody stands."""
    place = read(opendrive(Layout(stop=5.0))).junction("1")
    assert place.tight == {key: pytest.approx(3.25, abs=0.01) for key, m in place.movements.items() if m.turn == "right"}
    points = grid("C", 4, place.control)
    for cover, chosen in (("conflicts", {2, 3}), ("pairs", {2, 3}), ("class", {1, 2, 3})):
        selection = Selection(place, points, cover)
        assert {direction for scenario in selection for direction in scenario.directions} == chosen
        assert len(selection.too_tight) == (0 if cover == "class" else 4)
    right = replace(place, movements={key: m for key, m in place.movements.items() if key[0] or m.turn == "right"})
    assert all(scenario.directions[0] == 0 for scenario in Selection(right, points, "conflicts"))
    with pytest.raises(ScenarioError, match="no movement that a car can follow leads from entrance 0"):
        list(Selection(right, points, "conflicts", subject=0))
