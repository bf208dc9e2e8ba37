"""Finds which road users wait for each other, circles of vehicles that all wait, and vehicles that stand without a reason.

These are reasons to wait: a body ahead in the lane, a vehicle on the stretch that both movements share, a vehicle with the better
right that comes soon or is first at its line, and a light that is not green. A vehicle that waits in a circle of vehicles, each
waiting for the next, could go, unless a vehicle of the circle is an intruder, see `circles`. A vehicle that could go
loses time while it is slower than walking pace.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, Cast, Pairs, everybody, pairs, signal, sized
from pytest_rvads.logic.conduct.rights import (
    DUE,
    GREEN,
    PACE,
    RED,
    WAIVER,
    YELLOW,
    came_first,
    close_behind,
    coming,
    first_at_line,
    ground_of,
    has_way,
    near_crosswalk,
    owing,
    ready,
    waives,
    yields,
)
from pytest_rvads.logic.conduct.standing import advance, entered, facing, inside, lasting, latched, lines, stands
from pytest_rvads.logic.conduct.stretches import (
    ahead_by,
    first_stretch,
    neighbours,
    places,
    places_of,
    roads,
    shared,
    walk,
    walkers,
)
from pytest_rvads.runs.itineraries import LEAVE

AT_LINE = 5.0
"""Distance to the stopping line below which a vehicle is at its line and may wait for its turn [m]."""
QUEUE_GAP = 15.0
"""Distance to the stopping line, or to the vehicle ahead, below which a vehicle belongs to the queue [m]: about three lengths of
a car."""
SPARE = 1.0
"""Room, in addition to its length, that a vehicle must have on its exit road when it enters the junction [m]."""


def partners(cast: Cast) -> Pairs:
    """Return the pairs of vehicles of which the first can have a reason to let the second vehicle pass."""
    if cast.junction.control is JunctionControl.STOP:
        return cast.static(everybody)

    def belong(agent: int, other: int) -> bool:
        me, you = cast.agents[agent], cast.agents[other]
        return shared(cast, agent, other) is not None or _first_turn(cast.junction, me.way.key, you.entrance) < math.inf

    return pairs(cast, belong)


_places = places(partners, shared)


def _first_turns(cast: Cast) -> NDArray[np.float64]:
    met = ((cast.agents[agent].way.key, cast.agents[other].entrance) for agent, other in cast.static(partners).column)
    return np.array([_first_turn(cast.junction, way, entrance) for way, entrance in met], dtype=np.float64)


@lru_cache(maxsize=4096)
def _first_turn(junction: Junction, way: Key, entrance: int) -> float:
    """Return the least station at which a movement from an entrance reaches a stretch shared with `way` [m]; or infinity.

    Only movements to which vehicles on `way` give way count, and only if a stop or yield sign stands at the start of `way`.
    """
    if junction.stretches is None or junction.starts[way[0]].sign not in (Sign.STOP, Sign.YIELD):
        return math.inf
    turns = [key for key in junction.movements if key[0] == entrance and ground_of(junction, way, key) is not None]
    return min((junction.stretches[way, key].yours.start for key in turns), default=math.inf)


class _Debts(NamedTuple):
    """Which vehicle of each pair of `partners` has to give way to the other vehicle, arrays of shape ``(n, pairs)``."""

    owed: NDArray[np.bool_]
    """Whether the first vehicle has to give way to the second."""
    given: NDArray[np.bool_]
    """Whether the second vehicle has to give way to the first."""


@signal
def _debts(block: Block) -> _Debts:
    shape = len(block.zone), len(block.cast.static(partners))
    debts = _Debts(np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_))
    if len(block.cast.static(owing)):
        owes = yields(block)
        for truths, turned in ((debts.owed, False), (debts.given, True)):
            columns = block.cast.columns(owing, partners, turned=turned)
            truths[:, columns[columns >= 0]] = owes[:, columns >= 0]
    return debts


@signal
def at_line(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is before the junction, and at most `AT_LINE` before its line."""
    return (block.zone <= ENTRANCE) & (block.need("station") > block.cast.static(lines) - AT_LINE)


