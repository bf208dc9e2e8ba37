"""Getting on: which vehicle could go and does not, and which vehicle stands in the junction for no good reason.

A vehicle may wait for a body ahead in its lane, for a vehicle on the stretch that their movements share, for a vehicle with the
better right that is due or first at its line, and in a queue before a light that is not green. Vehicles that wait for each other
have no such excuse, but for an intruder, see `waiting.circles`. A vehicle that could go loses time as far as it is slower than
walking pace.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import ENTRANCE, Block, signal, sized
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.logic.conduct.motion import advance, facing, inside
from pytest_rvads.logic.conduct.rights import GREEN, PACE, RED, YELLOW
from pytest_rvads.logic.conduct.stretches import ahead_by, first_stretch, neighbours
from pytest_rvads.logic.conduct.waiting import QUEUE_GAP, circles, lines
from pytest_rvads.runs.itineraries import LEAVE

__all__ = ["BLOCKING_TIME", "CRAWL", "PASSED", "PATIENCE", "STUCK_TIME", "Lost", "blocks", "idles", "losses", "may_go"]

PATIENCE = 10.0
"""A vehicle that stands for this long although it could go impedes traffic [s]; laws give no number (StVO 3(2), CVC 22400(a))."""
BLOCKING_TIME = 3.0
"""A vehicle that loses more time than this in the junction blocks it [s]."""
STUCK_TIME = 1.0
"""A vehicle that entered without room and then stands in the junction for longer than this blocks it [s]."""
CRAWL = 0.5
"""A vehicle that is faster than this crosses the junction, however slowly, and does not block it [m/s]."""
PASSED = 1.0
"""A vehicle has passed a part of its way for good when its rear has left it by this [m]: fronts flicker over a line."""


def _need_everything(block: Block, _columns: Sequence[int]) -> None:
    """Check that a block holds geometry, positions, speeds and sizes of all vehicles: every vehicle may be waited for."""
    block.cast.static(neighbours)
    sized(block, range(len(block.cast)))
    block.need("speed")


def _before_lights(cast: Cast) -> NDArray[np.float64]:
    """Return where the front of every vehicle may wait at a light [m]: from before its line up to its first shared stretch."""
    ends = [first_stretch(cast.junction, agent.way.key) for agent in cast.agents]
    return np.array([cast.static(lines) - QUEUE_GAP, ends])


@signal
def _at_light(block: Block) -> NDArray[np.bool_]:
    """Which vehicle has a light that is not green, and its front near or past the line, before the first shared stretch."""
    waiting: NDArray[np.bool_] = _dark(block)
    if waiting.any():
        station, (begin, end) = block.need("station"), block.cast.static(_before_lights)
        waiting = waiting & (station > begin) & (station < end)
    return waiting


@signal(steady=True)
def _dark(block: Block) -> NDArray[np.bool_]:
    """Which vehicle comes to an entrance whose light is not green now."""
    light = block.lights.take(block.cast.entrance, axis=1)
    dark: NDArray[np.bool_] = (light == RED) | (light == YELLOW)
    return dark


def _slowness(block: Block, speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part of every step that is lost against walking pace [s]."""
    # Rounded, so that three hundred steps at rest are three seconds.
    lost: NDArray[np.float64] = (1.0 - np.minimum(np.maximum(speed / PACE, 0.0), 1.0)) * block.dt
    return lost.round(12)


@signal
def _may_lose(block: Block) -> NDArray[np.float64]:
    """The time that every vehicle loses in each state, provided that the vehicle could go [s]."""
    return _slowness(block, advance(block))


@signal
def _loses(block: Block) -> NDArray[np.bool_]:
    """Which vehicle loses time, provided that the vehicle could go."""
    losing: NDArray[np.bool_] = _may_lose(block) > 0.0
    return losing


@signal
def _far_down(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is so far down its exit road that it has arrived."""
    far: NDArray[np.bool_] = block.need("station") - block.cast.way >= LEAVE
    return far


@signal(pairs=neighbours)
def _trails(block: Block) -> NDArray[np.bool_]:
    """Which first vehicle is so near behind the second vehicle that it belongs to the same queue."""
    trailing: NDArray[np.bool_] = ahead_by(block) < QUEUE_GAP
    return trailing


@signal(needs=_need_everything, steady=True)
def may_go(block: Block) -> NDArray[np.bool_]:
    """Which vehicle could go: its light allows it, and it waits for no vehicle, or in a circle of waiting vehicles only.

    In the queue before the junction, a vehicle behind a vehicle that loses no time could not go. A vehicle far down its exit road
    has arrived.
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
    """No time, but the number of parts of its way that the vehicle has passed: the part before and the part in the junction."""
    idle: NDArray[np.float64]
    """In the present part of its way, although the vehicle could go."""
    circle: NDArray[np.float64]
    """In the present part of its way, in a circle of vehicles that wait for each other, since that circle began."""
    blocked: NDArray[np.float64]
    """In the junction, while no other vehicle kept the vehicle from going."""
    stuck: NDArray[np.float64]
    """In the junction, standing behind a vehicle that left no room when this vehicle entered."""


@signal(start=(0, np.zeros(4), np.zeros(4)))
def losses(
    block: Block, part: NDArray[np.int64], before: NDArray[np.float64], forgotten: NDArray[np.float64]
) -> tuple[Lost, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The time that every vehicle has lost, see `Lost`.

    Args:
        block: the states.
        part: the part of its way that every vehicle was in before the first state.
        before: the total of each of the four losses before the first state, shape ``(4, agents)`` [s].
        forgotten: the total of each loss when the loss last began anew, shape ``(4, agents)`` [s].
    """
    speed, free, wait = np.abs(block.need("speed")), may_go(block), circles(block)
    rear = block.need("station") - block.cast.length
    passed = (rear > PASSED).astype(np.int64) + (rear - block.cast.way > PASSED)
    parts = np.maximum(np.maximum.accumulate(passed, axis=0), part)
    goes_on = parts > np.concatenate((part[None], parts[:-1]))
    # A vehicle that overran its line on yellow or red, and now waits, does not stay in the junction.
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
    # Rounded, so that three hundred steps at rest are three seconds, whatever went before.
    sums = (total[1:] - forgotten).round(9)
    return Lost(parts, *sums.swapaxes(0, 1)), parts, total, forgotten


@signal(needs=_need_everything)
def idles(block: Block) -> NDArray[np.bool_]:
    """Which vehicle has lost more time than `PATIENCE` while it could go: before the junction, in it, or on its way out.

    The time in a circle of vehicles that wait for each other is counted separately, from the beginning of the circle. The time is
    counted anew in each part of the way. A part is passed as soon as the rear has left the part by `PASSED`.
    """
    lost: Lost = losses(block)
    idling: NDArray[np.bool_] = np.maximum(lost.idle, lost.circle) > PATIENCE
    return idling


@signal(needs=_need_everything)
def blocks(block: Block) -> NDArray[np.bool_]:
    """Which vehicle has lost more time than `BLOCKING_TIME` in the junction, or is stuck there for more than `STUCK_TIME`.

    A vehicle stays in the junction at `CRAWL` or less.
    """
    lost: Lost = losses(block)
    return (lost.blocked > BLOCKING_TIME) | (lost.stuck > STUCK_TIME)
