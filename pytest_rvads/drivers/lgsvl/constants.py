"""The constants of the LGSVL-like autopilot: read facts, and the few free ones that stand for what is unknown.

The facts describe how the controller of the LGSVL simulator behaves; no code of it was taken. Which constants are
free, what each was fitted on, and how far it may move is written down in ``docs/replication.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from pytest_rvads.errors import AutopilotError

__all__ = [
    "ADVANCE",
    "DECIDE",
    "HOLD",
    "RAMP",
    "RATES",
    "RED_WAIT",
    "SLOW",
    "TURN_SHARE",
    "TURN_WAIT",
    "Constants",
    "ZoneBox",
]

RATES = (4.0, 6.0, 8.0)
"""Rate at which the speed follows its target, by aggression [1/s]."""
ADVANCE = 1.0
"""Rate with which it begins to follow a higher target [1/s]."""
RAMP = 5.0
"""Time in which that rate grows to the full one [s]."""
TURN_SHARE = 0.5
"""Turns are driven at this share of the normal speed."""
SLOW = 15.0
"""From here on the target falls in proportion to the distance to the line [m]."""
DECIDE = 15.0
"""The one look at the light is taken here [m before the line]."""
HOLD = 1.0
"""Time to stay in the queue of a stop sign before going [s]."""
RED_WAIT = (0.0, 4.0)
"""Range of the time that a right turn waits on red, from standstill; 0 to 3 s on the original's faster vehicles [s]."""
TURN_WAIT = (1.0, 2.0)
"""Range of the time that a left turn waits after its light turned green [s]."""


@dataclass(frozen=True, slots=True)
class ZoneBox:
    """The zone that the scheduler takes for the junction: an upright box around a point off the centre (deficiency I2).

    The frame is the junction's. In an X, x leads to arm 1 and y to arm 2; in a T, x leads along the stem away from the
    centre, and y is its left.
    """

    x: float
    """Centre of the box [m]."""
    y: float
    """Centre of the box [m]."""
    half_x: float
    """Half its extent along x [m]."""
    half_y: float
    """Half its extent along y [m]."""

    def __post_init__(self) -> None:
        numbers = [getattr(self, item.name) for item in fields(self)]
        if not all(math.isfinite(number) for number in numbers) or min(self.half_x, self.half_y) <= 0:
            raise AutopilotError(f"a zone needs a finite place and positive extents, got {numbers}")


@dataclass(frozen=True, slots=True)
class Constants:
    """The free constants: they were fitted, the others were read."""

    zone4: ZoneBox = ZoneBox(0.8, -0.8, 7.5, 7.5)
    """Zone of an X."""
    zone3: ZoneBox = ZoneBox(2.0, 0.3, 4.6, 4.6)
    """Zone of a T."""
    launch: float = 0.21
    """How long a vehicle drives off at full speed before it knows that it has to stop (deficiency I1) [s]."""
    halt: float = 1.0
    """Distance to the line from which on the target speed is zero; the vehicle then stands at about three quarters of it [m]."""
    braking: float = 0.75
    """Share of the service brake that an approach counts on: LGSVL's own law brakes harder than any car can."""
