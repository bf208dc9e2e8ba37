"""Time lost, followed instant by instant, and worked out only when it may have become too much.

Who waits for whom takes a look at all pairs of vehicles. A vehicle loses at most the time that goes by while it is slow: as long
as that is less than anybody's patience, nothing has happened yet, and the instants are kept. Then they are worked out at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.blocks import as_blocks, assume
from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.memo import given
from pytest_rvads.conduct.motion import advance, entered, facing, inside, wt
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.conduct.progress import BLOCKING_TIME, CRAWL, NOTHING, PATIENCE, STUCK_TIME, Lost, losses, may_go
from pytest_rvads.conduct.rights import DUE, GAP, PACE, waives
from pytest_rvads.conduct.standing import Arrivals, arrivals
from pytest_rvads.conduct.waiting import QUEUE_GAP, leave_no_room, no_room
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, APPROACH, ENTRANCE, JUNCTION, Colour

__all__ = ["Backlog"]

_MOST = 2000
"""Instants that are kept."""
_ROUNDING = 1e-8
"""Sums of times in another order differ by less [s]."""
_IDLE, _BLOCKED, _STUCK = PATIENCE - _ROUNDING, BLOCKING_TIME - _ROUNDING, STUCK_TIME - _ROUNDING
_RED = (int(Colour.YELLOW), int(Colour.RED))


@dataclass(slots=True)
class _Loss:
    """What a vehicle has lost, and what it may have lost at most by now [s]."""

    settled: Lost = NOTHING
    """What it had lost before the instants that are kept."""
    may_idle: float = 0.0
    may_block: float = 0.0
    may_be_stuck: float = 0.0
    no_room: frozenset[Mover] | None = None
    """Which vehicles left it no room when it entered; None before."""
    free: bool = False
    """See `progress.may_go`."""


class Backlog:
    """Instants that nobody has worked out yet.

    Args:
        now: the instant, which goes on.
    """

    def __init__(self, now: Instant) -> None:
        self._now = now
        self._losses: dict[Mover, _Loss] = {}
        self._columns: list[Mover] = []
        self._rows: list[tuple[list[float], ...]] = []
        self._lights: list[list[int]] = []

    def add(self) -> bool:
        """Read an instant, and return whether somebody may have lost too much by now."""
        now, slots = self._now, self._now.slots
        if len(self._rows) >= _MOST or any(mover is not slot for mover, slot in zip(self._columns, slots, strict=False)):
            self.settle()
        self._columns = list(slots)
        pace = advance(now.block)[0].tolist()
        self._lights.append(now.lights)
        self._rows.append(
            (
                [m.zone for m in slots],
                [m.station for m in slots],
                [m.speed for m in slots],
                [m.wt for m in slots],
                [m.facing for m in slots],
                pace,
                [m.arrived for m in slots],
                [m.arrived_at - now.tick for m in slots],
                waives(now.block)[0].tolist(),
            )
        )
        within = inside(now.block)[0].tolist()
        much = False
        for mover in now.movers:
            loss = self._losses.get(mover)
            if loss is None:
                loss = self._losses[mover] = _Loss()
            if loss.no_room is None and mover.zone >= JUNCTION:
                loss.no_room = frozenset(slots[column] for column in leave_no_room(now.run, mover.slot, 0))
            if pace[mover.slot] < PACE and mover.here and not self._excused(mover):
                loss.may_idle += (1.0 - max(pace[mover.slot], 0.0) / PACE) * now.dt
            if abs(mover.speed) <= CRAWL and within[mover.slot]:
                loss.may_block += (1.0 - abs(mover.speed) / PACE) * now.dt
                loss.may_be_stuck += now.dt
            else:
                loss.may_be_stuck = 0.0
            if loss.may_idle > _IDLE or loss.may_block > _BLOCKED or loss.may_be_stuck > _STUCK:
                much = True
        return much

    def _excused(self, mover: Mover) -> bool:
        """Return whether a vehicle surely may not go, or has arrived."""
        if mover.zone > ENTRANCE:
            return mover.station - mover.agent.route.length >= LEAVE
        if mover.facing in _RED and mover.station > mover.line - QUEUE_GAP:
            return True
        return mover.zone == APPROACH and self._queues(mover)

    def _queues(self, mover: Mover) -> bool:
        """Return whether a vehicle waits behind another one, which surely does not wait for it.

        Who is on its approach, and would not be at the junction within `DUE`, is waited for by nobody but who is behind it in its
        lane. Where that is said of the vehicle and of all behind it, nobody ahead of it waits for it, not even by way of others.
        """
        front = mover.station
        waits = False
        for other in self._now.movers:
            if other.entrance != mover.entrance:
                continue
            if other.station <= front:
                if other.zone != APPROACH or other.station + DUE * max(other.speed, 0.0) >= 0.0:
                    return False
            elif other.speed < PACE and other.zone <= ENTRANCE and other.station - other.length - front < GAP:
                waits = True
        return waits

    def drop(self, mover: Mover) -> None:
        """Forget a vehicle that has vanished."""
        self._losses.pop(mover, None)

    def idles(self, mover: Mover) -> bool:
        """`progress.idles`."""
        loss = self._losses.get(mover)
        if loss is None or mover.zone == ABSENT:
            return False
        if loss.may_idle > _IDLE:
            self.settle()
        return bool(max(loss.settled.idle, loss.settled.circle) > PATIENCE)

    def blocks(self, mover: Mover) -> bool:
        """`progress.blocks`."""
        loss = self._losses.get(mover)
        if loss is None:
            return False
        if loss.settled.blocked <= BLOCKING_TIME and (loss.may_block > _BLOCKED or loss.may_be_stuck > _STUCK):
            self.settle()
        stuck = loss.may_be_stuck > _STUCK and loss.settled.stuck > STUCK_TIME
        return bool(loss.settled.blocked > BLOCKING_TIME or stuck)

    def may_go(self, mover: Mover) -> bool:
        """`progress.may_go`."""
        self.settle()
        loss = self._losses.get(mover)
        return loss is not None and mover.zone != ABSENT and loss.free

    def settle(self) -> None:
        """Work out what the instants so far have cost everybody."""
        if not self._rows:
            return
        zones = self._table(0, ABSENT)
        there = np.flatnonzero((zones != ABSENT).any(axis=0)).tolist()
        run = self._as_run(zones, there)
        for column, slot in enumerate(there):
            loss = self._losses.get(self._columns[slot])
            if loss is None:
                continue
            settled = loss.settled = Lost(*(times[-1].item() for times in losses(run, column, loss.settled)))
            loss.may_idle, loss.may_block, loss.may_be_stuck = max(settled.idle, settled.circle), settled.blocked, settled.stuck
            loss.free = bool(may_go(run, column)[-1])
        self._rows.clear()
        self._lights.clear()

    def _table(self, item: int, absent: float) -> NDArray[np.float64]:
        """Return one number of every vehicle in every instant, by column; vehicles that came meanwhile are absent before."""
        count = len(self._columns)
        return np.array([row[item] + [absent] * (count - len(row[item])) for row in self._rows])

    def _as_run(self, zones: NDArray[np.float64], slots: list[int]) -> Run:
        """Return the instants as a run of the vehicles in some columns."""
        now, movers = self._now, [self._columns[slot] for slot in slots]
        zone, lights = zones[:, slots].astype(np.int8), np.array(self._lights, dtype=np.int8)
        station, speed, waiting, faced, pace, arrived, since, waiving = (self._table(k, fill)[:, slots] for k, fill in _ABSENT)
        agents = tuple(mover.agent for mover in movers)
        run = Run("live", now.junction, agents, zone, lights, now.dt, station=station, speed=speed)
        (block,) = as_blocks(run, run.steps)
        block.values[wt], block.values[facing] = waiting.astype(np.int32), faced.astype(np.int8)
        block.values[advance] = pace
        block.values[entered] = np.array([[mover.entered for mover in movers]], dtype=np.int64)
        block.values[arrivals] = Arrivals(arrived.astype(np.bool_), np.arange(len(since))[:, None] + since.astype(np.int64))
        block.values[waives] = waiving.astype(np.bool_)
        assume(run, block)
        column = {mover: number for number, mover in enumerate(movers)}
        those = [self._losses.get(mover) or _Loss() for mover in movers]
        left = (loss.no_room or () for loss in those)
        given(run, no_room, tuple(frozenset(column[other] for other in others if other in column) for others in left))
        return run


_ABSENT = ((1, np.nan), (2, np.nan), (3, 0), (4, 0), (5, np.nan), (6, 0), (7, 0), (8, 0))
"""Which numbers of a vehicle are kept beside its zone, and what they are as long as it is absent."""
