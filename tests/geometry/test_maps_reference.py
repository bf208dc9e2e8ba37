"""The five geometries of OpenDRIVE, against closed forms and independent integration; lane offsets and widths."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.opendrive.centre_lines import lane_lines, line_warnings
from pytest_rvads.geometry.opendrive.records import Cubic, Lane, Road, Section, Shape, evaluate

ALONG = np.linspace(0.0, 40.0, 81)
QUICK = settings(derandomize=True, deadline=None, max_examples=40)


def shape(kind: str, *values: float, length: float = 40.0, normalized: bool = False) -> Shape:
    return Shape(0.0, 3.0, -2.0, 0.7, length, kind, values, normalized)


def local(line: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the points in the frame of the start of the piece."""
    dx, dy = line.x - 3.0, line.y + 2.0
    return dx * math.cos(0.7) + dy * math.sin(0.7), dy * math.cos(0.7) - dx * math.sin(0.7)


def integrate(curvature: Callable[[np.ndarray], np.ndarray], s: float, steps: int = 200_001) -> tuple[float, float]:
    """Integrate cos and sin of the heading by Simpson's rule on a fine grid."""
    grid = np.linspace(0.0, s, steps)
    heading = np.concatenate(([0.0], np.cumsum((curvature(grid[1:]) + curvature(grid[:-1])) / 2 * np.diff(grid))))
    weights = np.ones(steps)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    h = s / (steps - 1) / 3
    return float(h * (weights @ np.cos(heading))), float(h * (weights @ np.sin(heading)))


def test_line() -> None:
    u, v = local(evaluate(shape("line"), ALONG))
    assert u == pytest.approx(ALONG)
    assert v == pytest.approx(0 * ALONG, abs=1e-12)


@given(curvature=st.floats(-0.3, 0.3))
@QUICK
def test_arc_is_a_circle(curvature: float) -> None:
    line = evaluate(shape("arc", curvature), ALONG)
    u, v = local(line)
    assert u**2 + v**2 == pytest.approx(
        np.where(curvature, (2 * np.sin(curvature * ALONG / 2) / (curvature or 1)) ** 2, ALONG**2), abs=1e-6
    )
    assert line.heading == pytest.approx(0.7 + curvature * ALONG)


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.1), (0.1, 0.0), (-0.05, 0.15), (0.02, 0.02), (0.0, 0.0)])
def test_spiral(first: float, last: float) -> None:
    for along in (np.array([0.0, 13.0, 40.0]), np.array([7.0, 40.0]), np.array([40.0])):
        u, v = local(evaluate(shape("spiral", first, last), along))
        x, y = integrate(lambda s: first + (last - first) / 40.0 * s, 40.0)
        assert (u[-1], v[-1]) == pytest.approx((x, y), abs=1e-6)
        assert len(u) == len(along)


def test_poly3_runs_by_arc_length() -> None:
    line = evaluate(shape("poly3", 0.0, 0.1, 0.01, -0.0002), ALONG)
    u, v = local(line)
    assert v == pytest.approx(0.1 * u + 0.01 * u**2 - 0.0002 * u**3, abs=1e-9)
    fine = evaluate(shape("poly3", 0.0, 0.1, 0.01, -0.0002), np.linspace(0.0, 40.0, 20_001))
    assert np.hypot(np.diff(fine.x), np.diff(fine.y)).sum() == pytest.approx(40.0, abs=1e-3)


@pytest.mark.parametrize("normalized", [True, False])
def test_param_poly3_of_a_bent_curve(normalized: bool) -> None:
    # u = 30 p, v = 8 p^2: a parabola; its arc length has a closed form.
    k = 1.0 if normalized else None
    length = 15 * (math.sqrt(1 + (16 / 30) ** 2) + math.asinh(16 / 30) / (16 / 30))
    scale = k or 1 / length
    piece = shape("paramPoly3", 0, 30 * scale, 0, 0, 0, 0, 8 * scale**2, 0, length=length, normalized=normalized)
    line = evaluate(piece, np.linspace(0.0, length, 101))
    u, v = local(line)
    assert (u[-1], v[-1]) == pytest.approx((30, 8))
    assert v == pytest.approx(8 * (u / 30) ** 2, abs=1e-9)
    steps = np.hypot(np.diff(u), np.diff(v))
    assert steps == pytest.approx(np.full(100, length / 100), abs=1e-3)


