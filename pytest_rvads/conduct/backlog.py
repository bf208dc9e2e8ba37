"""Time lost, followed instant by instant, and worked out only when it may have become too much.

Who waits for whom takes a look at all pairs of vehicles. A vehicle loses at most the time that goes by while it is slow: as long
as that is less than anybody's patience, nothing has happened yet, and the instants are kept. Then they are worked out at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.instant import Instant
from pytest_rvads.conduct.mover import Mover
from pytest_rvads.conduct.progress import BLOCKING_TIME, PATIENCE, blocking_time, lost_time, may_go
from pytest_rvads.conduct.rights import DUE, GAP, PACE
from pytest_rvads.conduct.waiting import AT_LINE
from pytest_rvads.runs.itineraries import LEAVE
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, APPROACH, ENTRANCE, EXIT, Colour

__all__ = ["Backlog"]

_MOST = 2000
"""Instants that are kept."""
_ROUNDING = 1e-8
"""Sums of times in another order differ by less [s]."""
_IDLE, _BLOCKED = PATIENCE - _ROUNDING, BLOCKING_TIME - _ROUNDING
_RED = (int(Colour.YELLOW), int(Colour.RED))


class _Loss:
    """What a vehicle has lost [s]."""

    __slots__ = ("blocked", "idle", "may_block", "may_idle", "part", "settled_part")

    def __init__(self) -> None:
        self.idle = self.blocked = 0.0
        self.may_idle = self.may_block = 0.0
        self.part = self.settled_part = -1


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
        self._free: NDArray[np.bool_] | None = None

    def add(self) -> bool:
        """Read an instant, and return whether somebody may have lost too much by now."""
        now, losses = self._now, self._losses
        slots = now.slots
        if len(self._rows) >= _MOST or any(mover is not slot for mover, slot in zip(self._columns, slots, strict=False)):
            self.settle()
        self._columns = list(slots)
        self._free = None
        self._lights.append(now.lights)
        self._rows.append(
            (
                [m.zone for m in slots],
                [m.station for m in slots],
                [m.speed for m in slots],
                [m.wt for m in slots],
                [m.facing for m in slots],
                [m.advance for m in slots],
            )
        )
        much = False
        for mover in now.movers:
            loss = losses.get(mover)
            if loss is None:
                loss = losses[mover] = _Loss()
            zone = mover.zone
            part = ENTRANCE if zone < ENTRANCE else EXIT if zone > EXIT else zone
            if part != loss.part:
                loss.part, loss.idle, loss.may_idle = part, 0.0, 0.0
            if mover.advance < PACE and mover.here and not self._excused(mover):
                loss.may_idle += (1.0 - max(mover.advance, 0.0) / PACE) * now.dt
            if abs(mover.speed) < PACE and now.inside(mover):
                loss.may_block += (1.0 - abs(mover.speed) / PACE) * now.dt
            if loss.may_idle > _IDLE or loss.may_block > _BLOCKED:
                much = True
        return much

    def _excused(self, mover: Mover) -> bool:
        """Return whether a vehicle surely may not go, or has arrived."""
        if mover.zone > ENTRANCE:
            return mover.station - mover.agent.route.length >= LEAVE
        if mover.facing in _RED and mover.station > mover.line - AT_LINE:
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
        if loss.idle <= PATIENCE < loss.may_idle + _ROUNDING:
            self.settle()
        return loss.idle > PATIENCE

    def blocks(self, mover: Mover) -> bool:
        """`progress.blocks`."""
        loss = self._losses.get(mover)
        if loss is None:
            return False
        if loss.blocked <= BLOCKING_TIME < loss.may_block + _ROUNDING:
            self.settle()
        return loss.blocked > BLOCKING_TIME

    def may_go(self, mover: Mover) -> bool:
        """`progress.may_go`."""
        if self._free is None:
            run = self._now.run
            self._free = np.array([may_go(run, slot)[0] for slot in range(len(run.agents))])
        return bool(self._free[mover.slot])

    def settle(self) -> None:
        """Work out what the instants so far have cost everybody."""
        if not self._rows:
            return
        zones = self._table(0, ABSENT)
        there = np.flatnonzero((zones != ABSENT).any(axis=0)).tolist()
        run = self._as_run(zones, there)
        lost = lost_time(run)
        for column, slot in enumerate(there):
            loss = self._losses.get(self._columns[slot])
            if loss is None:
                continue
            parts = np.clip(run.zone[:, column], ENTRANCE, EXIT)
            changes = np.flatnonzero(np.diff(parts)) + 1
            begin = int(changes[-1]) if len(changes) else 0
            kept = loss.idle if not begin and int(parts[0]) == loss.settled_part else 0.0
            loss.idle = loss.may_idle = _total(kept, lost[begin:, column])
            loss.settled_part = int(parts[-1])
            loss.blocked = loss.may_block = _total(loss.blocked, blocking_time(run, column))
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
        station, speed, wt, facing, advance = (self._table(k, fill)[:, slots] for k, fill in _ABSENT)
        agents = tuple(mover.agent for mover in movers)
        run = Run("live", now.junction, agents, zone, lights, now.dt, station=station, speed=speed)
        known = run.__dict__
        known["wt"], known["facing"], known["advance"] = wt.astype(np.int32), facing.astype(np.int8), advance
        known["entered"] = np.array([mover.entered for mover in movers], dtype=np.int64)
        return run


_ABSENT = ((1, np.nan), (2, np.nan), (3, 0), (4, 0), (5, np.nan))
"""Which numbers of a vehicle are kept beside its zone, and what they are as long as it is absent."""


def _total(before: float, losses: NDArray[np.float64]) -> float:
    """Return a sum, added up in the order of time."""
    return float(np.cumsum(np.concatenate(([before], losses)))[-1])
