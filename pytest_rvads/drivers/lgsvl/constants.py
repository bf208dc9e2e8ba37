"""The constants of the LGSVL-like autopilot: facts about the controller, and free constants for unknown values.

The facts describe the behaviour of the controller of the LGSVL simulator; no code of the controller was copied.
``docs/replication.md`` lists the free constants, the data of their fits, and their ranges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from pytest_rvads.support.errors import AutopilotError

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
"""Rate at which the speed begins to follow a higher target [1/s]."""
RAMP = 5.0
"""Time in which the rate grows from `ADVANCE` to the full rate [s]."""
TURN_SHARE = 0.5
"""Speed in turns as a share of the normal speed."""
SLOW = 15.0
"""Distance to the line from which on the target speed falls in proportion to the distance [m]."""
DECIDE = 15.0
"""Distance to the line at which the vehicle reads the light once [m]."""
HOLD = 1.0
"""Least time in the queue of a stop sign [s]."""
RED_WAIT = (0.0, 4.0)
"""Range of the time that a right turn waits on red from standstill on [s]; 0 to 3 s on the faster vehicles of the original."""
TURN_WAIT = (1.0, 2.0)
"""Range of the time that a left turn waits from green on [s]."""


@dataclass(frozen=True, slots=True)
class ZoneBox:
    """The zone that the scheduler mistakes for the junction: a box around a point off the centre (deficiency I2).

    The box is parallel to the axes of the frame of the junction. In an X, x leads to arm 1 and y to arm 2. In a T, x leads along
    the stem away from the centre, and y points to the left of x.
    """

    x: float
    """Centre of the box along x [m]."""
    y: float
    """Centre of the box along y [m]."""
    half_x: float
    """Half of the extent along x [m]."""
    half_y: float
    """Half of the extent along y [m]."""

    def __post_init__(self) -> None:
        numbers = [getattr(self, item.name) for item in fields(self)]
        if not all(math.isfinite(number) for number in numbers) or min(self.half_x, self.half_y) <= 0:
            raise AutopilotError(f"a zone needs a finite place and positive extents, got {numbers}")


@dataclass(frozen=True, slots=True)
class Constants:
    """The free constants, which were fitted."""

    zone4: ZoneBox = ZoneBox(0.8, -0.8, 7.5, 7.5)
    """Zone of an X."""
    zone3: ZoneBox = ZoneBox(2.0, 0.3, 4.6, 4.6)
    """Zone of a T."""
    launch: float = 0.21
    """Time that a vehicle drives off at full speed before the vehicle knows of the stop (deficiency I1) [s]."""
    halt: float = 1.0
    """Distance to the line at which the target speed becomes zero [m]; the vehicle stands at about three quarters of it."""
    braking: float = 0.75
    """Share of the service brake that an approach relies on; the motion law of LGSVL brakes harder than any car can."""
