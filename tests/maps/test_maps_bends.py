"""Movements that bend more tightly than a car steers are told, and stay as they are."""

import math
from pathlib import Path

import numpy as np
import pytest

from pytest_rvads.junctions.bends import LEAST_RADIUS, tight_bends
from pytest_rvads.junctions.graph import MetricGraph
from pytest_rvads.junctions.road_map import RoadMap, read_map
from pytest_rvads.opendrive.writer import Layout, opendrive
from pytest_rvads.runs.vehicle import Vehicle

from .conftest import Read


def bends(road_map: RoadMap) -> list[str]:
    return [warning.message for warning in road_map.warnings if warning.kind == "bend"]


def test_the_least_radius_is_that_of_the_car_that_drives() -> None:
    car = Vehicle()
    assert round(car.wheelbase / math.tan(car.steering_limit), 1) == LEAST_RADIUS


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
