"""The area that a body sweeps in a bend, and the search for a path of its rear axle that keeps the body in the lane.

A path is a sequence of offsets from the smoothed centre line, found by a Gauss-Newton descent. Drivers follow the path. The rule
`keep_lane` and the report of a map use whether a path exists. The descent solves its normal equations by elimination within their
bands, because the last bits of numpy's solvers depend on the number of threads, and runs have to be bit-identical.

A path is searched once per way and body, and only if a vehicle on the centre line would break the rule `keep_lane` in the
junction or on the roads at the junction. Before and behind such a path, drivers follow the centre line. Stations are always
measured along the centre line.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import LEAST_RADIUS, Segment, join, least_radius
from pytest_rvads.geometry.ways import Entrance, Exit, Movement

BAND = 5
"""Number of unknowns on which the errors of a row depend: the unknown of the row and two on either side."""


def normal_bands(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bands of the normal matrix: entry (k, k + m) at ``[m, k]``, shape ``(BAND, unknowns)``.

    `slopes` are the derivatives of the errors of every row by the unknowns of its band, shape ``(unknowns, errors, BAND)``.
    """
    count, half = len(slopes), BAND // 2
    products = np.einsum("nca,ncb->nab", slopes, slopes)
    padded = np.zeros((BAND, count + 2 * half))
    for a in range(BAND):
        for b in range(a, BAND):
            padded[b - a, a : a + count] += products[:, a, b]
    return padded[:, half : half + count]


