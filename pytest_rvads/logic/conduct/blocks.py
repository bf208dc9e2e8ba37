"""Blocks of consecutive states, their casts (the vehicles), and signals, which are quantities that are computed on a block.

A signal is computed once per block, for all vehicles or pairs of vehicles at once. A signal that depends on earlier states has a
carry: values that are kept for the next block. Because of the carry, a signal has the same values for a run in one block and for
the same run in many blocks.

In the package `conduct`, the vehicles of a block are all its agents, pedestrians included.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing, Parking
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.run import DT, Collision, Facts, Run, given, once
from pytest_rvads.runs.states import Agent, Kind, Zone
from pytest_rvads.support.errors import RunError

_Value = TypeVar("_Value")
_Scalar = TypeVar("_Scalar", bound=np.generic)
_FEW = 1000
"""Number of values below which `take` is faster than an index."""


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
        return self._static[key]


def pairs(cast: Cast, belong: Callable[[int, int], bool]) -> Pairs:
    """Return the ordered pairs of different vehicles for whose columns `belong` holds."""
    numbers = range(len(cast))
    return Pairs([(agent, other) for agent in numbers for other in numbers if agent != other and belong(agent, other)])


def everybody(cast: Cast) -> Pairs:
    """Return all pairs of vehicles, in both orders."""
    return pairs(cast, lambda _one, _two: True)


APPROACH, ENTRANCE, JUNCTION, EXIT, GONE, ABSENT = map(int, Zone)
"""The zones as plain numbers: numpy compares arrays with members of an enumeration several times as slowly."""


def sized(block: Block, columns: Sequence[int], position: str = "station") -> None:
    """Check that a block holds the positions of all vehicles and the sizes of some vehicles."""
    block.need(position)
    if any(block.cast.agents[column].size is None for column in columns):
        raise RunError("the run holds no size of its vehicles")


@dataclass(frozen=True, slots=True, eq=False)
class Signal(Generic[_Value]):
    """A quantity on a block of states: an array with a row per state and a column per vehicle or pair, or a tuple of arrays."""

    work: Callable[..., Any]
    """The function that computes the signal: takes the block and the parts of the carry, and returns the value. For a signal with
    a carry, the function returns the value and an array per part of the carry; the last row of such an array is this part of the
    carry for the next block."""
    start: tuple[Any, ...] | Callable[[float], tuple[Any, ...]] = ()
    """The carry of a vehicle or pair that was absent in the block before, or a function that returns this carry, given the time
    between two states [s]. An empty tuple: the signal has no carry."""
    pairs: Callable[[Cast], Pairs] | None = None
    """The pairs of vehicles that the columns of the value and of the carry are about; None: the columns are about vehicles."""
    needs: Callable[[Block, Sequence[int]], None] | None = None
    """Takes a block and the columns of some vehicles, and raises a `RunError` if the run does not record enough to compute the
    value for these vehicles."""
    otherwise: Any = False
    """The value for two vehicles that are not in `pairs`, and for a vehicle in a block from which the vehicle is absent."""
    of_entrances: bool = False
    """Whether the columns of the value are about entrances, and not about vehicles or pairs."""

    @overload
    def __call__(self, states: Block | Run) -> _Value: ...

    @overload
    def __call__(self, states: Block | Run, *columns: int) -> NDArray[Any]: ...

    def __call__(self, states: Block | Run, *columns: int) -> Any:
        """Return the value on a block or a run, for all vehicles or pairs, or for the vehicle or pair in `columns`."""
        if not isinstance(states, Block):
            blocks = once(states, as_blocks)
            if len(blocks) > 1:
                if not columns:
                    return once(states, self._assembled)
                own = columns if self.of_entrances else None
                parts = [self(block, *(own or [block.columns.get(column, -1) for column in columns])) for block in blocks]
                return np.concatenate(parts)
            states = blocks[0]
        if not columns:
            return states.values[self] if self in states.values else states.value(self)
        column = None if min(columns) < 0 else self.column(states.cast, columns)
        if column is None:
            return np.full(len(states.zone), self.otherwise)
        if self.needs is not None:
            self.needs(states, columns)
        value: Any = self(states)
        return value[:, column]

    def _assembled(self, run: Run) -> NDArray[Any]:
        """Return the values of the signal for all vehicles of a run, shape ``(steps, agents)``, put together from its blocks."""
        blocks = once(run, as_blocks)
        parts: list[Any] = [self(block) for block in blocks]
        values = np.full((run.steps, len(run.agents)), self.otherwise, dtype=parts[0].dtype)
        for block, part in zip(blocks, parts, strict=True):
            values[block.tick : block.tick + len(part), list(block.columns)] = part
        return values

    def column(self, cast: Cast, columns: Sequence[int]) -> int | None:
        """Return the column of the signal's value that is about a vehicle or a pair, given by the columns of its vehicles."""
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
    of_entrances: bool = ...,
) -> Callable[..., Signal[Any]]: ...


