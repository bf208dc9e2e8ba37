"""Finds vehicles that could go and do not go, and vehicles that stand in the junction or on a crosswalk without a reason.

These are reasons to wait: a body ahead in the lane, a vehicle on the stretch that both movements share, a vehicle with the better
right that comes soon or is first at its line, and a light that is not green. A vehicle that waits in a circle of vehicles, each
waiting for the next, could go, unless a vehicle of the circle is an intruder, see `waiting.circles`. A vehicle that could go
loses time while it is slower than walking pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ENTRANCE, Block, signal, sized
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.logic.conduct.rights import GREEN, PACE, RED, YELLOW, close_behind
from pytest_rvads.logic.conduct.standing import advance, facing, inside, lasting, latched, lines
from pytest_rvads.logic.conduct.stretches import ahead_by, first_stretch, neighbours
from pytest_rvads.logic.conduct.waiting import QUEUE_GAP, SPARE, circles, lets_pass, partners
from pytest_rvads.runs.itineraries import LEAVE

PATIENCE = 10.0
"""Lost time beyond which a vehicle that could go impedes traffic [s]; laws give no number (StVO 3(2), CVC 22400(a))."""
BLOCKING_TIME = 3.0
"""Time lost in the junction beyond which a vehicle blocks the junction [s]."""
STUCK_TIME = 1.0
"""Time beyond which a vehicle that entered without room and stands in the junction blocks the junction [s]."""
CRAWL = 0.5
"""Speed beyond which a vehicle crosses the junction and does not block the junction [m/s]."""
PASSED = 1.0
"""Distance from a part of its way to a vehicle's rear beyond which the vehicle has passed the part [m]; a measured position that
flickers over a border does not pass a part twice."""


def _need_everything(block: Block, _columns: Sequence[int]) -> None:
    """Check that a block holds geometry, and the positions, speeds and sizes of all vehicles, any of which may be waited for."""
    block.cast.static(neighbours)
    sized(block, range(len(block.cast)))
    block.need("speed")


def _before_lights(cast: Cast) -> NDArray[np.float64]:
    """Return the stations between which each vehicle may wait at a light [m]: the queue before its line to its first conflict.

    A crosswalk can lie before the entrance vertex; a vehicle waits at its light up to the vertex, at least.
    """
    ends = [max(first_stretch(cast.junction, agent.way.key), 0.0) for agent in cast.agents]
    return np.array([cast.static(lines) - QUEUE_GAP, ends])


@signal
def _at_light(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle may wait at its light: the light is not green, and the vehicle is near the light."""
    light = block.lights.take(block.cast.entrance, axis=1)
    waiting: NDArray[np.bool_] = (light == RED) | (light == YELLOW)
    if waiting.any():
        station, (begin, end) = block.need("station"), block.cast.static(_before_lights)
        waiting = waiting & (station > begin) & (station < end)
    return waiting


