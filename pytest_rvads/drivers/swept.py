"""The way of the rear axle through a narrow bend: the body that it drags and swings along stays in the lane where it can.

The way is found once per itinerary and vehicle, by a Gauss-Newton descent over its offsets from the smoothed centre line.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.lane import LANE_TOLERANCE
from pytest_rvads.maps.segment import Segment
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["AxlePath", "Sweep", "axle_path"]

Array = NDArray[np.float64]

STEP = 0.5
"""Distance between two points of the way [m]."""
FINE = 0.25
"""Distance between two points of the centre line that bodies are measured against [m]."""
AROUND = 4.0
"""How far along the centre line the place of a corner is looked for, beyond where the corner were on a straight way [m]."""
BEFORE, BEHIND = 2.0, 20.0
"""How far the search reaches, before the rear axle of a vehicle at the stopping line and behind the junction [m]."""
EARLY = 1.0
"""How far before the stopping line the front may leave the centre line [m]: vehicles stop and start there, in their lane."""
BLUR = 2.5
"""Standard deviation of the smoothing of the centre line [m]: sharper corners are no way of an axle."""
MARGIN = 0.2
"""Kept from the border that `keep_lane` allows [m]: the tracking errs by so much."""
RESERVE = 0.97
"""Share of the sharpest curvature of the vehicle that is planned with."""
PACE = 1.8
"""Speed at which the front wheels must be able to turn as the way demands [m/s]."""
QUICK = 0.7
"""Share of the steering rate that the way may take."""
ROUNDS = 80
"""Steps of the descent, at most."""
DONE = 0.02
"""Weighted errors that are good enough: 1 cm over the border, or an offset of 0.5 m along 25 m."""
_STEER, _TURN, _JERK = 100.0, 10.0, 0.6
"""Weights of curvature beyond the vehicle's [m], of its change beyond what the wheels can turn, and of every change [m^2]."""
_LANE, _INSIDE, _CENTRE = 20.0, 2.0, 0.02
"""Weights of bodies over the border, of corners over it inside the junction, and of offsets [1/m].

All weights are chosen, not measured: what `keep_lane` judges comes before the rest."""