def signal(work: Any = None, **more: Any) -> Any:
    """Return a function as a signal (a quantity per state); a decorator with or without the arguments of `Signal`."""
    return Signal(work) if work is not None else lambda work: Signal(work, **more)


@dataclass(eq=False)
class Block:
    """Consecutive states of vehicles, in arrays as in `Run`, with a row per state and a column per vehicle."""

    cast: Cast
    zone: NDArray[np.int8]
    lights: NDArray[np.int8]
    dt: float = DT
    station: NDArray[np.float64] | None = None
    speed: NDArray[np.float64] | None = None
    pose: NDArray[np.float64] | None = None
    touching: Sequence[tuple[frozenset[str], int]] | None = None
    """The first contact of each pair of vehicles in this block: both names, and the row of the state; None: not recorded."""
    tick: int = 0
    """Tick of the first state."""
    previous: Block | None = None
    """The block before this block."""
    kept: Sequence[int | None] | None = None
    """Per vehicle, its column in the block before, or None if the vehicle was absent there. If `kept` itself is None, every
    vehicle has the same column as in the block before."""
    whole: bool = False
    """Whether the block is part of a run that is known to its end."""
    following: weakref.ref[Block] | None = None
    """The block after this block, if known; a weak reference, because two blocks that refer to each other would stay in memory
    until the next garbage collection."""
    columns: dict[int, int] = field(default_factory=dict)
    """Maps the column of a vehicle in the run to the column of the vehicle in this block."""
    after: dict[Signal[Any], tuple[NDArray[Any], ...]] = field(default_factory=dict)
    """The carry that every signal hands on to the next block."""
    unknown: dict[Signal[Any], str] = field(default_factory=dict)
    """Maps a signal whose carry could not be computed on this block to the reason, which is an error if the next block asks."""
    values: dict[Signal[Any], Any] = field(default_factory=dict)
    """The values of the signals that have been computed on this block so far."""

    @property
    def junction(self) -> Junction:
        """The junction of the cast."""
        return self.cast.junction

    @property
    def given(self) -> tuple[bool, ...]:
        """Three truth values: whether the block has stations, whether it has speeds, and whether it has poses."""
        return self.station is not None, self.speed is not None, self.pose is not None

    @property
    def next(self) -> Block | None:
        """The block after this block; None if that block is not known."""
        return None if self.following is None else self.following()

    @cached_property
    def here(self) -> NDArray[np.bool_]:
        """Whether each vehicle is present in each state, see `Run.here`."""
        return (self.zone != GONE) & (self.zone != ABSENT)

    @cached_property
    def ticks(self) -> NDArray[np.int64]:
        """The tick of every state, shape ``(n, 1)``."""
        return np.arange(self.tick, self.tick + len(self.zone))[:, None]

    def only(self, row: int) -> Block:
        """Return the state in a row of the block as a block of one state, with the values of signals computed so far."""
        if len(self.zone) == 1:
            return self
        part = slice(row, row + 1)
        station, speed, pose = (None if array is None else array[part] for array in (self.station, self.speed, self.pose))
        touching = None if self.touching is None else [(pair, 0) for pair, when in self.touching if when == row]
        state = Block(self.cast, self.zone[part], self.lights[part], self.dt, station, speed, pose, touching, self.tick + row)
        for signal, value in self.values.items():
            if isinstance(value, np.ndarray):
                state.values[signal] = value[part]
            elif isinstance(value, tuple):
                state.values[signal] = getattr(value, "_make", tuple)([array[part] for array in value])
        return state

    def need(self, name: str) -> NDArray[np.float64]:
        """Return the array ``station``, ``speed`` or ``pose`` of the block."""
        array: NDArray[np.float64] | None = getattr(self, name)
        if array is None:
            raise RunError(f"the run holds no {'speeds' if name == 'speed' else 'positions'}")
        return array

    def value(self, signal: Signal[_Value]) -> _Value:
        """Return the value of a signal on this block, computed at the first call."""
        carry = self._carry(signal) if signal.start else ()
        result: Any = signal.work(self, *carry)
        value: _Value = result[0] if signal.start else result
        self.values[signal] = value
        if signal.start:
            self.after[signal] = tuple([track[-1] for track in result[1:]])
        return value

    def _carry(self, signal: Signal[Any]) -> tuple[NDArray[Any], ...]:
        """Return the carry of a signal (values kept from the block before), rearranged to the columns of this block."""
        before = self.previous
        if before is not None:
            if signal in before.unknown:
                raise RunError(before.unknown[signal])
            signal(before)
            if self.kept is None:
                return before.after[signal]
        count = len(self.cast if signal.pairs is None else self.cast.static(signal.pairs))
        starts = signal.start(self.dt) if callable(signal.start) else signal.start
        fresh = tuple(np.repeat(np.asarray(start)[..., None], count, axis=-1) for start in starts)
        if before is None:
            if self.tick and count:
                raise RuntimeError(
                    f"{signal.work.__name__} depends on earlier states, and was not worked out on the block before"
                )
            return fresh
        columns = {then: now for now, then in enumerate(self.kept or ()) if then is not None}
        if signal.pairs is None:
            moves = list(columns.items())
        else:
            now, then = self.cast.static(signal.pairs).column, before.cast.static(signal.pairs).column
            moved = (((columns.get(agent), columns.get(other)), number) for (agent, other), number in then.items())
            moves = [(number, now[pair]) for pair, number in moved if pair in now]
        source, target = np.array(moves, dtype=np.int64).reshape(-1, 2).T
        for part, was in zip(fresh, before.after[signal], strict=True):
            part[..., target] = was[..., source]
        return fresh


