"""The relation of waiting between vehicles, and the circles in it."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.control import JunctionControl, Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import ENTRANCE, JUNCTION, Block, signal
from pytest_rvads.logic.conduct.cast import Cast, Pairs, everybody, pairs
from pytest_rvads.logic.conduct.grounds import ground_of
from pytest_rvads.logic.conduct.motion import entered, facing
from pytest_rvads.logic.conduct.rights import (
    DUE,
    PACE,
    RED,
    came_first,
    close_behind,
    coming,
    first_at_line,
    has_way,
    owing,
    ready,
    waives,
    yields,
)
from pytest_rvads.logic.conduct.stretches import Places, ahead_by, neighbours, passed, places, roads, shared

__all__ = ["QUEUE_GAP", "Circles", "circles", "due", "lets_pass", "lines"]

AT_LINE = 5.0
"""Nearer to the stopping line than this, a vehicle that stands waits for its turn [m]."""
QUEUE_GAP = 15.0
"""Nearer than this to the stopping line, or to the vehicle ahead, a vehicle belongs to the queue that waits there [m]: about
three lengths of a car."""
SPARE = 1.0
"""A vehicle must not enter the junction where less room than its length and this is left on its exit road [m]."""


def lines(cast: Cast) -> NDArray[np.float64]:
    """Return the stations of the stopping lines of all vehicles, shape ``(agents,)`` [m]."""
    return np.array([-cast.junction.setbacks[agent.entrance] for agent in cast.agents], dtype=np.float64)


def partners(cast: Cast) -> Pairs:
    """Return the pairs of vehicles of which the first may have a reason to let the second pass.

    Raises:
        RunError: the run holds no geometry of its junction.
    """
    if cast.junction.control is JunctionControl.STOP:
        return cast.static(everybody)
    return pairs(cast, lambda agent, other: shared(cast, agent, other) is not None or _first_turn(cast, agent, other) < math.inf)


def _places(cast: Cast) -> Places:
    """Return the stretches that `partners` share."""
    return places(shared(cast, agent, other) for agent, other in cast.static(partners).column)


def _first_turns(cast: Cast) -> NDArray[np.float64]:
    return np.array([_first_turn(cast, agent, other) for agent, other in cast.static(partners).column], dtype=np.float64)


def _first_turn(cast: Cast, agent: int, other: int) -> float:
    return _first_turn_onto(cast.junction, cast.agents[agent].way.key, cast.agents[other].entrance)


@lru_cache(maxsize=4096)
def _first_turn_onto(junction: Junction, way: Key, entrance: int) -> float:
    """Return the station at which a vehicle from an entrance first gets onto `way` [m]; infinity if it never does.

    Only movements from the entrance count to which `way` gives way by its sign.
    """
    if junction.stretches is None or junction.starts[way[0]].sign not in (Sign.STOP, Sign.YIELD):
        return math.inf
    turns = [key for key in junction.movements if key[0] == entrance and ground_of(junction, way, key) is not None]
    return min((junction.stretches[way, key].yours.start for key in turns), default=math.inf)


class _Columns(NamedTuple):
    """Which columns of `owing` are about which columns of `partners`."""

    owed: NDArray[np.int64]
    """Rows: columns of `owing`, and the columns of the same pairs in `partners`."""
    given: NDArray[np.int64]
    """Rows: columns of `owing`, and the columns of the reversed pairs in `partners`."""


def _columns(cast: Cast) -> _Columns:
    column, debts = cast.static(partners).column, cast.static(owing).column.items()
    owed = [(number, column[pair]) for pair, number in debts if pair in column]
    given = [(number, column[other, agent]) for (agent, other), number in debts if (other, agent) in column]
    return _Columns(*(np.array(moves, dtype=np.int64).reshape(-1, 2).T for moves in (owed, given)))


class _Debts(NamedTuple):
    """Which vehicle of `partners` has to give way to the other vehicle, each of shape ``(n, pairs)``."""

    owed: NDArray[np.bool_]
    """Whether the first vehicle has to give way to the second."""
    given: NDArray[np.bool_]
    """Whether the second vehicle has to give way to the first."""


@signal(steady=True)
def _debts(block: Block) -> _Debts:
    """See `_Debts`."""
    shape = len(block.zone), len(block.cast.static(partners))
    debts = _Debts(np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.bool_))
    if len(block.cast.static(owing)):
        owes = yields(block)
        for truths, (source, target) in zip(debts, block.cast.static(_columns), strict=True):
            truths[:, target] = owes[:, source]
    return debts


@signal
def at_line(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is before the junction, and at most `AT_LINE` before its line."""
    near_line: NDArray[np.bool_] = (block.zone <= ENTRANCE) & (block.need("station") > block.cast.static(lines) - AT_LINE)
    return near_line