class Sweep:
    """What a body sweeps while its rear axle follows a way beside an itinerary.

    Args:
        itinerary: the way of the front, which stays as it is.
        vehicle: whose body.
        half: from the centre line to the border that the body must not pass [m].
    """

    def __init__(self, itinerary: Itinerary, vehicle: Vehicle, half: float) -> None:
        self._half, self._length = half, itinerary.length
        self._back, self._rear = vehicle.rear_axle_offset, vehicle.length - vehicle.rear_axle_offset
        self._side = vehicle.width / 2.0
        self._most = RESERVE / vehicle.turning_radius
        self._swift = QUICK * vehicle.steering_rate / (vehicle.wheelbase * PACE)
        first = max(-itinerary.origin, itinerary.line - self._back - BEFORE)
        last = min(itinerary.end, itinerary.length + BEHIND)
        self.stations = np.arange(first, last, STEP)
        reach = self._back + self._rear + 2.0 * AROUND
        count = round((last - first + reach) / FINE) + 4
        fine = np.asarray(first - self._rear - AROUND + FINE * np.arange(count), dtype=np.float64)
        self._fine, (self._places, _) = fine, itinerary.centre(fine)
        # Per station the points of the centre line among which corners of the body there are nearest to one.
        self._near = np.arange(round(reach / FINE)) + np.arange(len(self.stations))[:, None] * round(STEP / FINE)
        beside = np.arange(-4.0 * BLUR, 4.0 * BLUR + STEP / 2, STEP)
        weights = np.exp(-0.5 * (beside / BLUR) ** 2)
        spread, _ = itinerary.centre((self.stations[:, None] + beside).ravel())
        blurred = (spread.reshape(len(self.stations), -1, 2) * weights[:, None]).sum(axis=1) / weights.sum()
        self.centre, _ = itinerary.centre(self.stations)
        self.free = np.ones(len(self.stations), dtype=np.bool_)
        self.free[self.stations < itinerary.line - self._back - EARLY] = self.free[-3:] = False
        self._base = np.where(self.free[:, None], blurred, self.centre)
        along = np.gradient(self._base, axis=0)
        self._left = np.stack((-along[:, 1], along[:, 0]), axis=-1) / np.hypot(along[:, 0], along[:, 1])[:, None]

    def way(self, offsets: Array) -> Array:
        """Return the points of the rear axle, shape ``(stations, 2)``."""
        points: Array = self._base + offsets[:, None] * self._left
        return points

    def over(self, points: Array) -> tuple[Array, Array]:
        """Return how far the body reaches over the border [m]: what `keep_lane` looks at, and other corners."""
        along = np.gradient(points, axis=0)
        ahead = along / np.hypot(along[:, 0], along[:, 1])[:, None]
        left = np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1)
        shape = [(self._back, 0.0), *((x, y) for x in (self._back, -self._rear) for y in (-self._side, self._side))]
        spots = np.stack([points + x * ahead + y * left for x, y in shape], axis=1)
        apart = spots[:, :, None, :] - self._places[self._near][:, None, :, :]
        square = (apart * apart).sum(axis=-1)
        nearest = square.argmin(axis=-1)
        far = np.sqrt(np.take_along_axis(square, nearest[..., None], axis=-1)[..., 0]) - self._half
        place = np.take_along_axis(self._fine[self._near], nearest, axis=1)
        inside = (place > 0.0) & (place < self._length)
        judged = inside.copy()
        judged[:, 1:] = ~inside[:, 1:]
        far = np.maximum(far, 0.0)
        return np.where(judged, far, 0.0), np.where(judged, 0.0, far)

    def curvature(self, points: Array) -> Array:
        """Return the curvature at every point but the first and the last [1/m]."""
        one, two = points[1:-1] - points[:-2], points[2:] - points[1:-1]
        cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
        sizes = [np.hypot(*side.T) for side in (one, two, one + two)]
        bend: Array = 2.0 * cross / (sizes[0] * sizes[1] * sizes[2])
        return bend

    def fits(self, points: Array) -> bool:
        """Return whether a vehicle can follow a way, and `keep_lane` finds nothing wrong with its body there."""
        return bool((np.abs(self.curvature(points)) <= self._most).all() and not self.over(points)[0].any())

    def errors(self, offsets: Array) -> Array:
        """Return what is wrong with a way, weighted, a row per station."""
        points = self.way(offsets)
        bend = np.pad(self.curvature(points), 1)
        judged, others = self.over(points)
        sharp = np.maximum(np.abs(bend) - self._most, 0.0)
        change = np.diff(bend, append=0.0) / STEP
        swift = np.maximum(np.abs(change) - self._swift, 0.0)
        bends = _STEER * sharp, _TURN * swift, _JERK * change
        return np.column_stack((*bends, _LANE * judged, _INSIDE * others, _CENTRE * offsets))

    def relax(self) -> Array:
        """Return the offsets of the best way found [m]."""
        count = len(self.stations)
        offsets = np.zeros(count)
        damping, best = 1.0, self.errors(offsets)
        cost = float((best * best).sum())
        band, nudge = 5, 1e-4
        for _ in range(ROUNDS):
            slopes = np.zeros((*best.shape, count))
            for colour in range(band):
                moved = np.zeros(count)
                moved[colour::band] = nudge
                change = (self.errors(offsets + moved) - best) / nudge
                for k in range(colour, count, band):
                    rows = slice(max(k - band // 2, 0), k + band // 2 + 1)
                    slopes[rows, :, k] = change[rows]
            slopes[:, :, ~self.free] = 0.0
            flat = slopes.reshape(-1, count)
            normal, pull = flat.T @ flat, flat.T @ best.ravel()
            for _ in range(12):
                trial = offsets - np.linalg.solve(normal + damping * np.eye(count), pull)
                errors = self.errors(trial)
                lower = float((errors * errors).sum())
                if lower < cost:
                    break
                damping *= 6.0
            else:
                break
            done = lower < DONE or cost - lower < 1e-3 * cost
            offsets, best, cost, damping = trial, errors, lower, max(damping / 6.0, 1e-6)
            if done:
                break
        return offsets


class AxlePath(NamedTuple):
    """The way of a rear axle beside the itinerary."""

    path: Segment
    pace: tuple[tuple[float, float], ...]
    """Stations of the rear axle on the itinerary [m], and how fast the wheels can turn as the path demands there [m/s]."""


@lru_cache(maxsize=256)
def axle_path(itinerary: Itinerary, vehicle: Vehicle, lane_width: float) -> AxlePath | None:
    """Return the way of the rear axle where it must leave the centre line, found once; None where it can follow the centre line.

    Args:
        itinerary: the way of the front.
        vehicle: whose body is to stay in the lane.
        lane_width: [m].
    """
    sweep = Sweep(itinerary, vehicle, lane_width / 2.0 + LANE_TOLERANCE - MARGIN)
    if sweep.fits(sweep.centre):
        return None
    # Rounded to 0.1 mm: the last bits depend on how many threads the linear algebra has, and a run must not.
    way = sweep.way(np.round(sweep.relax(), 4))
    path, arc = itinerary.path, itinerary.path.stations - itinerary.origin
    first, *_, last = sweep.stations.tolist()
    points = np.vstack((path.points[arc < first - FINE], way, path.points[arc > last + FINE]))
    change = np.abs(np.diff(np.pad(sweep.curvature(way), 1), append=0.0)) / STEP
    pace = QUICK * vehicle.steering_rate / (vehicle.wheelbase * np.maximum(change, 1e-3))
    pairs = zip(sweep.stations.tolist(), pace.tolist(), strict=True)
    return AxlePath(Segment(f"{path.id} rear axle", points, path.turn), tuple(pairs))
