"""What vehicles do by themselves: how long they have been at their entrance, which light they face, how fast they get on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, signal, sized
from pytest_rvads.logic.conduct.latches import lasting

__all__ = ["NEVER", "advance", "entered", "facing", "inside", "wt"]

NEVER = int(np.iinfo(np.int64).max)
"""The tick in which a vehicle entered that has not entered."""


@signal(start=(0,))
def wt(block: Block, before: NDArray[np.int32]) -> tuple[NDArray[np.int32], ...]:
    """Waiting times in ticks, see `Run.wt`."""
    # The first state of all counts nothing.
    found = lasting(block.zone == ENTRANCE, before - (block.tick == 0)).astype(np.int32)
    return found, found


@signal(start=(NEVER,), otherwise=NEVER, steady=True)
def entered(block: Block, before: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """The tick in which every vehicle entered the junction, as far as it has by then; see `NEVER`."""
    found = np.minimum(np.minimum.accumulate(np.where(block.zone >= JUNCTION, block.ticks, NEVER), axis=0), before)
    return found, found


@signal(start=(0,), steady=True)
def facing(block: Block, before: NDArray[np.int8]) -> tuple[NDArray[np.int8], ...]:
    """The colour of the light at the start of the way of every agent; from its entry on, as it was then."""
    colours, entry = block.lights[:, block.cast.entrance], entered(block)
    row = np.minimum(entry[-1] - block.tick, len(colours) - 1)
    at_entry = np.where(row >= 0, colours[np.maximum(row, 0), np.arange(len(row))], before)
    found = np.where(entry >= block.ticks, colours, at_entry).astype(np.int8)
    return found, found


@signal(start=(np.nan,), otherwise=np.nan)
def advance(block: Block, before: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """How fast every vehicle gets on along its way, see `Run.advance` [m/s]; in its first state, its speed."""
    station = block.need("station")
    rate = (station - np.concatenate((before[None], station[:-1]))) / block.dt
    return np.where(np.isnan(rate), block.need("speed"), rate), station


@signal(needs=sized)
def inside(block: Block) -> NDArray[np.bool_]:
    """Of which vehicle part of the body is in the junction."""
    front, cast = block.need("station"), block.cast
    found: NDArray[np.bool_] = (front > 0.0) & ((front - cast.length) - cast.way < 0.0) & block.here
    return found
