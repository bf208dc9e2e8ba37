"""Whether the vehicles of a log head where they go: where most don't, their headings mean something else."""

from __future__ import annotations

from itertools import islice

import numpy as np

from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.matching import directions
from pytest_rvads.satellites.tracks.samples import Log, Samples

__all__ = ["check_facing"]

_ASKED = 100
"""Number of vehicles whose headings are compared with their directions of motion."""
_MOVES = 10.0
"""Shortest distance driven by a compared vehicle, so that noise does not hide its direction [m]."""
_ALIKE = 0.92
"""Least cosine of the angle between heading and direction, on average: noise and slipping leave more than this. Degrees taken as
radians happen to lead nearly to the north, and exactly to the east."""


def check_facing(log: Log) -> None:
    """Check that most vehicles head in their direction of motion.

    Raises:
        RunError: most headings differ from the direction of motion, so that neither front bumpers nor ways can be derived.
    """
    asked = islice((vehicle for vehicle in log.vehicles if _tells(vehicle)), _ASKED)
    alike = [float(np.cos(v.heading - directions(v.points)).mean()) for v in asked if v.heading is not None]
    if alike and float(np.median(alike)) < _ALIKE:
        raise RunError(
            f"{log.where}: most of its vehicles head elsewhere than they go: headings are taken as radians counter-clockwise "
            "from east, and y as pointing north; where they are degrees, or those of a compass, say so by "
            "--columns heading=COLUMN:deg or heading=COLUMN:north"
        )


def _tells(vehicle: Samples) -> bool:
    return vehicle.heading is not None and bool(np.hypot(*(vehicle.points - vehicle.points[0]).T).max() >= _MOVES)
