"""Junctions of OpenDRIVE maps come out alike when the lanes of the map are written as lanelets, without junctions."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.road_map import RoadMap, read_map

from .lanelet_files import Osm


def beside(points: NDArray[np.float64], distance: float) -> list[tuple[float, float]]:
    """Return points at a distance to the left of a line, fewer than the line has."""
    step = np.gradient(points, axis=0)
    line = points + distance * np.column_stack((-step[:, 1], step[:, 0])) / np.hypot(*step.T)[:, None]
    kept = sorted({*range(0, len(line), max(1, min(6, len(line) // 6))), len(line) - 1})
    return [(float(x), float(y)) for x, y in line[kept]]


def written(road_map: RoadMap, path: Path) -> dict[str, str]:
    """Write the lanes of a map as lanelets that share no ways, and return the lane per lanelet."""
    osm = Osm()
    lanes = {}
    for edge in road_map.graph.edges.values():
        half = min(edge.width, 4.0) / 2
        lanes[osm.lanelet(osm.way(beside(edge.points, half)), osm.way(beside(edge.points, -half)))] = edge.id
    osm.write(path)
    return lanes


def shape(report: JunctionReport) -> tuple[int, int, int, int, bool]:
    return report.ways, len(report.entrances), len(report.exits), len(report.movements), report.left_hand


# Maps with tighter bends are left out: the inner bound that the test writes would fold there.
@pytest.mark.extended
@pytest.mark.parametrize(
    ("stem", "count"),
    [
        ("Town01", 12),
        ("multi_intersections", 5),
        ("fabriksgatan", 1),
        ("sumo_t3", 1),
        ("sumo_stop4", 1),
        ("simple_4way_intersection", 1),
        ("simple_3way_intersection_lht", 1),
    ],
)
def test_lanelets_have_the_junctions_of_the_opendrive_map(shared: Path, tmp_path: Path, stem: str, count: int) -> None:
    original = read_map(shared / "maps" / f"{stem}.xodr")
    lanes = written(original, tmp_path / "twin.osm")
    twin = read_map(tmp_path / "twin.osm")
    found = {frozenset(lanes[id.split(":")[0]] for id in twin.graph.inside(report.id)): report for report in twin.junctions}
    usable = [report for report in original.junctions if report.usable]
    assert len(usable) == len(found) == count
    for report in usable:
        inside = set(original.graph.inside(report.id))
        (lanelets,) = [ids for ids in found if ids & inside]
        assert shape(found[lanelets]) == shape(report)
