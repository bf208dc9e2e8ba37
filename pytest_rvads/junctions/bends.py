"""Bends of movements that are tighter than a car can steer."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_RADIUS", "least_radius"]

LEAST_RADIUS = 2.7 / math.tan(0.61)
"""Of the circle on which the rear axle of a car drives with its wheels turned as far as they go [m]: a wheelbase of 2.7 m over
the tangent of 0.61 rad, which is 3.9 m."""
_CHORD = 4.0
"""Bends are measured over so much of the centre line [m], about the turned part of a right turn: single vertices are no bends."""


def least_radius(points: NDArray[np.float64]) -> float:
    """Return the least radius of a line of points, ``(points, 2)``, over `_CHORD` or all of it, where it is shorter [m]."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, lengths = steps[lengths > 0.0], lengths[lengths > 0.0]
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = np.cumsum(lengths) - lengths / 2
    chord = min(_CHORD, float(lengths.sum()))
    # A piece has its heading in its middle, and between two middles it changes evenly.
    turned = np.abs(np.interp(middles + chord, middles, headings) - headings).max()
    return chord / float(turned) if turned > 0.0 else np.inf
