"""Measures whether a vehicle owes another vehicle the way (has to give way to it), and whether it obstructs the other vehicle.

A vehicle obstructs the other vehicle if it takes the way that it owes, and the other vehicle touches it, meets it, brakes hard,
loses much of its speed, or was about to set off: "neither endanger nor substantially impede" (StVO, section 8(2)). A vehicle owes
the way until its rear has left the stretch that both ways share: "at any time during the turning movement" (California Vehicle
Code 21801(a)).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import Shared
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, Cast, signal, sized
from pytest_rvads.logic.conduct.bodies import collide, couples
from pytest_rvads.logic.conduct.rights import (
    GREEN,
    comes,
    held,
    kept_by,
    kept_by_walker,
    lights,
    owed_places,
    owing,
    ready,
    starting,
    waives,
    yields,
)
from pytest_rvads.logic.conduct.standing import entered, facing, lane, lasting, stands
from pytest_rvads.logic.conduct.stretches import contested, neighbours, walkers
from pytest_rvads.runs.states import Agent

HARD_BRAKING = 2.0
"""Deceleration beyond which a vehicle that brakes for another vehicle is impeded [m/s^2]."""
BEND_BRAKING = 4.0
"""Deceleration beyond which a turning vehicle, which brakes for its bend anyway, is impeded [m/s^2]."""
MIN_GAP = 1.0
"""Time between two vehicles at the same place below which the vehicles nearly meet [s]; the usual threshold of the
post-encroachment time."""
HEADWAY = 2.0
"""Time gap to the vehicle ahead below which a vehicle is taken to brake for the vehicle ahead [s].

The time gap is the two-second rule (UK Highway Code, rule 126).
"""
WINDOW = 0.1
"""Length of the windows over which decelerations are computed from speeds [s]."""
LOSS = 3.0
"""Loss of speed beyond which a vehicle that goes straight on is impeded, if the loss also exceeds `SHARE` of its speed [m/s]."""
SHARE = 1 / 3
"""Share of its speed that a vehicle has to lose, in addition to losing more than `LOSS`, to be impeded."""


def _stop_signs(cast: Cast) -> NDArray[np.bool_]:
    return np.array([cast.junction.starts[agent.entrance].sign is Sign.STOP for agent in cast.agents], dtype=np.bool_)


@signal
def unhindered(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle has no reason of its own to brake.

    Reasons are a light that is not green, a stop sign, the duty to give way, and a vehicle close ahead.
    """
    cast, both = block.cast, block.cast.static(lane)
    front = block.need("station")
    rear = front - cast.length
    near = both.second(rear) - both.first(front) < HEADWAY * both.first(block.need("speed"))
    behind = (both.second(front) > both.first(front)) & near & (both.second(block.zone) <= JUNCTION)
    lit, sign = cast.static(lights), cast.static(_stop_signs)
    unimpeded: NDArray[np.bool_] = ~held(block) & ~both.any(behind, len(cast))
    return unimpeded & np.where(lit, facing(block) == GREEN, ~sign | (block.zone >= JUNCTION))


class _Past(NamedTuple):
    """The speeds of vehicles, and how long they have been present, up to every state."""

    speeds: NDArray[np.float64]
    """The speeds in the last `WINDOW` before the block, followed by the speeds in the block [m/s]."""
    present: NDArray[np.int64]
    """For how many states each vehicle has been present, shape ``(n, agents)``."""


@signal(start=lambda dt: (0, np.full(max(round(WINDOW / dt), 1), np.nan)))
def past(block: Block, count: NDArray[np.int64], before: NDArray[np.float64]) -> tuple[_Past, NDArray[Any], NDArray[Any]]:
    """Return the speeds of vehicles before every state, and how long the vehicles have been present, see `_Past`."""
    speed = block.need("speed")
    history = _Past(np.concatenate((before, speed)), lasting(~np.isnan(speed), count))
    return history, history.present, history.speeds[None, -len(before) :]


