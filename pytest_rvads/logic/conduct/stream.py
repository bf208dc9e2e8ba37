"""States that come one after the other, as blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Block, Signal, unless_equal
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.runs.run import Facts
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import RunError

__all__ = ["Stream"]


class Stream:
    """Makes blocks of states as the states come, and hands the carry of every block on to the next block.

    Args:
        junction: the junction that the vehicles drive through.
        dt: time between two states [s].
        facts: the facts of the run; they may state a speed limit.
    """

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.dt, self._facts = dt, facts
        self.cast = Cast(junction, (), facts)
        self._kept: Sequence[int | None] | None = None
        self._last: Block | None = None
        self._tick = 0

    def recast(self, agents: Sequence[Agent], kept: Sequence[int | None]) -> None:
        """Replace the vehicles, because a vehicle has come or gone.

        Args:
            agents: the vehicles of the next block, in the order of its columns.
            kept: for every vehicle its column in the last block, None for a vehicle that has just come.
        """
        self.cast, self._kept = Cast(self.cast.junction, agents, self._facts), kept

    def feed(self, signals: Iterable[Signal[Any]], zone: NDArray[np.int8], lights: NDArray[np.int8], **arrays: Any) -> Block:
        """Return the next states as a block.

        Args:
            signals: the signals with a carry; each is worked out, because later blocks depend on its carry.
            zone: `Zone` of every vehicle, shape ``(n, agents)``.
            lights: `Colour` at every entrance, shape ``(n, entrances)``.
            **arrays: the other arrays of `Block` that are known.
        """
        last = self._last
        block = Block(self.cast, zone, lights, self.dt, **arrays, tick=self._tick, previous=last, kept=self._kept)
        if last is not None and self._kept is None and last.zone.shape == zone.shape and last.given == block.given:
            block.earlier, last.earlier = last, None
            block.zone, block.lights = unless_equal(zone, last.zone), unless_equal(lights, last.lights)
        for signal in signals:
            try:
                signal(block)
            except RunError as error:
                block.unknown[signal] = str(error)
        block.previous = None
        self._last, self._kept, self._tick = block, None, self._tick + len(zone)
        return block