def road(*, offsets: Any = (), widths: Any = (), shapes: Any = None, sections: Any = None, length: float = 40.0) -> Road:
    lane = Lane(-1, "driving", tuple(widths) or (Cubic(0, 4.0, 0, 0, 0),), (), (), ())
    shapes = shapes or (Shape(0.0, 0.0, 0.0, 0.0, length, "line", (), False),)
    return Road("r", length, None, None, tuple(shapes), tuple(offsets), sections or (Section(0.0, {-1: lane}),), None, None, ())


def test_lane_centre_is_offset_plus_half_the_width() -> None:
    straight = road(offsets=[Cubic(0, 1.0, 0.05, 0, 0)], widths=[Cubic(0, 3.0, 0.0, 0.001, 0)])
    (lines,) = lane_lines(straight)
    x, y = lines[-1].points.T
    assert y == pytest.approx(1.0 + 0.05 * x - (3.0 + 0.001 * x**2) / 2)
    assert not list(line_warnings(straight, [lines]))


def test_width_records_at_the_end_of_a_section_are_ignored() -> None:
    """Else lanes of Town04 jump by 7 to 14 m."""
    narrow = Lane(-1, "driving", (Cubic(0, 4.0, 0, 0, 0), Cubic(20.0, 30.0, 0, 0, 0)), (), (), (-1,))
    wide = Lane(-1, "driving", (Cubic(0, 4.0, 0, 0, 0),), (), (-1,), ())
    sections = (Section(0.0, {-1: narrow}), Section(20.0, {-1: wide}))
    one, two = lane_lines(road(sections=sections, offsets=[Cubic(0, 0, 0, 0, 0), Cubic(20.0, 9.0, 0, 0, 0)]))
    assert one[-1].points[-1].tolist() == pytest.approx([20.0, -2.0])
    assert two[-1].points[0].tolist() == pytest.approx([20.0, 7.0])


def test_inner_lanes_push_outer_ones_out() -> None:
    lanes = {
        1: Lane(1, "driving", (Cubic(0, 3.0, 0, 0, 0),), (), (), ()),
        2: Lane(2, "sidewalk", (Cubic(0, 2.0, 0, 0, 0),), (), (), ()),
        3: Lane(3, "onRamp".lower(), (Cubic(0, 4.0, 0, 0, 0),), (), (), ()),
    }
    (lines,) = lane_lines(road(sections=(Section(0.0, lanes),)))
    assert sorted(lines) == [1, 3]
    assert lines[1].points[:, 1] == pytest.approx(1.5)
    assert lines[3].points[:, 1] == pytest.approx(3 + 2 + 2)


def test_borders_stand_in_for_widths() -> None:
    lane = Lane(-1, "driving", (), (Cubic(0, -3.6, 0, 0, 0),), (), ())
    (lines,) = lane_lines(road(sections=(Section(0.0, {-1: lane}),)))
    assert lines[-1].points[:, 1] == pytest.approx(-1.8)


def test_folds_at_kinks_are_cut() -> None:
    """A lane on the inner side of a kink must not run backwards; the cut is reported."""
    bend = 0.5
    shapes = (
        Shape(0.0, 0.0, 0.0, 0.0, 20.0, "arc", (1e-9,), False),
        Shape(20.0, 20.0, 0.0, -bend, 20.0, "arc", (1e-9,), False),
    )
    (lines,) = lane_lines(road(shapes=shapes))
    line = lines[-1]
    steps = np.diff(line.points, axis=0)
    middle = np.arctan2(steps[:, 1], steps[:, 0])
    assert middle.min() >= -bend - 1e-6
    assert middle.max() <= 1e-6
    # Two straight lines that are cut where they cross: each is shorter by t tan(bend / 2).
    assert np.hypot(*steps.T).sum() == pytest.approx(40 - 2 * 2.0 * math.tan(bend / 2), abs=1e-6)
    assert [warning.kind for warning in line_warnings(road(shapes=shapes), [lines])] == ["kink"]
    assert line.turning == pytest.approx(-bend)


def test_lengths_and_gaps_are_compared() -> None:
    shapes = (Shape(0.0, 0.0, 0.0, 0.0, 20.0, "line", (), False), Shape(20.0, 20.5, 0.0, 0.0, 20.3, "line", (), False))
    assert [warning.kind for warning in line_warnings(road(shapes=shapes), [])] == ["gap", "length"]
