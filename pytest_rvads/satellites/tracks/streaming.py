"""Reads traffic that is still being recorded: a `Stream` reads states and yields runs in which vehicles can be judged.

A vehicle can be judged as soon as the vehicles that were at the junction at the same time have left, because the ways of vehicles
are known only when they have left. The memory grows with the number of vehicles at the junction and with the time that they stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.archive import FARTHEST, Name, Size
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.importing import Intake, recording_of
from pytest_rvads.satellites.tracks.lightlog import changes_of, signals_at
from pytest_rvads.satellites.tracks.samples import LATEST, Log, Samples, kind_of
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.wording import one_line

GONE_AFTER = 2.0
"""Time without a sample after which a vehicle counts as gone [s]."""
LONGEST = 300.0
"""Longest time for which a vehicle that stays at the junction delays the verdicts on other vehicles [s].

A vehicle that stays longer, such as a parked vehicle, no longer delays verdicts, and its older samples are dropped.
"""
_LONGEST_PAUSE = 10.0
"""Longest time between two searches for vehicles that can be judged [s]; a search also starts whenever a vehicle has left."""

_Place = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]


class SeenVehicle(msgspec.Struct, frozen=True):
    """A vehicle as a line of the stream describes it at one time."""

    id: Name
    x: _Place
    """East coordinate of the recorded point of the vehicle [m]."""
    y: _Place
    """North coordinate of the recorded point of the vehicle [m]."""
    heading: _Place | None = None
    """Heading, counter-clockwise from east [rad]; None to derive the heading from the positions."""
    speed: _Place | None = None
    """Forward speed [m/s]; None to derive the speed from the positions."""
    length: Size | None = None
    width: Size | None = None
    kind: str = "car"


class State(msgspec.Struct, frozen=True):
    """A line of the stream: all vehicles and lights at one time."""

    t: Annotated[float, Meta(ge=-LATEST, le=LATEST)]
    """Time on the clock of the log [s]."""
    vehicles: tuple[SeenVehicle, ...] = ()
    lights: dict[str, str] = {}
    """Colour (green, yellow, red or none) by name of an entrance (``0``, ``0.1``) or id of a signal. A colour holds until a later
    line has another colour for the same name."""


@dataclass(slots=True)
class _SampledVehicle:
    """The samples of a vehicle in the stream so far."""

    first: SeenVehicle
    """The vehicle in its first sample, from which its size and kind are taken."""
    times: list[float] = field(default_factory=list)
    rows: list[tuple[float, float, float | None, float | None]] = field(default_factory=list)
    """x, y, heading, speed of each sample, in SI units."""
    judged: bool = False

    def samples(self) -> Samples:
        """Return the samples in the form that all log formats share."""
        columns = np.array(self.rows, dtype=np.float64).T  # numpy converts None to NaN
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

    Without an intake, positions are exact and refer to the front bumper.
    """

    def __init__(self, label: str, junction: Junction, intake: Intake | None = None) -> None:
        self._label, self._junction, self._intake = label, junction, intake or Intake("front", position_accuracy=0.0)
        self._signals = signals_at(junction)
        self._now: float | None = None
        self._last_search = -np.inf
        self._present: dict[str, _SampledVehicle] = {}
        self._departed: list[_SampledVehicle] = []
        self._lights: dict[str, list[tuple[float, Colour]]] = {}
        self.left_out: Counter[str] = Counter()
        """Number of omitted vehicles by reason."""
        self.judged = 0
        """Number of vehicles that were judged so far."""

    def read(self, line: bytes, where: str) -> Iterator[Run]:
        """Read a line, and return runs of the vehicles that can be judged now."""
        state = decode(line, State, where, RunError)
        if self._now is not None and state.t <= self._now:
            raise RunError(f"{where}: the time must be later than {self._now:g} s, got {state.t:g} s")
        names = [vehicle.id for vehicle in state.vehicles]
        if len(set(names)) < len(names):
            raise RunError(f"{where}: two vehicles have the same id: give each vehicle its own id")
        for key, name in state.lights.items():
            if key not in self._signals:
                signals = one_line(", ".join(self._signals), 200)
                raise RunError(f"{where}: the name of a light must be of {signals}, got {key!r:.40}")
            if name.upper() not in Colour.__members__:
                names_of_colours = " or ".join(colour.name.lower() for colour in Colour)
                raise RunError(f"{where}: the colour of a light must be {names_of_colours}, got {name!r:.40}")
        self._now = state.t
        for signal, name in state.lights.items():
            self._lights.setdefault(signal, []).append((state.t, Colour[name.upper()]))
        for vehicle in state.vehicles:
            track = self._present.setdefault(vehicle.id, _SampledVehicle(vehicle))
            track.times.append(state.t)
            track.rows.append((vehicle.x, vehicle.y, vehicle.heading, vehicle.speed))
        gone_names = [name for name, track in self._present.items() if track.span[1] < state.t - GONE_AFTER]
        self._departed += [self._present.pop(name) for name in gone_names]
        if not gone_names and state.t < self._last_search + _LONGEST_PAUSE:
            return iter(())
        self._last_search = state.t
        return self._ready(state.t)

    def end(self) -> Iterator[Run]:
        """Return the runs of all vehicles that are not judged yet. Callers must not read another line after this call."""
        self._departed += self._present.values()
        self._present.clear()
        return self._ready(np.inf)

    def _ready(self, now: float) -> Iterator[Run]:
        """Yield runs of the vehicles that left before every present vehicle came, and drop what no later run needs."""
        present_since = [seen.span[0] for seen in self._present.values() if seen.span[0] > now - LONGEST]
        first_present = min(present_since, default=np.inf)
        ready = [seen for seen in self._departed if not seen.judged and seen.span[1] < first_present]
        if ready:
            yield from self._runs(ready)
            for seen in ready:
                seen.judged = True
            self.judged += sum(kind_of(seen.first.kind) is not Kind.PEDESTRIAN for seen in ready)
        needed_since = min((s.span[0] for s in (*self._departed, *self._present.values()) if not s.judged), default=now)
        needed_since = max(needed_since, now - LONGEST)
        self._departed = [seen for seen in self._departed if not seen.judged or seen.span[1] >= needed_since]
        for vehicle in self._present.values():
            count = int(np.searchsorted(vehicle.times, needed_since - LONGEST))
            if count:
                del vehicle.times[:count], vehicle.rows[:count]
        for signal, changes in self._lights.items():
            last = max((k for k, (time, _) in enumerate(changes) if time <= needed_since), default=0)
            self._lights[signal] = changes[last:]

    def _runs(self, ready: list[_SampledVehicle]) -> Iterator[Run]:
        names = {seen.first.id for seen in ready}
        begin, end = min(seen.span[0] for seen in ready), max(seen.span[1] for seen in ready)
        meanwhile = [seen for seen in (*self._departed, *self._present.values()) if seen.span[0] <= end and seen.span[1] >= begin]
        log = Log(self._label, tuple(seen.samples() for seen in meanwhile))
        recording = recording_of(log, self._junction, self._intake, changes_of(self._lights), self._label)
        for name, why in recording.left_out:
            if name in names:
                self.left_out[why] += 1
        for run in recording:
            if run.excerpt is None or run.excerpt.judged is None:
                yield run
                continue
            # A second pass of vehicle v17 through the junction has the name v17#2.
            judged = tuple(name for name in run.excerpt.judged if name.partition("#")[0] in names or name in names)
            if judged:
                yield replace(run, excerpt=replace(run.excerpt, judged=judged))
