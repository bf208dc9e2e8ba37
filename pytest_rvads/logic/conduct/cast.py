"""Casts (the vehicles of consecutive states), pairs of vehicles, and the grounds on which a vehicle has to give way to another.

A pair of vehicles has at most one ground, which stays the same in the run. Lights decide between two vehicles that come to
lights. At an all-way stop the order of arrival decides. In all other cases the map, the signs and the sides from which both
vehicles come decide (`Junction.yields`). A `Cause` names the vehicles that are to blame for a collision or meeting.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.crosswalks import Crossing, Parking
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Key
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.states import Agent, Kind
from pytest_rvads.support.errors import RunError

_Value = TypeVar("_Value")
_Scalar = TypeVar("_Scalar", bound=np.generic)

_MINOR = (Sign.STOP, Sign.YIELD)


class Pairs:
    """Pairs of vehicles by their columns in a block, in increasing order; (1, 2) and (2, 1) are two pairs if `ordered`."""

    def __init__(self, pairs: Sequence[tuple[int, int]], *, ordered: bool = True) -> None:
        self.agents, self.others = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        self.column = {pair: number for number, pair in enumerate(pairs)}
        if not ordered:
            self.column |= {(other, agent): number for number, (agent, other) in enumerate(pairs)}
        self._starts = np.flatnonzero(np.diff(self.agents, prepend=-1))
        self._firsts = self.agents[self._starts]

    def __len__(self) -> int:
        return len(self.agents)

    def first(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return the values of the first vehicle of every pair, given values of all vehicles, shape ``(..., agents)``."""
        return _gathered(values, self.agents)

    def second(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return the values of the second vehicle of every pair, see `first`."""
        return _gathered(values, self.others)

    def any(self, truths: NDArray[np.bool_], agents: int) -> NDArray[np.bool_]:
        """Return whether each vehicle, ``(n, agents)``, is first in a pair for which `truths`, ``(n, pairs)``, is true."""
        firsts = np.zeros((len(truths), agents), dtype=np.bool_)
        if len(self):
            firsts[:, self._firsts] = np.logical_or.reduceat(truths, self._starts, axis=1)
        return firsts

    def count(self, truths: NDArray[np.bool_], agents: int) -> NDArray[np.int64]:
        """Return in how many pairs for which `truths` is true each vehicle is first, in shapes as in `any`."""
        counts = np.zeros((len(truths), agents), dtype=np.int64)
        if len(self):
            counts[:, self._firsts] = np.add.reduceat(truths, self._starts, axis=1, dtype=np.int64)
        return counts


def _gathered(values: NDArray[_Scalar], columns: NDArray[np.int64]) -> NDArray[_Scalar]:
    # For one state `take` is more than twice as fast as an index. For a whole run an index is nearly twice as fast as `take`.
    return values.take(columns, axis=-1) if values.size < _FEW else values[..., columns]


_FEW = 1000
"""Number of values below which `take` is faster than an index."""


class Cast:
    """The vehicles of a block of consecutive states, with a cache of values that do not depend on their states."""

    def __init__(self, junction: Junction, agents: Sequence[Agent], facts: Facts) -> None:
        self.junction, self.agents, self.facts = junction, tuple(agents), facts
        self.entrance = np.array([agent.entrance for agent in self.agents], dtype=np.int64)
        self.exit = np.array([agent.exit for agent in self.agents], dtype=np.int64)
        self.way = np.array([agent.way.length for agent in self.agents], dtype=np.float64)
        """Lengths of the ways through the junction [m]."""
        self.length, self.width = np.array([agent.size or (np.nan, np.nan) for agent in self.agents]).reshape(-1, 2).T
        """Lengths and widths of the bodies [m]; NaN for a body of unknown size."""
        self.on_foot = np.array([agent.kind is Kind.PEDESTRIAN for agent in self.agents], dtype=np.bool_)
        """Whether each agent is a pedestrian, whose body is a circle."""
        self.crossing = np.array([isinstance(agent.way, Crossing) for agent in self.agents], dtype=np.bool_)
        """Whether each agent is on a crossing, the way of a pedestrian over a crosswalk."""
        self.aside = np.array([isinstance(agent.way, Crossing | Parking) for agent in self.agents], dtype=np.bool_)
        """Whether each agent is on a crossing or in a parking place, so that it takes no turns with vehicles."""
        self.straight = np.array([agent.turn is Turn.STRAIGHT for agent in self.agents], dtype=np.bool_)
        """Whether each agent goes straight on."""
        self._static: dict[object, Any] = {}

    def __len__(self) -> int:
        return len(self.agents)

    def static(self, work: Callable[[Cast], _Value]) -> _Value:
        """Return the result of `work` on these vehicles; `work` is called once, and its result is cached."""
        if work not in self._static:
            self._static[work] = work(self)
        result: _Value = self._static[work]
        return result

    def columns(self, of: Callable[[Cast], Pairs], among: Callable[[Cast], Pairs], *, turned: bool = False) -> NDArray[np.int64]:
        """Return, per pair of `of`, its column in `among`, or that of the pair turned round; -1 for a pair that `among` lacks."""
        key = of, among, turned
        if key not in self._static:
            column, pairs = self.static(among).column, self.static(of).column
            found = [column.get(pair[::-1] if turned else pair, -1) for pair in pairs]
            self._static[key] = np.array(found, dtype=np.int64)
        result: NDArray[np.int64] = self._static[key]
        return result


def pairs(cast: Cast, belong: Callable[[int, int], bool]) -> Pairs:
    """Return the ordered pairs of different vehicles for whose columns `belong` holds."""
    numbers = range(len(cast))
    return Pairs([(agent, other) for agent in numbers for other in numbers if agent != other and belong(agent, other)])


def everybody(cast: Cast) -> Pairs:
    """Return all pairs of vehicles, in both orders."""
    return pairs(cast, lambda _one, _two: True)


class Ground(StrEnum):
    """The grounds (reasons) on which a vehicle has to give way to another vehicle."""

    SIGN = "sign"
    """The vehicle comes past a stop or yield sign, and the other vehicle does not."""
    PRIORITY = "priority"
    """The other vehicle has a priority sign and this vehicle has no sign, or the map says which movement has priority."""
    SIDE = "side"
    """The other vehicle comes from the near side: the right, where traffic keeps right."""
    TURN = "turn"
    """The vehicle turns across the way of oncoming traffic."""
    MERGE = "merge"
    """According to the map, the lane of the vehicle joins the lane of the other vehicle."""


@dataclass(frozen=True, slots=True)
class Cause:
    """The vehicles to blame for a collision or meeting, and the reason."""

    agents: tuple[str, ...]
    """The name of the vehicle to blame, or both names if both vehicles share the blame."""
    reason: str
    """What the vehicle did, as a phrase that follows the name of the vehicle: ``"had entered on red"``."""


def lit(junction: Junction, entrance: int) -> bool:
    """Return whether an entrance, given by number, has a light; further numbers are starts of ways that begin at no entrance."""
    return junction.starts[entrance].sign is Sign.LIGHTS


def ground_of(junction: Junction, way: Key, other: Key) -> Ground | None:
    """Return the ground on which an agent on way `way` has to give way to an agent on way `other`; None without a ground."""
    if junction.control is JunctionControl.STOP:
        return None
    if junction.yields is None:
        raise RunError("the run holds no geometry of its junction")
    reason = junction.yields.get((way, other))
    if lit(junction, way[0]) and lit(junction, other[0]):
        return Ground.TURN if reason is Reason.TURN else None
    match reason:
        case Reason.SIGN:
            return Ground.SIGN if junction.entrances[way[0]].sign in _MINOR else Ground.PRIORITY
        case Reason.STATED:
            return Ground.PRIORITY
        case Reason.RIGHT:
            return Ground.SIDE
        case Reason.TURN:
            return Ground.TURN
        case Reason.MERGE:
            return Ground.MERGE
    return None


def in_turn(junction: Junction, way: Key, other: Key) -> bool:
    """Return whether, at an all-way stop, the order of arrival decides which of two vehicles on given movements goes first.

    The order of arrival decides between movements from different arms that share a stretch (California Vehicle Code 21800(a)
    protects a vehicle that has entered). If the places of the lanes are unknown, the order of arrival decides between all
    movements from different arms.
    """
    if not junction.movements.keys() >= {way, other} or junction.entrances[way[0]].arm == junction.entrances[other[0]].arm:
        return False
    return junction.conflicts is None or (way, other) in junction.conflicts


def may_owe(run: Run | Cast, agent: int, other: int) -> bool:
    """Return whether it is possible that the agent has to give way to the other agent: on a `Ground`, or in a turn on red.

    Pedestrians are owed crosswalks, see `walkers`, and parked vehicles are owed nothing.
    """
    me, you, junction = run.agents[agent], run.agents[other], run.junction
    if agent == other or junction.control is JunctionControl.STOP or isinstance(you.way, Crossing | Parking):
        return False
    if not lit(junction, me.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    if me.turn is junction.near:
        return True
    if not lit(junction, you.entrance):
        return ground_of(junction, me.way.key, you.way.key) is not None
    return me.turn is junction.far and you.turn is not junction.far and (me.entrance, you.entrance) in junction.opposite
