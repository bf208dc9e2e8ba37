"""Whether vehicles keep to their lane, and to their route at all."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.presence import window
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.junctions.sweep import LANE_TOLERANCE, Narrow, no_way
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import AXLE, Zone
from pytest_rvads.runs.vehicle import usual_body

__all__ = ["MAX_OFFSET", "NEAR", "beside", "lane_allows", "off_lane", "off_route", "too_tight", "wrong_lanes"]

MAX_OFFSET = 3.0
"""A vehicle whose front is this far to the side of its itinerary, and whose rear axle is half as far, is off its route [m].

The front alone swings out by 2 m in narrow bends."""
NEAR = 0.75
"""How far around its station the front of a vehicle is looked for on its itinerary [m]."""
_AROUND = 5.0
"""Likewise the rear axle, around the place where it would be on a straight way [m]."""
_SURE = 0.05
"""Nearer to a border than this, it is looked at where exactly a body is [m]."""


def beside(way: Itinerary, x: float, y: float, heading: float, station: float, length: float) -> bool:
    """Return whether a vehicle is off its route.

    Args:
        way: its itinerary.
        x: east coordinate of its reference point [m].
        y: north coordinate [m].
        heading: [rad].
        station: of the reference point [m].
        length: of the body [m].
    """
    _, front = way.path.project(x, y, station + way.origin, NEAR)
    if abs(front) <= MAX_OFFSET:
        return False
    back = AXLE * length
    axle_x, axle_y = x - back * math.cos(heading), y - back * math.sin(heading)
    _, axle = way.path.project(axle_x, axle_y, station + way.origin - back, _AROUND)
    return abs(axle) > MAX_OFFSET / 2


def off_route(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent is off its route, see `beside`."""
    pose, station = run.need("pose")[:, agent], run.need("station")[:, agent]
    way, length = _way(run, agent), run.size(agent)[0]
    found = np.zeros(run.steps, dtype=np.bool_)
    # Projecting takes a while, so it is done where a look at the place at that station says that it is worth it.
    far = np.abs(_offset(way, pose[:, :2], station)) > MAX_OFFSET - 2 * NEAR
    for tick in np.flatnonzero(far & run.here[:, agent]).tolist():
        x, y, heading = pose[tick].tolist()
        found[tick] = beside(way, x, y, heading, float(station[tick]), length)
    return found


def off_lane(run: Run, agent: int) -> NDArray[np.bool_]:
    """The body of the agent reaches over the border of its lane, on the roads; or its front leaves it, in the junction.

    Borders are half a lane beside the itinerary; `LANE_TOLERANCE` is allowed.
    """
    way, (length, width) = _way(run, agent), run.size(agent)
    half = run.junction.lane_width / 2 + LANE_TOLERANCE
    ticks = _aside(run, agent, way, half - width / 2)
    pose, station = run.need("pose")[ticks, agent], run.need("station")[ticks, agent]
    # The four corners one after the other: (front, rear) times (right, left).
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    across = np.stack((-ahead[:, 1], ahead[:, 0]), axis=-1) * width / 2
    corners = [pose[:, :2] - back * ahead + side * across for back in (0.0, length) for side in (-1, 1)]
    around = np.concatenate((station, station, station - length, station - length))
    place = _nearest(way, np.concatenate(corners), around)
    over = (place <= 0.0) | (place >= way.length)
    over &= np.abs(_offset(way, np.concatenate(corners), place)) > half
    strayed = (run.zone[ticks, agent] == Zone.JUNCTION) & (np.abs(_offset(way, pose[:, :2], station)) > half)
    found = np.zeros(run.steps, dtype=np.bool_)
    found[ticks] = strayed | over.reshape(4, -1).any(axis=0)
    return found