def pull(slopes: NDArray[np.float64], errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of half the sum of the squared errors ``(unknowns, errors)`` by every unknown."""
    count, half = len(slopes), BAND // 2
    padded = np.zeros(count + 2 * half)
    for a in range(BAND):
        padded[a : a + count] += (slopes[:, :, a] * errors).sum(axis=1)
    return padded[half : half + count]


def solved(bands: NDArray[np.float64], damping: float, right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of the damped normal equations, by elimination within their bands."""
    count = len(right)
    rows = [list(row) for row in zip(*bands.tolist(), strict=True)]
    x = right.tolist() + [0.0] * (BAND - 1)
    for k in range(count):
        row = rows[k]
        row[0] += damping
        for m in range(1, BAND):
            if row[m]:
                share, below = row[m] / row[0], rows[k + m]
                for q in range(m, BAND):
                    below[q - m] -= share * row[q]
                x[k + m] -= share * x[k]
    for k in range(count - 1, -1, -1):
        row = rows[k]
        x[k] = (x[k] - sum(row[m] * x[k + m] for m in range(1, BAND))) / row[0]
    return np.array(x[:count])


Array = NDArray[np.float64]

LANE_TOLERANCE = 0.3
"""Largest distance by which the rule `keep_lane` allows a body to cross the border of its lane [m].

The distance is about the variation of the lateral position of human drivers.
"""
STEP = 0.5
"""Distance between two points of the path [m]."""
FINE = 0.25
"""Distance between two points of the centre line that bodies are measured against [m]."""
AROUND = 4.0
"""The station of a corner of a body is searched up to this distance from the corner's station on a straight path [m]."""
EXIT_LENGTH = 60.0
"""Longest part of the exit road that belongs to the way of a vehicle [m]."""
BEFORE, BEHIND = 12.0, 15.0
"""Length before the stopping line, and length behind the junction, that the search for a path includes [m]."""
BLUR = 2.5
"""Standard deviation of the smoothing of the centre line [m]; an axle can't follow sharper corners."""
MARGIN = 0.2
"""Distance that a path keeps from the border that `keep_lane` allows, if there is room [m]: the error of path tracking."""
RESERVE = 0.97
"""Share of the vehicle's sharpest curvature that a path uses, if a path with this share keeps the lane."""
LEAST = 0.03
"""Least margin of a path that counts as keeping the lane [m]: the error of the rear axle at a walking pace."""
LITTLE, MOST = 0.08, 0.98
"""Margin [m] and share of the sharpest curvature for a path, if no path fits with `MARGIN` and `RESERVE`."""
WITHIN = math.tan(0.61) / (0.7 * 0.8 / 1.8)
"""Least length of path in which the wheels turn from straight on to their limit [m].

The front wheels of a car turn by up to 0.61 rad, at up to 0.8 rad/s. The length is that at 0.7 of this rate and 1.8 m/s.
"""
ROUNDS = 80
"""Most steps of the descent."""
DONE = 0.02
"""Sum of weighted errors that is good enough: 1 cm over the border, or an offset of 0.5 m along 25 m."""
_STEER, _TURN, _JERK = 100.0, 10.0, 0.6
"""Weights of curvature beyond the vehicle's limit [m], of its change beyond the wheels' limit, and of every change [m^2]."""
_LANE, _INSIDE, _CENTRE = 20.0, 2.0, 0.02
"""Weights of bodies over the border, of corners over the border inside the junction, and of offsets [1/m].

All weights are chosen, not measured: the errors that `keep_lane` judges have priority.
"""
_NUDGE = 1e-4
"""Change of an offset from which derivatives are computed [m]."""


class Body(NamedTuple):
    """The measures of a vehicle that decide where it can go."""

    length: float
    """Length from bumper to bumper [m]."""
    width: float
    """Width [m]."""
    axle: float
    """Distance from the front bumper to the rear axle [m]."""
    radius: float
    """Radius of the circle of the rear axle with the wheels turned to their limit [m]."""


class Course(NamedTuple):
    """The centre line of an approach, a movement and an exit road, with the width of its lane."""

    path: Segment
    origin: float
    """Arc length of the entrance vertex on `path` [m]."""
    length: float
    """Length of the movement [m]."""
    start: float
    """Station of the front at which a path begins on the centre line [m]."""
    lane_width: float
    """Width of the lane [m]."""
    behind: float = BEHIND
    """Longest part of the exit road that the course includes [m]."""


CAR = Body(4.6, 1.86, 3.65, LEAST_RADIUS)


@lru_cache(maxsize=256)
def through(approach: Segment, movement: Segment, road: Segment) -> Segment | None:
    """Return the centre line of a vehicle's way, joined once; None if the segments do not meet."""
    return join((approach, movement, road if road.length <= EXIT_LENGTH else road.head(EXIT_LENGTH)))


def course_of(entrance: Entrance, movement: Movement, exit: Exit, lane_width: float) -> Course | None:
    """Return the course of a movement; None if one of its centre lines is not known, or if the lines do not meet."""
    approach, line, road = entrance.approach, movement.path, exit.road
    if approach is None or line is None or road is None or (path := through(approach, line, road)) is None:
        return None
    return Course(path, approach.length, line.length, max(-approach.length, min(-entrance.setback, 0.0) - BEFORE), lane_width)


class Sweep:
    """The area that a body sweeps while its rear axle follows a path beside a centre line.

    `margin` is the distance kept from the border that `keep_lane` allows [m], `share` the allowed share of the vehicle's sharpest
    curvature, and `firm` a factor of the weights of sharp curvature and of the border.
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
        # For the middle of the front and for every corner, the points of the centre line among which the nearest is searched.
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
        self.free[:2] = False
        self.free[-3:] = last == path.length - origin  # where the way of a vehicle ends, the path need not end on the centre line
        self._base = np.where(self.free[:, None], blurred, self.centre)
        # A vehicle starts with its front on the centre line, and its heading points from the first rear-axle point to the front.
        front, _ = path.centre(np.array([course.start + origin]))
        ahead = (front[0] - self._base[0]) / math.dist(front[0], self._base[0])
        self._base[:2] = front - np.array([[self._back], [self._back - STEP]]) * ahead
        along = np.gradient(self._base, axis=0)
        self._left = np.stack((-along[:, 1], along[:, 0]), axis=-1) / np.hypot(along[:, 0], along[:, 1])[:, None]

    def way(self, offsets: Array) -> Array:
        """Return the points of the rear axle on a path given by offsets, shape ``(stations, 2)``."""
        points: Array = self._base + offsets[:, None] * self._left
        return points

    def _spots(self, points: Array) -> Array:
        """Return the middle of the front and the corners of the body on a path, shape ``(stations, 5, 2)``."""
        along = np.gradient(points, axis=0)
        ahead = (along / np.hypot(along[:, 0], along[:, 1])[:, None])[:, None, :]
        left = np.stack((-ahead[..., 1], ahead[..., 0]), axis=-1)
        x, y = self._shape
        spots: Array = points[:, None, :] + x * ahead + y * left
        return spots

    def nearest(self, points: Array) -> NDArray[np.int64]:
        """Return the numbers of the points of the centre line nearest to front and corners, shape ``(stations, 5)``."""
        apart = self._spots(points)[:, :, None, :] - self._places[self._near]
        square = apart[..., 0] ** 2 + apart[..., 1] ** 2
        return np.take_along_axis(self._near, square.argmin(axis=-1)[..., None], axis=-1)[..., 0]

    def over(self, points: Array, nearest: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return how far the body is over the border [m]: at the points that `keep_lane` checks, and at the other corners."""
        apart = self._spots(points) - self._places[nearest]
        far = np.maximum(np.hypot(apart[..., 0], apart[..., 1]) - self._half, 0.0)
        place = self._fine[nearest]
        joint = STEP if self._margin > LEAST else STEP / 2.0
        judged = (place <= joint) | (place >= self._length - joint)
        judged[:, 0] = (place[:, 0] > 0.0) & (place[:, 0] < self._length)
        return np.where(judged, far, 0.0), np.where(judged, 0.0, far)

    def curvature(self, points: Array) -> Array:
        """Return the curvature at every point but the first and the last [1/m]."""
        step, next_step = points[1:-1] - points[:-2], points[2:] - points[1:-1]
        cross = step[:, 0] * next_step[:, 1] - step[:, 1] * next_step[:, 0]
        sizes = [np.hypot(*side.T) for side in (step, next_step, step + next_step)]
        bend: Array = 2.0 * cross / (sizes[0] * sizes[1] * sizes[2])
        return bend

    def amiss(self, points: Array) -> Array:
        """Return the stations where a vehicle can't follow a path, or where its body violates `keep_lane` [m]."""
        judged, _ = self.over(points, self.nearest(points))
        stations: Array = self.stations[judged.any(axis=1) | (np.abs(np.pad(self.curvature(points), 1)) > self._most)]
        return stations

    def errors(self, offsets: Array, nearest: NDArray[np.int64]) -> Array:
        """Return the weighted errors that the search of the best path makes small, a row per station."""
        points = self.way(offsets)
        bend = np.pad(self.curvature(points), 1)
        judged, others = self.over(points, nearest)
        sharp = np.maximum(np.abs(bend) - self._most, 0.0)
        change = np.diff(bend, append=0.0) / STEP
        swift = np.maximum(np.abs(change) - self._swift, 0.0)
        bends = self._firm * _STEER * sharp, _TURN * swift, _JERK * change
        return np.column_stack((*bends, self._firm * _LANE * judged, _INSIDE * others, _CENTRE * offsets))

    def relax(self, offsets: Array) -> Array:
        """Return the offsets of the best path found by a descent from given `offsets` [m]."""
        damping, damped, station = 1.0, True, np.arange(len(offsets))
        nearest = self.nearest(self.way(offsets))
        best = self.errors(offsets, nearest)
        cost = float((best * best).sum())
        for _ in range(ROUNDS):
            # The derivatives of a station's errors by the offsets around it, shape ``(stations, errors, BAND)`` [1/m].
            slopes = np.zeros((*best.shape, BAND))
            for colour in range(BAND):
                moved = np.zeros(len(offsets))
                moved[colour::BAND] = _NUDGE
                moved[~self.free] = 0.0
                change = (self.errors(offsets + moved, nearest) - best) / _NUDGE
                slopes[station, :, (colour - station + BAND // 2) % BAND] = change
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


def with_roads(course: Course, start: float, body: Body) -> Course:
    """Return a course that holds the bends in which a body would leave its lane, on the approach from station `start` on [m]."""
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
    """Stations of the points on the centre line [m]."""
    points: Array
    """Points of the path, shape ``(stations, 2)`` [m]."""
    bend: Array
    """Curvature at every point, shape ``(stations,)`` [1/m]."""
    amiss: Array
    """Stations of the rear axle where the vehicle can't follow the path, or does not keep its lane [m]."""


@lru_cache(maxsize=1024)
def plan(course: Course, body: Body) -> Plan | None:
    """Return the path of the rear axle that keeps a body in its lane best; None if the centre line is good enough."""
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
    """Least radius of the centre line [m]."""
    start: float
    """Station of the front from which on the lane certainly can't be kept [m]; at most the station of the entrance vertex."""
    end: float
    """Station of the front up to which the lane can't be kept [m]; at least the station at which the rear leaves the junction."""


def no_way(course: Course, body: Body) -> Narrow | None:
    """Return the bend in which no path of the rear axle keeps the body in its lane; None if a path is found.

    No path is planned for a bend in which the ring that the body sweeps on a circle with the radius of the bend fits in the lane.
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
