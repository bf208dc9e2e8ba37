"""Decides whether a body is in the way of a line of sight."""

from __future__ import annotations

import math

from pytest_rvads.runs.states import VehicleState

__all__ = ["crosses"]


def crosses(eye: tuple[float, float], target: tuple[float, float], body: VehicleState) -> bool:
    """Return whether the line between two points crosses the rectangle of a body, by the clipping of Liang and Barsky."""
    cos, sin = math.cos(body.heading), math.sin(body.heading)
    begin, end = 0.0, 1.0
    (ax, ay), (bx, by) = ((x - body.x, y - body.y) for x, y in (eye, target))
    ends = (
        (ax * cos + ay * sin, bx * cos + by * sin, -body.length, 0.0),
        (ay * cos - ax * sin, by * cos - bx * sin, -body.width / 2, body.width / 2),
    )
    for a, b, low, high in ends:
        if a == b:
            if not low <= a <= high:
                return False
            continue
        enter, leave = sorted(((low - a) / (b - a), (high - a) / (b - a)))
        begin, end = max(begin, enter), min(end, leave)
    return begin <= end