@signal(pairs=partners)
def due(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle is due at the shared stretch: the vehicle comes, see `coming`, or is first at its line and may go.

    A vehicle that waives its right is not due by standing at its line.
    """
    both, at = block.cast.static(partners), block.cast.static(_places)
    standing = both.second(ready(block) & block.here) & ~np.isnan(at.begin)
    due_vehicles: NDArray[np.bool_] = coming(block, both, at) | standing
    return due_vehicles


@signal
def _walks(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is faster than walking pace."""
    fast: NDArray[np.bool_] = block.need("speed") > PACE
    return fast


@signal(pairs=partners)
def _about_to_turn(block: Block) -> NDArray[np.bool_]:
    """Which second vehicle, if it turned, would within `DUE` be on a way to which the first vehicle gives way by its sign."""
    reach = block.need("station") + DUE * np.maximum(block.need("speed"), 0.0)
    turning: NDArray[np.bool_] = block.cast.static(partners).second(reach) >= block.cast.static(_first_turns)
    return turning


@signal(pairs=partners, steady=True)
def lets_pass(block: Block) -> NDArray[np.bool_]:
    """Which first vehicle has a reason to let the second pass."""
    passed(block)  # stations change the value only where a border is passed
    cast, both, at = block.cast, block.cast.static(partners), block.cast.static(_places)
    station, within, apart = block.need("station"), block.zone == JUNCTION, np.isnan(at.begin)
    front, their_front, rear = both.first(station), both.second(station), station - cast.length
    before, their_within, waiving = both.first(at_line(block)), both.second(within), waives(block)
    reasons: NDArray[np.bool_]
    if block.junction.control is JunctionControl.STOP:
        reasons = before & their_within | came_first(block) & ~(apart & both.second(waiving))
    else:
        turning = (block.zone <= ENTRANCE) & block.here & has_way(block)
        reasons = before & both.second(turning) & _about_to_turn(block)
    ahead = front < at.begin
    on_mine = (front >= at.begin) & (both.first(rear) <= at.end) & both.first(block.here)
    on_theirs = (their_front >= at.begin_of_two) & (both.second(rear) <= at.end_of_two) & both.second(block.here)
    reasons |= on_theirs & (ahead | on_mine)
    comes, debts = due(block), _debts(block)
    reasons |= ahead & their_within & (their_front < at.begin_of_two) & ~debts.given
    reasons |= before & comes & both.second(_walks(block))
    reasons |= ahead & debts.owed & (comes | both.second(first_at_line(block)))
    reasons &= before | both.first(within) | apart
    return reasons


@signal(pairs=neighbours, start=(False,), steady=True)
def no_room(block: Block, before: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], ...]:
    """Which second vehicle left the first no room when the first entered the junction.

    The second vehicle stood or crept ahead on the way or exit road of the first. Or the second vehicle moved on, to that exit
    road or along it, and its rear left less room there than the length of the first vehicle and `SPARE`.
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


@signal(steady=True)
def _intruders(block: Block) -> NDArray[np.bool_]:
    """Which vehicle is an intruder.

    An intruder entered on red, or entered the way of a vehicle that was inside before and to which the intruder owed the way.
    """
    both, entry = block.cast.static(partners), entered(block)
    intruders: NDArray[np.bool_] = (block.zone >= JUNCTION) & (facing(block) == RED)
    late = lets_pass(block) & _debts(block).given
    if late.any():
        late &= (both.first(entry) < both.second(entry)) & both.second(block.zone == JUNCTION)
        rows, columns = np.nonzero(late)
        intruders[rows, both.two[columns]] = True
    return intruders


class Circles(NamedTuple):
    """Which vehicles wait, each of shape ``(n, agents)``.

    A vehicle waits for a vehicle that it lets pass, and for a slow vehicle that it is close behind. At an all-way stop a
    vehicle may let a vehicle pass whose way does not meet; such a courtesy makes no circle, because the first vehicle could go.
    """

    held: NDArray[np.bool_]
    """Which vehicle waits, directly or through other waiting vehicles, for a vehicle that does not wait for this vehicle."""
    circling: NDArray[np.bool_]
    """Which vehicle waits in a circle, in which vehicles wait for each other and for no other vehicle."""
    stuck: NDArray[np.bool_]
    """Which vehicle lets no vehicle pass, and is close behind a vehicle that left no room when this vehicle entered."""


@signal(steady=True)
def circles(block: Block) -> Circles:
    """Which vehicles wait, see `Circles`.

    A vehicle that waits for an intruder, see `_intruders`, is held by the intruder, even where both wait for each other.
    """
    queued, giving, late = close_behind(block), lets_pass(block), _intruders(block)
    blocked = queued & no_room(block)
    # The relation of waiting seldom changes from one state to the next.
    keys = [row.tobytes() for row in np.concatenate((queued, blocked, giving, late), axis=1)]
    rows = {key: row for row, key in enumerate(keys)}
    parts = (part[list(rows.values())] for part in (queued, blocked, giving, late))
    situations = dict(zip(rows, _wait(block.cast, *parts), strict=True))
    return Circles(*np.stack([situations[key] for key in keys], axis=1))


def _wait(
    cast: Cast, queued: NDArray[np.bool_], blocked: NDArray[np.bool_], giving: NDArray[np.bool_], late: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the three arrays of `Circles`, shape ``(n, 3, agents)``.

    Args:
        cast: the vehicles.
        queued: which vehicle is close behind which slow vehicle, shape ``(n, neighbours)``.
        blocked: the pairs of `queued` in which the second vehicle left the first no room at its entry,
            shape ``(n, neighbours)``.
        giving: which vehicle lets which vehicle pass, shape ``(n, partners)``.
        late: which vehicles are intruders, shape ``(n, agents)``.
    """
    near, both = cast.static(neighbours), cast.static(partners)
    shape = len(late), len(cast), len(cast)
    reach, behind, yielding = (np.zeros(shape, dtype=np.bool_) for _ in range(3))
    reach[:, near.one, near.two], behind[:, near.one, near.two], yielding[:, both.one, both.two] = queued, blocked, giving
    waits = reach | yielding
    reach = _closure(waits)
    courtesies = yielding & cast.static(_courtesies) & reach & reach.swapaxes(1, 2)
    if courtesies.any():
        yielding &= ~courtesies
        reach = _closure(waits & ~courtesies)
    one_way = ~(reach & reach.swapaxes(1, 2)) | (late[:, None, :] & ~late[:, :, None])
    held, lets, stuck = ((of & one_way).any(axis=2) for of in (reach, yielding, behind))
    return np.stack((held, reach.any(axis=2) & ~held, stuck & ~lets), axis=1)


def _closure(waits: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which vehicle waits for which vehicle directly or by way of other vehicles, shape ``(n, agents, agents)``."""
    reach = waits.copy()
    for via in np.flatnonzero(reach.any(axis=(0, 1)) & reach.any(axis=(0, 2))).tolist():
        reach |= reach[:, :, via, None] & reach[:, via, None, :]
    return reach


def _courtesies(cast: Cast) -> NDArray[np.bool_]:
    """Return for which pairs of vehicles at an all-way stop the ways do not meet, shape ``(agents, agents)``."""
    both, apart = cast.static(partners), np.zeros((len(cast), len(cast)), dtype=np.bool_)
    if cast.junction.control is JunctionControl.STOP:
        apart[both.one, both.two] = np.isnan(cast.static(_places).begin)
    return apart
