"""The states that live monitors read, one after the other.

`RuleMonitor.see` reads values `Seen` and returns values `Decided`. `Stream` makes blocks of one or more states, and passes the
carries of signals (the values that quantities per state keep for later states) from block to block. `Instant` is the present
state: the vehicles by column, and a run of this state alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Block, Cast, Signal, assume
from pytest_rvads.logic.conduct.standing import advance, entered, facing, wt
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import ABSENT, Agent
from pytest_rvads.support.errors import RunError


class Seen(NamedTuple):
    """The state of a vehicle at an instant; see `RuleMonitor.see`."""

    agent: Agent
    """Name, way and size of the vehicle, the same in every state; no other vehicle present has the same name."""
    station: float
    """Station of the reference point along the itinerary, 0 at the entrance vertex [m]."""
    speed: float
    """Forward speed [m/s]."""
    x: float
    """East coordinate of the reference point [m]."""
    y: float
    """North coordinate of the reference point [m]."""
    heading: float
    """Counter-clockwise from east [rad]."""
    spread: float = 0.0
    """Three standard deviations of the measured station [m]."""


@dataclass(frozen=True, slots=True)
class Decided:
    """The final verdict of an instance of a rule (the rule for certain vehicles and entrances)."""

    rule: str
    """Name of the rule."""
    binding: Mapping[str, str]
    """Variables of the rule, with the names of the vehicles and entrances that the variables stand for."""
    verdict: Truth
    """``F``: the instance was violated at `time`; ``T``: no continuation violates the instance; ``?``: a vehicle of the instance
    left, and the instance can't be violated any more."""
    time: float
    """Time of the decision since the first state [s]."""


def sizes_of(vehicle_size: tuple[float, float] | Sequence[tuple[float, float]], count: int) -> tuple[tuple[float, float], ...]:
    """Return the length and width of every vehicle [m], given a pair of numbers for all vehicles or a pair per vehicle."""
    sizes = np.asarray(vehicle_size, dtype=np.float64)
    if sizes.shape not in ((2,), (count, 2)) or not (np.isfinite(sizes) & (sizes > 0)).all():
        raise RunError(
            f"vehicle_size must be a length and width [m], for all {count} vehicles or for each, got {vehicle_size!r:.60}"
        )
    return tuple((float(length), float(width)) for length, width in np.broadcast_to(sizes, (count, 2)))


