"""Finds by how much the tracks of a log lie systematically beside the lanes of a map, and the correction for this.

The lateral distances of all matched vehicles from their ways are explained by one shift and one rotation of all tracks. Where
vehicles drive beside the middle of their lanes for reasons of their own, a shift and rotation explain little.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording
from pytest_rvads.satellites.tracks.matching import evenly_spaced

TOLERATED = 0.5
"""Largest systematic distance of tracks beside the lanes without a warning [m]: less than the room beside a car in its lane."""
_WEAKEST = 0.05
"""Singular values below this share of the largest are left out: if all vehicles drive on one straight road, their lateral
distances do not show a shift along the road."""


@dataclass(frozen=True, slots=True)
class Misalignment:
    """The shift and the rotation by which tracks lie beside the lanes, estimated by least squares."""

    lateral: float
    """Mean lateral distance of the tracks from their ways, positive to the left [m]."""
    systematic: float
    """Root mean square of the lateral distances that the correction takes away [m]."""
    shift: tuple[float, float]
    """Correction of x and y at `centre` [m]."""
    rotation: float
    """Correction of the headings, counter-clockwise [rad]."""
    centre: tuple[float, float]
    """Mean of the compared points, about which the tracks are rotated [m]."""

    def in_words(self) -> str:
        """Return the sizes of the misalignment and of the correction in words."""
        return (
            f"lie {self.systematic:.2f} m beside the lanes (mean {self.lateral:+.2f} m, left is positive); a shift by "
            f"({self.shift[0]:.2f}, {self.shift[1]:.2f}) m and a turn by {math.degrees(self.rotation):.2f} degrees about "
            f"({self.centre[0]:.0f}, {self.centre[1]:.0f}) would bring them onto the lanes"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return {
            "lateral": round(self.lateral, 4),
            "systematic": round(self.systematic, 4),
            "shift": [round(number, 4) for number in self.shift],
            "rotation": round(self.rotation, 6),
            "centre": [round(number, 4) for number in self.centre],
        }

    def similarity(self, offset: tuple[float, float]) -> tuple[complex, complex]:
        """Return the correction as arguments of `Log.moved`, for a log to whose positions `offset` [m] is added later."""
        turn, centre, later = cmath.rect(1.0, self.rotation), complex(*self.centre), complex(*offset)
        return turn, turn * (later - centre) + centre + complex(*self.shift) - later


def misalignment_of(recordings: Sequence[Recording]) -> Misalignment:
    """Return by how much the tracks of recordings of one log lie beside the lanes.

    A small shift ``d`` and rotation ``r`` about the centre ``c`` change the lateral distance of a point ``p`` of a track by
    ``n . (d + r J (p - c))``, where ``n`` points to the left of the way and ``J`` turns by 90 degrees. The returned correction
    has the least sum of squares of the lateral distances of points at equal distances along the tracks.
    """
    points, lefts, laterals = [], [], []
    for recording in recordings:
        for track in recording.vehicles:
            picked = evenly_spaced(track.pose[:, :2])
            way = Itinerary.through(recording.junction, track.agent.way.entrance, track.agent.way.exit)
            middle, ahead = way.centre(track.station[picked])
            left = np.column_stack((-ahead[:, 1], ahead[:, 0]))
            points.append(track.pose[picked, :2])
            lefts.append(left)
            laterals.append(((track.pose[picked, :2] - middle) * left).sum(axis=1))
    place, left, lateral = np.vstack(points), np.vstack(lefts), np.concatenate(laterals)
    centre = place.mean(axis=0)
    apart = place - centre
    radius = max(float(np.sqrt((apart**2).sum(axis=1).mean())), 1.0)
    turning = (left * np.column_stack((-apart[:, 1], apart[:, 0]))).sum(axis=1) / radius
    effect = np.column_stack((left, turning))
    x, y, turned = np.linalg.lstsq(effect, -lateral, rcond=_WEAKEST)[0].tolist()
    systematic = math.sqrt(float(((effect @ [x, y, turned]) ** 2).mean()))
    return Misalignment(float(lateral.mean()), systematic, (x, y), turned / radius, (float(centre[0]), float(centre[1])))
