"""Recorded traffic at a junction: agents that come and go, with individual sample times, cut into runs of busy periods.

Before its first and after its last sample, an agent is absent (`Zone.ABSENT`): its numbers are NaN, and no rule is judged about
the agent.

The clock of a recorded run has steps of 0.01 s, as in simulated runs, so that waiting times and simultaneous arrivals mean the
same in both kinds of runs. A recording stores the samples and builds a run when the run is indexed, so that one run at a time is
in memory. Stations and speeds between samples are interpolated.

An excerpt is the part of a recording that one run holds: a busy period, a time with vehicles near the junction, or a part of
such a time. An instance of a rule (the rule for certain vehicles) is judged in one excerpt: the excerpt that judges the vehicle
of the instance that appeared last. The indicators of two vehicles are computed in the excerpt that judges the vehicle that
appeared later. An excerpt also shows vehicles that it does not judge, as context.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.runs.itineraries import Itinerary, itinerary
from pytest_rvads.runs.run import DT, Excerpt, Facts, Run
from pytest_rvads.runs.smoothing import BRIEF, DERIVED, PACE, beside
from pytest_rvads.runs.states import Agent, Colour, Kind, Zone

NEAR = 15.0
"""Distance before its stopping line from which on a vehicle is near the junction [m]: two queuing vehicles fit in."""
NEAR_TIME = 5.0
"""A vehicle is also near the junction if it would reach its stopping line within this time at its present speed [s].