@signal(pairs=partners)
def due(block: Block) -> NDArray[np.bool_]:
    """Return whether each pair's second vehicle is due: it comes soon, see `coming`, or is first at its line and may go."""
    both, at = block.cast.static(partners), block.cast.static(_places)
    return coming(block, both, at) | both.second(ready(block) & block.here) & ~np.isnan(at.begin)


@signal(pairs=walkers)
def lets_walk(block: Block) -> NDArray[np.bool_]:
    """Return whether the vehicle of each pair has a reason to wait for the pedestrian, who walks or stands on the crosswalk.

    A pedestrian at the kerb is no reason, because it may stand there for ever, nor is one that is past the lane of the vehicle.
    """
    both, waiting = block.cast.static(walkers), at_line(block) | (block.zone == JUNCTION)
    before = both.first(block.need("station")) < block.cast.static(places_of).far
    return walk(block).on & before & (both.first(waiting) | near_crosswalk(block))


@signal(pairs=partners)
def lets_pass(block: Block) -> NDArray[np.bool_]:
    """Return whether the first vehicle of each pair has a reason to let the second vehicle pass."""
    cast, both, at = block.cast, block.cast.static(partners), block.cast.static(_places)
    station, within, apart = block.need("station"), block.zone == JUNCTION, np.isnan(at.begin)
    front, their_front, rear = both.first(station), both.second(station), station - cast.length
    before, their_within, waiving = both.first(at_line(block)), both.second(within), waives(block)
    reasons: NDArray[np.bool_]
    if block.junction.control is JunctionControl.STOP:
        reasons = before & their_within | came_first(block) & ~(apart & both.second(waiving))
    else:
        # The second vehicle can turn into the way of the first within `DUE`, to whom the first gives way because of its sign.
        reach = station + DUE * np.maximum(block.need("speed"), 0.0)
        turning = (block.zone <= ENTRANCE) & block.here & has_way(block)
        reasons = before & both.second(turning) & (both.second(reach) >= cast.static(_first_turns))
    ahead = front < at.begin
    on_mine = (front >= at.begin) & (both.first(rear) <= at.end) & both.first(block.here)
    on_theirs = (their_front >= at.begin_of_two) & (both.second(rear) <= at.end_of_two) & both.second(block.here)
    reasons |= on_theirs & (ahead | on_mine)
    comes, debts = due(block), _debts(block)
    reasons |= ahead & their_within & (their_front < at.begin_of_two) & ~debts.given
    reasons |= before & comes & both.second(block.need("speed") > PACE)
    reasons |= ahead & debts.owed & (comes | both.second(first_at_line(block)))
    reasons &= before | both.first(within) | apart
    if cast.aside.any():
        reasons[:, both.first(cast.aside) | both.second(cast.aside)] = False
        reasons[:, cast.columns(walkers, partners)] = lets_walk(block)
    return reasons


