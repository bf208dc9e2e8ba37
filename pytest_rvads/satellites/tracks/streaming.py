"""Traffic that is still being recorded: takes states one by one, and yields recordings of the vehicles that can be judged.

A vehicle can be judged as soon as all vehicles that were at the junction with it have left: then the ways of all are known. The
memory is bounded by the number of vehicles at the junction and by the time that they stay.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from pytest_rvads.decoding import decode
from pytest_rvads.errors import RunError
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.bounds import FARTHEST, Name, Size
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.importing import recording_of
from pytest_rvads.satellites.tracks.intake import Intake
from pytest_rvads.satellites.tracks.lightlog import changes_of, signals_at
from pytest_rvads.satellites.tracks.samples import LATEST, Log, Samples, kind_of
from pytest_rvads.wording import one_line

__all__ = ["GONE_AFTER", "LONGEST", "State", "Stream"]

GONE_AFTER = 2.0
"""Who has not been seen for this long has gone [s]."""
LONGEST = 300.0
"""Nobody is waited for, and nothing is kept, for much longer than this [s]: who parks keeps nobody from being judged."""
_EVERY = 10.0
"""Who can be judged, and what is needed no more, is looked for at least so often, even if nobody goes [s]."""

_Place = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
_Time = Annotated[float, Meta(ge=-LATEST, le=LATEST)]


class SeenVehicle(msgspec.Struct, frozen=True):
    """A vehicle in a line."""

    id: Name
    x: _Place
    """East coordinate of the point that `Intake.point` says [m]."""
    y: _Place
    """North coordinate [m]."""
    heading: _Place | None = None
    """Counter-clockwise from east [rad]; worked out from the positions where a line does not tell it."""
    speed: _Place | None = None
    """Forward [m/s]; likewise."""
    length: Size | None = None
    width: Size | None = None
    kind: str = "car"


class State(msgspec.Struct, frozen=True):
    """A line: what is seen at one time."""

    t: _Time
    """On the clock of the log [s]."""
    vehicles: tuple[SeenVehicle, ...] = ()
    lights: dict[str, str] = {}
    """By entrance (``0``, ``0.1``) or id of a signal: green, yellow, red or none, until another line tells it again."""


@dataclass(slots=True)
class _Seen:
    """What has been seen of a vehicle."""

    first: SeenVehicle
    times: list[float] = field(default_factory=list)
    rows: list[tuple[float, float, float | None, float | None]] = field(default_factory=list)
    """x, y, heading, speed."""
    judged: bool = False

    def samples(self) -> Samples:
        """Return all of it as a vehicle of a log."""
        columns = np.array(self.rows, dtype=np.float64).T  # what is None is NaN then
        heading, speed = (None if np.isnan(values).any() else values for values in columns[2:])
        vehicle = self.first
        size = None if vehicle.length is None or vehicle.width is None else (vehicle.length, vehicle.width)
        return Samples(vehicle.id, np.array(self.times), columns[:2].T, heading, speed, size, kind_of(vehicle.kind))

    @property
    def span(self) -> tuple[float, float]:
        """When it was there [s]."""
        return self.times[0], self.times[-1]


class Stream:
    """Reads states line by line, and yields runs in which vehicles can be judged.

    Args:
        label: begins the labels of the runs.
        junction: where the vehicles drive.
        intake: which point of a vehicle is told, how exactly, and what else `read_tracks` takes.
    """

    def __init__(self, label: str, junction: Junction, intake: Intake | None = None) -> None:
        self._label, self._junction, self._intake = label, junction, intake or Intake("front", position_accuracy=0.0)
        self._signals = signals_at(junction)
        self._now: float | None = None
        self._looked = -np.inf
        self._there: dict[str, _Seen] = {}
        self._past: list[_Seen] = []
        self._lights: dict[str, list[tuple[float, Colour]]] = {}
        self.left_out: dict[str, int] = {}
        """Why vehicles were left out, and how many."""
        self.judged = 0
        """Vehicles that have been judged."""

    def read(self, line: bytes, where: str) -> Iterator[Run]:
        """Read a line and return the runs of which it is the last that was missing.

        Args:
            line: a state in JSON, see `State`.
            where: begins the message of an error.

        Raises:
            RunError: what is no state, or one that is not later than the one before; nothing of it is kept.
        """
        state = decode(line, State, where, RunError)
        if self._now is not None and state.t <= self._now:
            raise RunError(f"{where}: time must go on, got {state.t:g} s after {self._now:g} s")
        names = [vehicle.id for vehicle in state.vehicles]
        if len(set(names)) < len(names):
            raise RunError(f"{where}: two vehicles have the same id: give each its own")
        shown = [(self._signal(key, where), _colour(name, where)) for key, name in state.lights.items()]
        self._now = state.t
        for signal, colour in shown:
            self._lights.setdefault(signal, []).append((state.t, colour))
        for vehicle in state.vehicles:
            seen = self._there.get(vehicle.id)
            if seen is None:
                seen = self._there[vehicle.id] = _Seen(vehicle)
            seen.times.append(state.t)
            seen.rows.append((vehicle.x, vehicle.y, vehicle.heading, vehicle.speed))
        gone = [name for name, seen in self._there.items() if seen.span[1] < state.t - GONE_AFTER]
        self._past += [self._there.pop(name) for name in gone]
        if not gone and state.t < self._looked + _EVERY:
            return iter(())
        self._looked = state.t
        return self._ready(state.t)

    def end(self) -> Iterator[Run]:
        """Return the runs of everybody who has not been judged: nothing more comes."""
        self._past += self._there.values()
        self._there.clear()
        return self._ready(np.inf)

    def _signal(self, key: str, where: str) -> str:
        if key not in self._signals:
            raise RunError(f"{where}: lights must be called {one_line(', '.join(self._signals), 200)}, got {key!r:.40}")
        return key

    def _ready(self, now: float) -> Iterator[Run]:
        """Yield runs of those who have gone and were there with nobody who has not, and forget who is needed no more."""
        waiting = [seen.span[0] for seen in self._there.values() if seen.span[0] > now - LONGEST]
        since = min(waiting, default=np.inf)
        ready = [seen for seen in self._past if not seen.judged and seen.span[1] < since]
        if ready:
            yield from self._runs(ready)
            for seen in ready:
                seen.judged = True
            self.judged += len(ready)
        needed = min((s.span[0] for s in (*self._past, *self._there.values()) if not s.judged), default=now)
        needed = max(needed, now - LONGEST)
        self._past = [seen for seen in self._past if not seen.judged or seen.span[1] >= needed]
        self._forget(needed)

    def _forget(self, before: float) -> None:
        """Drop samples and colours that nobody needs any more."""
        for seen in self._there.values():
            old = int(np.searchsorted(seen.times, before - LONGEST))
            if old:
                del seen.times[:old], seen.rows[:old]
        for signal, changes in self._lights.items():
            last = max((k for k, (time, _) in enumerate(changes) if time <= before), default=0)
            self._lights[signal] = changes[last:]

    def _runs(self, ready: list[_Seen]) -> Iterator[Run]:
        names = {seen.first.id for seen in ready}
        begin, end = min(seen.span[0] for seen in ready), max(seen.span[1] for seen in ready)
        there = [seen for seen in (*self._past, *self._there.values()) if seen.span[0] <= end and seen.span[1] >= begin]
        log = Log(self._label, tuple(seen.samples() for seen in there))
        recording = recording_of(log, self._junction, self._intake, changes_of(self._lights), self._label)
        for name, why in recording.left_out:
            if name in names:
                self.left_out[why] = self.left_out.get(why, 0) + 1
        for run in recording:
            if run.excerpt is None or run.excerpt.judged is None:
                yield run
                continue
            # Who comes back is called v17#2.
            mine = tuple(name for name in run.excerpt.judged if name.partition("#")[0] in names or name in names)
            if mine:
                yield replace(run, excerpt=replace(run.excerpt, judged=mine))


def _colour(name: str, where: str) -> Colour:
    try:
        return Colour[name.upper()]
    except KeyError:
        known = " or ".join(colour.name.lower() for colour in Colour)
        raise RunError(f"{where}: the colour of a light must be {known}, got {name!r:.40}") from None
