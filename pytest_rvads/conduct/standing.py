"""What road users are held to beyond the paper's predicates: stopping before the line, arriving at it, the limit of speed.

Every function takes a run and the column of an agent and returns one value per state, shape ``(steps,)``. What a run
does not record makes them raise, so that nothing is guessed. The numbers are parameters of the road rulebook.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.presence import window
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Zone

__all__ = [
    "LINE_TOLERANCE",
    "SPEED_TOLERANCE",
    "STANDSTILL",
    "STOP_PLACE",
    "TIE",
    "arrivals",
    "arrived",
    "drives",
    "find_arrivals",
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
"""Who arrives within this time of each other arrives at about the same time [s]; statutes give no number."""
STANDSTILL = 0.1
"""A vehicle at most this fast, forwards or backwards, stands still [m/s]; wheel-speed sensors resolve about as much."""
LINE_TOLERANCE = 0.1
"""How far over the stopping line a bumper may stand and still have stopped before it [m]."""
STOP_PLACE = 5.0
"""Length of the stop place before the stopping line, or before the stop sign where that stands farther upstream [m]: about a
car length; statutes ask for a stop before the line, the crosswalk or the junction, and give no distance."""
SPEED_TOLERANCE = 0.5
"""How much faster than the limit is still within what a speed control holds [m/s]."""


def stop_place(junction: Junction, entrance: int) -> tuple[float, float]:
    """Return the stations between which the front of a vehicle stands when it has stopped at an entrance [m].

    The stop place begins `STOP_PLACE` before the stopping line, or before the stop sign where that stands farther upstream. It
    ends at the stopping line, or at the entrance vertex where no line is marked, plus `LINE_TOLERANCE`.
    """
    place = junction.entrances[entrance]
    return -max(place.setback, place.sign_setback or 0.0) - STOP_PLACE, LINE_TOLERANCE - place.setback


def stopped(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has stopped in the stop place, and since then has neither entered the junction nor backed out of that place.

    A full stop is something that a vehicle does: standing before the entrance zone counts once the vehicle has driven.
    """
    here, still = stops(run, agent)
    driven = np.logical_or.accumulate(run.here[:, agent] & ~stands(run)[:, agent])
    still = still & (driven | (run.zone[:, agent] == Zone.ENTRANCE))
    tick = np.arange(run.steps)
    last_still = np.maximum.accumulate(np.where(still, tick, -1))
    last_away = np.maximum.accumulate(np.where(here, -1, tick))
    found: NDArray[np.bool_] = here & (last_still > last_away)
    return found


