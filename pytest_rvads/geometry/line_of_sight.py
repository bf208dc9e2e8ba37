"""Decides whether a body is in the way of a line of sight."""

from __future__ import annotations

import math


def crosses(
    eye: tuple[float, float], target: tuple[float, float], front: tuple[float, float, float], size: tuple[float, float]
) -> bool:
    """Return whether the line between two points [m] crosses the rectangle of a body, by the clipping of Liang and Barsky.

    The body is given by the centre of its front, x and y [m] and heading [rad], and by its length and width [m].
    """
    x, y, heading = front
    length, width = size
    cos, sin = math.cos(heading), math.sin(heading)
    begin, end = 0.0, 1.0
    (ax, ay), (bx, by) = ((px - x, py - y) for px, py in (eye, target))
    ends = (
        (ax * cos + ay * sin, bx * cos + by * sin, -length, 0.0),
        (ay * cos - ax * sin, by * cos - bx * sin, -width / 2, width / 2),
    )
    for a, b, low, high in ends:
        if a == b:
            if not low <= a <= high:
                return False
            continue
        enter, leave = sorted(((low - a) / (b - a), (high - a) / (b - a)))
        begin, end = max(begin, enter), min(end, leave)
    return begin <= end
