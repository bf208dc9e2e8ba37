"""One instant of traffic in plain numbers: what the words of rules ask of a few vehicles, a hundred times a second.

On a run the same is said of all its states at once, in `standing`, `rights`, `priority` and `stretches`; for one state
of ten vehicles numpy takes longer to be called than to compute. The comparisons are the same ones, on the same numbers, so both
say the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.blocks import Block, Stream, as_block
from pytest_rvads.conduct.memo import given
from pytest_rvads.conduct.motion import NEVER, advance, entered, facing, wt
from pytest_rvads.conduct.mover import Mover, Pair
from pytest_rvads.conduct.priority import HEADWAY
from pytest_rvads.conduct.rights import DUE, GAP, PACE, ROOM, WAIVER
from pytest_rvads.conduct.standing import STANDSTILL, TIE, arrivals, arrived, stopped
from pytest_rvads.junctions.conflicts import Stretch
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import ABSENT, ENTRANCE, EXIT, JUNCTION, Agent, Colour

__all__ = ["Instant"]

_CARRIED, _MOVING = (wt, entered, facing, arrivals), (advance, stopped)
"""Signals with a carry: those that need zones and lights only, and those that need stations and speeds."""
_GREEN, _YELLOW, _RED = int(Colour.GREEN), int(Colour.YELLOW), int(Colour.RED)


class _State(Run):
    """A run of one state, which knows the states before by the block that is given for it."""

    @cached_property
    def wt(self) -> NDArray[np.int32]:
        found: NDArray[np.int32] = wt(self)
        return found

    @cached_property
    def entered(self) -> NDArray[np.int64]:
        found: NDArray[np.int64] = entered(self)[0]
        return found

    @cached_property
    def facing(self) -> NDArray[np.int8]:
        found: NDArray[np.int8] = facing(self)
        return found

    @cached_property
    def advance(self) -> NDArray[np.float64]:
        found: NDArray[np.float64] = advance(self)
        return found


class Instant:
    """The vehicles at a junction, one instant after the other.

    Args:
        junction: where they drive.
        dt: time between two instants [s].
        facts: the speed limit.
    """

    def __init__(self, junction: Junction, dt: float, facts: Facts) -> None:
        self.junction, self.dt, self.facts = junction, dt, facts
        self.tick = -1
        self.slots: list[Mover] = []
        self.movers: list[Mover] = []
        """Those that are not absent."""
        self.lights: list[int] = [0] * len(junction.entrances)
        self.located = self.timed = self.posed = True
        """Whether stations, speeds and poses are given."""
        self.touching: frozenset[frozenset[str]] | None = None
        """Names of those that touch for the first time now, where somebody recorded it."""
        self._pairs: dict[tuple[Mover, Mover], Pair] = {}
        self._run: Run | None = None
        self._all_way = junction.control is JunctionControl.STOP
        self._stream = Stream(junction, dt, facts)
        self._cast: list[Mover] = []
        self.block = Block(self._stream.cast, np.empty((1, 0), dtype=np.int8), np.array([self.lights], dtype=np.int8))
        """The state."""
        self._tie, self._waiver = round(TIE / dt), round(WAIVER / dt)

    def _feed(
        self,
        zones: Sequence[int],
        stations: Sequence[float] | None,
        speeds: Sequence[float] | None,
        poses: Sequence[Sequence[float]] | None,
        lights: Sequence[int],
    ) -> Block:
        """Return the state as a block."""
        if self._cast != self.slots:
            columns = {mover: column for column, mover in enumerate(self._cast)}
            self._stream.recast([mover.agent for mover in self.slots], [columns.get(mover) for mover in self.slots])
            self._cast = list(self.slots)
        station, speed, pose = (None if values is None else np.array([values]) for values in (stations, speeds, poses))
        signals = _CARRIED if station is None or speed is None else (*_CARRIED, *_MOVING)
        touching = None if self.touching is None else [(pair, 0) for pair in self.touching]
        state = np.array([zones], dtype=np.int8), np.array([lights], dtype=np.int8)
        return self._stream.feed(signals, *state, station=station, speed=speed, pose=pose, touching=touching)

    def add(self, agent: Agent, slot: int) -> Mover:
        """Return a vehicle that appears in the next instant, in a column of its own or one that has become free."""
        mover = Mover(agent, slot, self.junction, self.dt)
        if self.tick >= 0:  # it was not there before
            mover.speeds.extend([math.nan] * (mover.speeds.maxlen or 0))
        self.slots[slot : slot + 1] = [mover]
        return mover

    def drop(self, mover: Mover) -> None:
        """Forget what was kept about a vehicle that has vanished."""
        for key in [key for key in self._pairs if mover in key]:
            del self._pairs[key]

    def move(
        self,
        zones: Sequence[int],
        stations: Sequence[float] | None,
        speeds: Sequence[float] | None,
        poses: Sequence[Sequence[float]] | None,
        lights: Sequence[int],
    ) -> list[Mover]:
        """Go on to the next instant, and return whose zone is another one now; arguments are by column."""
        self.tick += 1
        self._run = None
        self.block = self._feed(zones, stations, speeds, poses, lights)
        self.lights = list(lights)
        self.located, self.timed, self.posed = stations is not None, speeds is not None, poses is not None
        changed = [mover for mover, zone in zip(self.slots, zones, strict=True) if self._zone(mover, zone)]
        self.movers = [mover for mover in self.slots if mover.zone != ABSENT]
        waiting, faced, found = (values[0].tolist() for values in (wt(self.block), facing(self.block), arrived(self.block)))
        since = arrivals(self.block).tick[0].tolist()
        pace = advance(self.block)[0].tolist() if self.located and self.timed else [math.nan] * len(self.slots)
        for mover in self.slots:
            slot = mover.slot
            mover.wt, mover.facing, mover.arrived, mover.arrived_at = waiting[slot], faced[slot], found[slot], since[slot]
        for mover in self.movers:
            slot = mover.slot
            mover.advance = pace[slot]
            if stations is not None:
                mover.station = stations[slot]
            if speeds is not None:
                mover.speed = speed = speeds[slot]
                mover.speeds.append(speed)
        if self.located and self.timed and self.junction.stretches is not None:
            self._wait(changed)
        return changed

    def _wait(self, changed: Sequence[Mover]) -> None:
        """Work out which vehicles are next to go, and for how long they have stood so."""
        for mover in changed:
            if mover.entered == self.tick:
                mover.slow_at_entry = frozenset(o for o in self.movers if o.speed <= PACE)
        for mover in self.movers:
            may_go = mover.arrived and (not mover.lit or mover.facing == _GREEN) and self.leads(mover)
            mover.next_to_go = may_go and not self._held(mover)
            if mover.next_to_go and abs(mover.speed) <= STANDSTILL:
                kept = any(self._keeps(mover, other) for other in self.movers if other is not mover)
                mover.ready, mover.last_ready = mover.ready + 1, self.tick
                mover.free = 0 if kept else mover.free + 1
            else:
                mover.ready = mover.free = 0

    def _zone(self, mover: Mover, zone: int) -> bool:
        """Take over the zone of a vehicle, and return whether it is another one."""
        tick = self.tick
        changed = zone != mover.zone
        if changed:
            mover.zone = zone
            if zone >= JUNCTION and mover.entered == NEVER:
                mover.entered = tick
            if zone == ABSENT:
                mover.station = mover.speed = mover.advance = math.nan
        return changed

    @property
    def run(self) -> Run:
        """A run of this state alone, that knows what it takes over from those before."""
        if self._run is None:
            self._run = self._as_run()
        return self._run

    def _as_run(self) -> Run:
        slots = self.slots
        pairs = None if self.touching is None else tuple(Collision(0.0, _two(pair), 0.0) for pair in self.touching)
        run = _State(
            "live",
            self.junction,
            tuple(m.agent for m in slots),
            np.array([[m.zone for m in slots]], dtype=np.int8),
            np.array([self.lights], dtype=np.int8),
            self.dt,
            station=self.block.station,
            speed=self.block.speed,
            pose=self.block.pose,
            collisions=pairs,
            facts=self.facts,
        )
        given(run, as_block, self.block)
        return run

    def require(self, *names: str) -> None:
        """Raise a `RunError` where ``station``, ``speed`` or ``pose`` is not given."""
        given = {"station": self.located, "speed": self.timed, "pose": self.posed}
        if not all(given[name] for name in names):
            self.run.need(next(name for name in names if not given[name]))

    def pair(self, me: Mover, you: Mover) -> Pair:
        """Return what is static about two vehicles, found out once."""
        found = self._pairs.get((me, you))
        if found is None:
            found = self._pairs[me, you] = Pair(self.run, me, you)
        return found

    def leads(self, mover: Mover) -> bool:
        """`standing.leads`."""
        entrance, station = mover.entrance, mover.station
        return not any(
            o.entrance == entrance and o.zone <= ENTRANCE and o.station > station for o in self.movers if o is not mover
        )

    def waited(self, mover: Mover) -> int:
        """`standing.waited`."""
        if not (self.located and self.timed):
            return mover.wt
        return self.tick - mover.arrived_at if mover.arrived else 0

    def yields(self, pair: Pair) -> bool:
        """`priority.yields`."""
        me, you = pair.me, pair.you
        if you.lit and you.facing != _GREEN and you.facing != _YELLOW:
            return False
        if not me.lit or pair.always:
            return True
        return (me.facing == _RED) is pair.near

    def due(self, mover: Mover, stretch: Stretch) -> bool:
        """`rights.due`."""
        return mover.here and (_coming(mover, stretch) or (mover.next_to_go and not self.waives(mover)))

    def waives(self, mover: Mover) -> bool:
        """`rights.waives`."""
        return mover.free > self._waiver

    def starting(self, mover: Mover) -> bool:
        """`rights.starting`."""
        if not mover.next_to_go:
            return False
        if abs(mover.speed) <= STANDSTILL:
            return mover.ready <= self._waiver
        return mover.last_ready >= 0 and self.tick - mover.last_ready < self._waiver

    def unhindered(self, mover: Mover) -> bool:
        """`priority.unhindered`."""
        if self._held(mover):
            return False
        if mover.lit:
            if mover.facing != _GREEN:
                return False
        elif mover.stop_sign and mover.zone < JUNCTION:
            return False
        front, far = mover.station, HEADWAY * mover.speed
        for other in self.movers:
            if other is not mover and other.entrance == mover.entrance and other.zone <= JUNCTION:
                ahead = other.station
                if ahead > front and ahead - other.length - front < far:
                    return False
        return True

    def kept(self, mover: Mover, other: Mover) -> bool:
        """Return whether a third vehicle, neither `mover` nor `other`, keeps `mover`: `rights.kept_by`."""
        thirds = (o for o in self.movers if o is not mover and o is not other and o not in mover.slow_at_entry)
        return any(self._close_behind(self.pair(mover, third)) for third in thirds if third.speed < PACE)

    def _held(self, mover: Mover) -> bool:
        """`rights.held`."""
        if mover.held_at != self.tick:
            mover.held_at, mover.is_held = self.tick, self._find_held(mover)
        return mover.is_held

    def _find_held(self, mover: Mover) -> bool:
        for other in self.movers:
            if other is mover:
                continue
            pair = self.pair(mover, other)
            if self._all_way:
                if mover.arrived and other.arrived and pair.in_turn:
                    later = self.waited(other) - self.waited(mover)
                    if later > self._tie or (pair.from_right and later >= -self._tie):
                        return True
                continue
            if not pair.owing or pair.contested is None or not self.yields(pair):
                continue
            if (_coming(other, pair.contested.yours) and other.here) or (other.arrived and self.leads(other)):
                return True
        return False

    def _keeps(self, mover: Mover, other: Mover) -> bool:
        """Return whether `other` keeps `mover` from going, as in `rights.waives`."""
        pair = self.pair(mover, other)
        if self._close_behind(pair):
            return True
        if pair.contested is None or not _on(other, pair.contested.yours):
            return False
        if self._all_way:
            return other.arrived_at <= mover.arrived_at
        back = self.pair(other, mover)
        return not (back.owing and self.yields(back))

    def _close_behind(self, pair: Pair) -> bool:
        """`rights.close_behind`."""
        me, you, common = pair.me, pair.you, pair.common
        if not (you.speed < PACE and you.here):
            return False
        ahead, behind = you.station, you.station - you.length
        if me.entrance == you.entrance and behind < pair.parting and ahead > me.station and behind - me.station < GAP:
            return True
        if me.agent.exit != you.agent.exit:
            return False
        mine, yours = me.agent.route.length, you.agent.route.length
        front, ahead, behind = me.station - mine, ahead - yours, behind - yours
        merged = ahead >= (common.yours.start - yours if common else 0.0)
        if not (merged and ahead > front):
            return False
        return behind - front < GAP or (me.arrived and you.zone == EXIT and behind < me.length + ROOM)


def _coming(mover: Mover, stretch: Stretch) -> bool:
    """Return whether it is on a stretch of its movement, or would be there within `DUE`; as in `rights.due`."""
    front = mover.station
    return stretch.start - front <= DUE * max(mover.speed, 0.0) and front - mover.length <= stretch.end


def _on(mover: Mover, stretch: Stretch) -> bool:
    """`stretches.on_stretch`."""
    front = mover.station
    return front >= stretch.start and front - mover.length <= stretch.end and mover.here


def _two(pair: Iterable[str]) -> tuple[str, str]:
    one, two = sorted(pair)
    return one, two
