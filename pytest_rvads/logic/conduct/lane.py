"""Measures whether vehicles keep to their lane and to their route."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import directions
from pytest_rvads.geometry.sweep import LANE_TOLERANCE, Narrow, no_way
from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, Cast, signal, sized, window
from pytest_rvads.logic.conduct.bodies import headings
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import AXLE, usual_body
from pytest_rvads.support.errors import RunError

MAX_OFFSET = 3.0
"""Largest offset of a vehicle's front from its itinerary [m]; the largest offset of its rear axle is half as large.

A vehicle is off its route if both offsets are exceeded. The front alone swings out by up to 2 m in narrow bends.
"""
NEAR = 0.75
"""Largest difference between a vehicle's station and the station to which its front is projected on the itinerary [m]."""
_AROUND = 5.0
"""Largest difference between the station to which a rear axle or corner is projected and its station on a straight way [m]."""
_FINE = 0.1
"""Spacing of the points of a way whose distances from a corner are computed [m]; the shortest of these distances exceeds the
distance of the corner from the way by less than 1 mm."""
_SURE = 0.05
"""Distance of a body from the border of its lane below which the corners of the body are located exactly [m]."""


def beside(way: Itinerary, x: float, y: float, heading: float, station: float, length: float) -> bool:
    """Return whether a vehicle is off its route; `x`, `y` and `station` are those of its reference point [m]."""
    _, front = way.path.project(x, y, station + way.origin, NEAR)
    if abs(front) <= MAX_OFFSET:
        return False
    back = AXLE * length
    axle_x, axle_y = x - back * math.cos(heading), y - back * math.sin(heading)
    _, axle = way.path.project(axle_x, axle_y, station + way.origin - back, _AROUND)
    return abs(axle) > MAX_OFFSET / 2


