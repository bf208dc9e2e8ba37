"""Who waits for whom, and where that goes round in a circle.

Only vehicles that are near the junction together, or close behind each other, can have a reason to wait for each other; each pair
is looked at while that lasts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.grounds import may_owe
from pytest_rvads.conduct.presence import near, window
from pytest_rvads.conduct.rights import GAP, PACE, close_behind, comes_first, due, yields
from pytest_rvads.conduct.stretches import ALWAYS, on_stretch, position, shared
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.conflicts import Shared
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

__all__ = ["Reason", "at_line", "circles", "reasons"]

AT_LINE = 5.0
"""Nearer to the stopping line than this, a vehicle that stands waits for the light or for its turn [m]."""
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
        queued = close_behind(run, agent, other, common, when)
        yielding = _lets_pass(run, agent, other, common, when) | queued & _cut_off(run, agent, other, when)
        if queued.any() or yielding.any():
            yield Reason(agent, other, when.start, queued, yielding)


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
            found[np.ix_(here, here)] |= (apart <= GAP + lengths[here]) & same[np.ix_(here, here)]
    return found


def circles(run: Run, found: Sequence[Reason]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return who waits for anybody, and who lets anybody pass, that does not wait for it as well, each ``(steps, agents)``.

    Whoever came in on red is in the way of those who did not, whatever they do to each other.
    """
    held = np.zeros((run.steps, len(run.agents)), dtype=np.bool_)
    gives_way = np.zeros_like(held)
    red = (run.zone >= Zone.JUNCTION) & (run.facing == Colour.RED)
    moments = _changes(run, found, red)
    for first in range(0, len(moments), _CHUNK):
        now = moments[first : first + _CHUNK]
        until = int(moments[first + _CHUNK]) if first + _CHUNK < len(moments) else run.steps
        some = [r for r in found if r.begin < until and r.begin + len(r.queued) > now[0]]
        who = sorted({k for r in some for k in (r.agent, r.other)})
        place = {column: number for number, column in enumerate(who)}
        queued = np.zeros((len(who), len(who), len(now)), dtype=np.bool_)
        yielding = np.zeros_like(queued)
        for r in some:
            at = now - r.begin
            inside = (at >= 0) & (at < len(r.queued))
            one, two = place[r.agent], place[r.other]
            queued[one, two, inside], yielding[one, two, inside] = r.queued[at[inside]], r.yielding[at[inside]]
        waits = queued | yielding
        reach = waits.copy()
        for via in range(len(who)):
            reach |= reach[:, via, None] & reach[None, via, :]
        late = red[now][:, who].T
        one_way = ~(reach & reach.swapaxes(0, 1)) | (late[None] & ~late[:, None])
        lasts = np.diff(now, append=until)
        for target, of in ((held, waits), (gives_way, yielding)):
            target[now[0] : until, who] = np.repeat(np.any(of & one_way, axis=1).T, lasts, axis=0)
    return held, gives_way


def _changes(run: Run, found: Sequence[Reason], red: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the ticks, increasing from 0 on, in which it changes who waits for whom or who came in on red."""
    changed = np.zeros(run.steps + 1, dtype=np.bool_)
    changed[0] = True
    changed[1:-1] = (red[1:] != red[:-1]).any(axis=1)
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


def _cut_off(run: Run, agent: int, other: int, when: slice) -> NDArray[np.bool_]:
    """Whether the agent was in the junction before the other one, which then is ahead because it pushed in."""
    found: NDArray[np.bool_] = (run.zone[when, agent] >= Zone.JUNCTION) & (run.entered[other] > run.entered[agent])
    return found


def _lets_pass(run: Run, agent: int, other: int, common: Shared | None, when: slice) -> NDArray[np.bool_]:
    """Whether the agent has reason to let the other one pass."""
    zone, theirs = run.zone[when, agent], run.zone[when, other]
    before = at_line(run, agent, when)
    found = np.zeros(len(zone), dtype=np.bool_)
    if run.junction.control is JunctionControl.STOP:
        found |= before & (theirs == Zone.JUNCTION)
        found |= comes_first(run, agent, other, when)
    if common is None:
        return found
    front = position(run, agent, when)[0]
    ahead = front < common.mine.start
    there = on_stretch(run, other, common.yours, when)
    found |= there & (ahead | on_stretch(run, agent, common.mine, when))
    gives = yields(run, other, agent, when) if may_owe(run, other, agent) else np.zeros_like(found)
    found |= ahead & (theirs == Zone.JUNCTION) & (position(run, other, when)[0] < common.yours.start) & ~gives
    comes = due(run, other, common.yours, when, waiving=True)
    found |= before & comes & (run.need("speed")[when, other] > PACE)
    if may_owe(run, agent, other):
        found |= ahead & yields(run, agent, other, when) & comes
    found &= before | (zone == Zone.JUNCTION)
    return found
