"""What a log says of its vehicles, whatever its format: the one value between those who read logs and those who match them."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
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
_FASTEST, _JUMP = 100.0, 4.0
"""Nobody gets on faster [m/s], nor jumps farther [m], between two samples: that is another vehicle of the same name.
A simulator that knows lanes only lets vehicles jump from one to the next."""
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
        self._sizes: dict[str, tuple[float, float] | None] = {}
        self._kinds: dict[str, Kind] = {}
        self._ahead: dict[str, float] = {}
        self._refused: dict[str, str] = {}
        self._left = _MOST_SAMPLES
        self.lights: dict[str, Changes] = {}

    def add(self, name: str, row: int, numbers: tuple[float, ...]) -> bool:
        """Add a sample: `FIELDS`, of which heading and speed are NaN where the log has none; return whether it is the first."""
        found = self._rows.get(name)
        new = found is None
        if found is None:
            found = self._rows[name] = self._begun(name, row)
        found[0].append(row)
        for column, number in zip(found[1], numbers, strict=True):
            column.append(number)
        self._spend(1)
        return new

    def extend(self, name: str, rows: NDArray[np.int64], numbers: _Values) -> None:
        """Add samples of a vehicle, `numbers` of shape ``(samples, 5)``, see `add`."""
        found = self._rows.get(name)
        if found is None:
            found = self._rows[name] = self._begun(name, int(rows[0]))
        found[0].frombytes(rows.astype("=q").tobytes())
        for column, values in zip(found[1], numbers.T, strict=True):
            column.frombytes(values.astype("=d").tobytes())
        self._spend(len(rows))

    def _spend(self, samples: int) -> None:
        self._left -= samples
        if self._left < 0:
            raise RunError(f"{self.where}: it has more than {_MOST_SAMPLES:,} samples: cut it into several files")

    def _begun(self, name: str, row: int) -> tuple[array[int], tuple[array[float], ...]]:
        if len(self._rows) >= _MOST_VEHICLES:
            raise RunError(f"{self.where}: it has more than {_MOST_VEHICLES:,} vehicles: cut it into several files")
        if not name or len(name) > 200 or not name.isprintable():
            self.refuse(name, row, "id", f"{name!r:.60} is no name, expected 1 to 200 characters that can be printed")
        return array("q"), tuple(array("d") for _ in FIELDS)

    def describe(
        self, name: str, size: tuple[float, float] | None = None, kind: Kind | None = None, ahead: float | None = None
    ) -> None:
        """Say what does not change about a vehicle: length and width [m], its kind, and how far ahead its front is [m]."""
        if size is not None:
            self._sizes[name] = size
        if kind is not None:
            self._kinds[name] = kind
        if ahead is not None:
            self._ahead[name] = ahead

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
        vehicles = []
        while self._rows:
            name = next(iter(self._rows))
            rows, columns = self._rows.pop(name)
            if one_line(name, 60) in self._refused:
                continue
            numbers = np.array([np.frombuffer(column) for column in columns]) if len(rows) else np.zeros((len(FIELDS), 0))
            bad = self._bad(name, numbers)
            if bad is not None:
                self.refuse(name, rows[bad[0]], *bad[1:])
                continue
            times, x, y, heading, speed = numbers
            vehicles.append(
                Samples(
                    name,
                    times,
                    np.column_stack((x, y)),
                    None if np.isnan(heading).all() else heading,
                    None if np.isnan(speed).all() else speed,
                    self._sizes.get(name),
                    self._kinds.get(name, Kind.CAR),
                    self._ahead.get(name),
                )
            )
        return Log(self.where, tuple(vehicles), tuple(self._refused.items()), self.lights)

    def _bad(self, name: str, numbers: _Values) -> tuple[int, str, str] | None:
        """Return which sample of a vehicle can't be, in which column, and why."""
        for column, values in zip(FIELDS, numbers, strict=True):
            if column in ("heading", "speed") and np.isnan(values).all():
                continue
            wrong = np.flatnonzero(~(np.abs(values) <= _MOST[column]))
            if len(wrong):
                return int(wrong[0]), column, f"{values[wrong[0]]:g} is no {column}, expected a number up to {_MOST[column]:g}"
        times, x, y = numbers[:3]
        back = np.flatnonzero(np.diff(times) <= 0.0)
        if len(back):
            at, before = times[back[0] + 1], times[back[0]]
            return int(back[0]) + 1, "time", f"{name!r} is at {at:g} s again or goes back, expected more than {before:g} s"
        moved = np.hypot(np.diff(x), np.diff(y))
        jumps = np.flatnonzero(moved > _FASTEST * np.diff(times) + _JUMP)
        if len(jumps):
            k = int(jumps[0])
            return k + 1, "x", f"{name!r} is {moved[k]:.1f} m from where it was {times[k + 1] - times[k]:g} s before"
        size = self._sizes.get(name)
        if size is not None and not all(0.0 < number <= _LONGEST for number in size):
            return 0, "size", f"{size[0]:g} x {size[1]:g} m is no size, expected more than 0 and up to {_LONGEST:g} m"
        return None


def kind_of(text: str) -> Kind:
    """Return which kind of road user a log means; what is none of the others is a car."""
    said = text.lower()
    return next((kind for kind, words in _KINDS.items() if any(word in said for word in words)), Kind.CAR)
