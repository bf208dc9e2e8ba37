"""Who gives way to whom, followed instant by instant: the same as on a whole run, in constant time and memory per instant."""

from __future__ import annotations

import math
from collections.abc import Callable

from pytest_rvads.conduct.clearance import Bodies
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.conduct.priority import Encounter
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, APPROACH, JUNCTION

__all__ = ["Follower", "Giving"]

Follower = Callable[[Run], bool]
"""Reads a run of one state, the next one, and returns whether something holds there."""


class Giving:
    """Whether a vehicle owes the way to another one, and whether it obstructs it: `priority.owes` and `priority.obstructs`.

    Args:
        now: the instant in which both are there for the first time.
        me: the vehicle that may owe the way.
        you: the one that it may owe it to.
        bodies: of the two.

    Raises:
        RunError: it is not known where the lanes lie.
    """

    __slots__ = ("_active", "_bodies", "_encounter", "_me", "_pair", "_you", "never", "value")

    def __init__(self, now: Instant, me: Mover, you: Mover, bodies: Bodies) -> None:
        self._me, self._you, self._bodies = me, you, bodies
        self._pair = now.pair(me, you)
        common = self._pair.common if self._pair.owing else None
        self.never = common is None
        """Whether it never owes it."""
        self._encounter = None if common is None else Encounter(now.run, me.slot, you.slot, common)
        self._active = False
        self.value = (False, False)
        """Whether it owes the way, and whether it obstructs the other one, in the latest instant."""

    def follow(self, now: Instant) -> None:
        """Read an instant."""
        me, encounter = self._me, self._encounter
        self.value = (False, False)
        if encounter is None or (encounter.over and not me.zone <= JUNCTION) or me.zone == ABSENT:
            return
        if not self._active:
            if me.zone == APPROACH and me.station < me.line - me.reach:
                return
            self._begin(now, encounter)
        pair, you = self._pair, self._you
        common = encounter.common
        inside, front = me.zone >= JUNCTION, me.station
        there = front >= common.mine.start
        better = now.yields(pair)
        bound = better and now.due(you, common.yours)
        owes, obstructs = bound and not there and me.zone > APPROACH and me.zone <= JUNCTION, False
        if not encounter.over:
            ahead, rear = you.station, front - me.length
            if common.merges:
                ahead, rear = ahead - you.agent.route.length, rear - me.agent.route.length
            if not me.here:
                rear = math.inf
            braked = inside and max(you.speeds, default=0.0) > you.speed
            free = braked and now.unhindered(you)
            touch = inside and self._touching(now)
            taking, obstructs = encounter.step(inside, better, bound, touch, there, rear, ahead, you.speed, free)
            owes = owes or taking
        self.value = (owes, obstructs)

    def _begin(self, now: Instant, encounter: Encounter) -> None:
        """Read what counts of the instants before: how fast the other one was (NaN: not there), and who was inside already."""
        self._active = True
        inside = self._me.entered < now.tick
        for speed in list(self._you.speeds)[:-1]:
            encounter.step(inside, False, False, False, False, -math.inf, math.nan, speed, False)

    def _touching(self, now: Instant) -> bool:
        if now.touching is None:
            return self._bodies.look(now)
        return frozenset((self._me.agent.name, self._you.agent.name)) in now.touching
