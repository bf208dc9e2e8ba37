"""The ways that a junction has in addition if pedestrians walk there: crossings of its crosswalks, and parking places.

A crosswalk has a crossing in each direction, and a parking place beside its near side, before the painted area.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np

from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.crosswalks import SIDEWALK, Crossing, Crosswalk, Parking, Side
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.geometry.ways import Entrance, Exit, Further

_BAY, _OFF = 8.0, 1.2
"""Length of a parking place before a crosswalk, and the distance from the kerb to the middle of the place [m]."""


def walking_ways(crosswalks: Sequence[Crosswalk], entrances: int, exits: int, *, left_hand: bool) -> tuple[Further, ...]:
    """Return the ways in the order that `Junction.walked` describes."""
    further: list[Further] = []
    # The crossings, each with a stretch of sidewalk before and behind the roadway.
    for number, side in product(range(len(crosswalks)), Side):
        crosswalk = crosswalks[number]
        points = crosswalk.path.points if side is Side.NEAR else crosswalk.path.points[::-1]
        path = Segment(f"{crosswalk.id}.{side}", points)
        (x, y, heading), (u, v, direction) = path.pose(0.0), path.pose(path.length)
        back = np.array([SIDEWALK * math.cos(heading), SIDEWALK * math.sin(heading)])
        on = np.array([SIDEWALK * math.cos(direction), SIDEWALK * math.sin(direction)])
        sign = Sign.NONE if crosswalk.phase is None else Sign.LIGHTS
        approach = Segment(f"{path.id}.from", np.array([np.array([x, y]) - back, (x, y)]))
        road = Segment(f"{path.id}.to", np.array([(u, v), np.array([u, v]) + on]))
        crossing = Crossing(entrances + len(further), exits + len(further), number, side, path.length, path)
        start = Entrance(crosswalk.arm, sign=sign, phase=crosswalk.phase, approach=approach)
        further.append(Further(crossing, start, Exit(crosswalk.arm, road=road)))
    # The parking places beside the kerbs of the near sides, in the direction of vehicles that come to the junction. A parked
    # vehicle stands on the approach of such a way.
    for crosswalk in crosswalks:
        x, y, across = crosswalk.path.pose(0.0)
        heading = across + (math.pi / 2 if left_hand else -math.pi / 2)
        ahead = np.array([math.cos(heading), math.sin(heading)])
        kerb = np.array([x - _OFF * math.cos(across), y - _OFF * math.sin(across)])
        along = (crosswalk.area - kerb) @ ahead
        before, after = float(along.min()), float(along.max())
        corners = [kerb + at * ahead for at in (before - _BAY, before, after, after + _BAY)]
        names = ("bay", "beside", "behind")
        place, beside, behind = (
            Segment(f"{crosswalk.id}.{name}", np.array(ends)) for name, ends in zip(names, pairwise(corners), strict=True)
        )
        way = Parking(entrances + len(further), exits + len(further), beside.length, beside)
        further.append(Further(way, Entrance(crosswalk.arm, approach=place), Exit(crosswalk.arm, road=behind)))
    return tuple(further)