class Ways:
    """The centre lines of several ways in one table, by which places on all these ways are computed at once."""

    def __init__(self, ways: Sequence[Itinerary]) -> None:
        self.ways = ways
        self.length = np.array([way.length for way in ways])
        self._origin = np.array([way.origin for way in ways])
        inner = (way.path.stations[1:-1] + number * _FAR for number, way in enumerate(ways))
        self._inner = np.concatenate([np.empty(0), *inner])
        self._points = np.concatenate([np.empty((0, 2)), *(way.path.points[:-1] for way in ways)])
        self._arc = np.concatenate([np.empty(0), *(way.path.stations[:-1] for way in ways)])
        self._ahead = np.concatenate([np.empty((0, 2)), *(directions(way.path) for way in ways)])

    def centre(self, way: NDArray[np.int64], station: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points of centre lines [m], and the directions of the lines at these points, both of shape ``(places, 2)``."""
        along = station + self._origin.take(way)
        # A way of k pieces has k - 1 points between them.
        piece = np.searchsorted(self._inner, along + way * _FAR, side="right") + way
        ahead = self._ahead.take(piece, axis=0)
        return self._points.take(piece, axis=0) + (along - self._arc.take(piece))[:, None] * ahead, ahead

    def offset(self, way: NDArray[np.int64], points: NDArray[np.float64], station: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the offsets of points to the left of their ways at given stations, shape ``(places,)`` [m]."""
        place, ahead = self.centre(way, station)
        apart = points - place
        return ahead[:, 0] * apart[:, 1] - ahead[:, 1] * apart[:, 0]

    def nearest(self, way: NDArray[np.int64], points: NDArray[np.float64], station: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the stations at which centre lines are nearest to points, ``(places,)`` [m]; `station` gives them roughly."""
        for _ in range(3):
            place, ahead = self.centre(way, station)
            station = station + ((points - place) * ahead).sum(axis=1)
        return station

    def near(
        self, way: NDArray[np.int64], points: NDArray[np.float64], station: NDArray[np.float64], reach: float
    ) -> NDArray[np.bool_]:
        """Return whether the way has a point within `_AROUND` of the station that is at most `reach` [m] away from each point.

        The method checks results of `nearest`, which can be wrong where a centre line jumps sideways.
        """
        beside = np.arange(-_AROUND, _AROUND + _FINE, _FINE)
        place, _ = self.centre(np.repeat(way, len(beside)), (station[:, None] + beside).ravel())
        apart = points[:, None] - place.reshape(len(points), len(beside), 2)
        return np.asarray((np.hypot(apart[..., 0], apart[..., 1]) <= reach).any(axis=1))


_FAR = 1e6
"""Distance by which the stations of successive ways are set apart in the sorted table of all ways [m]."""


def _ways(cast: Cast) -> Ways:
    if not cast.junction.drivable:
        raise RunError("the run holds no geometry of its junction")
    return Ways([itinerary(cast.junction, *agent.way.key) for agent in cast.agents])


def _placed(block: Block, columns: Sequence[int]) -> None:
    block.need("pose")
    _in_lanes(block, columns)


def _in_lanes(block: Block, columns: Sequence[int]) -> None:
    block.cast.static(_ways)
    sized(block, columns)


@signal(needs=_placed)
def off_route(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is off its route, see `beside`."""
    pose, station, ways = block.need("pose"), block.need("station"), block.cast.static(_ways)
    off = np.zeros(block.zone.shape, dtype=np.bool_)
    rows, columns, (offset, _), _ = _beside(block)
    # Projection takes long. Only vehicles whose offset at their station is large are projected.
    far = np.flatnonzero(np.abs(offset) > MAX_OFFSET - 2 * NEAR).tolist()
    for row, column in ((int(rows[k]), int(columns[k])) for k in far):
        x, y, heading = pose[row, column].tolist()
        length = float(block.cast.length[column])
        off[row, column] = beside(ways.ways[column], x, y, heading, float(station[row, column]), length)
    return off


@signal(needs=_in_lanes)
def off_lane(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is outside its lane: a corner of its body on a road, the middle of its front in the junction.

    The borders of the lane are half a lane beside the itinerary. A vehicle may cross a border by up to `LANE_TOLERANCE`.
    """
    ways, half = block.cast.static(_ways), block.junction.lane_width / 2 + LANE_TOLERANCE
    rows, columns, _, apart = _beside(block)
    # Only the corners of vehicles so far beside their itinerary can cross a border.
    far = (apart > half - block.cast.width[columns] / 2 - _SURE).any(axis=0)
    rows, columns = rows[far], columns[far]
    outside = np.zeros(block.zone.shape, dtype=np.bool_)
    if not len(rows):
        return outside
    pose, station = block.need("pose")[rows, columns], block.need("station")[rows, columns]
    length, width = block.cast.length[columns], block.cast.width[columns]
    # The four corners in succession: (front, rear) times (right, left).
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    across = np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1) * width[:, None] / 2
    backs = (np.zeros_like(length), length)
    corners = np.concatenate([pose[:, :2] - back[:, None] * ahead + side * across for back in backs for side in (-1, 1)])
    around, four = np.concatenate([station - back for back in backs for _ in range(2)]), np.tile(columns, 4)
    place = ways.nearest(four, corners, around)
    over = (place <= 0.0) | (place >= ways.length[four])
    over &= np.abs(ways.offset(four, corners, place)) > half
    out = np.flatnonzero(over)
    over[out] = ~ways.near(four[out], corners[out], around[out], half)
    strayed = (block.zone[rows, columns] == JUNCTION) & (np.abs(ways.offset(columns, pose[:, :2], station)) > half)
    outside[rows, columns] = strayed | over.reshape(4, -1).any(axis=0)
    return outside


@signal
def _beside(block: Block) -> tuple[NDArray[Any], ...]:
    """Return the rows and columns of all present vehicles, and how far the middles of front and rear are from the way.

    The third array has the offsets to the left, the fourth the distances, both of shape ``(2, places)`` [m].
    """
    ways, present = block.cast.static(_ways), np.flatnonzero(block.here)
    rows, columns = np.divmod(present, len(block.cast) or 1)
    front, station = block.need("pose")[..., :2].reshape(-1, 2).take(present, axis=0), block.need("station").take(present)
    length = block.cast.length.take(columns)
    points = np.concatenate((front, front - length[:, None] * headings(block).reshape(-1, 2).take(present, axis=0)))
    place, ahead = ways.centre(np.concatenate((columns, columns)), np.concatenate((station, station - length)))
    apart = points - place
    offset = ahead[:, 0] * apart[:, 1] - ahead[:, 1] * apart[:, 0]
    return rows, columns, offset.reshape(2, -1), np.hypot(apart[:, 0], apart[:, 1]).reshape(2, -1)


def too_tight(run: Run, agent: int) -> tuple[Narrow, float] | None:
    """Return the bend in which no path keeps the body of the agent in its lane, and the agent's smallest turning radius [m].

    The result is None without such a bend, or if the run lacks the geometry or the size of the agent. A vehicle whose radius the
    facts do not state steers like a usual car of its length.
    """
    who = run.agents[agent]
    if not run.junction.drivable or who.size is None:
        return None
    body = usual_body(*who.size)
    body = body._replace(radius=dict(run.facts.turning).get(who.name) or body.radius)
    start = float(run.need("station")[window(run, (agent,))[0], agent])
    narrow = no_way(itinerary(run.junction, *who.way.key).course(run.junction.lane_width, start), body)
    return None if narrow is None else (narrow, body.radius)


def beyond_steering(run: Run, agent: int) -> bool:
    """Return whether the agent was outside its lane only in a bend in which no path keeps the vehicle in its lane.

    The bend reaches from the agent's entry into the junction until its rear has left the junction, and includes in any case the
    place where the best path leaves the lane.
    """
    bend = too_tight(run, agent)
    if bend is None:
        return False
    station, (narrow, _) = run.need("station")[:, agent], bend
    turning = (station > narrow.start) & (station < narrow.end)
    return not (off_lane(run, agent) & ~turning).any()


@lru_cache(maxsize=1024)
def wrong_lanes(junction: Junction, entrance: int, exit: int) -> tuple[int, ...]:
    """Return the entrances of the same arm as `entrance` from which no movement leads to the arm of `exit`."""
    arm, exit_arm = junction.starts[entrance].arm, junction.ends[exit].arm
    leading = {start for start, end in junction.movements if junction.exits[end].arm == exit_arm}
    return tuple(lane for lane in junction.arms[arm].entrances if lane not in leading)


def lane_allows(run: Run, agent: int) -> NDArray[np.bool_]:
    """Return whether the lane nearest to the agent's front leads to the arm of its exit; true unless it is at its entrance."""
    junction, who = run.junction, run.agents[agent]
    pose, station = run.need("pose")[:, agent], run.need("station")[:, agent]
    if not junction.drivable:
        raise RunError("the run holds no geometry of its junction")
    ticks = np.flatnonzero(run.zone[:, agent] == ENTRANCE)
    points, along = pose[ticks, :2], station[ticks]
    arm = junction.entrances[who.entrance].arm
    lanes = {who.entrance: who.exit}
    for entrance, exit in sorted(junction.movements):
        if junction.entrances[entrance].arm == arm:
            lanes.setdefault(entrance, exit)
    ways = Ways([itinerary(junction, *key) for key in lanes.items()])
    numbers = (np.full(len(ticks), number) for number in range(len(lanes)))
    apart = [np.abs(ways.offset(number, points, ways.nearest(number, points, along))) for number in numbers]
    lane = np.array(list(lanes))[np.argmin(apart, axis=0)]
    allowed = np.ones(run.steps, dtype=np.bool_)
    allowed[ticks] = ~np.isin(lane, wrong_lanes(junction, *who.way.key))
    return allowed
