"""Where movements get in each other's way: the stretches that two of them share."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.segment import Segment
from pytest_rvads.runs.run import Run

__all__ = [
    "CONFLICT_WIDTH",
    "Shared",
    "Stretch",
    "Way",
    "before_exit",
    "conflicts",
    "meet",
    "on_stretch",
    "position",
    "shared",
    "stretches",
]

CONFLICT_WIDTH = 2.6
"""Two movements whose centre lines come nearer than this are in conflict [m]: the width of a car and what its body sweeps
in a bend."""
_SPACING = 0.5

Way = tuple[int, int]
"""A movement: entrance and exit."""


class Stretch(NamedTuple):
    """Part of a movement, after the entrance vertex."""

    start: float
    """[m]."""
    end: float
    """[m]."""


class Shared(NamedTuple):
    """Where two movements get in each other's way."""

    mine: Stretch
    """On the first movement."""
    yours: Stretch
    """On the second one."""
    merges: bool
    """Whether both lead into the same exit: behind each other there is then room for both."""


@lru_cache(maxsize=64)
def stretches(junction: Junction) -> dict[tuple[Way, Way], Shared] | None:
    """Return what pairs of movements share, in both orders; None without geometry.

    Movements from one entrance don't count: there one vehicle follows the other.
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
                mine, yours = Stretch(float(here[0]), float(here[-1])), Stretch(float(there[0]), float(there[-1]))
                merges = one[1] == two[1]
                found[one, two], found[two, one] = Shared(mine, yours, merges), Shared(yours, mine, merges)
    return found


@lru_cache(maxsize=64)
def conflicts(junction: Junction) -> frozenset[tuple[Way, Way]] | None:
    """Return the pairs of movements, in both orders, that two vehicles can't make at the same time; None without geometry."""
    found = stretches(junction)
    return None if found is None else frozenset(found)


def shared(run: Run, one: int, two: int) -> Shared | None:
    """Return what the movements of two agents, given by column, share; None where they don't meet.

    Raises:
        RunError: the run holds no geometry of its junction.
    """
    found = stretches(run.junction)
    if found is None:
        raise RunError("the run holds no geometry of its junction")
    first, second = run.agents[one], run.agents[two]
    return found.get(((first.entrance, first.exit), (second.entrance, second.exit)))


def position(run: Run, agent: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the stations of front and rear of an agent, each of shape ``(steps,)`` [m].

    Raises:
        RunError: the run holds no positions, or not the size of the vehicle.
    """
    front = run.need("station")[:, agent]
    return front, front - run.size(agent)[0]


def on_stretch(run: Run, agent: int, stretch: Stretch) -> NDArray[np.bool_]:
    """Return where part of the body of an agent is on a stretch of its movement, shape ``(steps,)``."""
    front, rear = position(run, agent)
    found: NDArray[np.bool_] = (front >= stretch.start) & (rear <= stretch.end)
    return found


def meet(run: Run, one: int, two: int) -> NDArray[np.bool_]:
    """Return where both agents are on the stretch that their movements share, shape ``(steps,)``.

    Where both lead into the same exit they meet when one is beside the other, not when it follows.
    """
    common = shared(run, one, two)
    if common is None:
        return np.zeros(run.steps, dtype=np.bool_)
    both = on_stretch(run, one, common.mine) & on_stretch(run, two, common.yours)
    if common.merges:
        (front, rear), (ahead, behind) = before_exit(run, one), before_exit(run, two)
        both &= (front > behind) & (ahead > rear)
    return both


def before_exit(run: Run, agent: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where front and rear of an agent are, counted from its exit vertex, each of shape ``(steps,)`` [m]."""
    front, rear = position(run, agent)
    who = run.agents[agent]
    length = run.junction.movements[who.entrance, who.exit].length
    return front - length, rear - length


def _sample(segment: Segment) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return stations, shape ``(k,)``, and points, shape ``(k, 2)``, along a centre line [m]."""
    stations = np.append(np.arange(0.0, segment.length, _SPACING), segment.length)
    return stations, np.array([segment.pose(float(s))[:2] for s in stations])
