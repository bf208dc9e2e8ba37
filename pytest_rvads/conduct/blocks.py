"""Blocks: one or more consecutive states of vehicles, and signals, which are quantities that words share on a block.

A signal is worked out once per block, for all vehicles or pairs of vehicles at once. A signal that depends on earlier states has
a carry, which one block hands on to the next block: so the values are the same whether a run is one block, or every state is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.memo import once
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.run import DT, Collision, Facts, Run
from pytest_rvads.runs.states import Agent, Zone

__all__ = [
    "ABSENT",
    "APPROACH",
    "ENTRANCE",
    "EXIT",
    "GONE",
    "JUNCTION",
    "Block",
    "Cast",
    "Pairs",
    "Signal",
    "Stream",
    "as_block",
    "everybody",
    "lasting",
    "latched",
    "pairs",
    "signal",
    "sized",
    "tick_of",
]

_Value = TypeVar("_Value")
APPROACH, ENTRANCE, JUNCTION, EXIT, GONE, ABSENT = map(int, Zone)
"""The zones as plain numbers: numpy compares arrays with members of an enumeration several times as slowly."""


class Pairs:
    """Pairs of vehicles, by column.

    Args:
        pairs: increasing.
        ordered: whether a pair is not the same in the other order.
    """

    def __init__(self, pairs: Sequence[tuple[int, int]], *, ordered: bool = True) -> None:
        self.one, self.two = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        self.column = {pair: number for number, pair in enumerate(pairs)}
        if not ordered:
            self.column |= {(two, one): number for number, (one, two) in enumerate(pairs)}
        self._starts = np.flatnonzero(np.diff(self.one, prepend=-1))

    def __len__(self) -> int:
        return len(self.one)

    def any(self, truths: NDArray[np.bool_], agents: int) -> NDArray[np.bool_]:
        """Return for which vehicle something holds of a pair that it is the first of, shape ``(n, agents)``.

        Args:
            truths: about the pairs, shape ``(n, pairs)``.
            agents: how many vehicles there are.
        """
        found = np.zeros((len(truths), agents), dtype=np.bool_)
        if len(self):
            found[:, self.one[self._starts]] = np.logical_or.reduceat(truths, self._starts, axis=1)
        return found


class Cast:
    """The vehicles of a block, and what is static about them.

    Args:
        junction: where they drive.
        agents: the vehicles, in the order of the columns.
        facts: that may state a speed limit.
    """

    def __init__(self, junction: Junction, agents: Sequence[Agent], facts: Facts) -> None:
        self.junction, self.agents, self.facts = junction, tuple(agents), facts
        self.entrance = np.array([agent.entrance for agent in self.agents], dtype=np.int64)
        self.exit = np.array([agent.exit for agent in self.agents], dtype=np.int64)
        self.way = np.array([agent.route.length for agent in self.agents], dtype=np.float64)
        """Lengths of the movements [m]."""
        self.length, self.width = np.array([agent.size or (np.nan, np.nan) for agent in self.agents]).reshape(-1, 2).T
        """Of the bodies [m]; NaN where they are not known."""
        self._static: dict[object, Any] = {}

    def __len__(self) -> int:
        return len(self.agents)

    def static(self, work: Callable[[Cast], _Value]) -> _Value:
        """Return what `work` finds out about the vehicles; the work is done once."""
        if work not in self._static:
            self._static[work] = work(self)
        result: _Value = self._static[work]
        return result


def sized(block: Block, columns: Sequence[int], position: str = "station") -> None:
    """Check that positions, and the sizes of some vehicles, are known.

    Args:
        block: the states.
        columns: of the vehicles.
        position: ``station`` or ``pose``.

    Raises:
        RunError: they are not.
    """
    block.need(position)
    if any(block.cast.agents[column].size is None for column in columns):
        raise RunError("the run holds no size of its vehicles")


def pairs(cast: Cast, belong: Callable[[int, int], bool]) -> Pairs:
    """Return the ordered pairs of different vehicles that belong together."""
    numbers = range(len(cast))
    return Pairs([(one, two) for one in numbers for two in numbers if one != two and belong(one, two)])


@dataclass(frozen=True, slots=True, eq=False)
class Signal(Generic[_Value]):
    """A quantity on a block: an array with a row per state and a column per vehicle or pair, or a tuple of arrays."""

    work: Callable[..., Any]
    """Takes the block and the carry; returns the value, and with a carry also one array per part of it, whose last row is the
    carry of the next block."""
    start: tuple[Any, ...] | Callable[[float], tuple[Any, ...]] = ()
    """The carry of a vehicle, or of a pair of vehicles, that was not there before, or what returns it for the time between two
    states [s]; empty: the signal has no carry."""
    pairs: Callable[[Cast], Pairs] | None = None
    """Which pairs the columns of the value and the carry are about; None: vehicles."""
    needs: Callable[[Block, Sequence[int]], None] | None = None
    """Raises a `RunError` where the value about some vehicles, given by column, is not known."""
    otherwise: Any = False
    """The value about two vehicles that make no pair."""

    @overload
    def __call__(self, states: Block | Run) -> _Value: ...

    @overload
    def __call__(self, states: Block | Run, *columns: int) -> NDArray[Any]: ...

    def __call__(self, states: Block | Run, *columns: int) -> Any:
        """Return the value on a block or a whole run: for all vehicles or pairs, or for one, given by column.

        Of two vehicles that make no pair it is `otherwise` in every state.
        """
        block = states if isinstance(states, Block) else once(states, as_block)
        values = block.values
        if not columns:
            return values[self] if self in values else block.value(self)
        column = self.column(block.cast, columns)
        if column is None:
            return np.full(len(block.zone), self.otherwise)
        if self.needs is not None:
            self.needs(block, columns)
        value: Any = self(block)
        return value[:, column]

    def column(self, cast: Cast, columns: Sequence[int]) -> int | None:
        """Return which column of the value is about a vehicle or a pair, given by its columns."""
        return columns[0] if self.pairs is None else cast.static(self.pairs).column.get((columns[0], columns[1]))


@overload
def signal(work: Callable[[Block], _Value]) -> Signal[_Value]: ...


@overload
def signal(
    *,
    start: tuple[Any, ...] | Callable[[float], tuple[Any, ...]] = ...,
    pairs: Callable[[Cast], Pairs] | None = ...,
    needs: Callable[[Block, Sequence[int]], None] | None = ...,
    otherwise: Any = ...,
) -> Callable[..., Signal[Any]]: ...


def signal(work: Any = None, **more: Any) -> Any:
    """Make a signal of a function, see `Signal`."""
    return Signal(work) if work is not None else lambda work: Signal(work, **more)


_Carry = dict[Signal[Any], tuple[NDArray[Any], ...]]


@dataclass(eq=False)
class Block:
    """Consecutive states; arrays as in `Run`, with a row per state and a column per vehicle."""

    cast: Cast
    zone: NDArray[np.int8]
    lights: NDArray[np.int8]
    dt: float = DT
    station: NDArray[np.float64] | None = None
    speed: NDArray[np.float64] | None = None
    pose: NDArray[np.float64] | None = None
    touching: Sequence[tuple[frozenset[str], int]] | None = None
    """Names of the pairs that touch for the first time, and in which row; None where nobody recorded it."""
    tick: int = 0
    """Of the first state."""
    last: bool = False
    """Whether it is known that no block comes after this one."""
    before: _Carry = field(default_factory=dict)
    """What signals carry over from the block before."""
    after: _Carry = field(default_factory=dict)
    """What they carry over to the next block."""
    values: dict[Signal[Any], Any] = field(default_factory=dict)
    """Those that are worked out."""

    @property
    def junction(self) -> Junction:
        """Where the vehicles drive."""
        return self.cast.junction

    @cached_property
    def here(self) -> NDArray[np.bool_]:
        """`Run.here`."""
        found: NDArray[np.bool_] = (self.zone != GONE) & (self.zone != ABSENT)
        return found

    @cached_property
    def ticks(self) -> NDArray[np.int64]:
        """The tick of every state, shape ``(n, 1)``."""
        return np.arange(self.tick, self.tick + len(self.zone))[:, None]

    def need(self, name: str) -> NDArray[np.float64]:
        """Return ``station``, ``speed`` or ``pose``.

        Raises:
            RunError: it is not recorded.
        """
        array: NDArray[np.float64] | None = getattr(self, name)
        if array is None:
            raise RunError(f"the run holds no {'speeds' if name == 'speed' else 'positions'}")
        return array

    def value(self, signal: Signal[_Value]) -> _Value:
        """Work out the value of a signal."""
        value: _Value
        if signal.start:
            carry = self.before.get(signal) or _fresh(signal, self.cast, self.dt)
            value, *tracks = signal.work(self, *carry)
            self.after[signal] = tuple([track[-1] for track in tracks])
        else:
            value = signal.work(self)
        self.values[signal] = value
        return value


def _fresh(signal: Signal[Any], cast: Cast, dt: float) -> tuple[NDArray[Any], ...]:
    count = len(cast if signal.pairs is None else cast.static(signal.pairs))
    starts = signal.start(dt) if callable(signal.start) else signal.start
    return tuple(np.repeat(np.asarray(start)[..., None], count, axis=-1) for start in starts)


class Stream:
    """Feeds blocks, each with the carry of the one before.

    Args:
        junction: where the vehicles drive.
        dt: time between two states [s].
        facts: that may state a speed limit.
    """

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.dt, self._facts = dt, facts
        self.cast = Cast(junction, (), facts)
        self._carry: _Carry = {}
        self._tick = 0

    def recast(self, agents: Sequence[Agent], kept: Sequence[int | None]) -> None:
        """Change who the vehicles are.

        Args:
            agents: from the next block on.
            kept: the column that each of them had so far; None: it was not there.
        """
        old, self.cast = self.cast, Cast(self.cast.junction, agents, self._facts)
        columns = {before: now for now, before in enumerate(kept) if before is not None}
        for signal, carry in self._carry.items():
            if signal.pairs is None:
                moves = list(columns.items())
            else:
                now, then = self.cast.static(signal.pairs).column, old.static(signal.pairs).column
                moved = (((columns.get(one), columns.get(two)), number) for (one, two), number in then.items())
                moves = [(number, now[pair]) for pair, number in moved if pair in now]
            source, target = np.array(moves, dtype=np.int64).reshape(-1, 2).T
            fresh = _fresh(signal, self.cast, self.dt)
            for part, was in zip(fresh, carry, strict=True):
                part[..., target] = was[..., source]
            self._carry[signal] = fresh

    def feed(self, signals: Iterable[Signal[Any]], zone: NDArray[np.int8], lights: NDArray[np.int8], **arrays: Any) -> Block:
        """Return the next states as a block.

        Args:
            signals: with a carry, which are worked out because later blocks depend on them.
            zone: as in `Block`, likewise the others.
            lights: likewise.
            **arrays: those that are known.
        """
        block = Block(self.cast, zone, lights, self.dt, **arrays, tick=self._tick, before=self._carry)
        for signal in signals:
            try:
                signal(block)
            except RunError:
                continue  # what is not known now has no carry either
        self._carry, self._tick = block.after, self._tick + len(zone)
        return block


def as_block(run: Run) -> Block:
    """Return a whole run as one block."""
    contacts = None if run.collisions is None else [(frozenset(c.agents), tick_of(run, c)) for c in run.collisions]
    cast = Cast(run.junction, run.agents, run.facts)
    return Block(cast, run.zone, run.lights, run.dt, run.station, run.speed, run.pose, contacts, last=True)


def tick_of(run: Run, collision: Collision) -> int:
    """Return the tick of a collision."""
    return min(max(round(collision.time / run.dt), 0), run.steps - 1)


def everybody(cast: Cast) -> Pairs:
    """Return all pairs of vehicles, in both orders."""
    return pairs(cast, lambda _one, _two: True)


def lasting(truths: NDArray[np.bool_], before: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return for how many states, up to each, something has been true without a break.

    Args:
        truths: shape ``(n, columns)``.
        before: for how many states it had been true before the first state, shape ``(columns,)``.
    """
    count = np.arange(1, len(truths) + 1)[:, None]
    return count - np.maximum.accumulate(np.where(truths, -before, count), axis=0)


def latched(set_: NDArray[np.bool_], reset: NDArray[np.bool_], before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what is true from the states in which it is set up to the states in which it is reset; never both in one state.

    Args:
        set_: where it is set, shape ``(n, columns)``.
        reset: where it is reset, likewise.
        before: whether it was true before the first state, shape ``(columns,)``.
    """
    count = np.arange(1, len(set_) + 1)[:, None]
    last_set = np.maximum.accumulate(np.where(set_, count, 0), axis=0)
    last_reset = np.maximum.accumulate(np.where(reset, count, 0), axis=0)
    found: NDArray[np.bool_] = (last_set > last_reset) | (before & (last_reset == 0))
    return found
