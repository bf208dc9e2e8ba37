"""Pure pursuit on the rear axle (Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992)."""

from __future__ import annotations

import math

from pytest_rvads.runs.states import VehicleState

__all__ = ["lookahead", "pursue"]


def lookahead(speed: float) -> float:
    """Return how far ahead of the rear axle to aim at `speed` [m/s], along the way [m]."""
    ahead = 0.35 * speed + 1.5
    return ahead if ahead > 2.5 else 2.5


def pursue(me: VehicleState, back: float, wheelbase: float, x: float, y: float) -> float:
    """Return the angle of the front wheels [rad] that leads the rear axle to a point on a circle.

    Args:
        me: the own vehicle.
        back: its reference point to its rear axle [m].
        wheelbase: rear axle to front axle [m].
        x: of the point, east [m].
        y: likewise, north [m].
    """
    heading = me.heading
    cos, sin = math.cos(heading), math.sin(heading)
    dx = x - me.x + back * cos
    dy = y - me.y + back * sin
    left = dy * cos - dx * sin
    return math.atan2(2.0 * wheelbase * left, dx * dx + dy * dy)
