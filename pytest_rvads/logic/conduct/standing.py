"""Measures what a vehicle does by itself: place, waiting time, colour of the light ahead, progress, stops, speed limit.

The rulebook ``road`` uses measures that the paper's predicates lack: stopping before the line, arriving at the line, keeping the
speed limit. The tolerances of this module are parameters of this rulebook. A measure that needs values that the run does not
record raises an error.

`lasting` counts for how long a truth value has been true, and `latched` keeps a truth value true until a reset.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import APPROACH, ENTRANCE, EXIT, JUNCTION, Block, Cast, Pairs, Signal, pairs, signal, sized
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.support.errors import RunError

TIE = 0.5
"""Difference of arrival times up to which two vehicles arrive at about the same time [s]; statutes give no number."""
STANDSTILL = 0.1
"""Highest speed of a vehicle that stands still, forwards or backwards [m/s]; wheel-speed sensors resolve about as much."""
LINE_TOLERANCE = 0.1
"""Distance of a front bumper beyond the stopping line up to which a vehicle counts as stopped before the line [m]."""
STOP_PLACE = 5.0
"""Length of the stop place before the stopping line, or before a stop sign farther upstream [m].

The length is about a car length. Statutes ask for a stop before the line, the crosswalk or the junction, and give no distance.
"""
SPEED_TOLERANCE = 0.5
"""Excess over the speed limit up to which a vehicle counts as keeping the limit [m/s], because speed controllers overshoot."""


def lasting(truths: NDArray[np.bool_], before: NDArray[Any]) -> NDArray[np.int64]:
    """Return, per state and column, for how many states the column has been true without a break, this state included.

    `before` holds these numbers for the state before the first state, shape ``(columns,)``.
    """
    if len(truths) == 1:
        return np.where(truths, before + 1, 0)
    count = np.arange(1, len(truths) + 1)[:, None]
    return count - np.maximum.accumulate(np.where(truths, -before, count), axis=0)


def latched(set_: NDArray[np.bool_], reset: NDArray[np.bool_], before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the values of latches: a latch is true from a state that sets the latch until a state that resets the latch.

    No state both sets and resets a latch. `before` holds the values before the first state, shape ``(columns,)``.
    """
    if len(set_) == 1:
        return set_ | (before & ~reset)
    count = np.arange(1, len(set_) + 1)[:, None]
    last_set = np.maximum.accumulate(np.where(set_, count, 0), axis=0)
    last_reset = np.maximum.accumulate(np.where(reset, count, 0), axis=0)
    return (last_set > last_reset) | (before & (last_reset == 0))


in_junction = signal(lambda block: block.zone == JUNCTION)
"""Whether each vehicle is in the junction (``a@j``), with its reference point on a movement of the junction."""
at_entrance = signal(lambda block: block.zone == ENTRANCE)
"""Whether each vehicle is at its entrance (``a@j.en``)."""
on_approach = signal(lambda block: (block.zone == APPROACH) | (block.zone == ENTRANCE))
"""Whether each vehicle is on the road to its entrance (``a@r``); the entrance zone is part of the road."""
on_exit = signal(lambda block: block.zone == EXIT)
"""Whether each vehicle is on its exit road (``a@j.ex`` and ``a@r``), which begins with the exit vertex."""
speed: Signal[NDArray[np.float64]] = Signal(lambda block: block.need("speed"), otherwise=np.nan)
"""The speed of each vehicle, ``a.sp`` [m/s]."""
colour: Signal[NDArray[np.int8]] = Signal(lambda block: block.lights, of_entrances=True)
"""The colour of the light at every entrance, ``lt.cl``."""

NEVER = int(np.iinfo(np.int64).max)
"""Tick that stands for the entry of a vehicle that has not entered the junction."""


@signal(start=(0,))
def wt(block: Block, before: NDArray[np.int32]) -> tuple[NDArray[np.int32], ...]:
    """Return the waiting time of each vehicle in ticks.

    The waiting time is zero in the first state and outside the entrance zone, and grows by one with every further state in the
    zone. The waiting time does not restart when the vehicle starts to move inside the zone.
    """
    # The first state of a run adds nothing to a waiting time.
    ticks = lasting(block.zone == ENTRANCE, before - (block.tick == 0)).astype(np.int32)
    return ticks, ticks


