"""Where vehicles start: the speeds of configurations, the gaps of queues, and no two vehicles in one place.

Upstream of turn lanes several entrances share a lane, and a turn lane has no width where it begins. On such approaches, two
vehicles at the same distance from their lines would stand inside each other. `Scenario.starts` refuses, before a run, starts of
vehicles inside each other and starts on approaches that are too short.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.way_ahead import fastest
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.bodies import touch
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Agent, Vehicle
from pytest_rvads.scenarios.classes import rotate
from pytest_rvads.scenarios.configurations import Configuration
from pytest_rvads.support.errors import ScenarioError

_BESIDE = 2.0
"""Distance of centre lines below which two lanes count as one lane [m]: cars, 1.86 m wide, have no room beside each other."""
_NEAR = 3.0
"""Distance of centre lines from which on bodies do not touch [m].

The law allows vehicles a width of at most 2.6 m (Council Directive 96/53/EC, Annex I).
"""
_SPACING = 0.5
"""Distance of the points at which approaches are compared [m]."""


class Fork(NamedTuple):
    """Two entrances, the lower number first, whose approaches begin on one common lane."""

    entrances: tuple[int, int]
    distances: tuple[float, float]
    """Distances before the two stopping lines at which the lanes part [m]; negative behind the line."""


@lru_cache(maxsize=256)
def forks(place: Junction) -> tuple[Fork, ...]:
    """Return the pairs of entrances whose approaches begin on a common lane; entrances without a known approach are skipped."""
    lines = _approaches(place)
    pairs = []
    for first, second in combinations(lines, 2):
        distances = _parting(lines[first], lines[second])
        if distances is None and (swapped := _parting(lines[second], lines[first])) is not None:
            distances = swapped[1], swapped[0]
        if distances is not None:
            of_first, of_second = distances[0] - place.setbacks[first], distances[1] - place.setbacks[second]
            pairs.append(Fork((first, second), (of_first, of_second)))
    return tuple(pairs)


@lru_cache(maxsize=256)
def near(place: Junction) -> frozenset[tuple[int, int]]:
    """Return the pairs of entrances, the lower number first, on whose approaches vehicles could start inside each other.

    The two approaches begin on a common lane, see `forks`, or converge towards their stopping lines.
    """
    lines = {entrance: points[::-2] for entrance, points in _approaches(place).items()}
    pairs = combinations(lines, 2)
    return frozenset((a, b) for a, b in pairs if min(np.hypot(*(lines[b] - p).T).min() for p in lines[a]) < _NEAR)


def _parting(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the distances before their ends at which two lines part [m]; None if the first line does not begin on the second."""
    last = nearest = -1
    for k, point in enumerate(first):
        gaps = np.hypot(*(second - point).T)
        if gaps.min() >= _BESIDE:
            break
        last, nearest = k, int(gaps.argmin())
    if last < 0:
        return None
    return (len(first) - 1 - last) * _SPACING, (len(second) - 1 - nearest) * _SPACING


def _approaches(place: Junction) -> dict[int, NDArray[np.float64]]:
    """Return, per entrance with a known approach, points of the approach, the last at its end, shape ``(k, 2)`` [m]."""
    points = {}
    for entrance, lane in enumerate(place.entrances):
        if line := lane.approach:
            stations = np.arange(line.length, 0.0, -_SPACING)[::-1]
            points[entrance] = np.column_stack([np.interp(stations, line.stations, axis) for axis in line.points.T])
    return points


QUEUE_GAP = 2.0
"""Gap between two vehicles of a standing queue [m]."""
QUEUE_TIME = 1.0
"""Time gap of followers at the start, in addition to `QUEUE_GAP` [s]."""
_ROUNDING = 1e-9
"""Greatest rounding error of a distance [m]."""


class _Start(NamedTuple):
    """The start of a vehicle."""

    name: str
    way: Key
    body: Vehicle
    distance: float
    """Distance from the reference point to the stopping line [m]."""
    speed: float
    """Speed at the start [m/s]."""

    @property
    def entrance(self) -> int:
        """Number of the entrance."""
        return self.way[0]


