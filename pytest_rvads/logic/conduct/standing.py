"""Duties of road users beyond the paper's predicates: stopping before the line, arriving at the line, keeping the speed limit.

Values that are not recorded raise an error instead of being guessed. The numbers are parameters of the road rulebook.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import APPROACH, ENTRANCE, Block, signal
from pytest_rvads.logic.conduct.cast import Cast, Pairs, pairs
from pytest_rvads.logic.conduct.motion import latched, wt
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.support.errors import RunError

__all__ = [
    "LINE_TOLERANCE",
    "SPEED_TOLERANCE",
    "STANDSTILL",
    "STOP_PLACE",
    "TIE",
    "arrivals",
    "arrived",
    "drives",
    "in_stop_place",
    "lane",
    "leads",
    "limits_of",
    "speeding",
    "standing_time",
    "stands",
    "stop_place",
    "stopped",
    "stops",
    "waited",
]

TIE = 0.5
"""Vehicles that arrive within this time of each other arrive at about the same time [s]; statutes give no number."""
STANDSTILL = 0.1
"""Highest speed of a vehicle that stands still, forwards or backwards [m/s]; wheel-speed sensors resolve about as much."""
LINE_TOLERANCE = 0.1
"""Largest distance of a bumper beyond the stopping line that still counts as stopped before the line [m]."""
STOP_PLACE = 5.0
"""Length of the stop place before the stopping line, or before a stop sign farther upstream [m].

The length is about a car length. Statutes ask for a stop before the line, the crosswalk or the junction, and give no distance.
"""
SPEED_TOLERANCE = 0.5
"""Largest excess over the limit that a speed control produces [m/s]."""


def stop_place(junction: Junction, entrance: int) -> tuple[float, float]:
    """Return the stations between which the front of a vehicle stands when it has stopped at an entrance [m].

    The stop place begins `STOP_PLACE` before the stopping line, or before a stop sign farther upstream. It ends `LINE_TOLERANCE`
    after the stopping line, or after the entrance vertex if no line is marked.
    """
    place = junction.starts[entrance]
    return -max(place.setback, place.sign_setback or 0.0) - STOP_PLACE, LINE_TOLERANCE - place.setback


def _stop_places(cast: Cast) -> NDArray[np.float64]:
    return np.array([stop_place(cast.junction, agent.entrance) for agent in cast.agents]).reshape(-1, 2).T


def lane(cast: Cast) -> Pairs:
    """Return the pairs of vehicles that come to the same entrance."""
    return pairs(cast, lambda agent, other: cast.agents[agent].entrance == cast.agents[other].entrance)


@signal
def stands(block: Block) -> NDArray[np.bool_]:
    """Whether each vehicle stands still."""
    still: NDArray[np.bool_] = np.abs(block.need("speed")) <= STANDSTILL
    return still


@signal
def leads(block: Block) -> NDArray[np.bool_]:
    """Whether no vehicle is ahead of each vehicle in its lane before the junction."""
    both, station = block.cast.static(lane), block.need("station")
    ahead = (both.second(block.zone) <= ENTRANCE) & (both.second(station) > both.first(station))
    return ~both.any(ahead, len(block.cast))


@signal
def stops(block: Block) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Whether each vehicle is between the beginning of its stop place and the junction, and whether it stops there.

    A vehicle stops if it stands in the stop place and leads its lane: a vehicle that queued stops again.
    """
    begin, line = block.cast.static(_stop_places)
    station, zone = block.need("station"), block.zone
    in_place = (zone == ENTRANCE) | ((zone == APPROACH) & (station >= begin))
    return in_place, in_place & stands(block) & (station <= line) & leads(block)


@signal
def in_stop_place(block: Block) -> NDArray[np.bool_]:
    """Whether each vehicle is between the beginning of its stop place and the junction."""
    return stops(block)[0]


