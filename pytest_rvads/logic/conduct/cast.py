"""Casts: the vehicles of a block of states, and the pairs of vehicles that signals are about."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.run import Facts
from pytest_rvads.runs.states import Agent

__all__ = ["Cast", "Pairs", "everybody", "pairs"]

_Value = TypeVar("_Value")
_Scalar = TypeVar("_Scalar", bound=np.generic)


class Pairs:
    """Pairs of vehicles; a vehicle is given by its column in a block.

    Args:
        pairs: the columns of the first and the second vehicle of every pair, in increasing order.
        ordered: whether (1, 2) and (2, 1) are two different pairs.
    """

    def __init__(self, pairs: Sequence[tuple[int, int]], *, ordered: bool = True) -> None:
        self.one, self.two = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        self.column = {pair: number for number, pair in enumerate(pairs)}
        if not ordered:
            self.column |= {(other, agent): number for number, (agent, other) in enumerate(pairs)}
        self._starts = np.flatnonzero(np.diff(self.one, prepend=-1))
        self._firsts = self.one[self._starts]

    def __len__(self) -> int:
        return len(self.one)

    def first(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return the values of the first vehicle of every pair, given values of all vehicles, shape ``(..., agents)``."""
        return _gathered(values, self.one)

    def second(self, values: NDArray[_Scalar]) -> NDArray[_Scalar]:
        """Return the values of the second vehicle of every pair, see `first`."""
        return _gathered(values, self.two)

    def any(self, truths: NDArray[np.bool_], agents: int) -> NDArray[np.bool_]:
        """Return which vehicles are the first of a pair for which `truths` holds, shape ``(n, agents)``; see `count`."""
        firsts = np.zeros((len(truths), agents), dtype=np.bool_)
        if len(self):
            firsts[:, self._firsts] = np.logical_or.reduceat(truths, self._starts, axis=1)
        return firsts

    def count(self, truths: NDArray[np.bool_], agents: int) -> NDArray[np.int64]:
        """Return, for every vehicle, the number of pairs with this vehicle first for which `truths` holds, shape ``(n, agents)``.

        Args:
            truths: a truth value per state and pair, shape ``(n, pairs)``.
            agents: number of vehicles.
        """
        counts = np.zeros((len(truths), agents), dtype=np.int64)
        if len(self):
            counts[:, self._firsts] = np.add.reduceat(truths, self._starts, axis=1, dtype=np.int64)
        return counts


def _gathered(values: NDArray[_Scalar], columns: NDArray[np.int64]) -> NDArray[_Scalar]:
    # For one state `take` is more than twice as fast as an index, for a whole run an index is nearly twice as fast.
    return values.take(columns, axis=-1) if values.size < _FEW else values[..., columns]


_FEW = 1000
"""Fewer values than this are gathered by `take`."""


class Cast:
    """The vehicles of a block, with what stays the same as long as these vehicles drive.

    Args:
        junction: the junction that the vehicles drive through.
        agents: the vehicles, in the order of the columns.
        facts: the facts of the run; they may state a speed limit.
    """

    def __init__(self, junction: Junction, agents: Sequence[Agent], facts: Facts) -> None:
        self.junction, self.agents, self.facts = junction, tuple(agents), facts
        self.entrance = np.array([agent.entrance for agent in self.agents], dtype=np.int64)
        self.exit = np.array([agent.exit for agent in self.agents], dtype=np.int64)
        self.way = np.array([agent.way.length for agent in self.agents], dtype=np.float64)
        """Lengths of the ways through the junction [m]."""
        self.length, self.width = np.array([agent.size or (np.nan, np.nan) for agent in self.agents]).reshape(-1, 2).T
        """Lengths and widths of the bodies [m]; NaN for a body of unknown size."""
        self._static: dict[object, Any] = {}

    def __len__(self) -> int:
        return len(self.agents)

    def static(self, work: Callable[[Cast], _Value]) -> _Value:
        """Return the result of `work` on this cast; `work` is called once per cast."""
        if work not in self._static:
            self._static[work] = work(self)
        result: _Value = self._static[work]
        return result


def pairs(cast: Cast, belong: Callable[[int, int], bool]) -> Pairs:
    """Return the ordered pairs of different vehicles for which `belong` holds, given their columns."""
    numbers = range(len(cast))
    return Pairs([(agent, other) for agent in numbers for other in numbers if agent != other and belong(agent, other)])


def everybody(cast: Cast) -> Pairs:
    """Return all pairs of vehicles, in both orders."""
    return pairs(cast, lambda _one, _two: True)
