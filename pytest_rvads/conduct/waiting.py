"""Who waits for whom, and where that goes round in a circle.

Only vehicles that are near the junction together, or close behind each other, can have a reason to wait for each other; each pair
is looked at while that lasts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.grounds import ground_of, may_owe
from pytest_rvads.conduct.memo import once
from pytest_rvads.conduct.motion import entered, facing
from pytest_rvads.conduct.presence import near, window
from pytest_rvads.conduct.rights import DUE, PACE, came_first, close_behind, due, first_at_line, has_way, waives, yields
from pytest_rvads.conduct.stretches import ALWAYS, ahead_by, on_stretch, position, shared
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.conflicts import Key, Shared
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import JunctionControl, Sign
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["QUEUE_GAP", "Reason", "circles", "leave_no_room", "no_room", "reasons", "since"]

AT_LINE = 5.0
"""Nearer to the stopping line than this, a vehicle that stands waits for its turn [m]."""
QUEUE_GAP = 15.0
"""Nearer than this to the stopping line, or to the vehicle ahead, a vehicle belongs to the queue that waits there [m]: about
three lengths of a car."""
SPARE = 1.0
"""A vehicle must not enter the junction where less room than its length and this is left on its exit road [m]."""
MOST = 200_000_000
"""States times pairs of vehicles that are looked at."""
_BLOCK = 50
"""Ticks that are looked at together to find out who is never close behind whom."""
_CHUNK = 256
"""Instants at which circles are looked for together."""


class Reason(NamedTuple):
    """Why one vehicle waits for another, in part of a run."""

    agent: int
    other: int
    begin: int
    """First tick of the part."""
    queued: NDArray[np.bool_]
    """Where it is close behind the other one, which is slow, shape ``(ticks,)``."""
    yielding: NDArray[np.bool_]
    """Where it lets the other one pass, likewise."""
    trailing: NDArray[np.bool_]
    """Where it is before the junction and less than `QUEUE_GAP` behind the other one, likewise."""


def reasons(run: Run) -> Iterator[Reason]:
    """Yield who waits for whom, and when; pairs that never wait are left out.

    Raises:
        RunError: the run holds no positions or no geometry, or too many vehicles that are there together.
    """
    work = 0
    for agent, other, when in _pairs(run):
        work += when.stop - when.start
        if work > MOST:
            count = len(run.agents)
            raise RunError(
                f"{count} vehicles in {run.steps:,} states are too many to tell who waits for whom: cut the run in parts"
            )
        common = shared(run, agent, other)
        ahead = ahead_by(run, agent, other)[when]
        queued = close_behind(run, agent, other)[when]
        yielding = _lets_pass(run, agent, other, common, when)
        trailing = (run.zone[when, agent] <= Zone.ENTRANCE) & (ahead < QUEUE_GAP)
        if queued.any() or yielding.any() or trailing.any():
            yield Reason(agent, other, when.start, queued, yielding, trailing)


def _pairs(run: Run) -> Iterator[tuple[int, int, slice]]:
    """Yield pairs of agents of which one may wait for the other, and when: all, all the time, where nobody is absent."""
    pairs = permutations(range(len(run.agents)), 2)
    if not (run.zone == Zone.ABSENT).any():
        yield from ((one, two, slice(0, run.steps)) for one, two in pairs)
        return
    spans, queues = near(run).tolist(), _queues(run)
    for one, two in pairs:
        begin, end = max(spans[one][0], spans[two][0]), min(spans[one][1], spans[two][1])
        if queues[one, two]:
            begin, end = window(run, (one, two))
        elif run.agents[one].exit == run.agents[two].exit:  # one waits for room, wherever the other one is on its exit road
            end = min(spans[one][1], window(run, (two,))[1])
        if begin < end:
            yield one, two, slice(begin, end)


def _queues(run: Run) -> NDArray[np.bool_]:
    """Return who may ever be close behind whom on a road that both drive along, shape ``(agents, agents)``."""
    count, steps = len(run.agents), run.steps
    lengths = np.array([run.size(k)[0] for k in range(count)])
    found = np.zeros((count, count), dtype=np.bool_)
    for ends, offsets in (
        ([a.entrance for a in run.agents], np.zeros(count)),
        ([a.exit for a in run.agents], np.array([a.route.length for a in run.agents])),
    ):
        same = np.equal.outer(ends, ends)
        for start in range(0, steps, _BLOCK):
            here = np.flatnonzero(run.here[start : start + _BLOCK].any(axis=0))
            block = run.need("station")[start : start + _BLOCK, here] - offsets[here]
            low, high = np.fmin.reduce(block, axis=0), np.fmax.reduce(block, axis=0)
            apart = np.maximum(low[:, None] - high, low - high[:, None])
            found[np.ix_(here, here)] |= (apart <= QUEUE_GAP + lengths[here]) & same[np.ix_(here, here)]
    return found


def circles(run: Run, found: Sequence[Reason]) -> tuple[NDArray[np.bool_], ...]:
    """Return which vehicles are held, which wait in a circle, and which are stuck, each of shape ``(steps, agents)``.

    A held vehicle waits, by itself or by way of others, for a vehicle that does not wait for it. In a circle vehicles wait for
    each other, and for nobody else. A stuck vehicle lets nobody pass, and is close behind a vehicle that left it no room when it
    entered. A vehicle that waits for an intruder, see `_intruders`, is held by the intruder, even where both wait for each other.
    """
    result = tuple(np.zeros((run.steps, len(run.agents)), dtype=np.bool_) for _ in range(3))
    intruders = _intruders(run, found)
    moments = _changes(run, found, intruders)
    for first in range(0, len(moments), _CHUNK):
        now = moments[first : first + _CHUNK]
        until = int(moments[first + _CHUNK]) if first + _CHUNK < len(moments) else run.steps
        some = [r for r in found if r.begin < until and r.begin + len(r.queued) > now[0]]
        who = sorted({k for r in some for k in (r.agent, r.other)})
        place = {column: number for number, column in enumerate(who)}
        queued = np.zeros((len(who), len(who), len(now)), dtype=np.bool_)
        yielding, blocked = np.zeros_like(queued), np.zeros_like(queued)
        for r in some:
            at = now - r.begin
            inside = (at >= 0) & (at < len(r.queued))
            one, two = place[r.agent], place[r.other]
            queued[one, two, inside], yielding[one, two, inside] = r.queued[at[inside]], r.yielding[at[inside]]
            blocked[one, two] = queued[one, two] & (r.other in once(run, no_room)[r.agent])
        waits = queued | yielding
        reach = waits.copy()
        for via in range(len(who)):
            reach |= reach[:, via, None] & reach[None, via, :]
        late = intruders[now][:, who].T
        one_way = ~(reach & reach.swapaxes(0, 1)) | (late[None] & ~late[:, None])
        lasts = np.diff(now, append=until)
        held, giving, behind = (np.any(of & one_way, axis=1).T for of in (reach, yielding, blocked))
        circling = np.any(reach, axis=1).T & ~held
        for target, value in zip(result, (held, circling, behind & ~giving), strict=True):
            target[now[0] : until, who] = np.repeat(value, lasts, axis=0)
    return result


def _intruders(run: Run, found: Sequence[Reason]) -> NDArray[np.bool_]:
    """Return which vehicles are intruders, shape ``(steps, agents)``.

    An intruder entered on red, or entered the way of a vehicle that was inside before and to which the intruder owed the way.
    """
    intruders: NDArray[np.bool_] = (run.zone >= Zone.JUNCTION) & (facing(run) == Colour.RED)
    entries = entered(run).min(axis=0)
    for r in found:
        if entries[r.agent] < entries[r.other] and may_owe(run, r.other, r.agent):
            when = slice(r.begin, r.begin + len(r.yielding))
            inside = run.zone[when, r.other] == Zone.JUNCTION
            intruders[when, r.other] |= inside & r.yielding & yields(run, r.other, r.agent)[when]
    return intruders


def _changes(run: Run, found: Sequence[Reason], intruders: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the ticks, increasing from 0 on, in which it changes who waits for whom or who is an intruder."""
    changed = np.zeros(run.steps + 1, dtype=np.bool_)
    changed[0] = True
    changed[1:-1] = (intruders[1:] != intruders[:-1]).any(axis=1)
    for r in found:
        changed[[r.begin, r.begin + len(r.queued)]] = True
        changed[r.begin + 1 : r.begin + len(r.queued)] |= np.diff(r.queued) | np.diff(r.yielding)
    return np.flatnonzero(changed[: run.steps])


