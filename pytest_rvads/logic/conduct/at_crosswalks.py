"""Finds vehicles that stand on crosswalks, and pedestrians who wait at the kerb or stepped onto a crosswalk on WALK."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ENTRANCE, Block, signal, sized
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.logic.conduct.on_foot import walkers
from pytest_rvads.logic.conduct.progress import CRAWL, STUCK_TIME, idles
from pytest_rvads.logic.conduct.rights import GREEN, WAIVER, close_behind, near_crosswalk
from pytest_rvads.logic.conduct.standing import entered, facing, lasting, latched, stands
from pytest_rvads.logic.conduct.stretches import ahead_by, neighbours
from pytest_rvads.logic.conduct.waiting import SPARE, lets_pass, partners

__all__ = ["on_crosswalk", "stands_on_crosswalk", "stepped_on_walk", "waits_to_cross"]


@signal(steady=True)
def stepped_on_walk(block: Block) -> NDArray[np.bool_]:
    """Return whether the light of each pedestrian showed green (WALK) when the pedestrian stepped onto the crosswalk."""
    on_walk: NDArray[np.bool_] = (entered(block) <= block.ticks) & (facing(block) == GREEN)
    return on_walk


@signal(pairs=walkers, start=(0, False), needs=sized)
def waits_to_cross(block: Block, before: NDArray[np.int64], waived: NDArray[np.bool_]) -> tuple[NDArray[Any], ...]:
    """Return whether each pair's pedestrian waits in the last metre before the kerb, and the vehicle is near the crosswalk.

    A pedestrian who does not step onto the roadway while the vehicle stands there for `WAIVER` lets the vehicle go first.
    """
    both, near = block.cast.static(walkers), near_crosswalk(block)
    waits = both.second(block.zone == ENTRANCE)
    count = lasting(waits & near & both.first(stands(block)), before)
    gone_by = latched(waits & (count > round(WAIVER / block.dt)), ~waits, waived)
    return waits & near & ~gone_by, count, gone_by


def _areas(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the painted areas of crosswalks begin and end on the way of each vehicle, shape ``(crosswalks, agents)`` [m].

    A vehicle that does not drive over a crosswalk has NaN there.
    """
    numbers, covers = range(len(cast.junction.crossings)), cast.junction.covers
    areas = [[covers.get((number, agent.way.key), (np.nan, np.nan)) for agent in cast.agents] for number in numbers]
    begin, end = np.array(areas, dtype=np.float64).reshape(len(numbers), len(cast), 2).transpose(2, 0, 1)
    return begin, end


@signal(needs=sized)
def on_crosswalk(block: Block) -> NDArray[np.bool_]:
    """Return whether a part of the body of each vehicle is over the painted area of a crosswalk."""
    begin, end = block.cast.static(_areas)
    front = block.need("station")[:, None]
    over: NDArray[np.bool_] = ((front > begin) & (front - block.cast.length < end)).any(axis=1)
    return over & block.here


@signal(start=(np.nan, False, 0), needs=idles.needs)
def stands_on_crosswalk(
    block: Block, before: NDArray[np.float64], full: NDArray[np.bool_], count: NDArray[np.int64]
) -> tuple[NDArray[Any], ...]:
    """Return whether each vehicle has stood or crept on a crosswalk for longer than `STUCK_TIME` without a break or an excuse.

    Excuses are a road user to whom the vehicle gives way, and a vehicle close ahead that left room for this vehicle behind the
    crosswalk when this vehicle drove onto it: its length and `SPARE`.
    """
    cast, near, (begin, end) = block.cast, block.cast.static(neighbours), block.cast.static(_areas)
    front = block.need("station")
    last = np.concatenate((before[None], front[:-1]))[:, None]
    comes = (last < begin) & (front[:, None] >= begin)
    room = near.first(front) + ahead_by(block)
    tight = comes.copy()
    for number, stop in enumerate(end):
        tight[:, number] &= near.any(room < near.first(stop + cast.length + SPARE), len(cast))
    full_ahead = latched(np.any(tight, axis=1), np.any(comes & ~tight, axis=1), full)
    queued = near.any(close_behind(block), len(cast))
    gives_way = cast.static(partners).any(lets_pass(block), len(cast))
    stays = on_crosswalk(block) & (np.abs(block.need("speed")) <= CRAWL) & ~gives_way & (full_ahead | ~queued)
    lasts = lasting(stays, count)
    return lasts > round(STUCK_TIME / block.dt), front, full_ahead, lasts
