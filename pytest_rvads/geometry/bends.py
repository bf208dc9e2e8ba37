"""Bends of movements that are tighter than a car can steer."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_RADIUS", "least_radius"]

LEAST_RADIUS = 2.7 / math.tan(0.61)
"""Least radius of the circle of a car's rear axle, with the wheels turned to their limit [m].

The radius is a wheelbase of 2.7 m over the tangent of 0.61 rad, which is 3.9 m.
"""
_CHORD = 4.0
"""Length of centre line over which a bend is measured [m], about the turned part of a right turn: a single vertex is no bend."""


def least_radius(points: NDArray[np.float64]) -> float:
    """Return the least radius of a line of points, ``(points, 2)``, over a length of `_CHORD`, or over a shorter line [m]."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0.0], lengths[lengths > 0.0]
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = np.cumsum(lengths) - lengths / 2
    chord = min(_CHORD, float(lengths.sum()))
    # The heading of a piece holds at its middle, and changes evenly between two middles.
    turned = np.abs(np.interp(middles + chord, middles, headings) - headings).max()
    return chord / float(turned) if turned > 0.0 else np.inf
