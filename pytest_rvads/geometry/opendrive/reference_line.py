"""Reference lines of roads: the five plan-view geometries of OpenDRIVE, sampled by station.

Lines and arcs are closed forms. Spirals are integrated by 5-point Gauss-Legendre quadrature on pieces of at most 2 m, within
4.4e-8 m of Fresnel integrals. The parameters of poly3 and paramPoly3 are found from arc lengths.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.opendrive.records import Shape

__all__ = ["Line", "evaluate"]

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_PIECE = 2.0
_STEP = 0.05
_MOST_CELLS = 200_000
_END = 1e-6


class Line(NamedTuple):
    """Points of a reference line."""

    x: Array
    """East, shape ``(k,)`` [m]."""
    y: Array
    """North, shape ``(k,)`` [m]."""
    heading: Array
    """Counter-clockwise from east, not unwrapped, shape ``(k,)`` [rad]."""


def evaluate(shape: Shape, along: Array) -> Line:
    """Return points of a piece of a reference line.

    Args:
        shape: the piece.
        along: ascending distances from the start of the piece, shape ``(k,)`` [m].
    """
    if shape.kind == "line":
        u, v, turn = along, np.zeros_like(along), np.zeros_like(along)
    elif shape.kind == "arc":
        u, v, turn = _arc(shape.values[0], along)
    elif shape.kind == "spiral":
        u, v, turn = _spiral(shape.values[0], shape.values[1], shape.length, along)
    elif shape.kind == "poly3":
        u, v, turn = _poly3(shape.values, along)
    else:
        u, v, turn = _param_poly3(shape.values, shape.length, shape.normalized, along)
    cos, sin = np.cos(shape.heading), np.sin(shape.heading)
    return Line(shape.x + u * cos - v * sin, shape.y + u * sin + v * cos, shape.heading + turn)


def _arc(curvature: float, along: Array) -> tuple[Array, Array, Array]:
    turn = curvature * along
    # sin(a)/k and (1 - cos(a))/k, written so that both hold for a curvature of zero, too.
    half = np.sinc(turn / (2 * np.pi))
    chord = along * half
    return chord * np.cos(turn / 2), chord * np.sin(turn / 2), turn


def _spiral(first: float, last: float, length: float, along: Array) -> tuple[Array, Array, Array]:
    rate = (last - first) / length if length else 0.0
    lead = np.linspace(0.0, along[0], int(np.ceil(along[0] / _PIECE)) + 1)[:-1]
    grid = np.concatenate((lead, along)) if len(lead) or along[0] == 0.0 else np.concatenate(([0.0], along))
    widest = float(np.max(np.diff(grid), initial=0.0))
    parts = max(1, int(np.ceil(widest / _PIECE)))
    fine = grid
    if parts > 1:
        steps = np.linspace(0.0, 1.0, parts + 1)[:-1]
        fine = np.append((grid[:-1, None] + np.diff(grid)[:, None] * steps).ravel(), grid[-1])
    half = np.diff(fine) / 2
    nodes = (fine[:-1] + half)[:, None] + half[:, None] * _NODES
    angle = first * nodes + rate * nodes**2 / 2
    u = np.concatenate(([0.0], np.cumsum(half * (np.cos(angle) @ _WEIGHTS))))
    v = np.concatenate(([0.0], np.cumsum(half * (np.sin(angle) @ _WEIGHTS))))
    keep = slice(None, None, parts)
    back = len(along)
    return u[keep][-back:], v[keep][-back:], first * along + rate * along**2 / 2


def _poly3(values: tuple[float, ...], along: Array) -> tuple[Array, Array, Array]:
    a, b, c, d = values
    grid = _grid(along[-1], along[-1])
    u = np.interp(along, _arc_length(grid, lambda p: np.sqrt(1 + (b + p * (2 * c + 3 * d * p)) ** 2)), grid)
    return u, a + u * (b + u * (c + u * d)), np.arctan(b + u * (2 * c + 3 * d * u))


def _param_poly3(values: tuple[float, ...], length: float, normalized: bool, along: Array) -> tuple[Array, Array, Array]:
    au, bu, cu, du, av, bv, cv, dv = values
    end = 1.0 if normalized else length
    grid = _grid(end, length)
    arc = _arc_length(grid, lambda p: np.hypot(bu + p * (2 * cu + 3 * du * p), bv + p * (2 * cv + 3 * dv * p)))
    p = np.interp(along, arc, grid)
    # The stated length of a piece may differ from the arc length by centimetres; the end point is exact.
    p[along >= length - _END] = end
    turn = np.arctan2(bv + p * (2 * cv + 3 * dv * p), bu + p * (2 * cu + 3 * du * p))
    return au + p * (bu + p * (cu + p * du)), av + p * (bv + p * (cv + p * dv)), turn


def _grid(end: float, length: float) -> Array:
    """Return parameters from 0 to `end`, about `_STEP` metres apart on a piece of this length."""
    cells = min(max(int(np.ceil(length / _STEP)), 1), _MOST_CELLS)
    return np.linspace(0.0, max(end, _STEP), cells + 1)


def _arc_length(grid: Array, speed: Callable[[Array], Array]) -> Array:
    """Return the integral of `speed` from the first parameter of `grid` to every parameter."""
    half = np.diff(grid) / 2
    nodes = (grid[:-1] + half)[:, None] + half[:, None] * _NODES
    return np.concatenate(([0.0], np.cumsum(half * (speed(nodes) @ _WEIGHTS))))
