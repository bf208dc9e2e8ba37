"""Samples of the vehicles of a log, independent of the log's format: the value that readers return and that matching takes.

A bad row costs its vehicle, and a vehicle that passes no junction is left out. Every output counts both, with the reason.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import RunError
from pytest_rvads.runs.bounds import FARTHEST
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Kind
from pytest_rvads.wording import one_line

__all__ = ["FIELDS", "LATEST", "Gather", "Log", "Samples", "kind_of"]

_Values = NDArray[np.float64]

FIELDS = ("time", "x", "y", "heading", "speed")
"""What a sample of a vehicle has; heading and speed may be missing."""
LATEST = 1e12
"""Largest time [s]: clocks may count from 1970, or in milliseconds by mistake."""
_MOST = {"time": LATEST, "x": FARTHEST, "y": FARTHEST, "heading": 1e6, "speed": 1e3}
"""Largest number of each that is still a time, a place, an angle or a speed."""
_MOST_SAMPLES = 20_000_000
"""Of a log: they take a gigabyte; an hour of a hundred vehicles at a time at 50 Hz."""
_MOST_VEHICLES = 200_000
_FASTEST, _JUMP = 60.0, 4.0
"""Fastest vehicle between two samples [m/s], on top of a jump of `_JUMP`. After a faster step the id belongs to another vehicle.
The jump is allowed because simulators of lanes move a vehicle from one lane to the next in one step."""
_UNSEEN = 1.0
"""Longest time between two samples after which size and class are not compared [s]. After a longer time the id may belong to
another vehicle."""
_OTHER = 0.3
"""Largest difference of length or width between two samples of one vehicle [m]; the boxes of a detector vary by less."""
_LONGEST = 100.0
"""Longest vehicle [m]."""
_KINDS = {
    Kind.TRUCK: ("truck", "lorry", "bus", "trailer", "coach"),
    Kind.CYCLIST: ("bicycl", "cyclist", "bike"),
    Kind.PEDESTRIAN: ("pedestrian", "walker", "person"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """One vehicle of a log; arrays have one row per sample."""

    name: str
    times: _Values
    """Increasing, shape ``(samples,)`` [s]."""
    points: _Values
    """x and y of the point that the log gives, shape ``(samples, 2)`` [m]."""
    heading: _Values | None = None
    """Counter-clockwise from east [rad]."""
    speed: _Values | None = None
    """Forward [m/s]."""
    size: tuple[float, float] | None = None
    """Length and width [m]."""
    kind: Kind = Kind.CAR
    ahead: float | None = None
    """How far ahead of the point the front bumper is [m]; None: as far as the point and the length say."""


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log, read."""

    where: str
    """Names it in messages."""
    vehicles: tuple[Samples, ...]
    refused: tuple[tuple[str, str], ...] = ()
    """Vehicles with a damaged row, and which one: file, row, column and why."""
    lights: Mapping[str, Changes] = field(default_factory=dict)
    """By id of a signal, as far as the log has them."""
    map: Path | None = None
    """OpenDRIVE file that it names as its map."""
    again: tuple[str, ...] = ()
    """A sentence per id that another vehicle uses again: file, row, why, and what that vehicle is called."""


@dataclass(frozen=True, slots=True)
class _Body:
    """What a log says of a vehicle from one of its samples on."""

    at: int
    size: tuple[float, float] | None = None
    kind: Kind = Kind.CAR
    ahead: float | None = None

    def differs(self, other: _Body) -> str:
        """Return how another body differs from this one, in words; empty where it does not."""
        if self.kind is not other.kind:
            return f"a {other.kind.name.lower()} and was a {self.kind.name.lower()}"
        sizes = None if self.size is None or other.size is None else (*self.size, *other.size)
        if sizes is not None and max(abs(sizes[0] - sizes[2]), abs(sizes[1] - sizes[3])) > _OTHER:
            return f"{sizes[2]:g} x {sizes[3]:g} m large and was {sizes[0]:g} x {sizes[1]:g} m"
        return ""