The time is not below `pytest_rvads.logic.conduct.rights.DUE`.
"""
MOST_JUDGED = 24
"""Most vehicles that are judged in one run. Longer periods are cut, because the cost grows with the square of the vehicles."""


@dataclass(frozen=True, slots=True)
class Period:
    """A time in which vehicles are near the junction without a break, or a part of such a time."""

    begin: float
    """Time at which the first judged vehicle appears [s], or the earlier time at which a vehicle near at that time came near."""
    end: float
    """Time at which the last judged vehicle vanishes [s]."""
    busy: float
    """Time at which the first judged vehicle comes near the junction [s]."""
    judged: tuple[int, ...]
    """Numbers of the judged vehicles; each vehicle is judged in one period."""
    present: tuple[int, ...]
    """Numbers of all vehicles that are present in the period, increasing."""


def near_junction(station: NDArray[np.float64], speed: NDArray[np.float64], line: float, leave: float) -> NDArray[np.bool_]:
    """Return whether a vehicle is near the junction at given stations [m] and speeds [m/s].

    A vehicle is near from `NEAR` before its stopping line at the station `line` on, or from the distance that it drives in
    `NEAR_TIME` if this distance is longer, up to the station `leave` [m].
    """
    reach = np.maximum(NEAR, NEAR_TIME * np.maximum(speed, 0.0))
    near: NDArray[np.bool_] = (station >= line - reach) & (station <= leave)
    return near


def busy_periods(tracks: Sequence[Track], ways: Sequence[Itinerary]) -> tuple[Period, ...]:
    """Return the busy periods of a junction in order, given the way of every track."""
    # The first and the last time at which each vehicle is near the junction [s]; None if it never comes near.
    near: list[tuple[float, float] | None] = []
    for track, way in zip(tracks, ways, strict=True):
        samples = track.times[near_junction(track.station, track.speed, way.line, way.leave)]
        near.append((float(samples[0]), float(samples[-1])) if len(samples) else None)
    order = sorted((*both, number) for number, both in enumerate(near) if both is not None)
    groups: list[list[int]] = []
    until = -np.inf
    for begin, end, number in order:
        if begin > until or len(groups[-1]) >= MOST_JUDGED:
            groups.append([])
        groups[-1].append(number)
        until = max(until, end)
    begins, ends = (np.array([track.times[k] for track in tracks]) for k in (0, -1))
    periods = []
    for group in groups:
        begin, end = float(begins[group].min()), float(ends[group].max())
        # The run goes back so far that it shows waiting times, and the order in which vehicles entered.
        begin = min((since for since, until in filter(None, near) if since < begin <= until), default=begin)
        present = np.flatnonzero((begins <= end) & (ends >= begin))
        busy = min(both[0] for number in group if (both := near[number]) is not None)
        periods.append(Period(begin, end, busy, tuple(sorted(group)), tuple(present.tolist())))
    return tuple(periods)


_Values = NDArray[np.float64]
_APART = 0.15
"""Longest time between two samples during which no vehicle can stop and set off again unseen [s], see `unseen_stand`."""
_AROUND = 4
"""Number of consecutive samples from which `speeds` can find a stop between the second and the third of these samples."""
_AGREE = 0.1
"""Largest share by which the distance at the mean speed differs from the distance driven, if `stations` uses the speeds."""
HARDEST = 5.0
"""Greatest braking or acceleration of a vehicle that is about to stop [m/s^2]."""
_ALL = 3.0
"""Greatest possible error of a measurement, as a number of standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The samples of a vehicle near the junction, or of a pedestrian at a crosswalk; arrays have a row per sample."""

    agent: Agent
    """Name, way, kind and size of the vehicle or pedestrian."""
    times: NDArray[np.float64]
    """Times on the clock of the recording, increasing, at least two, shape ``(samples,)`` [s]."""
    station: NDArray[np.float64]
    """Station of the reference point (centre of the front bumper), 0 at the entrance vertex, shape ``(samples,)`` [m]."""
    speed: NDArray[np.float64]
    """Forward speed, shape ``(samples,)`` [m/s]."""
    pose: NDArray[np.float64]
    """x [m], y [m], heading [rad] of the reference point, shape ``(samples, 3)``."""
    spread: NDArray[np.float64] | None = None
    """Largest distance of the vehicle from its station, shape ``(samples,)`` [m]; None for exact stations."""
    offset: float = 0.0
    """Lateral distance of the vehicle from its itinerary, root mean square [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """The light of an entrance: a colour holds until the next change, and is unknown before the first change."""

    times: NDArray[np.float64]
    """Times of the changes on the clock of the recording, increasing, shape ``(changes,)`` [s]."""
    colours: NDArray[np.int8]
    """`Colour` from each change on, shape ``(changes,)``."""


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Sequence[Run]):
    """Recorded traffic at a junction: a sequence of runs, one run per busy period. A run is built when it is indexed.

    A long busy period is cut into several runs. Each vehicle is judged in one run, which also holds all vehicles that were at the
    junction at the same time.
    """

    label: str
    """Beginning of the labels of the runs."""
    junction: Junction
    """The junction that the recorded traffic passes."""
    tracks: tuple[Track, ...]
    """Tracks in the order of their first samples."""
    lights: Mapping[int, Changes] = field(default_factory=dict)
    """Lights by entrance, or by the start of another way, see `Junction.starts`."""
    facts: Facts = field(default_factory=Facts)
    """The facts on which verdicts depend beside the states, such as the speed limit; the same for all runs."""
    position_accuracy: float = 0.0
    """Standard deviation of a measured coordinate [m]; 0 for exact coordinates. The coordinates of tracks are smoothed."""
    speed_accuracy: float = 0.0
    """Standard deviation of a measured speed [m/s]; 0 for exact speeds. Speeds are smoothed if coordinates are not exact."""
    dt: float = DT
    """Time between two states of a run [s]."""
    left_out: tuple[tuple[str, str], ...] = ()
    """Names of the vehicles and pedestrians of the log that are not in the recording, each with the reason."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "tracks", tuple(sorted(self.tracks, key=lambda track: (track.times[0], track.agent.name))))

    def __repr__(self) -> str:
        return f"<Recording {self.label}: {len(self.vehicles)} vehicles, {len(self)} busy periods>"

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
    def vehicles(self) -> tuple[Track, ...]:
        """The tracks of vehicles, without the tracks of pedestrians."""
        return tuple(track for track in self.tracks if _drives(track))

    @cached_property
    def periods(self) -> tuple[Period, ...]:
        """Times at which vehicles were near the junction, each with the numbers of its agents in `tracks`."""
        periods = busy_periods(self.tracks, [itinerary(self.junction, *track.agent.way.key) for track in self.tracks])
        return tuple(period for period in periods if any(_drives(self.tracks[number]) for number in period.present))

    def _run(self, period: Period) -> Run:
        """Return a busy period as a run, interpolated on the clock of the run."""
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
            rows = slice(int(begin), int(end))
            at = ticks[rows]
            station[rows, column] = stations(track.times, track.station, track.speed, at)
            around = (track.times, track.station, track.speed, track.spread)
            # In noisy speeds, a stop between two samples can't be told from noise.
            speed[rows, column] = speeds(*around, at) if self.speed_accuracy <= 0.0 else np.interp(at, track.times, track.speed)
            unwrapped = np.column_stack((track.pose[:, :2], np.unwrap(track.pose[:, 2])))
            pose[rows, column] = np.stack([np.interp(at, track.times, values) for values in unwrapped.T], axis=1)
            spread[rows, column] = 0.0 if track.spread is None else np.interp(at, track.times, track.spread)
            borders, along = itinerary(self.junction, *track.agent.way.key).borders, station[rows, column]
            # Noise makes no vehicle drive back, but pedestrians may turn back.
            by_station = np.searchsorted(borders, along, side="right")
            zone[rows, column] = zones(borders, along, spread[rows, column]) if _drives(track) else by_station
        lights = np.zeros((steps, len(self.junction.starts)), dtype=np.int8)
        for entrance, changes in self.lights.items():
            colours = np.concatenate(([Colour.NONE], changes.colours)).astype(np.int8)
            lights[:, entrance] = colours[np.searchsorted(changes.times, ticks, side="right")]
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
            excerpt=Excerpt(float(ticks[0]), judged, *self._deviations(tracks, ticks, speed)),
            spread=None if all(track.spread is None for track in tracks) else spread,
            provenance={"recording": self.label},
        )

    def _deviations(self, tracks: Sequence[Track], ticks: NDArray[np.float64], speed: NDArray[np.float64]) -> tuple[float, float]:
        """Return the standard deviations of positions of vehicles across their way [m], and of their speeds [m/s].

        If speeds are derived from positions, then headings, and so the place of the front of a vehicle, can be derived from
        positions as well. In this case the first result is the standard deviation of the measured positions. The second result
        includes unknown speeds between samples. `speed` has the interpolated speeds at `ticks`, shape ``(steps, tracks)`` [m/s].
        """
        position, accuracy = self.position_accuracy, self.speed_accuracy
        between = float(np.median(np.concatenate([np.diff(track.times) for track in tracks])))  # the median time of samples [s]
        smoothed = position > 0.0 and accuracy < DERIVED
        if smoothed:
            position = beside(position, between)
        if accuracy <= 0.0:
            exact = ((t, column) for column, t in enumerate(tracks) if t.spread is None and _drives(t))
            slower = (unseen_stand(t.times, t.station, t.speed, ticks, speed[:, column]) for t, column in exact)
            return position, max(slower, default=0.0) / _ALL
        if smoothed:
            accuracy = beside(accuracy, between)
        return position, max(accuracy, HARDEST * max(between - BRIEF, 0.0) / 2 / _ALL)


def _drives(track: Track) -> bool:
    return track.agent.kind is not Kind.PEDESTRIAN


class Before(NamedTuple):
    """The state just before the states that a call of `zones` gets; arrays have the shape ``(agents,)``."""

    zone: NDArray[np.int8]
    """Zone of each vehicle; `Zone.ABSENT` of an absent vehicle."""
    station: NDArray[np.float64]
    """Station of each vehicle [m]; NaN of an absent vehicle."""
    spread: NDArray[np.float64]
    """Spread of each vehicle [m]; NaN of an absent vehicle."""


def zones(
    borders: NDArray[np.float64],
    station: NDArray[np.float64],
    spread: NDArray[np.float64] | float = 0.0,
    before: Before | None = None,
) -> NDArray[np.int8]:
    """Return the zones of a vehicle, shape ``(steps,)``, or of several vehicles, shape ``(steps, agents)``.

    A vehicle crosses a border in the first state in which its station minus its spread is beyond the border. A vehicle also
    crosses a border by a step beyond the border that is longer than the sum of the spreads before and after the step, because
    noise makes no such step. A border stays crossed, even if the vehicle is measured before the border afterwards.

    Args:
        borders: `Itinerary.borders` of the vehicle, or of every vehicle, shape ``(4,)`` or ``(agents, 4)`` [m].
        station: stations of the reference point, in the shape of the result [m].
        spread: largest distance of a vehicle from its station, in the shape of the result, or a number [m]; 0 for exact stations.
        before: the state just before the first state of `station`; None if no vehicle was present in that state.
    """
    spread = np.broadcast_to(spread, station.shape)
    nan = np.full(station.shape[1:], np.nan)
    last = Before(np.full(station.shape[1:], Zone.ABSENT, dtype=np.int8), nan, nan) if before is None else before
    doubt = np.concatenate((last.spread[None], spread))
    driven = np.diff(station, axis=0, prepend=last.station[None]) > doubt[1:] + doubt[:-1]
    least = np.where(driven, station, station - spread)
    beyond = (least[..., None] >= borders).sum(axis=-1).astype(np.int8)
    return np.maximum(np.maximum.accumulate(beyond, axis=0), last.zone)


def stations(times: _Values, station: _Values, speed: _Values, at: _Values) -> _Values:
    """Return the stations at times `at` between samples [m], shape ``(steps,)``.

    The interpolation is a cubic if the speeds agree with the distance driven, and a straight line if the speeds disagree.
    `times` [s], `station` [m] and `speed` [m/s] of the samples have the shape ``(samples,)``.
    """
    piece = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    duration = np.diff(times)[piece]
    begin, end, v0, v1 = station[piece], station[piece + 1], speed[piece], speed[piece + 1]
    part = (at - times[piece]) / duration
    straight = begin + part * (end - begin)
    bend = part * (1 - part) * duration
    curved = straight + bend * ((1 - part) * (v0 - (end - begin) / duration) - part * (v1 - (end - begin) / duration))
    smooth = np.abs((v0 + v1) / 2 * duration - (end - begin)) <= _AGREE * np.abs(end - begin)
    interpolated: _Values = np.where(smooth, curved, straight)
    return interpolated


def speeds(times: _Values, station: _Values, speed: _Values, spread: _Values | None, at: _Values) -> _Values:
    """Return the speeds of a vehicle at times `at` between its samples [m/s], shape ``(steps,)``; samples as in `stations`.

    The speed is interpolated in a straight line, except between two samples before which the vehicle brakes and after which the
    vehicle accelerates. Between two such samples the braking is continued and the acceleration is extended backwards, if this
    agrees better with the distance driven, because a straight line would lose a short stop between two samples. `spread` is None
    for exact stations.
    """
    interpolated: _Values = np.interp(at, times, speed)
    if len(times) < _AROUND:
        return interpolated
    durations, driven = np.diff(times), np.diff(station)
    slopes = np.diff(speed) / durations
    before, after, duration = slopes[:-2], slopes[2:], durations[1:-1]
    v0, v1 = speed[1:-2], speed[2:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = (v1 - after * duration - v0) / (before - after)
        lowest = v0 + before * turn
        # A vehicle that comes to rest before its acceleration begins stands until its acceleration begins.
        stands = lowest < 0.0
        way = np.where(
            stands,
            (v1**2 / after - v0**2 / before) / 2,
            (v0 + lowest) / 2 * turn + (lowest + v1) / 2 * (duration - turn),
        )
    dips = (before < 0.0) & (after > 0.0) & (v0 > 0.0) & (v1 > 0.0) & (turn > 0.0) & (turn < duration)
    tolerance = 0.0 if spread is None else (spread[1:-2] + spread[2:-1]) / 2
    dips &= np.abs(way - driven[1:-1]) <= np.abs((v0 + v1) / 2 * duration - driven[1:-1]) + tolerance
    for k in (np.flatnonzero(dips) + 1).tolist():
        inside = slice(*np.searchsorted(at, times[[k, k + 1]]))
        braking = speed[k] + slopes[k - 1] * (at[inside] - times[k])
        leaving = speed[k + 1] + slopes[k + 1] * (at[inside] - times[k + 1])
        interpolated[inside] = np.maximum(np.maximum(braking, leaving), 0.0)
    return interpolated


def unseen_stand(times: _Values, station: _Values, speed: _Values, at: _Values, interpolated: _Values) -> float:
    """Return the greatest error of the interpolated speeds if a vehicle stood between two samples before the line [m/s].

    The average speed of a vehicle that brakes to a standstill and sets off again is at most half of the higher of its two speeds.
    `interpolated` has the speeds at times `at` between the samples, which are given as in `stations`.
    """
    duration, driven = np.diff(times), np.diff(station)
    higher = np.maximum(speed[:-1], speed[1:])
    near = (station[1:] >= -NEAR) & (station[:-1] <= 0.0)
    doubtful = np.flatnonzero(near & (duration > _APART) & (driven <= (higher + PACE) * duration / 2))
    bounds = np.searchsorted(at, times)
    spans = [slice(bounds[k], bounds[k + 1]) for k in doubtful if bounds[k] < bounds[k + 1]]
    lowest = [float(interpolated[span].min(initial=np.inf)) for span in spans]
    return max((slow for slow in lowest if slow > PACE), default=0.0)
