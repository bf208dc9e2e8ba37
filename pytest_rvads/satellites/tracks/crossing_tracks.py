"""Finds the crossings that a recorded pedestrian walks over, and computes the pedestrian's track along each crossing.

A pedestrian is in the recording while it is on a crosswalk, or on the sidewalk before or behind the crosswalk. A pedestrian who
walks over several crosswalks is several agents. The body of a pedestrian is a circle of the diameter `PERSON`, whatever size the
log states. The reference point is the front of this circle in the direction of the crossing. The recorded heading and speed are
not used: the heading is that of the crossing, and the speed follows from the positions. So a pedestrian who turns back keeps its
crossing, and its speed becomes negative.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import PERSON, SIDEWALK, Crossing, Side
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Track
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.tracks.matching import Line, Matched, track_of, unbroken
from pytest_rvads.satellites.tracks.samples import Samples

_Values = NDArray[np.float64]

_BESIDE = 1.0
"""Distance beside the painted area at which a pedestrian is still on the crosswalk [m], because many cut a corner of the area."""
_STEPPED = 0.5
"""Least distance of a pedestrian from both kerbs that proves a step onto the roadway [m]. Measured places are less accurate, and
the side of a car in the middle of its lane is farther from the kerb."""
_REACH = SIDEWALK - PERSON
"""Length of the sidewalk on which a pedestrian is recorded [m]: the whole body is on the way."""


class CrossingMatcher:
    """Matches pedestrians to the crossings of a junction that has them among its further ways, see `Junction.walked`."""

    def __init__(self, junction: Junction) -> None:
        ways = [way for way, _, _ in junction.further if isinstance(way, Crossing)]
        there, back = ([Itinerary.through(junction, *way.key) for way in ways if way.side is side] for side in Side)
        areas = [crosswalk.area for crosswalk in junction.crossings]
        self._crosswalks = list(zip(map(Line.of, there), back, areas, strict=True))

    def match(self, walker: Samples, points: _Values, ahead: float) -> list[Matched]:
        """Return each walk of a pedestrian over a crosswalk, in the order of their times.

        The recorded points on the map have the shape ``(samples, 2)`` [m]; the front of the body is `ahead` of them [m].
        """
        walks = []
        for line, back, area in self._crosswalks:
            length, (_, sides) = line.way.length, line.project(area)
            low, high = sides.min() - _BESIDE, sides.max() + _BESIDE
            station, lateral = line.project(points)
            near = np.flatnonzero((lateral >= low) & (lateral <= high) & (station >= -_REACH) & (station <= length + _REACH))
            for part in unbroken(walker.times[near]):
                if len(near[part]) < 2:
                    continue
                rows = slice(int(near[part][0]), int(near[part][-1]) + 1)
                along, beside = np.clip(station[rows], -_REACH, length + _REACH), lateral[rows]
                road = (along > 0.0) & (along < length)
                stepped = bool(((along >= _STEPPED) & (along <= length - _STEPPED)).any())
                # Who rides in a vehicle, or walks along the road, moves across the crosswalk and not along it.
                if not stepped or np.ptp(beside[road]) > max(np.ptp(along[road]), (high - low) / 2):
                    continue
                if along[0] >= length or (along[0] > 0.0 and along[-1] < along[0]):
                    along, beside, way = length - along, -beside, back
                else:
                    way = line.way
                walks.append(Matched(way, rows, along + ahead, beside, float(np.sqrt((beside**2).mean()))))
        return sorted(walks, key=lambda walk: walk.rows.start)


def track_on_foot(agent: Agent, walker: Samples, walk: Matched, points: _Values, ahead: float, accuracy: float) -> Track:
    """Return the track of a pedestrian along a crossing, see `track_of`; `accuracy` is that of a coordinate [m]."""
    fronts = points.copy()
    fronts[walk.rows] += ahead * walk.way.centre(walk.station)[1]
    return track_of(agent, replace(walker, speed=None), walk, fronts, None, accuracy)
