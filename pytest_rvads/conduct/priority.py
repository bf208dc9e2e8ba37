"""Whether a vehicle gave way to the vehicle that it owed the way to.

A vehicle obstructs the other vehicle when it takes the way all the same, and the other vehicle touches it, meets it, brakes
hard, loses much of its speed, or is passed as it sets off: "neither endanger nor substantially impede" (StVO, section 8(2)).
The way is owed until the vehicle is clear: "at any time during the turning movement" (California Vehicle Code 21801(a)).
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.bodies import collide
from pytest_rvads.conduct.grounds import lit, may_owe
from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.motion import facing
from pytest_rvads.conduct.presence import window
from pytest_rvads.conduct.rights import due, held, kept_by, starting, waives, yields
from pytest_rvads.conduct.standing import STANDSTILL
from pytest_rvads.conduct.stretches import contested, position
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.maps.control import Sign
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Colour, Zone

__all__ = [
    "HARD_BRAKING",
    "HEADWAY",
    "MIN_GAP",
    "WINDOW",
    "Encounter",
    "Meeting",
    "brakes_hard",
    "obstructs",
    "owes",
    "unhindered",
]

HARD_BRAKING = 2.0
"""A vehicle that has to brake harder than this on account of another vehicle is impeded [m/s^2]."""
BEND_BRAKING = 4.0
"""A vehicle that turns brakes for its bend anyway, and is impeded when it has to brake harder than this [m/s^2]."""
MIN_GAP = 1.0
"""Two vehicles that pass a place within this time of each other nearly meet [s]; the usual threshold of post-encroachment
times."""
HEADWAY = 2.0
"""A vehicle that follows another one at less than this time brakes on its account [s]: the two-second rule (UK Highway Code,
rule 126)."""
WINDOW = 0.1
"""Decelerations are differences of speed over this time [s]."""
LOSS = 3.0
"""A vehicle that goes straight on and loses more speed than this, and more than `SHARE`, is impeded [m/s]."""
SHARE = 1 / 3
"""Share of its speed that an unimpeded vehicle does not lose."""


def unhindered(run: Run, agent: int) -> NDArray[np.bool_]:
    """The agent has no reason of its own to brake: its light, its stop sign, whom it owes the way, who drives ahead of it."""
    found: NDArray[np.bool_] = ~held(run)[:, agent]
    if lit(run.junction, run.agents[agent].entrance):
        found &= facing(run)[:, agent] == Colour.GREEN
    elif run.junction.entrances[run.agents[agent].entrance].sign is Sign.STOP:
        found &= run.zone[:, agent] >= Zone.JUNCTION
    for other, who in enumerate(run.agents):
        begin, end = window(run, (agent, other))
        if other != agent and who.entrance == run.agents[agent].entrance and begin < end:
            when = slice(begin, end)
            (front, _), (ahead, behind) = position(run, agent, when), position(run, other, when)
            near = behind - front < HEADWAY * run.need("speed")[when, agent]
            found[when] &= ~((ahead > front) & near & (run.zone[when, other] <= Zone.JUNCTION))
    return found


def owes(run: Run, agent: int, other: int) -> NDArray[np.bool_]:
    """The agent, from its entrance zone on until it has been clear for `MIN_GAP`, has to let the other one go first."""
    return once(run, _encounter, agent, other)[0]


def obstructs(run: Run, agent: int, other: int) -> NDArray[np.bool_]:
    """The agent took the way that it owed to the other one, and got in its way."""
    return once(run, _encounter, agent, other)[1]


def _encounter(run: Run, agent: int, other: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    owed = np.zeros(run.steps, dtype=np.bool_)
    broken = np.zeros(run.steps, dtype=np.bool_)
    common = contested(run, agent, other) if may_owe(run, agent, other) else None
    if common is None:
        return owed, broken
    bound = yields(run, agent, other) & due(run, other, common.yours) & run.here[:, agent]
    ticks = np.flatnonzero(bound)
    if not len(ticks):
        return owed, broken
    owed |= bound & (run.zone[:, agent] == Zone.ENTRANCE)
    if run.entered[agent] < run.steps:
        encounter = Encounter(run.agents[agent], run.agents[other], common, run.dt)
        first, last = max(int(run.entered[agent]) - 1 - round(WINDOW / run.dt), 0), int(ticks[-1])
        for tick, meeting in enumerate(_meetings(run, agent, other, bound, slice(first, run.steps)), first):
            owed[tick], broken[tick] = encounter.step(meeting)
            if encounter.over or (tick > last and not encounter.owed):
                owed[tick + 1 :] = False
                break
    return owed, broken


class Meeting(NamedTuple):
    """What two vehicles do in one state."""

    inside: bool
    """Whether the agent has entered the junction."""
    near: bool
    """Whether it is in its entrance zone or beyond."""
    bound: bool
    """Whether it has to give way to the other vehicle, which is due."""
    touching: bool
    """Whether the bodies of the two vehicles touch."""
    front: float
    """Station of the front of the agent [m]."""
    rear: float
    """Station of its rear, infinite once it is gone [m]."""
    still: bool
    """Whether the agent stands."""
    ahead: float
    """Station of the front of the other vehicle; NaN where it is absent [m]."""
    speed: float
    """Speed of the other vehicle, likewise [m/s]."""
    unhindered: bool
    """Whether the other vehicle has no reason of its own to brake."""
    starting: bool
    """Whether the other vehicle is first at its line and about to go."""
    waives: bool
    """Whether the other vehicle waives its right."""
    kept: bool
    """Whether a third vehicle, which was not there before, keeps the agent."""


def _meetings(run: Run, agent: int, other: int, bound: NDArray[np.bool_], when: slice) -> list[Meeting]:
    (front, rear), (ahead, _) = (position(run, k, when) for k in (agent, other))
    thirds = np.delete(once(run, kept_by, agent), other, axis=1)
    columns = (
        run.zone[when, agent] >= Zone.JUNCTION,
        run.zone[when, agent] >= Zone.ENTRANCE,
        bound[when],
        collide(run, agent, other)[when],
        front,
        # A short exit road may end before the rear of the vehicle has left the stretch.
        np.where(run.here[when, agent], rear, math.inf),
        np.abs(run.need("speed")[when, agent]) <= STANDSTILL,
        ahead,
        run.need("speed")[when, other],
        once(run, unhindered, other)[when],
        starting(run)[when, other],
        waives(run)[when, other],
        thirds[when].any(axis=1),
    )
    return [Meeting(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


class Encounter:
    """Follows two vehicles state by state, until the agent has been clear of the shared stretch for `MIN_GAP`.

    The agent *goes* when it enters the junction, or when its last standstill before the stretch ends. It *takes the stretch* when
    its front reaches the stretch before the front of the other vehicle. It is *clear* when its rear has left the stretch.

    Args:
        agent: the vehicle that may owe the way.
        other: the vehicle that may have the better right.
        common: what their ways share.
        dt: time between two states [s].
    """

    def __init__(self, agent: Agent, other: Agent, common: Shared, dt: float) -> None:
        self.common, self._dt = common, dt
        self._lengths = agent.route.length, other.route.length
        self._passed = common.yours.end + (other.size[0] if other.size else 0.0)
        self._straight = other.turn is Turn.STRAIGHT
        self._speeds: deque[float] = deque(maxlen=max(round(WINDOW / dt), 1) + 1)
        self._tick = 0
        self._since: int | None = None
        self._left: int | None = None
        self._taken = self._first = self._braked = self._started = self._excused = False
        self._place = self._speed = self._pace = math.nan
        self.owed = False
        """Whether the agent has owed the way since it went."""
        self.over = False
        """Whether nothing can happen any more."""

    def step(self, now: Meeting) -> tuple[bool, bool]:
        """Read a state and return whether the agent owes the way, and whether it obstructs the other vehicle."""
        tick, self._tick = self._tick, self._tick + 1
        if math.isnan(now.speed):
            self._speeds.clear()
        else:
            self._speeds.append(now.speed)
        if not now.inside:
            return now.bound and now.near, False
        mine, yours = self.common.mine, self.common.yours
        before = now.front < mine.start
        if self._since is None or (before and now.still and not self._first):
            self._started, self._excused = now.starting, now.waives
            self._braked = self.owed = False
            self._place = math.nan
        if math.isnan(self._place):
            self._since, self._place, self._speed, self._pace = tick, now.ahead, now.speed, now.speed
        self.owed |= now.bound
        if not self._taken and not self._first:
            self._first = now.ahead >= yours.start
            self._taken = not before and now.ahead < yours.start
        if self._left is None and now.rear > mine.end:
            self._left = tick
        self._excused |= now.kept and not before and self._left is None
        self._look_at_braking(now)
        hit = self.owed and not self._excused and self._obstructed(tick, now)
        owes = now.bound and not self._excused
        passed = now.ahead > self._passed or (self._left is not None and (tick - self._left) * self._dt >= MIN_GAP)
        self.over = self.over or passed
        return owes or hit, hit

    def _look_at_braking(self, now: Meeting) -> None:
        """Note whether the other vehicle, before the stretch, brakes or slows down without a reason of its own."""
        if not now.unhindered:
            self._pace = min(self._pace, now.speed)
        elif now.ahead < self.common.yours.start:
            slowed = self._straight and now.speed < min(self._pace - LOSS, self._pace * (1 - SHARE))
            self._braked |= slowed or brakes_hard(self._speeds, self._dt, straight=self._straight)

    def _obstructed(self, tick: int, now: Meeting) -> bool:
        mine, yours = self.common.mine, self.common.yours
        there = now.ahead >= yours.start
        if now.touching and there and now.front >= mine.start and self._left is None:
            return True
        if not self._taken or self._since is None:
            return False
        if there:
            if self._left is not None:
                return (tick - self._left) * self._dt < MIN_GAP and not self.common.merges
            if not self.common.merges:
                return True
            apart = (now.rear - self._lengths[0]) - (now.ahead - self._lengths[1])
            return apart < MIN_GAP * now.speed
        # The other vehicle would be there by the time the agent has been clear for a while, had it gone on as it came.
        unhindered = self._place + self._speed * ((tick - self._since) * self._dt + MIN_GAP)
        return self._started or (self._braked and self._left is None and unhindered > yours.start)


def brakes_hard(speeds: deque[float], dt: float, *, straight: bool) -> bool:
    """Return whether a vehicle brakes harder than it does by itself, given its last speeds [m/s], `dt` apart [s]."""
    steps = len(speeds) - 1
    return steps > 0 and speeds[0] - speeds[-1] > (HARD_BRAKING if straight else BEND_BRAKING) * steps * dt
