"""Traffic that is still being recorded: states as they come, and recordings of the vehicles that can be judged by now.

A vehicle can be judged when it and everybody who was there with it have gone: then it is known which way each of them took, and
who waited for whom. What is kept is bounded by how many vehicles are there at a time, and for how long.
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
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Facts, Run
from pytest_rvads.runs.smoothing import smoothed
from pytest_rvads.runs.states import Agent, Colour

__all__ = ["GONE_AFTER", "LONGEST", "State", "Stream", "track_of"]

GONE_AFTER = 2.0
"""Who has not been seen for this long has gone [s]."""
LONGEST = 300.0
"""Nobody is waited for, and nothing is kept, for much longer than this [s]: who parks keeps nobody from being judged."""
FAR = 2.0
"""Whose way is farther than this from every way through the junction, root mean square, does not cross it [m]."""

_Place = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
_LightColour = {"none": Colour.NONE, "green": Colour.GREEN, "yellow": Colour.YELLOW, "red": Colour.RED}


class SeenVehicle(msgspec.Struct, frozen=True):
    """A vehicle in a line."""

    id: Name
    x: _Place
    """East coordinate of the middle of its front bumper [m]."""
    y: _Place
    """North coordinate [m]."""
    heading: _Place
    """Counter-clockwise from east [rad]."""
    speed: _Place | None = None
    """Forward [m/s]; worked out from the positions where no line tells it."""
    length: Size | None = None
    width: Size | None = None
    to: int | None = None
    """Number of the exit that it leaves by, where that is known."""


class State(msgspec.Struct, frozen=True):
    """A line: what is seen at one time."""

    t: _Place
    """On the clock of the log [s]."""
    vehicles: tuple[SeenVehicle, ...] = ()
    lights: dict[str, str] = {}
    """By the number of the entrance: green, yellow, red or none, which holds until another line tells it again."""


@dataclass(slots=True)
class _Seen:
    """What has been seen of a vehicle."""

    first: SeenVehicle
    times: list[float] = field(default_factory=list)
    rows: list[tuple[float, float, float, float | None]] = field(default_factory=list)
    judged: bool = False

    @property
    def span(self) -> tuple[float, float]:
        """When it was there [s]."""
        return self.times[0], self.times[-1]


class Stream:
    """Reads states line by line, and yields runs in which vehicles can be judged.

    Args:
        label: begins the labels of the runs.
        junction: where the vehicles drive.
        facts: the speed limit.
        position_accuracy: standard deviation of a position [m]; 0: exact.
    """

    def __init__(self, label: str, junction: Junction, facts: Facts | None = None, position_accuracy: float = 0.0) -> None:
        self._label, self._junction, self._facts = label, junction, facts or Facts()
        self._accuracy = position_accuracy
        self._now: float | None = None
        self._there: dict[str, _Seen] = {}
        self._past: list[_Seen] = []
        self._lights: dict[int, list[tuple[float, Colour]]] = {}
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
        shown = [(self._entrance(key, where), _colour(name, where)) for key, name in state.lights.items()]
        self._now = state.t
        for entrance, colour in shown:
            self._lights.setdefault(entrance, []).append((state.t, colour))
        for vehicle in state.vehicles:
            seen = self._there.get(vehicle.id)
            if seen is None:
                seen = self._there[vehicle.id] = _Seen(vehicle)
            seen.times.append(state.t)
            seen.rows.append((vehicle.x, vehicle.y, vehicle.heading, vehicle.speed))
        gone = [name for name, seen in self._there.items() if seen.span[1] < state.t - GONE_AFTER]
        self._past += [self._there.pop(name) for name in gone]
        return self._ready(state.t) if gone else iter(())

    def end(self) -> Iterator[Run]:
        """Return the runs of everybody who has not been judged: nothing more comes."""
        self._past += self._there.values()
        self._there.clear()
        return self._ready(np.inf)

    def _entrance(self, key: str, where: str) -> int:
        if not key.isdecimal() or int(key) >= len(self._junction.entrances):
            raise RunError(
                f"{where}: lights must go by the number of an entrance, 0 to {len(self._junction.entrances) - 1}, got {key!r:.40}"
            )
        return int(key)

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
        for entrance, changes in self._lights.items():
            last = max((k for k, (time, _) in enumerate(changes) if time <= before), default=0)
            self._lights[entrance] = changes[last:]

    def _runs(self, ready: list[_Seen]) -> Iterator[Run]:
        names = {seen.first.id for seen in ready}
        begin, end = min(seen.span[0] for seen in ready), max(seen.span[1] for seen in ready)
        tracks = []
        for seen in (*self._past, *self._there.values()):
            if seen.span[0] <= end and seen.span[1] >= begin:
                found = track_of(self._junction, seen.first, seen.times, seen.rows, self._accuracy)
                if isinstance(found, Track):
                    tracks.append(found)
                elif seen.first.id in names:
                    self.left_out[found] = self.left_out.get(found, 0) + 1
        lights = {
            entrance: Changes(np.array([t for t, _ in changes]), np.array([c for _, c in changes], dtype=np.int8))
            for entrance, changes in self._lights.items()
        }
        recording = Recording(self._label, self._junction, tuple(tracks), lights, self._facts, self._accuracy)
        for run in recording:
            if run.excerpt is None or run.excerpt.judged is None:
                yield run
                continue
            mine = tuple(name for name in run.excerpt.judged if name in names)
            if mine:
                yield replace(run, excerpt=replace(run.excerpt, judged=mine))


def track_of(
    junction: Junction,
    vehicle: SeenVehicle,
    times: list[float],
    rows: list[tuple[float, float, float, float | None]],
    accuracy: float,
) -> Track | str:
    """Return what was seen of a vehicle along the way through the junction that is nearest to it, or why it took none.

    Args:
        junction: where it drives.
        vehicle: its name, size and exit.
        times: shape ``(samples,)`` [s].
        rows: x [m], y [m], heading [rad] and speed [m/s] of its reference point.
        accuracy: standard deviation of a position [m].
    """
    if len(times) < 2:
        return "seen only once"
    pose = np.array([row[:3] for row in rows])
    best: tuple[float, Itinerary, np.ndarray] | None = None
    for entrance, exit in sorted(junction.movements):
        if vehicle.to is not None and exit != vehicle.to:
            continue
        way = Itinerary.through(junction, entrance, exit)
        station, beside = _project(way, pose[:, :2])
        offset = float(np.sqrt(np.mean(np.minimum(np.abs(beside), 10.0) ** 2)))
        if station.max() > 0.0 and station.min() < way.length and (best is None or offset < best[0]):
            best = offset, way, station
    if best is None or best[0] > FAR:
        return "never on a way through the junction"
    offset, way, station = best
    kept = (station > -way.origin) & (station < way.end)
    if kept.sum() < 2:
        return "never on a way through the junction"
    speeds = [row[3] for row in rows]
    given = None if None in speeds else np.array(speeds, dtype=np.float64)[kept]
    at = np.array(times)[kept]
    along, speed, spread = smoothed(at, station[kept], given, accuracy)
    size = None if vehicle.length is None or vehicle.width is None else (vehicle.length, vehicle.width)
    agent = Agent(vehicle.id, junction.movements[way.entrance, way.exit], size=size)
    return Track(agent, at, along, speed, pose[kept], spread, offset)


def _project(way: Itinerary, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stations and offsets to the left of points on the nearest part of a way, each of shape ``(points,)`` [m]."""
    line, arc = way.path.points, way.path.stations
    ahead, long = np.diff(line, axis=0) / np.diff(arc)[:, None], np.diff(arc)
    apart = points[:, None] - line[None, :-1]
    along = (apart * ahead).sum(axis=2)
    low, high = np.zeros(len(long)), long.copy()
    low[0], high[-1] = -np.inf, np.inf
    along = np.clip(along, low, high)
    rest = apart - along[:, :, None] * ahead
    piece = (rest**2).sum(axis=2).argmin(axis=1)
    at = np.arange(len(points))
    left = ahead[piece, 0] * apart[at, piece, 1] - ahead[piece, 1] * apart[at, piece, 0]
    return arc[piece] + along[at, piece] - way.origin, left


def _colour(name: str, where: str) -> Colour:
    if name not in _LightColour:
        raise RunError(f"{where}: the colour of a light must be {' or '.join(_LightColour)}, got {name!r:.40}")
    return _LightColour[name]
