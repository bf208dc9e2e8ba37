"""What road users are held to beyond the paper's predicates: stopping, blocking, colliding, getting in each other's way.

Every function takes a run and the columns of agents and returns one truth value per state, shape ``(steps,)``. What a run
does not record makes them raise, so that nothing is guessed. The numbers are parameters of the road rulebook.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import RunError
from pytest_rvads.maps.junction import Junction
from pytest_rvads.maps.segment import Segment
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Zone

__all__ = [
    "BLOCKING_TIME",
    "CONFLICT_WIDTH",
    "LINE_TOLERANCE",
    "SPEED_TOLERANCE",
    "STANDSTILL",
    "blocks",
    "collide",
    "conflicts",
    "speed_limit",
    "speeding",
    "standing_time",
    "stands_inside",
    "stopped",
    "stretches",
    "vehicle_size",
]

STANDSTILL = 0.1
"""A vehicle at most this fast stands still [m/s]; wheel-speed sensors resolve about as much."""
LINE_TOLERANCE = 0.1
"""How far over the stopping line a bumper may stand and still have stopped before it [m]."""
BLOCKING_TIME = 3.0
"""A vehicle that stands in the junction for longer than this blocks it [s]."""
SPEED_TOLERANCE = 0.5
"""How much faster than the limit is still within what a speed control holds [m/s]."""
CONFLICT_WIDTH = 2.6
"""Two movements whose centre lines come nearer than this are in conflict [m]: the width of a car and what its body sweeps
in a bend."""
_SPACING = 0.5


def vehicle_size(run: Run) -> tuple[float, float]:
    """Return length and width of the vehicles of a run [m].

    Raises:
        RunError: the run does not record them in ``meta["vehicle"]``.
    """
    recorded = run.meta.get("vehicle") or {}
    if recorded.get("length") is None or recorded.get("width") is None:
        raise RunError("the run holds no size of its vehicles")
    return float(recorded["length"]), float(recorded["width"])


def speed_limit(run: Run) -> float:
    """Return the speed limit [m/s].

    Raises:
        RunError: the run does not record it in ``meta["speed_limit"]``.
    """
    if run.meta.get("speed_limit") is None:
        raise RunError("the run holds no speed limit")
    return float(run.meta["speed_limit"])


def _speed(run: Run, agent: int) -> NDArray[np.float64]:
    if run.speed is None:
        raise RunError("the run holds no speeds")
    return run.speed[:, agent]


def _station(run: Run, agent: int) -> NDArray[np.float64]:
    if run.station is None:
        raise RunError("the run holds no positions")
    return run.station[:, agent]


def stopped(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent is at its entrance and has stood still there, before the stopping line, in the present approach."""
    here = run.zone[:, agent] == Zone.ENTRANCE
    line = -run.junction.setbacks[run.agents[agent].entrance] + LINE_TOLERANCE
    still = here & (_speed(run, agent) <= STANDSTILL) & (_station(run, agent) <= line)
    tick = np.arange(run.steps)
    last_still = np.maximum.accumulate(np.where(still, tick, -1))
    last_away = np.maximum.accumulate(np.where(here, -1, tick))
    found: NDArray[np.bool_] = here & (last_still > last_away)
    return found


def standing_time(run: Run, agent: int) -> NDArray[np.int32]:
    """Return for how many steps the agent has been standing at its entrance, shape ``(steps,)``.

    This is the waiting time as the text of the paper has it, "since its speed became zero"; it restarts when the vehicle moves.
    """
    tick = np.arange(run.steps, dtype=np.int32)
    still = (run.zone[:, agent] == Zone.ENTRANCE) & (_speed(run, agent) <= STANDSTILL)
    found: NDArray[np.int32] = tick - np.maximum.accumulate(np.where(still, 0, tick))
    return found


def stands_inside(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent stands still with part of its body in the junction."""
    who = run.agents[agent]
    length, _ = vehicle_size(run)
    station = _station(run, agent)
    inside = (station > 0.0) & (station - length < run.junction.movements[who.entrance, who.exit].length)
    found: NDArray[np.bool_] = inside & (run.zone[:, agent] != Zone.GONE) & (_speed(run, agent) <= STANDSTILL)
    return found


def blocks(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has been standing for longer than `BLOCKING_TIME` with part of its body in the junction."""
    tick = np.arange(run.steps)
    since = np.maximum.accumulate(np.where(stands_inside(run, agent), -1, tick))
    found: NDArray[np.bool_] = (tick - since) * run.dt > BLOCKING_TIME
    return found


def speeding(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent drives faster than the limit and the tolerance."""
    found: NDArray[np.bool_] = _speed(run, agent) > speed_limit(run) + SPEED_TOLERANCE
    return found


def collide(run: Run, one: int, two: int) -> NDArray[np.bool_]:
    """The bodies of two agents touch for the first time."""
    if run.pose is None and not run.collisions:
        raise RunError("the run holds neither positions nor collisions")
    pair = {run.agents[one].name, run.agents[two].name}
    found = np.zeros(run.steps, dtype=np.bool_)
    for collision in run.collisions:
        if set(collision.agents) == pair:
            found[min(max(round(collision.time / run.dt), 0), run.steps - 1)] = True
    return found


Way = tuple[int, int]
"""A movement: entrance and exit."""
Stretch = tuple[float, float]
"""Part of a movement, from and to, after the entrance vertex [m]."""


@lru_cache(maxsize=64)
def stretches(junction: Junction) -> dict[tuple[Way, Way], tuple[Stretch, Stretch]] | None:
    """Return where movements get in each other's way: per pair, in both orders, the stretch on the one and on the other.

    Movements from one entrance don't count: there one vehicle follows the other. None without geometry.
    """
    if junction.geometry is None:
        return None
    lines = {way: _sample(segment) for way, segment in junction.geometry.movements.items()}
    found = {}
    for one, (along, first) in lines.items():
        for two, (across, second) in lines.items():
            if one[0] >= two[0]:
                continue
            near = np.hypot(first[:, None, 0] - second[None, :, 0], first[:, None, 1] - second[None, :, 1]) < CONFLICT_WIDTH
            if near.any():
                here, there = along[near.any(axis=1)], across[near.any(axis=0)]
                mine, yours = (float(here[0]), float(here[-1])), (float(there[0]), float(there[-1]))
                found[one, two], found[two, one] = (mine, yours), (yours, mine)
    return found


@lru_cache(maxsize=64)
def conflicts(junction: Junction) -> frozenset[tuple[Way, Way]] | None:
    """Return the pairs of movements, in both orders, that two vehicles can't make at the same time; None without geometry."""
    found = stretches(junction)
    return None if found is None else frozenset(found)


def _sample(segment: Segment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations, shape ``(k,)``, and points, shape ``(k, 2)``, along a centre line [m]."""
    stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
    return stations, np.array([segment.pose(float(s))[:2] for s in stations])