@signal(pairs=neighbours, start=(False,))
def no_room(block: Block, before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Return whether each pair's second vehicle left the first vehicle no room when the first entered the junction.

    Such a second vehicle was ahead on the way or exit road of the first. It stood or crept, or it left less room behind its rear
    on the common exit road than the length of the first vehicle and `SPARE`.
    """
    cast, both = block.cast, block.cast.static(neighbours)
    enters, blocked = both.first(entered(block) == block.ticks), np.zeros((len(block.zone), len(both)), dtype=np.bool_)
    if enters.any():
        rear = ahead_by(block)
        room = both.first(block.need("station")) + rear - both.first(cast.way)
        rolling = cast.static(roads).exit & (room < both.first(cast.length) + SPARE)
        blocked = enters & (rear < math.inf) & (rolling | (both.second(block.need("speed")) < PACE))
    blocked = before | np.logical_or.accumulate(blocked, axis=0)
    return blocked, blocked


@signal
def _intruders(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle is an intruder in the junction.

    An intruder entered on red, or entered the way of a vehicle in the junction to which the intruder had to give way.
    """
    both, entry = block.cast.static(partners), entered(block)
    intruders: NDArray[np.bool_] = (block.zone >= JUNCTION) & (facing(block) == RED)
    late = lets_pass(block) & _debts(block).given
    if late.any():
        late &= (both.first(entry) < both.second(entry)) & both.second(block.zone == JUNCTION)
        rows, columns = np.nonzero(late)
        intruders[rows, both.others[columns]] = True
    return intruders


class Circles(NamedTuple):
    """Which vehicles wait for other vehicles, also in circles of vehicles, arrays of shape ``(n, agents)``.

    A vehicle waits for a vehicle that it lets pass, and for a slow vehicle close ahead. At an all-way stop a vehicle sometimes
    lets a vehicle pass although their ways do not meet; such a courtesy makes no circle, because the courteous vehicle could go.
    """

    held: NDArray[np.bool_]
    """Which vehicle waits, directly or through other waiting vehicles, for a vehicle that does not wait for this vehicle."""
    circling: NDArray[np.bool_]
    """Which vehicle waits in a circle of vehicles that wait for each other and for no vehicle outside the circle."""
    stuck: NDArray[np.bool_]
    """Which vehicle lets no vehicle pass, and is close behind a vehicle that left no room when this vehicle entered."""


@signal
def circles(block: Block) -> Circles:
    """Return which vehicles wait, also in circles, see `Circles`.

    A vehicle that waits for an intruder, see `_intruders`, is held by the intruder, even if both wait for each other.
    """
    queued, giving, late = close_behind(block), lets_pass(block), _intruders(block)
    blocked = queued & no_room(block)
    # Which vehicle waits for which vehicle seldom changes from one state to the next, so each situation is computed once.
    keys = [row.tobytes() for row in np.concatenate((queued, blocked, giving, late), axis=1)]
    rows = {key: row for row, key in enumerate(keys)}
    queued, blocked, giving, late = (part[list(rows.values())] for part in (queued, blocked, giving, late))
    cast, near, both = block.cast, block.cast.static(neighbours), block.cast.static(partners)
    shape = len(late), len(cast), len(cast)
    reach, behind, yielding = (np.zeros(shape, dtype=np.bool_) for _ in range(3))
    reach[:, near.agents, near.others], behind[:, near.agents, near.others] = queued, blocked
    yielding[:, both.agents, both.others] = giving
    waits = reach | yielding
    reach = _closure(waits)
    apart = np.zeros(shape[1:], dtype=np.bool_)
    if cast.junction.control is JunctionControl.STOP:
        apart[both.agents, both.others] = np.isnan(cast.static(_places).begin)
    courtesies = yielding & apart & reach & reach.swapaxes(1, 2)
    if courtesies.any():
        yielding &= ~courtesies
        reach = _closure(waits & ~courtesies)
    one_way = ~(reach & reach.swapaxes(1, 2)) | (late[:, None, :] & ~late[:, :, None])
    held, lets, stuck = ((of & one_way).any(axis=2) for of in (reach, yielding, behind))
    situations = dict(zip(rows, np.stack((held, reach.any(axis=2) & ~held, stuck & ~lets), axis=1), strict=True))
    return Circles(*np.stack([situations[key] for key in keys], axis=1))


def _closure(waits: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which vehicle waits for which vehicle, directly or through a chain of vehicles, shape ``(n, agents, agents)``."""
    reach = waits.copy()
    for via in np.flatnonzero(reach.any(axis=(0, 1)) & reach.any(axis=(0, 2))).tolist():
        reach |= reach[:, :, via, None] & reach[:, via, None, :]
    return reach


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


@signal(needs=_need_everything)
def may_go(block: Block) -> NDArray[np.bool_]:
    """Return whether each vehicle could go: no light stops it, and it waits for no vehicle, or only in a circle of vehicles.

    In the queue before the junction, a vehicle could go only if the vehicle ahead could go and loses time. A vehicle far down its
    exit road has ended its drive, and the value is false.
    """
    cast, near, slow = block.cast, block.cast.static(neighbours), _may_lose(block) > 0.0
    on_its_way = block.need("station") - cast.way < LEAVE
    free: NDArray[np.bool_] = block.here & on_its_way & ~_at_light(block) & ~circles(block).held
    trailing = near.first(block.zone <= ENTRANCE) & (ahead_by(block) < QUEUE_GAP)
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
    return np.maximum(lost.idle, lost.circle) > PATIENCE


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