@signal(start=(NEVER,), otherwise=NEVER)
def entered(block: Block, before: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """Return, per state, the tick in which each vehicle entered the junction; `NEVER` before the vehicle enters."""
    ticks = np.minimum(np.minimum.accumulate(np.where(block.zone >= JUNCTION, block.ticks, NEVER), axis=0), before)
    return ticks, ticks


@signal(start=(0,))
def facing(block: Block, before: NDArray[np.int8]) -> tuple[NDArray[np.int8], ...]:
    """Return the colour of the light at the start of each vehicle's way; after the vehicle's entry, the colour at its entry."""
    colours, entry = block.lights[:, block.cast.entrance], entered(block)
    row = np.minimum(entry[-1] - block.tick, len(colours) - 1)
    at_entry = np.where(row >= 0, colours[np.maximum(row, 0), np.arange(len(row))], before)
    colour = np.where(entry >= block.ticks, colours, at_entry).astype(np.int8)
    return colour, colour


@signal(start=(np.nan,), otherwise=np.nan)
def advance(block: Block, before: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return the progress of each vehicle along its way, negative when it reverses [m/s]; in its first state, its speed."""
    station = block.need("station")
    rate = (station - np.concatenate((before[None], station[:-1]))) / block.dt
    return np.where(np.isnan(rate), block.need("speed"), rate), station


@signal(needs=sized)
def inside(block: Block) -> NDArray[np.bool_]:
    """Return whether a part of the body of each vehicle is in the junction."""
    front, cast = block.need("station"), block.cast
    entry = np.maximum(cast.static(lines), 0.0)  # the stations at which the junction begins, see `Itinerary.entry`
    return (front > entry) & ((front - cast.length) - cast.way < 0.0) & block.here


def lines(cast: Cast) -> NDArray[np.float64]:
    """Return the stations of the stopping lines of all vehicles, shape ``(agents,)`` [m]."""
    return np.array([-cast.junction.setbacks[agent.entrance] for agent in cast.agents], dtype=np.float64)


def stop_place(junction: Junction, entrance: int) -> tuple[float, float]:
    """Return the stations at which the stop place of an entrance begins and ends [m].

    A vehicle that stops at the entrance stands with its front in the stop place. The stop place begins `STOP_PLACE` before the
    stopping line, or before a stop sign farther upstream. It ends `LINE_TOLERANCE` after the stopping line, or after the entrance
    vertex if no line is marked.
    """
    place = junction.starts[entrance]
    posted = place.setback if place.sign_setback is None else place.sign_setback
    return -max(place.setback, posted) - STOP_PLACE, LINE_TOLERANCE - place.setback


def _stop_places(cast: Cast) -> NDArray[np.float64]:
    return np.array([stop_place(cast.junction, agent.entrance) for agent in cast.agents]).reshape(-1, 2).T


def lane(cast: Cast) -> Pairs:
    """Return the pairs of vehicles that come to the same entrance."""
    return pairs(cast, lambda agent, other: cast.agents[agent].entrance == cast.agents[other].entrance)


@signal
def stands(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle stands still."""
    return np.abs(block.need("speed")) <= STANDSTILL


@signal
def leads(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle leads its lane: no vehicle is ahead of it in its lane before the junction."""
    both, station = block.cast.static(lane), block.need("station")
    ahead = (both.second(block.zone) <= ENTRANCE) & (both.second(station) > both.first(station))
    return ~both.any(ahead, len(block.cast))


@signal
def stops(block: Block) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether each vehicle is between the beginning of its stop place and the junction, and whether it stops there.

    A vehicle stops if it stands in the stop place and no vehicle is ahead of it in its lane. Therefore a vehicle that stood
    behind another vehicle has to stop again at the line.
    """
    begin, line = block.cast.static(_stop_places)
    station, zone = block.need("station"), block.zone
    in_place = (zone == ENTRANCE) | ((zone == APPROACH) & (station >= begin))
    return in_place, in_place & stands(block) & (station <= line) & leads(block)


@signal
def in_stop_place(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is between the beginning of its stop place and the junction."""
    return stops(block)[0]


@signal(start=(False, False))
def stopped(block: Block, had_driven: NDArray[np.bool_], before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Return whether each vehicle has stopped in its stop place, and has since neither entered the junction nor backed out.

    A full stop is an action of a vehicle: standing before the entrance zone counts only if the vehicle has driven before.
    """
    in_place, still = stops(block)
    driven = had_driven | np.logical_or.accumulate(block.here & ~stands(block), axis=0)
    stood = latched(still & (driven | (block.zone == ENTRANCE)), ~in_place, before)
    return stood, driven, stood


class Arrivals(NamedTuple):
    """The arrivals of the vehicles of a run at the junction."""

    arrived: NDArray[np.bool_]
    """Whether each vehicle has arrived and has not entered the junction since, shape ``(steps, agents)``."""
    tick: NDArray[np.int64]
    """Tick of the latest arrival of every vehicle so far, -1 before its first arrival, shape ``(steps, agents)``."""


@signal(start=(False, -1))
def arrivals(block: Block, before: NDArray[np.bool_], last: NDArray[np.int64]) -> tuple[Arrivals, NDArray[Any], NDArray[Any]]:
    """Return the arrivals of the vehicles at the junction, see `Arrivals`.

    A vehicle arrives when it stops in the stop place or its front enters the entrance zone, whichever is earlier. The arrival
    lasts until the vehicle enters the junction or backs out of the stop place; a second stop is no new arrival. If the run does
    not record positions or speeds, a vehicle arrives when its front enters the entrance zone.
    """
    at_line = block.zone == ENTRANCE
    in_place, still = (at_line, at_line) if block.station is None or block.speed is None else stops(block)
    has_arrived = latched(at_line | still, ~in_place, before)
    arrives = has_arrived & ~np.concatenate((before[None], has_arrived[:-1]))
    tick = np.maximum.accumulate(np.where(arrives, block.ticks, last), axis=0)
    return Arrivals(has_arrived, tick), has_arrived, tick


@signal
def arrived(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle has arrived at its line, see `arrivals`, and has not entered the junction."""
    latest: Arrivals = arrivals(block)
    return latest.arrived


@signal
def waited(block: Block) -> NDArray[np.int64]:
    """Return for how many ticks each vehicle has been waiting since its arrival; 0 for a vehicle that has not arrived."""
    if block.station is None or block.speed is None:
        return np.asarray(wt(block), dtype=np.int64)
    latest: Arrivals = arrivals(block)
    return np.where(latest.arrived, block.ticks - latest.tick, 0)


def standing_time(run: Run, agent: int) -> NDArray[np.int32]:
    """Return for how many steps the agent has been standing at its entrance: the waiting time in the text of the paper."""
    tick = np.arange(run.steps, dtype=np.int32)
    still = (run.zone[:, agent] == ENTRANCE) & stands(run, agent)
    return tick - np.maximum.accumulate(np.where(still, 0, tick))


def drives(run: Run, agent: int) -> bool:
    """Return whether the agent moves in some state; true if speeds are not recorded."""
    return run.speed is None or bool((np.abs(run.speed[:, agent]) > STANDSTILL).any())


def _limits_known(block: Block, columns: Sequence[int]) -> None:
    """Check that the speed limits along the ways of some vehicles are known."""
    for column in columns:
        limits_of(block.junction, block.cast.agents[column].way.key, block.cast.facts)


@signal(needs=_limits_known)
def speeding(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle exceeds the speed limit at its place by more than `SPEED_TOLERANCE`; false without a limit."""
    borders, limits = block.cast.static(_limits)
    most = limits[:, 0]
    if borders.size:
        piece = (block.need("station")[..., None] >= borders).sum(axis=-1)
        most = np.take_along_axis(limits[None], piece[..., None], axis=-1)[..., 0]
    return np.abs(block.need("speed")) > most + SPEED_TOLERANCE


def _limits(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return, per vehicle, the stations at which its speed limit changes [m], and the limits before and after [m/s], padded."""
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
    """Return the speed limits along a way, of the map or else of the facts: stations where limits begin [m], and limits [m/s]."""
    stated = itinerary(junction, *way).limits if junction.drivable else ()
    limits = [(station, facts.speed_limit if limit is None else limit) for station, limit in stated or ((0.0, None),)]
    known_limits = tuple((station, limit) for station, limit in limits if limit is not None)
    if len(known_limits) < len(limits):
        raise RunError("the run holds no speed limit" + (", and its map states none for a part of a way" if known_limits else ""))
    return known_limits
