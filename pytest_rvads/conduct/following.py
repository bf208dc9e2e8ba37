"""What depends on the past, followed state by state: the same as on a whole run, in constant time and memory per state.

The functions of the predicates take a run of the first state and the columns of the agents, and return what reads the next ones.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct import standing
from pytest_rvads.conduct.bodies import collide
from pytest_rvads.conduct.grounds import may_owe
from pytest_rvads.conduct.priority import Encounter, due, owed_before, yields
from pytest_rvads.conduct.progress import BLOCKING_TIME, PATIENCE, blocking_time, lost_time, part
from pytest_rvads.conduct.stretches import shared
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone

__all__ = ["Follower", "Past", "blocks", "idles", "obstructs", "owes", "stopped"]

Follower = Callable[[Run], bool]
"""Reads a run of one state, the next one, and returns whether something holds there."""


class Past:
    """What runs of one state take over from those before: waiting times, lights at the entry, who entered first, progress.

    Args:
        agents: number of vehicles.
    """

    def __init__(self, agents: int) -> None:
        self._tick = -1
        self._wt = np.full(agents, -1, dtype=np.int32)
        self._entered = np.full(agents, np.iinfo(np.int64).max)
        self._facing: NDArray[np.int8] | None = None
        self._station: NDArray[np.float64] | None = None

    def carry(self, run: Run) -> None:
        """Give a run of one state, the next one, what it takes over."""
        self._tick += 1
        zone = run.zone[0]
        self._wt = np.where((zone == Zone.ENTRANCE) & (self._wt >= 0), self._wt + 1, 0).astype(np.int32)
        before = self._entered < self._tick
        self._entered = np.where((zone >= Zone.JUNCTION) & ~before, np.minimum(self._entered, self._tick), self._entered)
        now = run.lights[0, [agent.entrance for agent in run.agents]]
        self._facing = now if self._facing is None else np.where(before, self._facing, now)
        known = run.__dict__
        known["wt"], known["entered"], known["facing"] = self._wt[None], self._entered, self._facing[None]
        if run.station is not None and run.speed is not None:
            rate = run.speed[0] if self._station is None else (run.station[0] - self._station) / run.dt
            known["advance"], self._station = rate[None], run.station[0]


def stopped(_run: Run, agent: int) -> Follower:
    """Follow `standing.stopped`."""
    held = False

    def follow(run: Run) -> bool:
        nonlocal held
        here, stood = standing.stops(run, agent)
        held = bool(here[0] and (held or stood[0]))
        return held

    return follow


def blocks(_run: Run, agent: int) -> Follower:
    """Follow `progress.blocks`."""
    total = 0.0

    def follow(run: Run) -> bool:
        nonlocal total
        total += float(blocking_time(run, agent)[0])
        return total > BLOCKING_TIME

    return follow


def idles(_run: Run, agent: int) -> Follower:
    """Follow `progress.idles`."""
    total, before = 0.0, -1

    def follow(run: Run) -> bool:
        nonlocal total, before
        now = int(part(run, agent)[0])
        total, before = (total if now == before else 0.0) + float(lost_time(run)[0, agent]), now
        return total > PATIENCE

    return follow


def _priority(first: Run, agent: int, other: int) -> Callable[[Run], tuple[bool, bool]]:
    common = shared(first, agent, other) if may_owe(first, agent, other) else None
    if common is None:
        return lambda _run: (False, False)
    encounter = Encounter(first, agent, other, common)

    def follow(run: Run) -> tuple[bool, bool]:
        better = yields(run, agent, other)
        bound = better & due(run, other, common.yours)
        (row,) = encounter.rows(run, better, bound, collide(run, agent, other))
        taking, hit = (False, False) if encounter.over else encounter.step(*row)
        return bool(owed_before(run, agent, bound, common)[0]) or taking, hit

    return follow


def owes(first: Run, agent: int, other: int) -> Follower:
    """Follow `priority.owes`."""
    follow = _priority(first, agent, other)
    return lambda run: follow(run)[0]


def obstructs(first: Run, agent: int, other: int) -> Follower:
    """Follow `priority.obstructs`."""
    follow = _priority(first, agent, other)
    return lambda run: follow(run)[1]
