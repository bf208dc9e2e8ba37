"""What a body sweeps in a bend, and whether any path of its rear axle keeps the body in the lane.

A path is a row of offsets from the smoothed centre line, found by a Gauss-Newton descent. Drivers follow the path, `keep_lane`
asks whether there is one, and so does the report of a map.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.junctions.bends import LEAST_RADIUS, least_radius
from pytest_rvads.junctions.least_squares import BAND, normal_bands, pull, solved
from pytest_rvads.maps.segment import Segment, join

__all__ = [
    "CAR",
    "EXIT_LENGTH",
    "LANE_TOLERANCE",
    "STEP",
    "Body",
    "Course",
    "Sweep",
    "no_way",
    "plan",
    "through",
    "with_roads",
]

Array = NDArray[np.float64]

LANE_TOLERANCE = 0.3
"""How far a body may reach over the border of its lane [m]; about as much as lane keeping of people varies."""
STEP = 0.5
"""Distance between two points of the path [m]."""
FINE = 0.25
"""Distance between two points of the centre line that bodies are measured against [m]."""
AROUND = 4.0
"""How far along the centre line the place of a corner is looked for, around where the corner were on a straight path [m]."""
EXIT_LENGTH = 60.0
"""How much of the exit road belongs to the way of a vehicle, at most [m]."""
BEFORE, BEHIND = 12.0, 15.0
"""How far the search reaches, before the stopping line and behind the junction [m]."""
BLUR = 2.5
"""Standard deviation of the smoothing of the centre line [m]: sharper corners are no path of an axle."""
MARGIN = 0.2
"""Kept from the border that `keep_lane` allows where there is room for it [m]: the tracking errs by so much."""
RESERVE = 0.97
"""Share of the sharpest curvature of the vehicle that is planned with where that suffices."""
LEAST = 0.03
"""Margin that a path must leave to count as one that keeps the lane [m]: the rear axle errs by so much at a walking pace."""
LITTLE, MOST = 0.08, 0.98
"""Margin [m] and share that are planned with where nothing fits with `MARGIN` and `RESERVE`."""
WITHIN = math.tan(0.61) / (0.7 * 0.8 / 1.8)
"""Length of path within which the wheels turn from straight on to their limit, at the soonest [m].

Those of a car do so, by 0.61 rad, with 0.7 of their 0.8 rad/s at 1.8 m/s."""
ROUNDS = 80
"""Steps of the descent, at most."""
DONE = 0.02
"""Weighted errors that are good enough: 1 cm over the border, or an offset of 0.5 m along 25 m."""
_STEER, _TURN, _JERK = 100.0, 10.0, 0.6
"""Weights of curvature beyond the vehicle's [m], of its change beyond what the wheels can turn, and of every change [m^2]."""
_LANE, _INSIDE, _CENTRE = 20.0, 2.0, 0.02
"""Weights of bodies over the border, of corners over it inside the junction, and of offsets [1/m].

All weights are chosen, not measured: what `keep_lane` judges comes before the rest."""
_NUDGE = 1e-4
"""Change of an offset that slopes are measured with [m]."""


class Body(NamedTuple):
    """What of a vehicle decides where it can go."""

    length: float
    """Bumper to bumper [m]."""
    width: float
    """[m]."""
    axle: float
    """Front bumper to rear axle [m]."""
    radius: float
    """Of the circle on which the rear axle drives with the wheels turned as far as they go [m]."""


class Course(NamedTuple):
    """The centre line of an approach, a movement and an exit road, with the width of its lane."""

    path: Segment
    origin: float
    """Arc length of the entrance vertex on `path` [m]."""
    length: float
    """Of the movement [m]."""
    start: float
    """Station of the front where a path begins on the centre line [m]."""
    lane_width: float
    """[m]."""
    behind: float = BEHIND
    """How much of the exit road belongs to it, at most [m]."""


CAR = Body(4.6, 1.86, 3.65, LEAST_RADIUS)
"""A usual car."""


@lru_cache(maxsize=256)
def through(approach: Segment, movement: Segment, road: Segment) -> Segment | None:
    """Return the centre line of a vehicle's way, joined once; None where the segments do not meet."""
    return join((approach, movement, road if road.length <= EXIT_LENGTH else road.head(EXIT_LENGTH)))


