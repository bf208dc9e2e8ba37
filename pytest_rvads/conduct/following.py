"""Who gives way to whom, followed instant by instant: the same as on a whole run, in constant time and memory per instant."""

from __future__ import annotations

import math
from collections.abc import Callable

from pytest_rvads.conduct.bodies import collide
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.conduct.priority import Encounter, Meeting
from pytest_rvads.conduct.standing import STANDSTILL
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, APPROACH, ENTRANCE, JUNCTION

__all__ = ["Follower", "Giving"]

Follower = Callable[[Run], bool]
"""Reads a run of one state, the next one, and returns whether something holds there."""


class Giving:
    """Whether a vehicle owes the way to another one, and whether it obstructs it: `priority.owes` and `priority.obstructs`.

    Args:
        now: the instant in which both are there for the first time.
        me: the vehicle that may owe the way.
        you: the one that it may owe it to.

    Raises:
        RunError: it is not known where the lanes lie.
    """

    __slots__ = ("_active", "_encounter", "_me", "_pair", "_you", "never", "value")

    def __init__(self, now: Instant, me: Mover, you: Mover) -> None:
        self._me, self._you = me, you
        self._pair = now.pair(me, you)
        common = self._pair.contested if self._pair.owing else None
        self.never = common is None
        """Whether it never owes it."""
        self._encounter = None if common is None else Encounter(me.agent, you.agent, common, now.dt)
        self._active = False
        self.value = (False, False)
        """Whether it owes the way, and whether it obstructs the other one, in the latest instant."""

    def follow(self, now: Instant) -> None:
        """Read an instant."""
        me, you, encounter = self._me, self._you, self._encounter
        self.value = (False, False)
        if encounter is None or encounter.over or me.zone == ABSENT:
            return
        if not self._active:
            if me.zone == APPROACH and me.station < me.line - me.reach:
                return
            self._begin(now, encounter)
        inside, common = me.zone >= JUNCTION, encounter.common
        self.value = encounter.step(
            Meeting(
                inside,
                me.zone >= ENTRANCE,
                me.here and now.yields(self._pair) and now.due(you, common.yours),
                inside and self._touching(now),
                me.station,
                me.station - me.length if me.here else math.inf,
                abs(me.speed) <= STANDSTILL,
                you.station,
                you.speed,
                inside and now.unhindered(you),
                inside and now.starting(you),
                inside and now.waives(you),
                inside and me.station >= common.mine.start and now.kept(me, you),
            )
        )

    def _begin(self, now: Instant, encounter: Encounter) -> None:
        """Read what counts of the instants before: whether this vehicle was inside already, and how fast the other one was."""
        self._active = True
        nan = math.nan
        if self._me.entered < now.tick:
            encounter.step(Meeting(True, True, False, False, nan, nan, False, nan, nan, False, False, False, False))
        for speed in list(self._you.speeds)[:-1]:
            encounter.step(Meeting(False, False, False, False, nan, nan, False, nan, speed, False, False, False, False))

    def _touching(self, now: Instant) -> bool:
        return bool(collide(now.block, self._me.slot, self._you.slot)[0])