def placed(
    place: Junction, agents: Sequence[Agent], bodies: Sequence[Vehicle], starts: Sequence[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return the starts of vehicles with their followers, see `Scenario.starts` for gaps and errors.

    `starts` has per vehicle the distance [m] and speed [m/s] of the first vehicle at its entrance.
    """
    rows: list[_Start] = []
    for agent, body, (distance, speed) in zip(agents, bodies, starts, strict=True):
        if rows and rows[-1].entrance == agent.entrance:
            distance = rows[-1].distance + rows[-1].body.length + QUEUE_GAP + QUEUE_TIME * speed
        room = place.approach(agent.entrance)
        if distance > room:
            followed = len({other.entrance for other in agents}) < len(agents)
            cure = "a smaller distance, fewer followers" if followed else "a smaller distance"
            raise ScenarioError(
                f"distance {distance:g} m does not fit on entrance {agent.entrance} of junction {place.name!r}, where "
                f"{agent.name} starts: its approach is {room:.1f} m long, choose {cure} or another junction"
            )
        rows.append(_Start(agent.name, agent.way.key, body, distance, speed))
    if near(place):
        _check_apart(place, rows)
    return tuple((row.distance, row.speed) for row in rows)


def _check_apart(place: Junction, starts: Sequence[_Start]) -> None:
    """Check that vehicles on a common lane start behind each other, and that vehicles on converging approaches do not touch."""
    for (first, second), (parting, second_parting) in forks(place):
        # Distances upstream of the place where the lanes part; a vehicle beyond this place is not in the common lane.
        lane = [(s.distance - parting, s) for s in starts if s.entrance == first] + [
            (s.distance - second_parting, s) for s in starts if s.entrance == second
        ]
        queue = sorted((distance, s) for distance, s in lane if distance + s.body.length > 0.0)
        for (front, ahead), (distance, behind) in pairwise(queue):
            gap, needed = distance - front - ahead.body.length, QUEUE_GAP + QUEUE_TIME * behind.speed
            if ahead.entrance != behind.entrance and gap < needed - _ROUNDING:
                raise ScenarioError(
                    f"{behind.name} would start {max(gap, 0.0):.1f} m behind {ahead.name}, where {needed:.1f} m are needed: "
                    f"entrances {first} and {second} of junction {place.name!r} are one lane from {max(parting, 0.0):.1f} and "
                    f"{max(second_parting, 0.0):.1f} m before their lines on, choose smaller or different distances, or fewer "
                    "vehicles"
                )

    ways = [itinerary(place, *start.way) for start in starts]
    bodies = [
        (np.array([way.placed(way.start(s.distance), s.body.rear_axle_offset)]), (s.body.length, s.body.width))
        for way, s in zip(ways, starts, strict=True)
    ]
    for (start, body), (other, other_body) in combinations(zip(starts, bodies, strict=True), 2):
        if (start.entrance, other.entrance) in near(place) and touch([body, other_body]):
            raise ScenarioError(
                f"{start.name} and {other.name} would start inside each other, where the approaches of entrances "
                f"{start.entrance} and {other.entrance} of junction {place.name!r} converge: choose other distances, or fewer "
                "vehicles"
            )


def started(point: Configuration, place: Junction, rotation: int, subject: int | None, followers: int) -> dict[str, Any]:
    """Return the arguments of `Scenario` that say how the vehicles start in a configuration: distances, speeds and its label."""
    queue = followers * (Vehicle().length + QUEUE_GAP + QUEUE_TIME * max(point.speeds))
    if point.staggered:
        if subject is None:
            raise ScenarioError(
                f"configuration {point.label} is staggered around a subject, and there is none: say subject=0 or 'all', or "
                "choose another configuration"
            )
        rooms = [place.approach(entrance) - queue for entrance in range(len(place.entrances))]
        point = point.around((subject - rotation) % len(rooms), rotate(tuple(rooms), -rotation))
    speeds = point.speeds
    if not point.label.startswith("d"):  # speeds that a user asks for are kept
        starts = zip(rotate(tuple(range(len(speeds))), -rotation), point.distances, speeds, strict=True)
        speeds = tuple(min(speed, fastest_start(place, entrance, distance, queue)) for entrance, distance, speed in starts)
    return {"distance": point.distances, "speed": speeds, "configuration": point.label}


def fastest_start(place: Junction, entrance: int, distance: float, queue: float = 0.0) -> float:
    """Return the highest speed [m/s] at which vehicles start `distance` before the line, with the last `queue` behind them [m].

    All speed limits between the start of the last vehicle and the entrance count, and so do all bends of this stretch.
    """
    approach, start = place.entrances[entrance].approach, place.approach(entrance) - distance
    if approach is None or start <= 0.0:
        return SPEED_LIMIT
    start = min(start, approach.length - 0.01)  # a line can lie behind the end of the approach
    first = max(start - queue, 0.0)
    limits = approach.tail(approach.length - first).limits
    limit = min((limit or SPEED_LIMIT for _, limit in limits), default=SPEED_LIMIT)
    return min(limit, fastest(approach, first, start, Vehicle(), place.lane_width))
