"""The path that a driver steers its rear axle along in a narrow bend, and how fast the wheels can turn as the path demands."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from pytest_rvads.junctions.sweep import FINE, plan
from pytest_rvads.maps.segment import Segment
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["AxlePath", "axle_path"]

QUICK = 0.7
"""Share of the steering rate that the path may take."""


class AxlePath(NamedTuple):
    """The path of a rear axle beside the itinerary."""

    path: Segment
    pace: tuple[tuple[float, float], ...]
    """Stations of the rear axle on the itinerary [m], and how fast the wheels can turn as the path demands there [m/s]."""


@lru_cache(maxsize=256)
def axle_path(itinerary: Itinerary, vehicle: Vehicle, lane_width: float) -> AxlePath | None:
    """Return the path of the rear axle where it must leave the centre line; None where it can follow the centre line.

    Args:
        itinerary: the way of the front.
        vehicle: whose body is to stay in the lane.
        lane_width: [m].
    """
    planned = plan(itinerary.course(lane_width), vehicle.body)
    if planned is None:
        return None
    line, arc = itinerary.path, itinerary.path.stations - itinerary.origin
    first, *_, last = stations = planned.stations.tolist()
    points = np.vstack((line.points[arc < first - FINE], planned.points, line.points[arc > last + FINE]))
    pace = QUICK * vehicle.steering_rate / (vehicle.wheelbase * np.maximum(planned.change, 1e-3))
    return AxlePath(Segment(f"{line.id} rear axle", points, line.turn), tuple(zip(stations, pace.tolist(), strict=True)))