def row_of(name: str, values: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    """Return the values of an array of a state as a list of numbers or of lists, after a check of their shape."""
    row = np.asarray(values, dtype=np.float64)
    if row.shape != shape or not all(map(math.isfinite, row.ravel().tolist())):
        what = f"{shape[0]} finite numbers" if len(shape) == 1 else f"finite numbers of shape {shape}"
        raise RunError(f"{name} of a state must be {what}, got {values!r:.60}")
    numbers: list[Any] = row.tolist()
    return numbers


class Stream:
    """Makes blocks of states as the states come, and passes the carries of signals from block to block."""

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.dt, self._facts = dt, facts
        self.cast = Cast(junction, (), facts)
        self._kept: Sequence[int | None] | None = None
        self._last: Block | None = None
        self._tick = 0

    def recast(self, agents: Sequence[Agent], columns: Sequence[int | None]) -> None:
        """Replace the vehicles of the stream, each with its column in the last block, or None if it has just come."""
        self.cast, self._kept = Cast(self.cast.junction, agents, self._facts), columns

    def feed(self, signals: Iterable[Signal[Any]], zone: NDArray[np.int8], lights: NDArray[np.int8], **arrays: Any) -> Block:
        """Return the next n states as a block on which the given signals are evaluated."""
        last = self._last
        block = Block(self.cast, zone, lights, self.dt, **arrays, tick=self._tick, previous=last, kept=self._kept)
        for signal in signals:
            try:
                signal(block)
            except RunError as error:
                block.unknown[signal] = str(error)
        block.previous = None
        self._last, self._kept, self._tick = block, None, self._tick + len(zone)
        return block


OF_RUNS = (wt, entered, facing, advance)
"""The signals with a carry that a run of a single state reads from its block, instead of computing them from earlier states."""


@dataclass(slots=True, eq=False)
class Mover:
    """A vehicle that a live monitor reads, with its column and its present state."""

    agent: Agent
    slot: int
    """Column."""
    zone: int = int(ABSENT)
    station: float = math.nan
    spread: float = math.nan


class State(NamedTuple):
    """A state in the form that `Instant.feed` reads: sequences with a value per vehicle; None for values that are not given."""

    zones: Sequence[int]
    stations: Sequence[float] | None
    speeds: Sequence[float] | None
    poses: Sequence[Sequence[float]] | None
    lights: Sequence[int]
    touching: frozenset[frozenset[str]] | None = None
    """Pairs of names of vehicles that touch for the first time; None if no simulator recorded contacts."""

    @property
    def given(self) -> tuple[bool, ...]:
        """Per field of the state, whether the field is given."""
        return tuple(value is not None for value in self)


class _State(Run):
    """A run of one state; its values that depend on earlier states, such as waiting times, come from the block of the state."""

    @cached_property
    def wt(self) -> NDArray[np.int32]:
        ticks: NDArray[np.int32] = wt(self)
        return ticks

    @cached_property
    def entered(self) -> NDArray[np.int64]:
        ticks: NDArray[np.int64] = entered(self)[0]
        return ticks

    @cached_property
    def facing(self) -> NDArray[np.int8]:
        colours: NDArray[np.int8] = facing(self)
        return colours

    @cached_property
    def advance(self) -> NDArray[np.float64]:
        speeds: NDArray[np.float64] = advance(self)
        return speeds


class Instant:
    """The vehicles at a junction in the present state of a run that goes on state by state.

    The given signals are evaluated in every state, because later states depend on their carries.
    """

    def __init__(self, junction: Junction, dt: float, facts: Facts, signals: Iterable[Signal[Any]]) -> None:
        self.junction, self.dt, self.facts, self._signals = junction, dt, facts, tuple(signals)
        self.tick = -1
        self.slots: list[Mover] = []
        """The vehicles by column; a vehicle that is absent keeps its column until another vehicle takes it."""
        self._run: Run | None = None
        self._stream = Stream(junction, dt, facts)
        self._cast: list[Mover] = []
        lights = np.zeros((1, len(junction.starts)), dtype=np.int8)
        self.block = Block(self._stream.cast, np.empty((1, 0), dtype=np.int8), lights)
        self.row = 0
        """Row of the present state in the block."""

    def add(self, agent: Agent, slot: int) -> Mover:
        """Add a vehicle that appears in the next state, and return it; its column is new, or free since another vehicle left."""
        mover = Mover(agent, slot)
        self.slots[slot : slot + 1] = [mover]
        return mover

    def feed(self, states: Sequence[State]) -> None:
        """Evaluate the next states of the same vehicles as a block; `go_on` then goes from one state to the next."""
        if self._cast != self.slots:
            columns = {mover: column for column, mover in enumerate(self._cast)}
            self._stream.recast([mover.agent for mover in self.slots], [columns.get(mover) for mover in self.slots])
            self._cast = list(self.slots)
        zones, stations, speeds, poses, lights, touching = zip(*states, strict=True)
        station, speed = (None if values[0] is None else np.array(values) for values in (stations, speeds))
        pose = None if poses[0] is None else np.array(poses).reshape(len(states), -1, 3)
        hits = None if touching[0] is None else [(pair, row) for row, pairs in enumerate(touching) for pair in pairs]
        arrays = np.array(zones, dtype=np.int8), np.array(lights, dtype=np.int8)
        self.block = self._stream.feed(self._signals, *arrays, station=station, speed=speed, pose=pose, touching=hits)
        self.row = -1

    def go_on(self) -> None:
        """Make the next state of the block the present state."""
        self.tick, self.row, self._run = self.tick + 1, self.row + 1, None

    @property
    def run(self) -> Run:
        """The present state as a run of one state."""
        if self._run is None:
            block = self.block.only(self.row)
            names = None if block.touching is None else [sorted(pair) for pair, _ in block.touching]
            collisions = None if names is None else tuple(Collision(0.0, (first, second), 0.0) for first, second in names)
            self._run = _State(
                "live",
                self.junction,
                block.cast.agents,
                block.zone,
                block.lights,
                self.dt,
                station=block.station,
                speed=block.speed,
                pose=block.pose,
                collisions=collisions,
                facts=self.facts,
            )
            assume(self._run, block)
        return self._run