class Gather:
    """Gathers the rows of a log into vehicles; a bad row costs its vehicle.

    Args:
        where: names the log in messages.
        columns: what the log calls `FIELDS`, ``size``, ``id``; for messages.
        strict: a bad row is an error.
    """

    def __init__(self, where: str, columns: Mapping[str, str], *, strict: bool = False) -> None:
        self.where = where
        self._columns = columns
        self._strict = strict
        self._rows: dict[str, tuple[array[int], tuple[array[float], ...]]] = {}
        self._bodies: dict[str, list[_Body]] = {}
        self._refused: dict[str, str] = {}
        self._left, self._vehicles = _MOST_SAMPLES, 0
        self.lights: dict[str, Changes] = {}

    def add(self, name: str, row: int, numbers: tuple[float, ...]) -> bool:
        """Add a sample: `FIELDS`, of which heading and speed are NaN where the log has none.

        Returns:
            Whether `describe` is to be called: it is the first sample, or the vehicle may be another one by now.
        """
        found = self._rows.get(name)
        if found is None:
            found = self._rows[name] = self._begun(name, row)
        new = not found[0]
        if not new:
            time, x, y = (number - column[-1] for number, column in zip(numbers[:3], found[1][:3], strict=True))
            new = time > _UNSEEN or math.hypot(x, y) > _FASTEST * time + _JUMP
        found[0].append(row)
        for column, number in zip(found[1], numbers, strict=True):
            column.append(number)
        self._spend(1)
        return new

    def extend(self, name: str, rows: NDArray[np.int64], numbers: _Values) -> tuple[int, NDArray[np.int64]]:
        """Add samples of a vehicle, `numbers` of shape ``(samples, 5)``, see `add`.

        Returns:
            How many samples the vehicle had, and which of the new ones `describe` is to be called with.
        """
        found = self._rows.get(name)
        if found is None:
            found = self._rows[name] = self._begun(name, int(rows[0]))
        before = len(found[0])
        last = [column[-1] if before else np.nan for column in found[1][:3]]
        with np.errstate(invalid="ignore", over="ignore"):  # `log` refuses what is not finite
            steps = np.diff(np.vstack((last, numbers[:, :3])), axis=0)
            again = np.flatnonzero(~((steps[:, 0] <= _UNSEEN) & ~_jumped(steps)))
        found[0].frombytes(rows.astype("=q").tobytes())
        for column, values in zip(found[1], numbers.T, strict=True):
            column.frombytes(values.astype("=d").tobytes())
        self._spend(len(rows))
        return before, again

    def _spend(self, samples: int) -> None:
        self._left -= samples
        if self._left < 0:
            raise RunError(f"{self.where}: it has more than {_MOST_SAMPLES:,} samples: cut it into several files")

    def _another(self, vehicles: int = 1) -> None:
        self._vehicles += vehicles
        if self._vehicles > _MOST_VEHICLES:
            raise RunError(f"{self.where}: it has more than {_MOST_VEHICLES:,} vehicles: cut it into several files")

    def _begun(self, name: str, row: int) -> tuple[array[int], tuple[array[float], ...]]:
        self._another()
        if not name or len(name) > 200 or not name.isprintable():
            self.refuse(name, row, "id", f"{name!r:.60} is no name, expected 1 to 200 characters that can be printed")
        return array("q"), tuple(array("d") for _ in FIELDS)

    def describe(
        self,
        name: str,
        size: tuple[float, float] | None = None,
        kind: Kind = Kind.CAR,
        ahead: float | None = None,
        at: int | None = None,
    ) -> None:
        """Say what does not change about a vehicle: length and width [m], its kind, and how far ahead its front is [m].

        `at` is the number of its sample from which on another description than before holds; None: the last one.
        """
        bodies = self._bodies.setdefault(name, [])
        first = len(self._rows[name][0]) - 1 if at is None else at
        body = _Body(first if bodies else 0, size, kind, ahead)
        if not bodies or bodies[-1].differs(body):
            bodies.append(body)
            self._another(len(bodies) > 1)

    def refuse(self, name: str, row: int, column: str, why: str) -> None:
        """Leave a vehicle out because of what stands in a row of it.

        Raises:
            RunError: the reading is strict.
        """
        told = f"{self.where}: row {row}, column {self._columns.get(column, column)}: {why}"
        if self._strict:
            raise RunError(one_line(told))
        self._refused.setdefault(one_line(name, 60) or f"row {row}", one_line(told))

    def log(self) -> Log:
        """Return all that was gathered, and forget it."""
        vehicles: list[Samples] = []
        again: list[str] = []
        names = set(self._rows)
        while self._rows:
            name = next(iter(self._rows))
            rows, columns = self._rows.pop(name)
            if one_line(name, 60) in self._refused:
                continue
            numbers = np.array([np.frombuffer(column) for column in columns]) if len(rows) else np.zeros((len(FIELDS), 0))
            bodies = self._bodies.get(name, [_Body(0)])
            bad = self._bad(name, numbers, bodies)
            if bad is not None:
                self.refuse(name, rows[bad[0]], *bad[1:])
                continue
            own = name
            for number, (begin, end, body, why) in enumerate(_parted(numbers, bodies), start=1):
                if number > 1:
                    own = f"{name}#{number}"
                    while own in names:  # a vehicle of the log is called so
                        own += "'"
                    told = f"{self.where}: row {rows[begin]}: {name!r} is {why}: it is another vehicle, called {own}"
                    again.append(one_line(told))
                self._another(number > 1)
                times, x, y, *others = numbers[:, begin:end]
                heading, speed = (None if np.isnan(values).all() else values for values in others)
                points = np.column_stack((x, y))
                vehicles.append(Samples(own, times, points, heading, speed, body.size, body.kind, body.ahead))
        return Log(self.where, tuple(vehicles), tuple(self._refused.items()), self.lights, again=tuple(again))

    def _bad(self, name: str, numbers: _Values, bodies: Sequence[_Body]) -> tuple[int, str, str] | None:
        """Return which sample of a vehicle can't be, in which column, and why."""
        for column, values in zip(FIELDS, numbers, strict=True):
            if column in ("heading", "speed") and np.isnan(values).all():
                continue
            wrong = np.flatnonzero(~(np.abs(values) <= _MOST[column]))
            if len(wrong):
                return int(wrong[0]), column, f"{values[wrong[0]]:g} is no {column}, expected a number up to {_MOST[column]:g}"
        times = numbers[0]
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            at, before = times[back[0] + 1], times[back[0]]
            return int(back[0]) + 1, "time", f"{name!r} is at {at:g} s again or goes back, expected more than {before:g} s"
        track = numbers[:3].T
        jumps = np.flatnonzero(_jumped(np.diff(track, axis=0)))
        # A vehicle that is back where it was before a jump has not become another one.
        returns = ~_jumped(track[jumps[1:] + 1] - track[jumps[:-1]])
        wrong = jumps if self._strict else jumps[:-1][returns]
        if len(wrong):
            return int(wrong[0]) + 1, "x", f"{name!r} is {_away(numbers, int(wrong[0]) + 1)}"
        for body in bodies:
            if body.size is not None and not all(0.0 < number <= _LONGEST for number in body.size):
                what = f"{body.size[0]:g} x {body.size[1]:g} m is no size, expected more than 0 and up to {_LONGEST:g} m"
                return body.at, "size", what
        return None