_WORK = 150_000
"""Number of states of a block times the square of its number of vehicles; a block of this size fits into a processor's cache."""
_LEAST = 64
"""Smallest number of states of a block."""
_MOST = 4096
"""Largest number of states of a block."""
_BLOCKS = 60
"""Largest number of blocks into which a run is cut."""
_WHOLE = 10_000_000
"""Largest product of the number of states and the square of the number of vehicles at which a run without absent vehicles is one
block; a signal of pairs with 8 bytes per value then takes up to 80 MB."""


def as_blocks(run: Run, size: int = 0) -> tuple[Block, ...]:
    """Return a run as consecutive blocks; a run without absent vehicles is one block, unless it is large.

    If a run is cut into several blocks, a block holds only the vehicles that are present in at least one of its states.
    """
    present = run.zone != ABSENT
    most = int(present.sum(axis=1).max(initial=1))
    size = size or max(min(_WORK // most**2, _MOST), _LEAST, -(-run.steps // _BLOCKS))
    if run.steps <= size or (present.all() and run.steps * most**2 <= _WHOLE):
        size = max(run.steps, 1)
    contacts = None if run.collisions is None else [(frozenset(c.agents), tick_of(run, c)) for c in run.collisions]
    blocks: list[Block] = []
    for begin in range(0, max(run.steps, 1), size):
        part = slice(begin, begin + size)
        columns = np.flatnonzero(present[part].any(axis=0)).tolist() if size < run.steps else list(range(len(run.agents)))
        station, speed, pose = (
            None if array is None else array[part][:, columns] for array in (run.station, run.speed, run.pose)
        )
        previous = blocks[-1] if blocks else None
        block = Block(
            Cast(run.junction, [run.agents[column] for column in columns], run.facts),
            run.zone[part][:, columns],
            run.lights[part],
            run.dt,
            station,
            speed,
            pose,
            None if contacts is None else [(pair, tick - begin) for pair, tick in contacts if begin <= tick < begin + size],
            begin,
            previous,
            None if previous is None else [previous.columns.get(column) for column in columns],
            whole=True,
            columns={column: number for number, column in enumerate(columns)},
        )
        if previous is not None:
            previous.following = weakref.ref(block)
        blocks.append(block)
    return tuple(blocks)


def assume(run: Run, block: Block) -> None:
    """Make every signal that is later evaluated on a run read the given block, instead of blocks cut from the run."""
    blocks: tuple[Block, ...] = (block,)
    given(run, as_blocks, blocks)


def tick_of(run: Run, collision: Collision) -> int:
    """Return the tick of a run in which a collision happened."""
    return min(max(round(collision.time / run.dt), 0), run.steps - 1)


def window(run: Run, columns: Iterable[int]) -> tuple[int, int]:
    """Return the first tick and the tick after the last tick in which the run holds all given agents; two equal ticks if none.

    Rules for these agents are judged between the two ticks. Therefore an absent vehicle breaks no obligation, and no vehicle
    breaks an obligation towards an absent vehicle.
    """
    begin, end = 0, run.steps
    for begins, ends in run.spans[list(columns)].tolist():
        begin, end = max(begin, begins), min(end, ends)
    return begin, max(begin, end)


def ticks(run: Run, seconds: float) -> int:
    """Return a duration as a number of steps of the run, rounded."""
    return round(seconds / run.dt)
