"""Recorded traffic at one junction: vehicles that come and go, with individual sample times, cut into runs of busy periods.

Nothing is guessed from before the first sample of a vehicle or after its last sample. The vehicle is absent then (`Zone.ABSENT`),
its numbers are NaN, and no instance about it is judged.

The clock of a run has steps of 0.01 s, as in simulated runs, so that waiting times and ties mean the same in both. A recording
keeps the samples and makes a run when the run is indexed, so that one run at a time is in memory.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs import between
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.periods import Period, busy_periods
from pytest_rvads.runs.run import DT, Excerpt, Facts, Run
from pytest_rvads.runs.smoothing import DERIVED, beside
from pytest_rvads.runs.states import Agent, Colour, Zone

__all__ = ["Before", "Changes", "Recording", "Track", "zones"]

HARDEST = 5.0
"""Nobody who is about to stop brakes or sets off harder than this [m/s^2]."""
_ALL = 3.0
"""So many standard deviations are all that can be."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What was recorded of one vehicle near the junction; arrays have one row per sample."""

    agent: Agent
    """Its name, way, kind and size."""
    times: NDArray[np.float64]
    """On the clock of the recording, increasing, at least two, shape ``(samples,)`` [s]."""
    station: NDArray[np.float64]
    """Reference point (centre of the front bumper) along its itinerary, 0 at the entrance vertex, likewise [m]."""
    speed: NDArray[np.float64]
    """Forward, likewise [m/s]."""
    pose: NDArray[np.float64]
    """x [m], y [m], heading [rad] of the reference point, shape ``(samples, 3)``."""
    spread: NDArray[np.float64] | None = None
    """How far before or behind its station it may have been, shape ``(samples,)`` [m]; None: exact."""
    offset: float = 0.0
    """How far beside its itinerary it drove, root mean square [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """The light of one entrance: a colour holds until the next change; before the first one it is not known."""

    times: NDArray[np.float64]
    """On the clock of the recording, increasing, shape ``(changes,)`` [s]."""
    colours: NDArray[np.int8]
    """`Colour` from then on, likewise."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Sequence[Run]):
    """Recorded traffic at a junction: a sequence of runs, one run per busy period. A run is built when it is indexed.

    A long busy period is cut into several runs. Each vehicle is judged in one run, which also holds all vehicles that were at the
    junction at the same time.
    """

    label: str
    """Begins the labels of its runs."""
    junction: Junction
    tracks: tuple[Track, ...]
    """In the order in which they begin."""
    lights: Mapping[int, Changes] = field(default_factory=dict)
    """By entrance."""
    facts: Facts = field(default_factory=Facts)
    position_accuracy: float = 0.0
    """Standard deviation of a coordinate as it was measured [m]; 0: exact. Those of tracks are smoothed."""
    speed_accuracy: float = 0.0
    """Of a speed as it was measured [m/s]; 0: exact. Those of tracks are smoothed where positions are."""
    dt: float = DT
    """Time between two states of its runs [s]."""
    left_out: tuple[tuple[str, str], ...] = ()
    """Vehicles that were recorded and are not in it, and why."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "tracks", tuple(sorted(self.tracks, key=lambda track: (track.times[0], track.agent.name))))

    def __repr__(self) -> str:
        return f"<Recording {self.label}: {len(self.tracks)} vehicles, {len(self)} busy periods>"

    def __len__(self) -> int:
        return len(self.periods)

    @overload
    def __getitem__(self, index: int) -> Run: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Run]: ...

    def __getitem__(self, index: int | slice) -> Run | Sequence[Run]:
        if isinstance(index, slice):
            return [self._run(period) for period in self.periods[index]]
        return self._run(self.periods[index])

    def __iter__(self) -> Iterator[Run]:
        return map(self._run, self.periods)

    @cached_property
    def periods(self) -> tuple[Period, ...]:
        """When vehicles were near the junction, and which."""
        spans = [(track.times, track.station, track.speed) for track in self.tracks]
        ways = [self._itinerary(track) for track in self.tracks]
        return busy_periods(spans, [way.line for way in ways], [way.leave for way in ways])

    def _itinerary(self, track: Track) -> Itinerary:
        return itinerary(self.junction, *track.agent.way.key)

    def _run(self, period: Period) -> Run:
        """Return a busy period as a run: everything sampled with one clock, by interpolation."""
        first = np.floor(period.begin / self.dt)
        steps = int(np.ceil(period.end / self.dt) - first) + 1
        ticks = (first + np.arange(steps)) * self.dt
        tracks = [self.tracks[column] for column in period.present]
        count = len(tracks)
        zone = np.full((steps, count), Zone.ABSENT, dtype=np.int8)
        station, speed, spread = (np.full((steps, count), np.nan) for _ in range(3))
        pose = np.full((steps, count, 3), np.nan)
        for column, track in enumerate(tracks):
            begin, end = np.searchsorted(ticks, track.times[0]), np.searchsorted(ticks, track.times[-1], side="right")
            here = slice(int(begin), int(end))
            at = ticks[here]
            station[here, column] = between.stations(track.times, track.station, track.speed, at)
            speed[here, column] = between.speeds(track.times, track.station, track.speed, track.spread, at)
            turned = np.column_stack((track.pose[:, :2], np.unwrap(track.pose[:, 2])))
            pose[here, column] = np.stack([np.interp(at, track.times, values) for values in turned.T], axis=1)
            spread[here, column] = 0.0 if track.spread is None else np.interp(at, track.times, track.spread)
            zone[here, column] = zones(self._itinerary(track).borders, station[here, column], spread[here, column])
        lights = np.zeros((steps, len(self.junction.starts)), dtype=np.int8)
        for entrance, changes in self.lights.items():
            known = np.concatenate(([Colour.NONE], changes.colours)).astype(np.int8)
            lights[:, entrance] = known[np.searchsorted(changes.times, ticks, side="right")]
        judged = tuple(self.tracks[column].agent.name for column in period.judged)
        return Run(
            f"{self.label} at {period.busy:.1f} s",
            self.junction,
            tuple(track.agent for track in tracks),
            zone,
            lights,
            self.dt,
            station,
            speed,
            pose,
            facts=self.facts,
            excerpt=Excerpt(float(ticks[0]), judged, self._positions_known(tracks), self._speeds_known(tracks, ticks, speed)),
            spread=None if all(track.spread is None for track in tracks) else spread,
            provenance={"recording": self.label},
        )

    def _positions_known(self, tracks: Sequence[Track]) -> float:
        """Return the standard deviation of positions beside the way [m].

        Where speeds come from positions, so may headings, and with them where the front of a vehicle is: its positions count as
        no more exact than they were measured.
        """
        if self.position_accuracy <= 0.0 or self.speed_accuracy >= DERIVED:
            return self.position_accuracy
        return beside(self.position_accuracy, _apart(tracks))

    def _speeds_known(self, tracks: Sequence[Track], ticks: NDArray[np.float64], speed: NDArray[np.float64]) -> float:
        """Return the standard deviation of the speeds of vehicles [m/s], with what happens between samples.

        Args:
            tracks: those of a run.
            ticks: its times, shape ``(steps,)`` [s].
            speed: what is taken for their speeds then, shape ``(steps, tracks)`` [m/s].
        """
        if self.speed_accuracy <= 0.0:
            exact = ((t, column) for column, t in enumerate(tracks) if t.spread is None)
            slower = (between.unseen_stand(t.times, t.station, t.speed, ticks, speed[:, column]) for t, column in exact)
            return max(slower, default=0.0) / _ALL
        known = self.speed_accuracy
        if self.position_accuracy > 0.0 and known < DERIVED:
            known = beside(known, _apart(tracks))
        return max(known, HARDEST * max(_apart(tracks) - DT, 0.0) / 2 / _ALL)


def _apart(tracks: Sequence[Track]) -> float:
    """Return how far apart samples usually are [s]."""
    return float(np.median(np.concatenate([np.diff(track.times) for track in tracks])))


class Before(NamedTuple):
    """What `zones` needs of the last state before the states that it reads; per vehicle, shape ``(agents,)``."""

    zone: NDArray[np.int8]
    """`Zone.ABSENT` of a vehicle that was not there."""
    station: NDArray[np.float64]
    """[m]; NaN of a vehicle that was not there."""
    spread: NDArray[np.float64]
    """Likewise."""


def zones(
    borders: NDArray[np.float64],
    station: NDArray[np.float64],
    spread: NDArray[np.float64] | float = 0.0,
    before: Before | None = None,
) -> NDArray[np.int8]:
    """Return the zones of one vehicle, shape ``(steps,)``, or of several vehicles, shape ``(steps, agents)``.

    A vehicle crosses a border in the first state in which it is beyond the border even if it is `spread` behind its station.
    It also crosses the border in the first state beyond the border to which it has come by a step that is longer than the spread
    of both states: noise makes no such step. A border stays crossed, wherever the vehicle is or is measured afterwards.

    Args:
        borders: `Itinerary.borders` of the vehicle, or of every vehicle, shape ``(4,)`` or ``(agents, 4)`` [m].
        station: of the reference point along the way, of the shape of the result [m].
        spread: how far before or behind its station a vehicle may have been, likewise [m]; 0: exact.
        before: the state before the first state; None: no vehicle was there.
    """
    spread = np.broadcast_to(spread, station.shape)
    nothing = np.full(station.shape[1:], np.nan)
    last = Before(np.full(station.shape[1:], Zone.ABSENT, dtype=np.int8), nothing, nothing) if before is None else before
    doubt = np.concatenate((last.spread[None], spread))
    driven = np.diff(station, axis=0, prepend=last.station[None]) > doubt[1:] + doubt[:-1]
    surely = np.where(driven, station, station - spread)
    beyond = (surely[..., None] >= borders).sum(axis=-1).astype(np.int8)
    return np.maximum(np.maximum.accumulate(beyond, axis=0), last.zone)
