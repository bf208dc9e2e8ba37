"""Traffic that is still being recorded: a `Stream` reads states and yields runs of the vehicles that can be judged.

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

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.bounds import FARTHEST, Name, Size
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.tracks.importing import Intake, recording_of
from pytest_rvads.satellites.tracks.lightlog import changes_of, signals_at
from pytest_rvads.satellites.tracks.samples import LATEST, Log, Samples, kind_of
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

__all__ = ["GONE_AFTER", "LONGEST", "State", "Stream"]

GONE_AFTER = 2.0
"""Time without a sample after which a vehicle has left [s]."""
LONGEST = 300.0
"""Longest stay of a vehicle for which other vehicles wait with their judgment [s]. So a parked vehicle stops no judgment, and
older samples are dropped."""
_LONGEST_PAUSE = 10.0
"""Longest time between two searches for vehicles that can be judged [s]; a vehicle that leaves starts a search at once."""

_Place = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
_Time = Annotated[float, Meta(ge=-LATEST, le=LATEST)]


class SeenVehicle(msgspec.Struct, frozen=True):
    """A vehicle of a state."""

    id: Name
    x: _Place
    """East coordinate of the recorded point of the vehicle [m]."""
    y: _Place
    """North coordinate of the recorded point of the vehicle [m]."""
    heading: _Place | None = None
    """Counter-clockwise from east [rad]; None to derive the heading from the positions."""
    speed: _Place | None = None
    """Forward speed [m/s]; None to derive the speed from the positions."""
    length: Size | None = None
    width: Size | None = None
    kind: str = "car"


class State(msgspec.Struct, frozen=True):
    """A line of the stream: all vehicles and lights at a time."""

    t: _Time
    """Time on the clock of the log [s]."""
    vehicles: tuple[SeenVehicle, ...] = ()
    lights: dict[str, str] = {}
    """Colour by entrance (``0``, ``0.1``) or id of a signal: green, yellow, red or none. A colour holds until a later line has
    another colour."""


@dataclass(slots=True)
class _Seen:
    """All samples of a vehicle so far."""

    first: SeenVehicle
    """The first sample, which has size and kind."""
    times: list[float] = field(default_factory=list)
    rows: list[tuple[float, float, float | None, float | None]] = field(default_factory=list)
    """x, y, heading, speed of each sample, in SI units."""
    judged: bool = False

    def samples(self) -> Samples:
        """Return the samples as a vehicle of a log."""
        columns = np.array(self.rows, dtype=np.float64).T  # None becomes NaN
        heading, speed = (None if np.isnan(values).any() else values for values in columns[2:])
        vehicle = self.first
        size = None if vehicle.length is None or vehicle.width is None else (vehicle.length, vehicle.width)
        return Samples(vehicle.id, np.array(self.times), columns[:2].T, heading, speed, size, kind_of(vehicle.kind))

    @property
    def span(self) -> tuple[float, float]:
        """Times of the first and the last sample [s]."""
        return self.times[0], self.times[-1]


class Stream:
    """Reads states line by line, and yields runs in which vehicles can be judged.

    Args:
        label: prefix of the labels of the runs.
        junction: the junction of the vehicles.
        intake: recorded point, sizes, offset and accuracy, as for `read_tracks`; None for exact positions of the front bumper.
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
        """Number of omitted vehicles by reason."""
        self.judged = 0
        """Number of judged vehicles."""

    def read(self, line: bytes, where: str) -> Iterator[Run]:
        """Read a line and return the runs that this line completes.

        Args:
            line: a state in JSON, see `State`.
            where: name of the line in messages.

        Raises:
            RunError: the line is no state, or its time is not later than the time of the line before; the stream ignores the
                line.
        """
        state = decode(line, State, where, RunError)
        if self._now is not None and state.t <= self._now:
            raise RunError(f"{where}: the time must be later than {self._now:g} s, got {state.t:g} s")
        names = [vehicle.id for vehicle in state.vehicles]
        if len(set(names)) < len(names):
            raise RunError(f"{where}: two vehicles have the same id: give each vehicle its own id")
        colours = [(self._signal(key, where), _colour_named(name, where)) for key, name in state.lights.items()]
        self._now = state.t
        for signal, colour in colours:
            self._lights.setdefault(signal, []).append((state.t, colour))
        for vehicle in state.vehicles:
            track = self._there.get(vehicle.id)
            if track is None:
                track = self._there[vehicle.id] = _Seen(vehicle)
            track.times.append(state.t)
            track.rows.append((vehicle.x, vehicle.y, vehicle.heading, vehicle.speed))
        gone_names = [name for name, track in self._there.items() if track.span[1] < state.t - GONE_AFTER]
        self._past += [self._there.pop(name) for name in gone_names]
        if not gone_names and state.t < self._looked + _LONGEST_PAUSE:
            return iter(())
        self._looked = state.t
        return self._ready(state.t)

    def end(self) -> Iterator[Run]:
        """Return the runs of all vehicles that are not judged yet; the caller reads no more lines."""
        self._past += self._there.values()
        self._there.clear()
        return self._ready(np.inf)

    def _signal(self, key: str, where: str) -> str:
        if key not in self._signals:
            raise RunError(f"{where}: the name of a light must be of {one_line(', '.join(self._signals), 200)}, got {key!r:.40}")
        return key

    def _ready(self, now: float) -> Iterator[Run]:
        """Yield runs of the vehicles that left and whose companions all left, and drop the vehicles that no later run needs."""
        present_since = [seen.span[0] for seen in self._there.values() if seen.span[0] > now - LONGEST]
        first_present = min(present_since, default=np.inf)
        ready = [seen for seen in self._past if not seen.judged and seen.span[1] < first_present]
        if ready:
            yield from self._runs(ready)
            for seen in ready:
                seen.judged = True
            self.judged += len(ready)
        needed_since = min((s.span[0] for s in (*self._past, *self._there.values()) if not s.judged), default=now)
        needed_since = max(needed_since, now - LONGEST)
        self._past = [seen for seen in self._past if not seen.judged or seen.span[1] >= needed_since]
        self._forget(needed_since)

    def _forget(self, needed_since: float) -> None:
        """Drop samples and colours that are so old that no later run needs them."""
        for seen in self._there.values():
            count = int(np.searchsorted(seen.times, needed_since - LONGEST))
            if count:
                del seen.times[:count], seen.rows[:count]
        for signal, changes in self._lights.items():
            last = max((k for k, (time, _) in enumerate(changes) if time <= needed_since), default=0)
            self._lights[signal] = changes[last:]

    def _runs(self, ready: list[_Seen]) -> Iterator[Run]:
        names = {seen.first.id for seen in ready}
        begin, end = min(seen.span[0] for seen in ready), max(seen.span[1] for seen in ready)
        meanwhile = [seen for seen in (*self._past, *self._there.values()) if seen.span[0] <= end and seen.span[1] >= begin]
        log = Log(self._label, tuple(seen.samples() for seen in meanwhile))
        recording = recording_of(log, self._junction, self._intake, changes_of(self._lights), self._label)
        for name, why in recording.left_out:
            if name in names:
                self.left_out[why] = self.left_out.get(why, 0) + 1
        for run in recording:
            if run.excerpt is None or run.excerpt.judged is None:
                yield run
                continue
            # A vehicle that comes back has the name v17#2.
            judged = tuple(name for name in run.excerpt.judged if name.partition("#")[0] in names or name in names)
            if judged:
                yield replace(run, excerpt=replace(run.excerpt, judged=judged))


def _colour_named(name: str, where: str) -> Colour:
    try:
        return Colour[name.upper()]
    except KeyError:
        colours = " or ".join(colour.name.lower() for colour in Colour)
        raise RunError(f"{where}: the colour of a light must be {colours}, got {name!r:.40}") from None
