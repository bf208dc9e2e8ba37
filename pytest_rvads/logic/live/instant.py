"""One state of the traffic after the other, worked out in blocks of one or more states."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Block, Signal, assume
from pytest_rvads.logic.conduct.motion import advance, entered, facing, wt
from pytest_rvads.logic.conduct.stream import Stream
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import ABSENT, Agent

__all__ = ["OF_RUNS", "Instant", "Mover", "State"]

OF_RUNS = (wt, entered, facing, advance)
"""The signals with a carry that a run of one state has to offer."""


@dataclass(slots=True, eq=False)
class Mover:
    """A vehicle as it is now."""

    agent: Agent
    slot: int
    """Its column."""
    zone: int = int(ABSENT)
    station: float = math.nan
    spread: float = math.nan


class State(NamedTuple):
    """A state as it is given, by column; None where something is not given."""

    zones: Sequence[int]
    stations: Sequence[float] | None
    speeds: Sequence[float] | None
    poses: Sequence[Sequence[float]] | None
    lights: Sequence[int]
    touching: frozenset[frozenset[str]] | None = None
    """Names of the vehicles that touch for the first time, where a simulator recorded it."""

    @property
    def given(self) -> tuple[bool, ...]:
        """Which of its values are given."""
        return tuple(value is not None for value in self)


class _State(Run):
    """A run of one state, which knows the states before by the block that is given for it."""

    @cached_property
    def wt(self) -> NDArray[np.int32]:
        found: NDArray[np.int32] = wt(self)
        return found

    @cached_property
    def entered(self) -> NDArray[np.int64]:
        found: NDArray[np.int64] = entered(self)[0]
        return found

    @cached_property
    def facing(self) -> NDArray[np.int8]:
        found: NDArray[np.int8] = facing(self)
        return found

    @cached_property
    def advance(self) -> NDArray[np.float64]:
        found: NDArray[np.float64] = advance(self)
        return found


class Instant:
    """The vehicles at a junction, one state after the other.

    Args:
        junction: where they drive.
        dt: time between two states [s].
        facts: the speed limit.
        signals: the signals that are worked out in every state, because later states depend on their carries.
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
        """Which state of the block is now."""

    def add(self, agent: Agent, slot: int) -> Mover:
        """Return a vehicle that appears in the next state, in a column of its own or one that has become free."""
        mover = Mover(agent, slot)
        self.slots[slot : slot + 1] = [mover]
        return mover

    def feed(self, states: Sequence[State]) -> None:
        """Work out the next states of the same vehicles as a block; `go_on` goes from one state to the next."""
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
        """Go on to the next state of the block."""
        self.tick, self.row, self._run = self.tick + 1, self.row + 1, None

    @property
    def run(self) -> Run:
        """A run of this state alone, that knows what it takes over from the states before."""
        if self._run is None:
            self._run = self._as_run()
        return self._run

    def _as_run(self) -> Run:
        block = self.block.only(self.row)
        pairs = None if block.touching is None else tuple(Collision(0.0, _two(pair), 0.0) for pair, _ in block.touching)
        run = _State(
            "live",
            self.junction,
            block.cast.agents,
            block.zone,
            block.lights,
            self.dt,
            station=block.station,
            speed=block.speed,
            pose=block.pose,
            collisions=pairs,
            facts=self.facts,
        )
        assume(run, block)
        return run


def _two(pair: Iterable[str]) -> tuple[str, str]:
    one, two = sorted(pair)
    return one, two