def too_tight(run: Run, agent: int) -> tuple[Narrow, float] | None:
    """Return the bend where no path keeps the body of the agent in its lane, and the least radius that it can steer [m].

    The facts of the run tell what a vehicle needs; one that they do not name steers as a usual car of its length does.
    """
    who = run.agents[agent]
    if not run.junction.drivable or who.size is None:
        return None
    body = usual_body(*who.size)
    body = body._replace(radius=dict(run.facts.turning).get(who.name) or body.radius)
    start = float(run.need("station")[window(run, (agent,))[0], agent])
    narrow = no_way(_way(run, agent).course(run.junction.lane_width, start), body)
    return None if narrow is None else (narrow, body.radius)


def _aside(run: Run, agent: int, way: Itinerary, room: float) -> NDArray[np.int64]:
    """Return the ticks in which the middle of front or rear is further than `room` [m] from the itinerary, or nearly so.

    Elsewhere no corner can be over a border: that is known without looking for the nearest place of each.
    """
    begin, end = window(run, (agent,))
    pose, station = run.need("pose")[begin:end, agent], run.need("station")[begin:end, agent]
    length = run.size(agent)[0]
    ahead = np.stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])), axis=-1)
    far = np.zeros(len(station), dtype=np.bool_)
    for back in (0.0, length):
        place, _ = way.centre(station - back)
        apart = pose[:, :2] - place
        apart -= back * ahead
        far |= np.hypot(apart[:, 0], apart[:, 1]) > room - _SURE
    return begin + np.flatnonzero(far & run.here[begin:end, agent])


@lru_cache(maxsize=1024)
def wrong_lanes(junction: Junction, entrance: int, exit: int) -> tuple[int, ...]:
    """Return the entrances beside `entrance` from which no movement leads to the arm of `exit`."""
    here, there = junction.entrances[entrance].arm, junction.exits[exit].arm
    leading = {one for one, other in junction.movements if junction.exits[other].arm == there}
    return tuple(lane for lane in junction.arms[here].entrances if lane not in leading)


def lane_allows(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent is not at its entrance, or in no lane of its arm that does not lead where it goes.

    It is in the lane whose centre line its front is nearest to.

    Raises:
        RunError: the run does not record positions, or holds no geometry of its junction.
    """
    junction, who = run.junction, run.agents[agent]
    pose, station = run.need("pose")[:, agent], run.need("station")[:, agent]
    there = np.flatnonzero(run.zone[:, agent] == Zone.ENTRANCE)
    points, along = pose[there, :2], station[there]
    ways = {who.entrance: _way(run, agent)}
    for entrance, exit in sorted(junction.movements):
        if junction.entrances[entrance].arm == junction.entrances[who.entrance].arm and entrance not in ways:
            ways[entrance] = itinerary(junction, entrance, exit)
    apart = [np.abs(_offset(way, points, _nearest(way, points, along))) for way in ways.values()]
    lane = np.array(list(ways))[np.argmin(apart, axis=0)]
    found = np.ones(run.steps, dtype=np.bool_)
    found[there] = ~np.isin(lane, wrong_lanes(junction, *who.route.key))
    return found


def _way(run: Run, agent: int) -> Itinerary:
    if not run.junction.drivable:
        raise RunError("the run holds no geometry of its junction")
    who = run.agents[agent]
    return itinerary(run.junction, who.entrance, who.exit)


def _offset(way: Itinerary, points: NDArray[np.float64], station: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far points are to the left of the itinerary where it is at these stations, shape ``(steps,)`` [m]."""
    place, ahead = way.centre(station)
    apart = points - place
    found: NDArray[np.float64] = ahead[:, 0] * apart[:, 1] - ahead[:, 1] * apart[:, 0]
    return found


def _nearest(way: Itinerary, points: NDArray[np.float64], station: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the stations of points, given about where they are, shape ``(steps,)`` [m]."""
    for _ in range(3):
        place, ahead = way.centre(station)
        station = station + ((points - place) * ahead).sum(axis=1)
    return station