@signal(start=(False, False), steady=True)
def stopped(block: Block, had_driven: NDArray[np.bool_], before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Whether each vehicle has stopped in the stop place, and has since neither entered the junction nor backed out of the place.

    A full stop is an action of a vehicle: standing before the entrance zone counts only after the vehicle has driven.
    """
    in_place, still = stops(block)
    driven = had_driven | np.logical_or.accumulate(block.here & ~stands(block), axis=0)
    stood = latched(still & (driven | (block.zone == ENTRANCE)), ~in_place, before)
    return stood, driven, stood


class Arrivals(NamedTuple):
    """The arrivals of the vehicles of a run at the junction."""

    arrived: NDArray[np.bool_]
    """Whether each vehicle has arrived and has not entered since, shape ``(steps, agents)``."""
    tick: NDArray[np.int64]
    """Tick of the latest arrival of every vehicle so far, -1 before its first arrival, shape ``(steps, agents)``."""


@signal(start=(False, -1), steady=True)
def arrivals(block: Block, before: NDArray[np.bool_], last: NDArray[np.int64]) -> tuple[Arrivals, NDArray[Any], NDArray[Any]]:
    """The arrivals of the vehicles, see `Arrivals`.

    A vehicle arrives when it stops in the stop place or its front enters the entrance zone, whichever is earlier. The arrival
    lasts until the vehicle enters the junction or backs out of the stop place; a second stop does not restart it. Without
    positions or speeds, arrivals follow from the entrance zone alone.
    """
    at_line = block.zone == ENTRANCE
    in_place, still = (at_line, at_line) if block.station is None or block.speed is None else stops(block)
    has_arrived = latched(at_line | still, ~in_place, before)
    arrives = has_arrived & ~np.concatenate((before[None], has_arrived[:-1]))
    tick = np.maximum.accumulate(np.where(arrives, block.ticks, last), axis=0)
    return Arrivals(has_arrived, tick), has_arrived, tick


@signal(steady=True)
def arrived(block: Block) -> NDArray[np.bool_]:
    """Whether each vehicle has arrived at its line, see `arrivals`, and has not entered the junction."""
    latest: Arrivals = arrivals(block)
    return latest.arrived


@signal
def waited(block: Block) -> NDArray[np.int64]:
    """Ticks that each vehicle has been waiting since its arrival, 0 for a vehicle that has not arrived."""
    if block.station is None or block.speed is None:
        return np.asarray(wt(block), dtype=np.int64)
    latest: Arrivals = arrivals(block)
    return np.where(latest.arrived, block.ticks - latest.tick, 0)


def standing_time(run: Run, agent: int) -> NDArray[np.int32]:
    """Return the number of steps that the agent has been standing at its entrance, shape ``(steps,)``.

    This is the waiting time in the text of the paper, "since its speed became zero"; it restarts when the vehicle moves.
    """
    tick = np.arange(run.steps, dtype=np.int32)
    still = (run.zone[:, agent] == ENTRANCE) & stands(run, agent)
    durations: NDArray[np.int32] = tick - np.maximum.accumulate(np.where(still, 0, tick))
    return durations


def drives(run: Run, agent: int) -> bool:
    """Return whether the agent moves at all, or speeds are not recorded; an agent that never moves has kept no rule by acting."""
    return run.speed is None or bool((np.abs(run.speed[:, agent]) > STANDSTILL).any())


def _limited(block: Block, columns: Sequence[int]) -> None:
    for column in columns:
        limits_of(block.junction, block.cast.agents[column].way.key, block.cast.facts)


@signal(needs=_limited)
def speeding(block: Block) -> NDArray[np.bool_]:
    """Whether each vehicle exceeds the limit at its place by more than the tolerance; false where no limit is known."""
    borders, limits = block.cast.static(_limits)
    most = limits[:, 0]
    if borders.size:
        piece = (block.need("station")[..., None] >= borders).sum(axis=-1)
        most = np.take_along_axis(limits[None], piece[..., None], axis=-1)[..., 0]
    too_fast: NDArray[np.bool_] = np.abs(block.need("speed")) > most + SPEED_TOLERANCE
    return too_fast


def _limits(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return, per vehicle, the stations at which limits end and the limits, each row padded to the longest row."""
    rows = []
    for agent in cast.agents:
        with suppress(RunError):
            rows.append(limits_of(cast.junction, agent.way.key, cast.facts))
            continue
        rows.append(((0.0, math.nan),))
    most = max(map(len, rows), default=1)
    borders = [[station for station, _ in row[1:]] + [math.inf] * (most - len(row)) for row in rows]
    limits = [[limit for _, limit in row] + [math.nan] * (most - len(row)) for row in rows]
    return np.array(borders).reshape(len(rows), most - 1), np.array(limits).reshape(len(rows), most)


def limits_of(junction: Junction, way: Key, facts: Facts) -> tuple[tuple[float, float], ...]:
    """Return the speed limits along the way of a vehicle: the station where each begins [m], and the limit [m/s].

    The limit of the facts holds where the map of the junction states no limit.

    Raises:
        RunError: for a part of the way, neither the map nor the facts state a limit.
    """
    stated = itinerary(junction, *way).limits if junction.drivable else ()
    limits = [(station, facts.speed_limit if limit is None else limit) for station, limit in stated or ((0.0, None),)]
    known_limits = tuple((station, limit) for station, limit in limits if limit is not None)
    if len(known_limits) < len(limits):
        raise RunError("the run holds no speed limit" + (", and its map states none for a part of a way" if known_limits else ""))
    return known_limits
