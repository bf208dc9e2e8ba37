"""Maps drawn small: what is left of a line is near it, and every lane is there."""

import math
import re
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.finder import load
from pytest_rvads.geometry.opendrive.map_file import path_of
from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.satellites.campaigns.town import MarkedJunction, simplified, spot, town_picture

coordinates = st.floats(-1000, 1000, allow_nan=False)
lines = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=30).map(np.array)


def away(point: np.ndarray, line: np.ndarray) -> float:
    """Distance of a point from a line, piece by piece."""
    best = math.inf
    for a, b in pairwise(line):
        length = float((b - a) @ (b - a))
        share = min(max(float((point - a) @ (b - a)) / length, 0.0), 1.0) if length else 0.0
        best = min(best, math.dist(point, a + share * (b - a)))
    return best


@settings(max_examples=60, deadline=None)
@given(lines, st.floats(0.01, 50.0))
def test_no_point_is_farther_from_the_simplified_line_than_allowed(line: np.ndarray, tolerance: float) -> None:
    found = simplified(line, tolerance)
    assert found[0].tolist() == line[0].tolist()
    assert found[-1].tolist() == line[-1].tolist()
    assert max(away(point, found) for point in line) <= tolerance + 1e-6


def test_of_a_straight_line_its_ends_are_left() -> None:
    line = np.column_stack([np.linspace(0.0, 100.0, 201), np.linspace(5.0, -5.0, 201)])
    assert simplified(line, 0.2).tolist() == [[0.0, 5.0], [100.0, -5.0]]


def ends(d: str) -> list[tuple[float, float]]:
    """Where the lines of a path begin and end."""
    found = []
    for part in d.split("M")[1:]:
        x, y = map(float, re.split("[ l]", part)[:2])
        steps = [tuple(map(float, step.split())) for step in part.split("l")[1:]]
        found += [(x, y), (x + sum(s[0] for s in steps), y + sum(s[1] for s in steps))]
    return found


@pytest.mark.parametrize("name", ["stop4", "lanes4", "roundabout4"])
def test_every_lane_is_drawn_where_it_lies(name: str) -> None:
    road_map = load(path_of(name))
    picture = town_picture("town", road_map, []).svg
    drawn = [end for d in re.findall(' d="([^"]*)"', picture) for end in ends(d)]
    lanes = [edge.points for edge in road_map.graph.edges.values()]
    assert len(drawn) == 2 * len(lanes)
    for points in lanes:
        for x, y in (points[0], points[-1]):
            assert min(math.dist((x, -y), end) for end in drawn) < 0.15, "north is up, within a decimetre"
    west, north, wide, tall = map(float, re.findall('viewBox="([^"]*)"', picture)[0].split())
    for x, y in drawn:
        assert west <= x <= west + wide
        assert north <= y <= north + tall


def test_a_junction_is_where_its_arms_meet() -> None:
    (report,) = load(path_of("stop4")).junctions
    found = spot(report)
    x, y, radius = found
    for arm in report.arms:
        assert math.dist((arm.x, -arm.y), (x, y)) == pytest.approx(radius, abs=0.2)


def test_a_bend_takes_few_points() -> None:
    # One lane as a file has it: 30 m of an arc with a point every 5 cm.
    angles = np.linspace(0.0, 0.3, 600)
    arc = np.column_stack([100 * np.sin(angles), 100 * (1 - np.cos(angles))])
    assert len(simplified(arc, 0.2)) < 6


@pytest.mark.parametrize(
    ("outcomes", "mark"),
    [
        ("PASS NA", "good"),
        ("PASS FAIL ERROR", "bad"),
        ("PASS ERROR OPEN", "error"),
        ("PASS OPEN", "doubt"),
        ("PASS PROVOKED", "doubt"),
        ("NA", "none"),
        ("", "none"),
    ],
)
def test_a_junction_is_marked_by_the_worst_that_happened(outcomes: str, mark: str) -> None:
    (report,) = load(path_of("stop4")).junctions
    verdicts: Counter[Tallied] = Counter(map(Outcome, outcomes.split()))
    assert MarkedJunction("stop4", report, verdicts, incomplete=False, note="").mark == mark
    missing = MarkedJunction("stop4", report, verdicts, incomplete=True, note="").mark
    assert missing == ("doubt" if mark in ("good", "none") else mark), "where results are missing, nothing is good or idle"