def _jumped(steps: _Values) -> NDArray[np.bool_]:
    """Return which steps in time [s], x and y [m], of shape ``(steps, 3)``, no vehicle makes."""
    found: NDArray[np.bool_] = np.hypot(steps[:, 1], steps[:, 2]) > _FASTEST * steps[:, 0] + _JUMP
    return found


def _away(numbers: _Values, at: int) -> str:
    """Return how far a vehicle got in one step, in words."""
    time, x, y = numbers[:3, at] - numbers[:3, at - 1]
    return f"{math.hypot(x, y):.1f} m from where it was {time:g} s before"


def _parted(numbers: _Values, bodies: Sequence[_Body]) -> Iterator[tuple[int, int, _Body, str]]:
    """Yield for each vehicle of an id its first sample, the sample after its last, its body, and why it is a new vehicle."""
    why = {int(at) + 1: _away(numbers, int(at) + 1) for at in np.flatnonzero(_jumped(np.diff(numbers[:3].T, axis=0)))}
    for one, other in pairwise(bodies):
        why.setdefault(other.at, one.differs(other))
    starts = [body.at for body in bodies]
    for begin, end in pairwise([0, *sorted(why), numbers.shape[1]]):
        yield begin, end, bodies[bisect_right(starts, begin) - 1], why.get(begin, "")


def kind_of(text: str) -> Kind:
    """Return the kind of road user that a class in a log names; an unknown class is a car."""
    said = text.lower()
    return next((kind for kind, words in _KINDS.items() if any(word in said for word in words)), Kind.CAR)