def _slowness(block: Block, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the time that each vehicle loses in every step because it is slower than walking pace [s]."""
    # Rounded, so that three hundred steps of 0.01 s at rest add up to exactly three seconds.
    lost: NDArray[np.float64] = (1.0 - np.minimum(np.maximum(speed / PACE, 0.0), 1.0)) * block.dt
    return lost.round(12)


@signal
def _may_lose(block: Block) -> NDArray[np.float64]:
    """Return the time that each vehicle loses in every state if it could go, which is not checked [s]."""
    return _slowness(block, advance(block))


@signal
def _loses(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle loses time if it could go, which is not checked."""
    losing: NDArray[np.bool_] = _may_lose(block) > 0.0
    return losing


@signal
def _far_down(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is so far down its exit road that its drive is over."""
    far: NDArray[np.bool_] = block.need("station") - block.cast.way >= LEAVE
    return far


@signal(pairs=neighbours)
def _trails(block: Block) -> NDArray[np.bool_]:
    """Return whether the first vehicle of each pair is so near behind the second that both belong to the same queue."""
    trailing: NDArray[np.bool_] = ahead_by(block) < QUEUE_GAP
    return trailing


@signal(needs=_need_everything)
def may_go(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle could go: no light stops it, and it waits for no vehicle, or only in a circle of vehicles.

    In the queue before the junction, a vehicle could go only if the vehicle ahead could go and loses time. A vehicle far down its
    exit road has ended its drive, and the value is false.
    """
    cast, near, slow = block.cast, block.cast.static(neighbours), _loses(block)
    free: NDArray[np.bool_] = block.here & ~_far_down(block) & ~_at_light(block) & ~circles(block).held
    trailing = near.first(block.zone <= ENTRANCE) & _trails(block)
    while trailing.any():
        excused = free & near.any(trailing & ~near.second(free & slow), len(cast))
        if not excused.any():
            break
        free &= ~excused
    return free


class Lost(NamedTuple):
    """The time that every vehicle has lost up to every state [s], each of shape ``(n, agents)``."""

    part: NDArray[np.int64]
    """How many parts of its way the vehicle has passed: 0 before, 1 in and 2 after the junction."""
    idle: NDArray[np.float64]
    """Time lost in the present part of its way, although the vehicle could go."""
    circle: NDArray[np.float64]
    """Time lost in the present part of its way, in a circle of vehicles that wait for each other, since the circle began."""
    blocked: NDArray[np.float64]
    """Time lost in the junction, while no other vehicle kept the vehicle from going."""
    stuck: NDArray[np.float64]
    """Time that the vehicle has stood in the junction behind a vehicle that left no room when this vehicle entered."""


@signal(start=(0, np.zeros(4), np.zeros(4)))
def losses(
    block: Block, part: NDArray[np.int64], before: NDArray[np.float64], forgotten: NDArray[np.float64]
) -> tuple[Lost, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the time that each vehicle has lost up to every state, see `Lost`.

    `before` holds the totals of the four losses before the first state, and `forgotten` holds the totals when each loss last
    began anew, both of shape ``(4, agents)`` [s].
    """
    speed, free, wait = np.abs(block.need("speed")), may_go(block), circles(block)
    rear = block.need("station") - block.cast.length
    passed = (rear > PASSED).astype(np.int64) + (rear - block.cast.way > PASSED)
    parts = np.maximum(np.maximum.accumulate(passed, axis=0), part)
    goes_on = parts > np.concatenate((part[None], parts[:-1]))
    # A vehicle that overran its line on yellow or red and waits for green does not count as a vehicle that stays.
    stays = inside(block) & (speed <= CRAWL)
    total, restarts = np.zeros((len(speed) + 1, *before.shape)), np.zeros((len(speed), *before.shape), dtype=np.bool_)
    total[0], lost, outside = before, np.where(free, _may_lose(block), 0.0), ~wait.circling
    total[1:, 0], total[1:, 1] = lost * outside, lost * wait.circling
    restarts[:, 0], restarts[:, 1], restarts[:, 3] = goes_on, goes_on | outside, True
    if stays.any():
        stays &= ~(_at_light(block) & (facing(block) != GREEN))
        stuck = stays & wait.stuck
        total[1:, 2] = np.where(stays & ~wait.held, _slowness(block, speed), 0.0)
        total[1:, 3], restarts[:, 3] = stuck * block.dt, ~stuck
    total = np.add.accumulate(total, axis=0)
    forgotten = np.maximum.accumulate(np.where(restarts, total[:-1], forgotten), axis=0)
    # Rounded, so that three hundred steps of 0.01 s at rest are exactly three seconds, whatever the total before.
    sums = (total[1:] - forgotten).round(9)
    return Lost(parts, *sums.swapaxes(0, 1)), parts, total, forgotten


@signal(needs=_need_everything)
def idles(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle has lost more time than `PATIENCE` in the present part of its way, although it could go."""
    lost: Lost = losses(block)
    idling: NDArray[np.bool_] = np.maximum(lost.idle, lost.circle) > PATIENCE
    return idling


@signal(needs=_need_everything)
def blocks(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle has lost more than `BLOCKING_TIME` in the junction, or been stuck there for `STUCK_TIME`."""
    lost: Lost = losses(block)
    return (lost.blocked > BLOCKING_TIME) | (lost.stuck > STUCK_TIME)


def _areas(cast: Cast) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where crosswalks begin and end on the way of each vehicle, or NaN, both of shape ``(crosswalks, agents)`` [m]."""
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


@signal(start=(np.nan, False, 0), needs=_need_everything)
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
