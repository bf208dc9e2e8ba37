"""What a vehicle does by itself: how long it has been at its entrance, which light it faces, how fast it gets on.

The first two functions work on truth values: for how long a value has been true, and what is true until it is reset.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, signal, sized

__all__ = ["NEVER", "advance", "entered", "facing", "inside", "lasting", "latched", "wt"]


def lasting(truths: NDArray[np.bool_], before: NDArray[Any]) -> NDArray[np.int64]:
    """Return for how many states, up to and with each state, every column has been true without a break.

    Args:
        truths: the truth values, shape ``(n, columns)``.
        before: for how many states every column had been true before the first state, shape ``(columns,)``.
    """
    if len(truths) == 1:
        return np.where(truths, before + 1, 0)
    count = np.arange(1, len(truths) + 1)[:, None]
    return count - np.maximum.accumulate(np.where(truths, -before, count), axis=0)


def latched(set_: NDArray[np.bool_], reset: NDArray[np.bool_], before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the states of latches: a latch is true from a state that sets the latch until a state that resets the latch.

    No state both sets and resets a latch.

    Args:
        set_: the states that set each latch, shape ``(n, columns)``.
        reset: the states that reset each latch, shape ``(n, columns)``.
        before: whether each latch was true before the first state, shape ``(columns,)``.
    """
    if len(set_) == 1:
        return set_ | (before & ~reset)
    count = np.arange(1, len(set_) + 1)[:, None]
    last_set = np.maximum.accumulate(np.where(set_, count, 0), axis=0)
    last_reset = np.maximum.accumulate(np.where(reset, count, 0), axis=0)
    truths: NDArray[np.bool_] = (last_set > last_reset) | (before & (last_reset == 0))
    return truths


NEVER = int(np.iinfo(np.int64).max)
"""Stands for the tick of entry of a vehicle that has not entered the junction."""


@signal(start=(0,))
def wt(block: Block, before: NDArray[np.int32]) -> tuple[NDArray[np.int32], ...]:
    """Waiting times in ticks, see `Run.wt`."""
    # The first state of a run adds nothing to a waiting time.
    ticks = lasting(block.zone == ENTRANCE, before - (block.tick == 0)).astype(np.int32)
    return ticks, ticks


@signal(start=(NEVER,), otherwise=NEVER, steady=True)
def entered(block: Block, before: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    """The tick in which every vehicle entered the junction, in each state; `NEVER` before the vehicle enters."""
    ticks = np.minimum(np.minimum.accumulate(np.where(block.zone >= JUNCTION, block.ticks, NEVER), axis=0), before)
    return ticks, ticks


@signal(start=(0,), steady=True)
def facing(block: Block, before: NDArray[np.int8]) -> tuple[NDArray[np.int8], ...]:
    """The colour of the light at the start of the way of every vehicle; after its entry, the colour at its entry."""
    colours, entry = block.lights[:, block.cast.entrance], entered(block)
    row = np.minimum(entry[-1] - block.tick, len(colours) - 1)
    at_entry = np.where(row >= 0, colours[np.maximum(row, 0), np.arange(len(row))], before)
    colour = np.where(entry >= block.ticks, colours, at_entry).astype(np.int8)
    return colour, colour


@signal(start=(np.nan,), otherwise=np.nan)
def advance(block: Block, before: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """The progress of every vehicle along its way per second, see `Run.advance` [m/s]; its speed in its first state."""
    station = block.need("station")
    rate = (station - np.concatenate((before[None], station[:-1]))) / block.dt
    return np.where(np.isnan(rate), block.need("speed"), rate), station


@signal(needs=sized)
def inside(block: Block) -> NDArray[np.bool_]:
    """Whether part of the body of each vehicle is in the junction."""
    front, cast = block.need("station"), block.cast
    inside_junction: NDArray[np.bool_] = (front > 0.0) & ((front - cast.length) - cast.way < 0.0) & block.here
    return inside_junction
