"""Who has to give way to whom, and whether he did: the hazard that the law speaks of, in seconds and metres.

A vehicle owes the way to one that has the better right and *is due*: it comes "so closely as to be a hazard" (California
Vehicle Code 21801(a), 21453(b)), or stands at its line and is next to go. It obstructs it when it takes the way all the same and
the other one has to brake hard, meets it, or touches it: "neither endanger nor substantially impede" (StVO, section 8(2)). The
numbers are named here.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.bodies import collide
from pytest_rvads.conduct.grounds import ground_of, lit, may_owe
from pytest_rvads.conduct.memo import each, once
from pytest_rvads.conduct.presence import window
from pytest_rvads.conduct.standing import leads
from pytest_rvads.conduct.stretches import ALWAYS, before_exit, position, shared
from pytest_rvads.junctions.conflicts import Shared, Stretch
from pytest_rvads.maps.control import JunctionControl, Sign
from pytest_rvads.maps.segment import Turn
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["DUE", "HARD_BRAKING", "MIN_GAP", "WINDOW", "Encounter", "due", "obstructs", "owed_before", "owes", "yields"]

DUE = 4.0
"""Who reaches the shared stretch within this time at its present speed is due [s]: the usual critical gap of a left turn
across oncoming traffic (Highway Capacity Manual: 4.1 s)."""
HARD_BRAKING = 2.0
"""Who has to brake harder than this on account of another is impeded [m/s^2]."""
BEND_BRAKING = 4.0
"""Who turns brakes for its bend anyway, and is impeded when it has to brake harder than this [m/s^2]."""
MIN_GAP = 1.0
"""Two that pass a place within this time of each other nearly meet [s]; the usual threshold of post-encroachment times."""
HEADWAY = 2.0
"""Who follows another one at less than this time brakes on its account [s]: the two-second rule (UK Highway Code, rule 126)."""
WINDOW = 0.1
"""Decelerations are differences of speed over this time [s]."""


def has_way(run: Run, agent: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """No light keeps the agent from going: it is green or yellow, was when the agent entered, or there is none."""
    facing = run.facing[when, agent]
    found: NDArray[np.bool_] = (facing == Colour.GREEN) | (facing == Colour.YELLOW)
    return found if lit(run.junction, run.agents[agent].entrance) else np.ones_like(found)


def due(run: Run, agent: int, stretch: Stretch, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """The agent is on a stretch of its movement, would be there within `DUE` at its present speed, or is next at its line."""
    found: NDArray[np.bool_] = (_coming(run, agent, stretch, when) | _next(run)[when, agent]) & run.here[when, agent]
    return found


def _coming(run: Run, agent: int, stretch: Stretch, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """Whether the agent is on a stretch of its movement, or would be there within `DUE` at its present speed."""
    front, rear = position(run, agent, when)
    speed = run.need("speed")[when, agent]
    found: NDArray[np.bool_] = (stretch.start - front <= DUE * np.maximum(speed, 0.0)) & (rear <= stretch.end)
    return found


def _next(run: Run) -> NDArray[np.bool_]:
    """Return who is first at its line and has the right to go, shape ``(steps, agents)``: at green, or where it owes nobody."""
    return once(run, _find_next)


def _find_next(run: Run) -> NDArray[np.bool_]:
    found = _first(run)
    if run.junction.control is JunctionControl.STOP:  # there the order of arrival decides
        return np.zeros_like(found)
    for agent, who in enumerate(run.agents):
        if lit(run.junction, who.entrance):
            found[:, agent] &= run.facing[:, agent] == Colour.GREEN
        else:
            found[:, agent] &= ~_held(run)[:, agent]
    return found


def _first(run: Run) -> NDArray[np.bool_]:
    """Return who is at its entrance with nobody before it there, shape ``(steps, agents)``."""
    first = [leads(run, agent) for agent in range(len(run.agents))]
    found: NDArray[np.bool_] = run.zone == Zone.ENTRANCE
    if first:
        found &= np.stack(first, axis=1)
    return found


def _held(run: Run) -> NDArray[np.bool_]:
    """Return who has to let somebody pass that comes or is first at its line, shape ``(steps, agents)``; not by lights alone.

    Whoever is held itself counts as well, so that of vehicles that hold each other in a circle none is due by standing there.
    """
    return once(run, _find_held)


def _find_held(run: Run) -> NDArray[np.bool_]:
    first = _first(run)
    found = np.zeros_like(first)
    for agent, who in enumerate(run.agents):
        if lit(run.junction, who.entrance):
            continue
        for other in range(len(run.agents)):
            common = shared(run, agent, other) if may_owe(run, agent, other) else None
            begin, end = window(run, (agent, other))
            if common is not None and begin < end:
                when = slice(begin, end)
                there = _coming(run, other, common.yours, when) & run.here[when, other]
                found[when, agent] |= (there | first[when, other]) & yields(run, agent, other, when)
    return found


def _unhindered(run: Run, agent: int) -> NDArray[np.bool_]:
    """Whether the agent has no reason of its own to brake: its light, its stop sign, who has priority, who drives ahead of it."""
    found: NDArray[np.bool_]
    if lit(run.junction, run.agents[agent].entrance):
        found = run.facing[:, agent] == Colour.GREEN
    else:
        found = ~_held(run)[:, agent]
        if run.junction.entrances[run.agents[agent].entrance].sign is Sign.STOP:
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
    """The agent, at its entrance or inside, has to let the other one go first; once it took the way, until both have passed."""
    return each(run, _encounter, agent, other)[0]


def obstructs(run: Run, agent: int, other: int) -> NDArray[np.bool_]:
    """The agent took the way that it owed to the other one, which meets it, touches it or had to brake hard for it."""
    return each(run, _encounter, agent, other)[1]


def _encounter(run: Run, agent: int, other: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    owed = np.zeros(run.steps, dtype=np.bool_)
    broken = np.zeros(run.steps, dtype=np.bool_)
    common = shared(run, agent, other) if may_owe(run, agent, other) else None
    if common is None:
        return owed, broken
    better = yields(run, agent, other)
    bound = better & due(run, other, common.yours) & run.here[:, agent]
    ticks = np.flatnonzero(bound)
    if not len(ticks):
        return owed, broken
    owed |= owed_before(run, agent, bound, common)
    if run.entered[agent] < run.steps:
        follower = Encounter(run, agent, other, common)
        first, last = max(int(run.entered[agent]) - 1 - round(WINDOW / run.dt), 0), int(ticks[-1])
        rows = follower.rows(run, better, bound, collide(run, agent, other), slice(first, run.steps))
        for tick, row in enumerate(rows, first):
            taking, broken[tick] = follower.step(*row)
            owed[tick] |= taking
            if follower.over or (tick > last and not follower.owed):
                break
    return owed, broken


def owed_before(run: Run, agent: int, bound: NDArray[np.bool_], common: Shared) -> NDArray[np.bool_]:
    """Return where the agent, at its entrance or inside, has not come to the shared stretch and has to give way."""
    zone = run.zone[:, agent]
    ahead = position(run, agent)[0] < common.mine.start
    found: NDArray[np.bool_] = bound & ahead & ((zone == Zone.ENTRANCE) | (zone == Zone.JUNCTION))
    return found


def yields(run: Run, agent: int, other: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """The agent has to give way to the other one where their ways meet, as the lights are.

    Turning across oncoming traffic it does to who also has the right to go (Vienna Convention on Road Traffic, Art. 16(2));
    turning to the near side on red to everybody who has it (CVC 21453(b)). Without lights it does on the ground that there is;
    to who comes to a light, as long as that lets it go.
    """
    me, you, junction = run.agents[agent], run.agents[other], run.junction
    facing = run.facing[when, agent]
    if not lit(junction, me.entrance):
        mine = np.ones(len(facing), dtype=np.bool_)
    elif me.turn is junction.near:
        mine = facing == Colour.RED
        if not lit(junction, you.entrance) and ground_of(junction, me.route.key, you.route.key) is not None:
            mine = np.ones_like(mine)
    else:
        mine = facing != Colour.RED
    found: NDArray[np.bool_] = mine & has_way(run, other, when)
    return found


class Encounter:
    """Follows two vehicles state by state, up to where one of them has passed the stretch that they share.

    Args:
        run: that the vehicles belong to; its states are not read.
        agent: column of the vehicle that may owe the way.
        other: column of the one that it may owe it to.
        common: what their movements share.
    """

    def __init__(self, run: Run, agent: int, other: int, common: Shared) -> None:
        self._agent, self._other, self._dt = agent, other, run.dt
        self.common = common
        """What their movements share."""
        who = run.agents[other]
        self._hard = HARD_BRAKING if who.turn is Turn.STRAIGHT else BEND_BRAKING
        self._arrives, self._clear = common.yours.start, common.mine.end
        if common.merges:
            self._arrives -= who.route.length
            self._clear = self._arrives
        self._speeds: deque[float] = deque(maxlen=max(round(WINDOW / run.dt), 1) + 1)
        self._tick = 0
        self._first = self._braked = False
        self._entered: int | None = None
        self._taken: int | None = None
        self._left: int | None = None
        self._start = (0.0, 0.0)
        self.owed = False
        """Whether the agent has owed the way since it entered, or owes it before."""
        self.over = False
        """Whether nothing can happen any more."""

    def rows(
        self,
        run: Run,
        better: NDArray[np.bool_],
        bound: NDArray[np.bool_],
        touching: NDArray[np.bool_],
        when: slice = ALWAYS,
    ) -> list[tuple[Any, ...]]:
        """Return what `step` takes, state by state, for a run with the same agents.

        Args:
            run: the states.
            better: whether the other one has the better right, shape ``(steps,)``.
            bound: whether the agent has to give way to the other one, which is due, likewise.
            touching: whether they touch, likewise.
            when: part of the run.
        """
        agent, other = self._agent, self._other
        (front, rear), (ahead, _) = (position(run, k, when) for k in (agent, other))
        there = front >= self.common.mine.start
        if self.common.merges:
            (_, rear), (ahead, _) = (before_exit(run, k, when) for k in (agent, other))
        # Who is gone has left the way, though a short exit road may end before its rear has.
        here = run.here[when, agent]
        rear = np.where(here, rear, math.inf)
        free = each(run, _unhindered, other)[when]
        inside, speed = run.zone[when, agent] >= Zone.JUNCTION, run.need("speed")[when, other]
        columns = (inside, better[when], bound[when] & here, touching[when], there, rear, ahead, speed, free)
        return list(zip(*(column.tolist() for column in columns), strict=True))

    def step(  # noqa: PLR0913 - the columns that `rows` gives, each by its name
        self,
        inside: bool,
        better: bool,
        bound: bool,
        touching: bool,
        there: bool,
        rear: float,
        ahead: float,
        speed: float,
        free: bool,
    ) -> tuple[bool, bool]:
        """Read a state and return whether the agent is taking a way that it owed, and whether it obstructs the other one.

        Args:
            inside: whether the agent has entered the junction.
            better: whether the other one has the better right; once its light is red, it has it no more.
            bound: whether it has to give way to the other one, which is due.
            touching: whether they touch.
            there: whether its front has reached the shared stretch.
            rear: of the agent, along its movement; where both merge, from the exit [m].
            ahead: front of the other one, likewise [m].
            speed: of the other one [m/s].
            free: whether the other one has no reason of its own to brake: its light is green, or was when it entered.
        """
        tick, self._tick = self._tick, self._tick + 1
        if math.isnan(speed):  # it is not there
            self._speeds.clear()
        else:
            self._speeds.append(speed)
        if not inside:
            self.owed = bound
            return False, False
        if self._entered is None:
            self._entered, self._start = tick, (ahead, speed)
        if self._taken is None and not self._first:
            self.owed = better and (self.owed or (bound and not there))
            if there and ahead < self._arrives:
                self._taken = tick
            self._first = ahead >= self._arrives
        if rear > self._clear and self._left is None:
            self._left = tick
        self._braked |= free and ahead < self._arrives and self._brakes_hard()
        hit = self.owed and (touching or self._impeded(tick, rear, ahead))
        taking = self.owed and self._taken is not None and not self.over
        self.over = self.over or self._passed(tick, there, ahead)
        return taking or hit, hit

    def _brakes_hard(self) -> bool:
        """Return whether the other one brakes harder than it does by itself."""
        steps = len(self._speeds) - 1
        return steps > 0 and self._speeds[0] - self._speeds[-1] > self._hard * steps * self._dt

    def _impeded(self, tick: int, rear: float, ahead: float) -> bool:
        """Return whether the other one meets the agent, which was first on the shared stretch, or has braked in order not to."""
        if self._taken is None or self._entered is None or self.over:
            return False
        if ahead >= self._arrives:
            return self._left is None or (tick - self._left) * self._dt < MIN_GAP
        place, speed = self._start
        # Where it would be a little later, had it gone on as it came.
        unhindered = place + speed * ((tick - self._entered) * self._dt + MIN_GAP)
        return self._braked and unhindered > (rear if self.common.merges else self._arrives if self._left is None else math.inf)

    def _passed(self, tick: int, there: bool, ahead: float) -> bool:
        if self._taken is not None:
            return ahead >= self._arrives or (tick - self._taken) * self._dt > DUE
        return there and not self.owed