def at_line(run: Run, agent: int, when: slice = ALWAYS) -> NDArray[np.bool_]:
    """Return where the agent is before the junction and so near to its line that it may wait there, shape ``(steps,)``."""
    line = -run.junction.setbacks[run.agents[agent].entrance]
    zone, station = run.zone[when, agent], run.need("station")[when, agent]
    found: NDArray[np.bool_] = (zone <= Zone.ENTRANCE) & (station > line - AT_LINE)
    return found


def no_room(run: Run) -> tuple[frozenset[int], ...]:
    """Return for every vehicle the columns of the vehicles that left it no room when it entered, see `leave_no_room`."""
    entries = enumerate(run.entered.tolist())
    return tuple(leave_no_room(run, agent, tick) if tick < run.steps else frozenset() for agent, tick in entries)


def leave_no_room(run: Run, agent: int, tick: int) -> frozenset[int]:
    """Return the columns of the vehicles that leave an agent no room to enter the junction in a state.

    Such a vehicle stands or creeps ahead on the agent's way or exit road. Or it moves on, to that exit road or along it, and its
    rear leaves less room there than the agent's length and `SPARE`.
    """
    me, found = run.agents[agent], set()
    for other, you in enumerate(run.agents):
        if other != agent and run.here[tick, other]:
            ahead = float(ahead_by(run, agent, other)[tick])
            room = run.need("station")[tick, agent] + ahead - me.route.length
            rolling = me.exit == you.exit and room < run.size(agent)[0] + SPARE
            if ahead < math.inf and (rolling or run.need("speed")[tick, other] < PACE):
                found.add(other)
    return frozenset(found)


