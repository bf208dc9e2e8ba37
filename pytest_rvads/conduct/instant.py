"""One instant of traffic in plain numbers: what the words of rules ask of a few vehicles, a hundred times a second.

On a run the same is said of all its states at once, in `standing`, `rights`, `priority` and `stretches`; for one state
of ten vehicles numpy takes longer to be called than to compute. The comparisons are the same ones, on the same numbers, so both
say the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.blocks import Block, Signal, Stream, assume
from pytest_rvads.conduct.motion import NEVER, advance, entered, facing, wt
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.conduct.standing import arrivals, arrived
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import ABSENT, JUNCTION, Agent, Colour

__all__ = ["Instant"]

_GREEN, _YELLOW, _RED = int(Colour.GREEN), int(Colour.YELLOW), int(Colour.RED)


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
    """The vehicles at a junction, one instant after the other.

    Args:
        junction: where they drive.
        dt: time between two instants [s].
        facts: the speed limit.
    """

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.junction, self.dt, self.facts = junction, dt, facts
        self.tick = -1
        self.slots: list[Mover] = []
        self.movers: list[Mover] = []
        """Those that are not absent."""
        self.lights: list[int] = [0] * len(junction.entrances)
        self.located = self.timed = True
        """Whether stations and speeds are given."""
        self.touching: frozenset[frozenset[str]] | None = None
        """Names of those that touch for the first time now, where somebody recorded it."""
        self._run: Run | None = None
        self._stream = Stream(junction, dt, facts)
        self.signals: list[Signal[Any]] = [wt, entered, facing, arrivals]
        """Those that are worked out in every state, because later states depend on them."""
        self._cast: list[Mover] = []
        self.block = Block(self._stream.cast, np.empty((1, 0), dtype=np.int8), np.array([self.lights], dtype=np.int8))
        """The state."""

    def _feed(
        self,
        zones: Sequence[int],
        stations: Sequence[float] | None,
        speeds: Sequence[float] | None,
        poses: Sequence[Sequence[float]] | None,
        lights: Sequence[int],
    ) -> Block:
        """Return the state as a block."""
        if self._cast != self.slots:
            columns = {mover: column for column, mover in enumerate(self._cast)}
            self._stream.recast([mover.agent for mover in self.slots], [columns.get(mover) for mover in self.slots])
            self._cast = list(self.slots)
        station, speed = (None if values is None else np.array([values]) for values in (stations, speeds))
        pose = None if poses is None else np.array([poses]).reshape(1, -1, 3)
        touching = None if self.touching is None else [(pair, 0) for pair in self.touching]
        state = np.array([zones], dtype=np.int8), np.array([lights], dtype=np.int8)
        return self._stream.feed(self.signals, *state, station=station, speed=speed, pose=pose, touching=touching)

    def add(self, agent: Agent, slot: int) -> Mover:
        """Return a vehicle that appears in the next instant, in a column of its own or one that has become free."""
        mover = Mover(agent, slot, self.junction)
        self.slots[slot : slot + 1] = [mover]
        return mover

    def move(
        self,
        zones: Sequence[int],
        stations: Sequence[float] | None,
        speeds: Sequence[float] | None,
        poses: Sequence[Sequence[float]] | None,
        lights: Sequence[int],
    ) -> list[Mover]:
        """Go on to the next instant, and return whose zone is another one now; arguments are by column."""
        self.tick += 1
        self._run = None
        self.block = self._feed(zones, stations, speeds, poses, lights)
        self.lights = list(lights)
        self.located, self.timed = stations is not None, speeds is not None
        changed = [mover for mover, zone in zip(self.slots, zones, strict=True) if self._zone(mover, zone)]
        self.movers = [mover for mover in self.slots if mover.zone != ABSENT]
        waiting, faced, found = (values[0].tolist() for values in (wt(self.block), facing(self.block), arrived(self.block)))
        since = arrivals(self.block).tick[0].tolist()
        for mover in self.slots:
            slot = mover.slot
            mover.wt, mover.facing, mover.arrived, mover.arrived_at = waiting[slot], faced[slot], found[slot], since[slot]
        for mover in self.movers:
            slot = mover.slot
            if stations is not None:
                mover.station = stations[slot]
            if speeds is not None:
                mover.speed = speeds[slot]
        return changed

    def _zone(self, mover: Mover, zone: int) -> bool:
        """Take over the zone of a vehicle, and return whether it is another one."""
        tick = self.tick
        changed = zone != mover.zone
        if changed:
            mover.zone = zone
            if zone >= JUNCTION and mover.entered == NEVER:
                mover.entered = tick
            if zone == ABSENT:
                mover.station = mover.speed = math.nan
        return changed

    @property
    def run(self) -> Run:
        """A run of this state alone, that knows what it takes over from those before."""
        if self._run is None:
            self._run = self._as_run()
        return self._run

    def _as_run(self) -> Run:
        slots = self.slots
        pairs = None if self.touching is None else tuple(Collision(0.0, _two(pair), 0.0) for pair in self.touching)
        run = _State(
            "live",
            self.junction,
            tuple(m.agent for m in slots),
            np.array([[m.zone for m in slots]], dtype=np.int8),
            np.array([self.lights], dtype=np.int8),
            self.dt,
            station=self.block.station,
            speed=self.block.speed,
            pose=self.block.pose,
            collisions=pairs,
            facts=self.facts,
        )
        assume(run, self.block)
        return run

    def waited(self, mover: Mover) -> int:
        """`standing.waited`."""
        if not (self.located and self.timed):
            return mover.wt
        return self.tick - mover.arrived_at if mover.arrived else 0


def _two(pair: Iterable[str]) -> tuple[str, str]:
    one, two = sorted(pair)
    return one, two