def stops(run: Run, agent: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where the agent is between the beginning of its stop place and the junction, and where it stops there.

    A vehicle stops where it stands in the stop place and leads: a vehicle that queued stops again. Both arrays have the shape
    ``(steps,)``.
    """
    begin, line = stop_place(run.junction, run.agents[agent].entrance)
    station, zone = run.need("station")[:, agent], run.zone[:, agent]
    here: NDArray[np.bool_] = (zone == Zone.ENTRANCE) | ((zone == Zone.APPROACH) & (station >= begin))
    still = here & stands(run)[:, agent] & (station <= line)
    return here, still & leads(run, agent) if still.any() else still


class Arrivals(NamedTuple):
    """When the vehicles of a run arrived at the junction."""

    arrived: NDArray[np.bool_]
    """Which vehicle has arrived and has not entered since, shape ``(steps, agents)``."""
    tick: NDArray[np.int64]
    """Tick of the latest arrival of every vehicle so far, -1 before its first one, shape ``(steps, agents)``."""


def arrivals(run: Run) -> Arrivals:
    """Return when the vehicles of a run arrived.

    A vehicle arrives when it stops in the stop place or its front enters the entrance zone, whichever is earlier. The arrival
    lasts until the vehicle enters the junction or backs out of the stop place; a second stop does not restart it. A run without
    positions or speeds knows only the entrance zone.
    """
    return once(run, find_arrivals)


def find_arrivals(run: Run) -> Arrivals:
    """Work out what `arrivals` returns."""
    at_line = run.zone == Zone.ENTRANCE
    here, event = at_line, at_line
    if len(run.agents) and run.station is not None and run.speed is not None:
        columns = [stops(run, agent) for agent in range(len(run.agents))]
        here = np.stack([there for there, _ in columns], axis=1)
        event = at_line | np.stack([still for _, still in columns], axis=1)
    tick = np.arange(run.steps)[:, None]
    away = np.maximum.accumulate(np.where(here, -1, tick), axis=0)
    before = np.maximum.accumulate(np.where(event, tick, -1), axis=0)
    first = event.copy()
    first[1:] &= before[:-1] <= away[1:]
    latest = np.maximum.accumulate(np.where(first, tick, -1), axis=0)
    return Arrivals(here & (latest > away), latest)


def arrived(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has arrived at its line, see `arrivals`, and has not entered the junction."""
    return arrivals(run).arrived[:, agent]


def waited(run: Run, agent: int) -> NDArray[np.int64]:
    """Return for how many ticks the agent has been waiting since it arrived, 0 where it has not arrived, shape ``(steps,)``."""
    if run.station is None or run.speed is None:
        return run.wt[:, agent].astype(np.int64)
    found = arrivals(run)
    return np.where(found.arrived[:, agent], np.arange(run.steps) - found.tick[:, agent], 0)


def leads(run: Run, agent: int) -> NDArray[np.bool_]:
    """Nobody is ahead of the agent in its lane before the junction."""
    found = np.ones(run.steps, dtype=np.bool_)
    for other, who in enumerate(run.agents):
        begin, end = window(run, (agent, other))
        if other != agent and who.entrance == run.agents[agent].entrance and begin < end:
            station, when = run.need("station"), slice(begin, end)
            found[when] &= ~((run.zone[when, other] <= Zone.ENTRANCE) & (station[when, other] > station[when, agent]))
    return found


def standing_time(run: Run, agent: int) -> NDArray[np.int32]:
    """Return for how many steps the agent has been standing at its entrance, shape ``(steps,)``.

    This is the waiting time as the text of the paper has it, "since its speed became zero"; it restarts when the vehicle moves.
    """
    tick = np.arange(run.steps, dtype=np.int32)
    still = (run.zone[:, agent] == Zone.ENTRANCE) & stands(run)[:, agent]
    found: NDArray[np.int32] = tick - np.maximum.accumulate(np.where(still, 0, tick))
    return found


def drives(run: Run, agent: int) -> bool:
    """Return whether the agent moves at all, as far as the run records speeds; one that does not has kept no rule by acting."""
    return run.speed is None or bool((np.abs(run.speed[:, agent]) > STANDSTILL).any())


def speeding(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent drives faster than the limit at its place and the tolerance.

    Raises:
        RunError: the run does not record speeds, or no limit.
    """
    limits = limits_of(run.junction, run.agents[agent].route.key, run.facts)
    speed, most = np.abs(run.need("speed")[:, agent]), np.array([limit for _, limit in limits])
    if len(limits) > 1:
        borders = [station for station, _ in limits[1:]]
        most = most[np.searchsorted(borders, run.need("station")[:, agent], side="right")]
    found: NDArray[np.bool_] = speed > most + SPEED_TOLERANCE
    return found


def limits_of(junction: Junction, way: Key, facts: Facts) -> tuple[tuple[float, float], ...]:
    """Return the speed limits along the way of a vehicle: the station where each begins [m], and the limit [m/s].

    The limit of the facts holds where the map of the junction states none.

    Raises:
        RunError: neither states one for all of the way.
    """
    stated = itinerary(junction, *way).limits if junction.drivable else ()
    limits = [(station, facts.speed_limit if limit is None else limit) for station, limit in stated or ((0.0, None),)]
    known = tuple((station, limit) for station, limit in limits if limit is not None)
    if len(known) < len(limits):
        raise RunError("the run holds no speed limit" + (", and its map states none for a part of a way" if known else ""))
    return known


def stands(run: Run) -> NDArray[np.bool_]:
    """Return which vehicle stands still, shape ``(steps, agents)``.

    Raises:
        RunError: the run does not record speeds.
    """
    return once(run, _find_standing)


def _find_standing(run: Run) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.abs(run.need("speed")) <= STANDSTILL
    return found