def _lets_pass(run: Run, agent: int, other: int, common: Shared | None, when: slice) -> NDArray[np.bool_]:
    """Whether the agent has reason to let the other one pass."""
    zone, theirs = run.zone[when, agent], run.zone[when, other]
    before = at_line(run, agent, when)
    if run.junction.control is JunctionControl.STOP:
        first = came_first(run, agent, other)[when]
        if common is None and first.any():
            first &= ~waives(run)[when, other]
        found: NDArray[np.bool_] = before & (theirs == Zone.JUNCTION) | first
    else:
        found = before & _may_turn(run, agent, other, when)
    if common is None:
        return found
    front = position(run, agent, when)[0]
    ahead = front < common.mine.start
    there = on_stretch(run, other, common.yours, when)
    found |= there & (ahead | on_stretch(run, agent, common.mine, when))
    gives = yields(run, other, agent)[when] if may_owe(run, other, agent) else np.zeros_like(found)
    found |= ahead & (theirs == Zone.JUNCTION) & (position(run, other, when)[0] < common.yours.start) & ~gives
    comes = due(run, other, common.yours, when)
    found |= before & comes & (run.need("speed")[when, other] > PACE)
    if may_owe(run, agent, other):
        found |= ahead & yields(run, agent, other)[when] & (comes | first_at_line(run)[when, other])
    found &= before | (zone == Zone.JUNCTION)
    return found


def _may_turn(run: Run, agent: int, other: int, when: slice) -> NDArray[np.bool_]:
    """Whether the other one has priority over the agent by a sign, comes within `DUE` and could still turn onto its way."""
    start = _first_turn(run.junction, run.agents[agent].route.key, run.agents[other].entrance)
    reach = run.need("station")[when, other] + DUE * np.maximum(run.need("speed")[when, other], 0.0)
    found: NDArray[np.bool_] = (reach >= start) & (run.zone[when, other] <= Zone.ENTRANCE) & run.here[when, other]
    return found & has_way(run)[when, other]


@lru_cache(maxsize=4096)
def _first_turn(junction: Junction, way: Key, entrance: int) -> float:
    """Return where a vehicle from an entrance first gets onto a way, on movements to which that way gives way by its sign [m]."""
    if junction.stretches is None or junction.entrances[way[0]].sign not in (Sign.STOP, Sign.YIELD):
        return math.inf
    turns = [key for key in junction.movements if key[0] == entrance and ground_of(junction, way, key) is not None]
    return min((junction.stretches[way, key].yours.start for key in turns), default=math.inf)


def since(amounts: NDArray[Any], restarts: NDArray[np.bool_], before: Any = 0.0) -> NDArray[np.float64]:
    """Return the sums of amounts since the last state in which they began anew; states along the first axis.

    Args:
        amounts: of every state, not negative.
        restarts: where a sum begins anew, with the amount of that state.
        before: the sum before the first state.
    """
    total = np.cumsum(np.concatenate((np.reshape(before, (1, *amounts.shape[1:])), amounts)), axis=0)
    gone = np.maximum.accumulate(np.where(restarts, total[:-1], 0.0), axis=0)
    # Rounded, so that three hundred steps at rest are three seconds, whatever went before.
    return np.round(total[1:] - gone, 9)