@signal
def brakes_hard(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle brakes harder than it would without other vehicles.

    The deceleration is measured over `WINDOW`, or since the vehicle appeared if it appeared later.
    """
    speeds, present = past(block)
    speed = block.need("speed")
    most = len(speeds) - len(speed)
    steps = np.minimum(present - 1, most)
    row = np.arange(most, most + len(speed))[:, None] - np.maximum(steps, 0)
    slower = np.take_along_axis(speeds, row, axis=0) - speed
    hard = np.where(block.cast.straight, HARD_BRAKING, BEND_BRAKING)
    return (steps > 0) & (slower > hard * steps * block.dt)


class _Debts(NamedTuple):
    """The values of `owes` and `obstructs`, each of shape ``(n, pairs)``."""

    owes: NDArray[np.bool_]
    obstructs: NDArray[np.bool_]


@signal(pairs=owing)
def _bound(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's first vehicle has to give way to the second, and the second is due.

    The second vehicle is due if it soon reaches the shared stretch, or is first at its line and may go.
    """
    both, owed = block.cast.static(owing), yields(block) & ~np.isnan(block.cast.static(owed_places).begin)
    due = (comes(block) | both.second(ready(block))) & both.second(block.here)
    return owed & due & both.first(block.here)


@signal
def _bound_later(block: Block) -> frozenset[tuple[Agent, Agent]]:
    """Return the pairs of vehicles for which `_bound` holds in this block of states or in a later block of the run."""
    agents, columns = block.cast.agents, np.flatnonzero(_bound(block).any(axis=0))
    both = block.cast.static(owing)
    bound_pairs = frozenset(
        (agents[agent], agents[other]) for agent, other in zip(both.agents[columns], both.others[columns], strict=True)
    )
    return bound_pairs if block.next is None else bound_pairs | _bound_later(block.next)


@signal(pairs=owing, start=(None,))
def _debts(block: Block, before: NDArray[np.object_]) -> tuple[_Debts, NDArray[np.object_]]:
    """Return the values of `_Debts`, by an `Encounter` per pair that reads the states from the first vehicle's entry on."""
    cast, both, entry = block.cast, block.cast.static(owing), entered(block)[-1]
    bound, carried_encounters = _bound(block), before.tolist()
    owed, broken, encounters = bound & (both.first(block.zone) == ENTRANCE), np.zeros_like(bound), before.copy()
    followed = both.first(entry < block.tick + len(bound)) & ~np.isnan(cast.static(owed_places).begin)
    followed &= np.array([encounter is None or not encounter.over for encounter in carried_encounters], dtype=np.bool_)
    bound_again = np.ones(len(both), dtype=np.bool_)
    if block.whole:
        # The later blocks of the run are known: only pairs that are bound in a later block or owed the way are followed further.
        later = _bound_later(block.next) if block.next is not None else frozenset()
        bound_again = np.array([(cast.agents[a], cast.agents[b]) in later for a, b in both.column], dtype=np.bool_)
        owed_before = np.array([encounter is not None and encounter.owed for encounter in carried_encounters], dtype=np.bool_)
        followed &= bound.any(axis=0) | bound_again | owed_before
    else:
        # An encounter that begins in a later block needs the carries of these signals.
        for carried in (past, kept_by, starting, waives, *((kept_by_walker,) if len(cast.static(walkers)) else ())):
            carried(block)
    chosen = np.flatnonzero(followed)
    first_rows = np.maximum(entry[both.agents[chosen]] - block.tick, 0).tolist()
    for pair, first_row, meetings in zip(chosen.tolist(), first_rows, _meetings(block, chosen, first_rows), strict=True):
        agent, other = int(both.agents[pair]), int(both.others[pair])
        common = contested(cast, agent, other) if encounters[pair] is None else None
        if common is not None:
            encounters[pair] = Encounter.of(cast.agents[agent], cast.agents[other], common, block.dt)
            if entry[agent] < block.tick:
                encounters[pair].step(_UNSEEN)
        encounter = encounters[pair]
        last = len(bound) if bound_again[pair] else int(np.flatnonzero(bound[:, pair])[-1]) if bound[:, pair].any() else -1
        for row, meeting in enumerate(meetings, first_row):
            owed[row, pair], broken[row, pair] = encounter.step(meeting)
            if encounter.over or (row > last and not encounter.owed):
                break
    return _Debts(owed, broken), encounters[None]


def _placed(block: Block, columns: Sequence[int]) -> None:
    block.cast.static(owed_places)
    sized(block, columns)
    block.need("speed")


@signal(pairs=owing, needs=_placed)
def owes(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's first vehicle owes the second vehicle the way: it has to let the second vehicle go first.

    The first vehicle can owe the way from its entrance zone on, until its rear has been off the shared stretch for `MIN_GAP`.
    """
    debts: _Debts = _debts(block)
    return debts.owes


@signal(pairs=owing, needs=_placed)
def obstructs(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's first vehicle took the way that it owed to the second vehicle, and obstructed the second."""
    debts: _Debts = _debts(block)
    return debts.obstructs


class Meeting(NamedTuple):
    """The values of a state that an `Encounter` of two vehicles, the agent and the other vehicle, reads."""

    bound: bool
    """Whether the agent has to give way to the other vehicle, which is due: it comes soon, or is first at its line."""
    touching: bool
    """Whether the bodies of the two vehicles touch."""
    front: float
    """Station of the front of the agent [m]."""
    rear: float
    """Station of the rear of the agent [m]; infinite once the agent is gone."""
    still: bool
    """Whether the agent stands."""
    ahead: float
    """Station of the front of the other vehicle [m]; NaN if the other vehicle is absent."""
    speed: float
    """Speed of the other vehicle [m/s]; NaN if the other vehicle is absent."""
    unhindered: bool
    """Whether the other vehicle has no reason of its own to brake."""
    starting: bool
    """Whether the other vehicle is first at its line and about to go."""
    waives: bool
    """Whether the other vehicle waives its right."""
    kept: bool
    """Whether a third vehicle or a pedestrian that was not in the way when the agent entered now holds the agent up."""
    brakes: bool
    """Whether the other vehicle brakes harder than it would without other vehicles."""


_UNSEEN = Meeting(False, False, math.nan, math.nan, False, math.nan, math.nan, False, False, False, False, False)
"""The first state of an encounter whose agent entered before the other vehicle appeared, so that the values are unknown."""


def _meetings(block: Block, chosen: NDArray[np.int64], firsts: Sequence[int]) -> Iterator[Iterator[Meeting]]:
    """Yield, per chosen pair of `owing`, an iterator over the states (`Meeting`) of the pair, from the row in `firsts` on."""
    if not len(chosen):
        return
    cast, both, near, begin = block.cast, block.cast.static(owing), block.cast.static(neighbours), min(firsts)
    agents, others = both.agents[chosen], both.others[chosen]
    touching, close = cast.columns(owing, couples)[chosen], cast.columns(owing, neighbours)[chosen]
    station, speed, holding = block.need("station"), block.need("speed"), kept_by(block)
    holders = near.count(holding, len(cast))
    by_other = (close >= 0) & holding.take(close, axis=1) if len(near) else False
    kept = holders.take(agents, axis=1) > by_other
    if len(on_foot := cast.static(walkers)):
        kept |= on_foot.any(kept_by_walker(block), len(cast)).take(agents, axis=1)
    columns = (
        _bound(block).take(chosen, axis=1),
        collide(block).take(touching, axis=1),
        station.take(agents, axis=1),
        # If the exit road is short, the vehicle is gone before its rear has left the stretch.
        np.where(block.here, station - cast.length, math.inf).take(agents, axis=1),
        stands(block).take(agents, axis=1),
        station.take(others, axis=1),
        speed.take(others, axis=1),
        unhindered(block).take(others, axis=1),
        starting(block).take(others, axis=1),
        waives(block).take(others, axis=1),
        kept,
        brakes_hard(block).take(others, axis=1),
    )
    rows = [column[begin:].T.tolist() for column in columns]
    for number, first in enumerate(firsts):
        yield map(Meeting._make, zip(*(row[number][first - begin :] for row in rows), strict=True))


@dataclass(slots=True, eq=False)
class Encounter:
    """Follows two vehicles state by state, from the agent's entry until the agent has been off the shared stretch for `MIN_GAP`.

    The agent *goes* when it enters the junction, or when its last standstill before the stretch ends. The agent *takes the
    stretch* when its front reaches the stretch before the front of the other vehicle. The agent is *clear* when its rear has left
    the stretch.
    """

    common: Shared
    """The stretches that the ways of the agent and of the other vehicle share."""
    dt: float
    """Time between two states [s]."""
    length: float
    """Length of the way of the agent [m]."""
    other_length: float
    """Length of the way of the other vehicle [m]."""
    behind: float
    """Station from which on the whole other vehicle is behind the stretch [m]."""
    straight: bool
    """Whether the other vehicle goes straight on."""
    tick: int = 0
    """Number of states that have been read."""
    since: int | None = None
    """Number of the state in which the agent went."""
    place: float = math.nan
    """Station of the other vehicle when the agent went [m]."""
    speed: float = math.nan
    """Speed of the other vehicle when the agent went [m/s]."""
    pace: float = math.nan
    """Speed to which the other vehicle has slowed down since for reasons of its own [m/s]."""
    started: bool = False
    """Whether the other vehicle was about to go when the agent went."""
    excused: bool = False
    """Whether the other vehicle waived its right when the agent went, or somebody holds up the agent on the stretch."""
    braked: bool = False
    """Whether the other vehicle has braked hard or lost much of its speed since the agent went."""
    taken: bool = False
    """Whether the agent has taken the stretch."""
    first: bool = False
    """Whether the other vehicle has reached the stretch before the agent."""
    left: int | None = None
    """Number of the state in which the rear of the agent left the stretch."""
    owed: bool = False
    """Whether the agent has owed the way in some state since it last *went*."""
    over: bool = False
    """Whether the encounter is over, so that no later state changes its values."""

    @classmethod
    def of(cls, agent: Agent, other: Agent, common: Shared, dt: float) -> Encounter:
        """Return the encounter of two vehicles before its first state."""
        behind = common.yours.end + (other.size[0] if other.size else 0.0)
        return cls(common, dt, agent.way.length, other.way.length, behind, other.turn is Turn.STRAIGHT)

    def step(self, now: Meeting) -> tuple[bool, bool]:
        """Read a state and return whether the agent owes the way, and whether it obstructs the other vehicle."""
        tick, self.tick = self.tick, self.tick + 1
        mine, yours = self.common.mine, self.common.yours
        before = now.front < mine.start
        if self.since is None or (before and now.still and not self.first):
            self.started, self.excused = now.starting, now.waives
            self.braked = self.owed = False
            self.place = math.nan
        if math.isnan(self.place):
            self.since, self.place, self.speed, self.pace = tick, now.ahead, now.speed, now.speed
        self.owed |= now.bound
        if not self.taken and not self.first:
            self.first = now.ahead >= yours.start
            self.taken = not before and now.ahead < yours.start
        if self.left is None and now.rear > mine.end:
            self.left = tick
        self.excused |= now.kept and not before and self.left is None
        if not now.unhindered:
            self.pace = min(self.pace, now.speed)
        elif now.ahead < yours.start:  # it brakes or slows down without a reason of its own
            slowed = self.straight and now.speed < min(self.pace - LOSS, self.pace * (1 - SHARE))
            self.braked |= slowed or now.brakes
        hit = self.owed and not self.excused and self._obstructed(tick, now)
        owes = now.bound and not self.excused
        passed = now.ahead > self.behind or (self.left is not None and (tick - self.left) * self.dt >= MIN_GAP)
        self.over = self.over or passed
        return owes or hit, hit

    def _obstructed(self, tick: int, now: Meeting) -> bool:
        mine, yours = self.common.mine, self.common.yours
        reached = now.ahead >= yours.start
        if now.touching and reached and now.front >= mine.start and self.left is None:
            return True
        if not self.taken or self.since is None:
            return False
        if reached:
            if self.left is not None:
                return (tick - self.left) * self.dt < MIN_GAP and not self.common.merges
            if not self.common.merges:
                return True
            apart = (now.rear - self.length) - (now.ahead - self.other_length)
            return apart < MIN_GAP * now.speed
        # The station of the other vehicle `MIN_GAP` from now, if it had kept the speed that it had when the agent went.
        unhindered = self.place + self.speed * ((tick - self.since) * self.dt + MIN_GAP)
        return self.started or (self.braked and self.left is None and unhindered > yours.start)