class Sweep:
    """What a body sweeps while its rear axle follows a path beside a centre line.

    Args:
        course: the centre line.
        body: what drives there.
        margin: kept from the border that `keep_lane` allows [m].
        share: of the sharpest curvature of the vehicle that is allowed.
    """

    def __init__(self, course: Course, body: Body, margin: float, share: float, firm: float = 1.0) -> None:
        self._firm, self._margin = firm, margin
        self._half, self._length = course.lane_width / 2.0 + LANE_TOLERANCE - margin, course.length
        self._back, self._rear = body.axle, body.length - body.axle
        self._side, self._most, self._swift = body.width / 2.0, share / body.radius, 1.0 / (body.radius * WITHIN)
        path, origin = course.path, course.origin
        first = course.start - self._back
        last = min(path.length - origin, course.length + course.behind)
        self.stations = np.arange(first, last, STEP)
        count = len(self.stations)
        points = round((last - first + self._back + self._rear + 2.0 * AROUND) / FINE) + 4
        fine = np.asarray(first - self._rear - AROUND + FINE * np.arange(points), dtype=np.float64)
        self._fine, (self._places, _) = fine, path.centre(fine + origin)
        # Middle of the front, then corners: of each the points of the centre line among which the nearest one is.
        ahead = np.array([self._back, self._back, self._back, -self._rear, -self._rear])
        self._shape = ahead[:, None], np.array([0.0, -self._side, self._side, -self._side, self._side])[:, None]
        start = np.arange(count)[:, None] * round(STEP / FINE) + np.round((ahead + self._rear) / FINE).astype(np.int64)
        self._near = start[:, :, None] + np.arange(round(2.0 * AROUND / FINE))
        beside = np.arange(-4.0 * BLUR, 4.0 * BLUR + STEP / 2, STEP)
        weights = np.exp(-0.5 * (beside / BLUR) ** 2)
        spread, _ = path.centre((self.stations[:, None] + beside).ravel() + origin)
        blurred = (spread.reshape(count, -1, 2) * weights[:, None]).sum(axis=1) / weights.sum()
        self.centre, _ = path.centre(self.stations + origin)
        self.free = np.ones(count, dtype=np.bool_)
        self.free[:2] = self.free[-3:] = False
        self._base = np.where(self.free[:, None], blurred, self.centre)
        # A vehicle starts with its front on the centre line, and points away from where its rear axle would be there.
        front, _ = path.centre(np.array([course.start + origin]))
        ahead = (front[0] - self._base[0]) / math.dist(front[0], self._base[0])
        self._base[:2] = front - np.array([[self._back], [self._back - STEP]]) * ahead
        along = np.gradient(self._base, axis=0)
        self._left = np.stack((-along[:, 1], along[:, 0]), axis=-1) / np.hypot(along[:, 0], along[:, 1])[:, None]

    def way(self, offsets: Array) -> Array:
        """Return the points of the rear axle, shape ``(stations, 2)``."""
        points: Array = self._base + offsets[:, None] * self._left
        return points

    def _spots(self, points: Array) -> Array:
        """Return the middle of the front and the corners of the body, shape ``(stations, 5, 2)``."""
        along = np.gradient(points, axis=0)
        ahead = (along / np.hypot(along[:, 0], along[:, 1])[:, None])[:, None, :]
        left = np.stack((-ahead[..., 1], ahead[..., 0]), axis=-1)
        x, y = self._shape
        spots: Array = points[:, None, :] + x * ahead + y * left
        return spots

    def nearest(self, points: Array) -> NDArray[np.int64]:
        """Return which points of the centre line are nearest to front and corners, shape ``(stations, 5)``."""
        apart = self._spots(points)[:, :, None, :] - self._places[self._near]
        square = apart[..., 0] ** 2 + apart[..., 1] ** 2
        return np.take_along_axis(self._near, square.argmin(axis=-1)[..., None], axis=-1)[..., 0]

    def over(self, points: Array, nearest: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return how far the body reaches over the border [m]: what `keep_lane` looks at, and other corners."""
        apart = self._spots(points) - self._places[nearest]
        far = np.maximum(np.hypot(apart[..., 0], apart[..., 1]) - self._half, 0.0)
        place = self._fine[nearest]
        joint = STEP if self._margin > LEAST else STEP / 2.0
        judged = (place <= joint) | (place >= self._length - joint)
        judged[:, 0] = (place[:, 0] > 0.0) & (place[:, 0] < self._length)
        return np.where(judged, far, 0.0), np.where(judged, 0.0, far)

    def curvature(self, points: Array) -> Array:
        """Return the curvature at every point but the first and the last [1/m]."""
        one, two = points[1:-1] - points[:-2], points[2:] - points[1:-1]
        cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
        sizes = [np.hypot(*side.T) for side in (one, two, one + two)]
        bend: Array = 2.0 * cross / (sizes[0] * sizes[1] * sizes[2])
        return bend

    def amiss(self, points: Array) -> Array:
        """Return the stations where a vehicle can't follow a path, or `keep_lane` finds something wrong with its body [m]."""
        judged, _ = self.over(points, self.nearest(points))
        stations: Array = self.stations[judged.any(axis=1) | (np.abs(np.pad(self.curvature(points), 1)) > self._most)]
        return stations

    def errors(self, offsets: Array, nearest: NDArray[np.int64]) -> Array:
        """Return what is wrong with a path, weighted, a row per station."""
        points = self.way(offsets)
        bend = np.pad(self.curvature(points), 1)
        judged, others = self.over(points, nearest)
        sharp = np.maximum(np.abs(bend) - self._most, 0.0)
        change = np.diff(bend, append=0.0) / STEP
        swift = np.maximum(np.abs(change) - self._swift, 0.0)
        bends = self._firm * _STEER * sharp, _TURN * swift, _JERK * change
        return np.column_stack((*bends, self._firm * _LANE * judged, _INSIDE * others, _CENTRE * offsets))

    def relax(self, offsets: Array) -> Array:
        """Return the offsets of the best path that a descent from some `offsets` finds [m]."""
        damping, damped = 1.0, True
        nearest = self.nearest(self.way(offsets))
        best = self.errors(offsets, nearest)
        cost = float((best * best).sum())
        for _ in range(ROUNDS):
            slopes = self._slopes(offsets, best, nearest)
            bands = normal_bands(slopes)
            force = pull(slopes, best)
            for _ in range(12):
                trial = offsets - solved(bands, damping, force)
                near = self.nearest(self.way(trial))
                errors = self.errors(trial, near)
                lower = float((errors * errors).sum())
                if damped := lower < cost:
                    break
                damping *= 6.0
            if not damped:
                break
            done = lower < DONE or cost - lower < 1e-3 * cost
            offsets, best, nearest, cost, damping = trial, errors, near, lower, max(damping / 6.0, 1e-6)
            if done:
                break
        return offsets

    def _slopes(self, offsets: Array, errors: Array, nearest: NDArray[np.int64]) -> Array:
        """Return how the errors of a station change with the offsets around, shape ``(stations, errors, BAND)`` [1/m]."""
        station = np.arange(len(offsets))
        slopes = np.zeros((*errors.shape, BAND))
        for colour in range(BAND):
            moved = np.zeros(len(offsets))
            moved[colour::BAND] = _NUDGE
            moved[~self.free] = 0.0
            change = (self.errors(offsets + moved, nearest) - errors) / _NUDGE
            slopes[station, :, (colour - station + BAND // 2) % BAND] = change
        return slopes


def with_roads(course: Course, start: float, body: Body) -> Course:
    """Return a course that reaches far enough to hold the bends of the roads in which a body would leave its lane.

    Args:
        course: the way through the junction.
        start: station of the front from which on the approach counts [m].
        body: what drives there, with its rear axle on the centre line.
    """
    start = max(start, -course.origin)
    whole = Sweep(course._replace(start=start, behind=math.inf), body, MARGIN, RESERVE)
    judged, _ = whole.over(whole.centre, whole.nearest(whole.centre))
    amiss = whole.stations[judged.any(axis=1)]
    if not len(amiss):
        return course
    first, last = (amiss[[0, -1]] + body.axle).tolist()
    return course._replace(
        start=max(start, min(course.start, first - BEFORE)), behind=max(course.behind, last - course.length + BEHIND)
    )


class Plan(NamedTuple):
    """A path of a rear axle that leaves the centre line."""

    stations: Array
    """Of the points on the centre line [m]."""
    points: Array
    """Shape ``(stations, 2)`` [m]."""
    bend: Array
    """Curvature at every point, shape ``(stations,)`` [1/m]."""
    amiss: Array
    """Stations of the rear axle where the vehicle can't follow the path, or does not keep its lane [m]."""


@lru_cache(maxsize=1024)
def plan(course: Course, body: Body) -> Plan | None:
    """Return the path of the rear axle that keeps a body in its lane best; None where the centre line will do."""
    roomy, exact = Sweep(course, body, MARGIN, RESERVE), Sweep(course, body, LEAST, 1.0)
    if not len(roomy.amiss(roomy.centre)):
        return None
    offsets = roomy.relax(np.zeros(len(roomy.stations)))
    close = Sweep(course, body, LITTLE, MOST, 10.0)
    if len(close.amiss(close.way(offsets))):
        offsets = close.relax(offsets)
    points = exact.way(offsets)
    amiss = exact.amiss(points)
    return Plan(exact.stations, points, np.pad(exact.curvature(points), 1), close.amiss(points) if len(amiss) else amiss)


class Narrow(NamedTuple):
    """A bend in which no path of the rear axle keeps a body in its lane."""

    radius: float
    """The least one of the centre line [m]."""
    start: float
    """Station of the front from which on the lane can't be kept for certain [m]: at the latest, the entrance vertex."""
    end: float
    """Station of the front up to which it can't [m]: at the soonest, where the rear leaves the junction."""


def no_way(course: Course, body: Body) -> Narrow | None:
    """Return where no path of the rear axle is found that keeps the body in its lane; None where there is one.

    A bend is not planned where even the ring that the body sweeps on a circle of its radius is narrower than the lane.
    """
    first = course.start - body.length - AROUND
    bend, _ = course.path.centre(np.arange(first, course.length + BEHIND, STEP) + course.origin)
    radius = least_radius(bend)
    ring = math.hypot(radius + body.width / 2.0, body.axle) - (radius - body.width / 2.0)
    if radius >= body.radius and ring <= course.lane_width + 2.0 * LANE_TOLERANCE:
        return None
    path = plan(course, body)
    if path is None or not len(path.amiss):
        return None
    first, last = (path.amiss[[0, -1]] + body.axle).tolist()
    return Narrow(radius, min(first - body.length - STEP, 0.0), max(last + STEP, course.length) + body.length)
