"""Crosswalks for tests, laid over the arms of built-in junctions by hand."""

import math
from dataclasses import replace

import numpy as np

from pytest_rvads.geometry.crosswalks import Crosswalk
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment


def zebra(name: str = "stop4", behind: float = 1.2, wide: float = 3.0, lit: bool = False) -> Junction:
    """Return a junction with a crosswalk over every arm, each with one entrance and one exit.

    Args:
        name: name of a built-in junction.
        behind: distance from the entrance vertex to the crosswalk [m].
        wide: width of the crosswalk [m].
        lit: whether pedestrians have lights; they walk while the other one of two phase groups has green.
    """
    place = find(name)
    crossings = []
    for arm, (entrances, exits) in enumerate(place.arms):
        approach, road = place.way_in(entrances[0]), place.way_out(exits[0])
        x, y, heading = approach.pose(approach.length + behind + wide / 2)
        ahead, right = np.array([math.cos(heading), math.sin(heading)]), np.array([math.sin(heading), -math.cos(heading)])
        u, v, _ = road.pose(0.0)
        apart = float(np.dot(np.array([x - u, y - v]), right))  # from the middle of the exit to the middle of the entrance
        half = place.lane_width / 2
        near, far = np.array([x, y]) + half * right, np.array([x, y]) - (apart + half) * right
        edge = wide / 2 * ahead
        area = np.array([near - edge, near + edge, far + edge, far - edge])
        phase = 1 - place.entrances[entrances[0]].phase if lit and place.entrances[entrances[0]].phase is not None else None
        crossings.append(
            Crosswalk(f"zebra{arm}", arm, area, Segment(f"zebra{arm}", np.array([near, far])), half + apart / 2, 0.0, phase)
        )
    return replace(place, crossings=tuple(crossings))
