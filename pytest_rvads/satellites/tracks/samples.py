"""Samples of the vehicles of a log, independent of the log's format. Readers return a `Log`, and matching takes a `Log`.

A vehicle with a bad row is left out, as is a vehicle that passes no junction. Every output counts these vehicles by reason.
"""

from __future__ import annotations

import cmath
import math
from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import PERSON
from pytest_rvads.runs.archive import FARTHEST
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Kind
from pytest_rvads.support.errors import RunError, suggest
from pytest_rvads.support.wording import one_line

_Values = NDArray[np.float64]

FIELDS = ("time", "x", "y", "heading", "speed")
"""Fields of a sample of a vehicle; a log can lack heading and speed."""
LATEST = 1e12
"""Largest time that is accepted [s]: some clocks count from 1970, and some logs give milliseconds as seconds by mistake."""
_LARGEST = {"time": LATEST, "x": FARTHEST, "y": FARTHEST, "heading": 1e6, "speed": 1e3}
"""Largest absolute value per field; a larger number is an error of the log."""
_MOST_SAMPLES = 20_000_000
"""Largest number of samples of a log: an hour of a hundred vehicles at 50 Hz, which takes a gigabyte of memory."""
_MOST_VEHICLES = 200_000
"""Largest number of vehicles of a log."""
_FASTEST, _JUMP = 60.0, 4.0
"""Between two samples, a vehicle moves at most `_JUMP` [m] plus the distance at speed `_FASTEST` [m/s]; after a longer move, the
id belongs to another vehicle. `_JUMP` is allowed because some simulators move a vehicle to another lane in one step."""
_COMPARABLE_TIME = 1.0
"""Size and class of a vehicle are compared with its earlier size and class only after a jump, or after a longer gap between
samples than this [s], because only then can the id belong to another vehicle."""
_SIZE_TOLERANCE = 0.3
"""Largest difference of length or width between samples of the same vehicle [m]; boxes of a detector vary by less."""
_CARS = ("car", "passenger", "van", "taxi", "auto", "default_vehtype")
"""Words for cars in the classes of logs; SUMO's default type of vehicle is a passenger car."""
_LONGEST = 100.0
"""Greatest length or width of a vehicle that is accepted [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The samples of a vehicle of a log; each array has a row per sample."""

    name: str
    times: _Values
    """Increasing times of the samples, shape ``(samples,)`` [s]."""
    points: _Values
    """x and y of the recorded point of the vehicle, shape ``(samples, 2)`` [m]."""
    heading: _Values | None = None
    """Heading, counter-clockwise from east, shape ``(samples,)`` [rad]."""
    speed: _Values | None = None
    """Forward speed, shape ``(samples,)`` [m/s]."""
    size: tuple[float, float] | None = None
    """Length and width [m]."""
    kind: Kind = Kind.CAR
    ahead: float | None = None
    """Distance from the recorded point to the front bumper [m]; None if it follows from the kind of point and the length."""
    label: str = ""
    """Class of the vehicle in the words of the log; empty if the log states none, or the kind by a code of its own."""

    def moved(self, turn: complex, shift: complex) -> Samples:
        """Return the vehicle after a similarity: the point ``x + y * 1j`` goes to ``turn * point + shift`` [m]."""
        places = turn * (self.points @ np.array([1.0, 1j])) + shift
        heading = None if self.heading is None else self.heading + cmath.phase(turn)
        speed = None if self.speed is None else self.speed * abs(turn)
        return replace(self, points=np.column_stack((places.real, places.imag)), heading=heading, speed=speed)


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """The content of a log of traffic: vehicles with their samples, lights, and left-out vehicles."""

    where: str
    """Name of the log in messages."""
    vehicles: tuple[Samples, ...]
    refused: tuple[tuple[str, str], ...] = ()
    """Per vehicle that was left out because of a bad row, its name and a sentence that names file, row, column and reason."""
    lights: Mapping[str, Changes] = field(default_factory=dict)
    """Changes of colour by id of the signal; empty if the log has no lights."""
    map: Path | None = None
    """Path of the map file that the log names; None if the log names no map."""
    reused_ids: tuple[str, ...] = ()
    """Per vehicle whose id an earlier vehicle had, a sentence that names file, row, reason, and the new name of the vehicle."""
    notes: tuple[str, ...] = ()
    """What a user should know about the reading of the log, a sentence each."""
    degrees: bool = False
    """Whether x and y of the vehicles are degrees of longitude and latitude."""
    utm: complex | None = None
    """UTM coordinates of the origin of x and y, as ``east + north * 1j`` [m]; None if the log does not name its place."""

    def moved(self, turn: complex, shift: complex) -> Log:
        """Return the log after a similarity of all vehicles, see `Samples.moved`."""
        return replace(self, vehicles=tuple(vehicle.moved(turn, shift) for vehicle in self.vehicles), utm=None)

    def of_kinds(self, kinds: Mapping[str, str]) -> Log:
        """Return the log with a kind of road user for each class in `kinds`; a note names classes of unknown kind."""
        for name, kind in kinds.items():
            if kind not in tuple(Kind):
                raise RunError(
                    f"the kind of class {name!r:.60} must be {', '.join(Kind)}, got {kind!r:.60}{suggest(kind, tuple(Kind))}"
                )
        vehicles, unknown = [], Counter[str]()
        for vehicle in self.vehicles:
            named = next((kinds[name] for name in (vehicle.label, *vehicle.label.split()) if name in kinds), None)
            if named is not None:
                vehicle = replace(vehicle, kind=Kind(named), size=None if named == Kind.PEDESTRIAN else vehicle.size, ahead=None)
            elif vehicle.label and vehicle.kind is Kind.CAR and not any(word in vehicle.label.lower() for word in _CARS):
                unknown[vehicle.label] += 1
            vehicles.append(vehicle)
        counts = one_line(", ".join(f"{name} ({count})" for name, count in unknown.items()), 300)
        note = (
            f"{self.where}: road users of unknown classes are taken for cars: {counts}: name their kinds by --classes CLASS=KIND"
        )
        return replace(self, vehicles=tuple(vehicles), notes=(*self.notes, *([note] if unknown else [])))


@dataclass(frozen=True, slots=True)
class _Body:
    """Size and kind of a vehicle, as the log states them from a certain sample on."""

    at: int
    """Number of the first sample for which this size and kind hold."""
    size: tuple[float, float] | None = None
    kind: Kind = Kind.CAR
    ahead: float | None = None
    label: str = ""

    def differs(self, other: _Body) -> str:
        """Return in words how another body differs from this body; empty if the bodies agree."""
        if self.kind is not other.kind:
            return f"a {other.kind.name.lower()} and was a {self.kind.name.lower()}"
        sizes = None if self.size is None or other.size is None else (*self.size, *other.size)
        if sizes is not None and max(abs(sizes[0] - sizes[2]), abs(sizes[1] - sizes[3])) > _SIZE_TOLERANCE:
            return f"{sizes[2]:g} x {sizes[3]:g} m large and was {sizes[0]:g} x {sizes[1]:g} m"
        return ""


class Gather:
    """Gathers the rows of a log into vehicles; a vehicle with a bad row is left out, or is an error if the reading is strict.

    `columns` has, for messages, the column of the log per field (`FIELDS`, ``size`` and ``id``).
    """

    def __init__(self, where: str, columns: Mapping[str, str], *, strict: bool = False) -> None:
        self.where = where
        self._columns = columns
        self._strict = strict
        self._rows: dict[str, tuple[array[int], tuple[array[float], ...]]] = {}
        self._bodies: dict[str, list[_Body]] = {}
        self._refused: dict[str, str] = {}
        self._samples = self._vehicles = 0
        self.lights: dict[str, Changes] = {}

    def add(self, name: str, row: int, numbers: tuple[float, ...]) -> bool:
        """Add a sample of a vehicle."""
        series = self._series(name, row)
        new = not series[0]
        if not new:
            time, x, y = (number - column[-1] for number, column in zip(numbers[:3], series[1][:3], strict=True))
            new = time > _COMPARABLE_TIME or math.hypot(x, y) > _FASTEST * time + _JUMP
        series[0].append(row)
        for column, number in zip(series[1], numbers, strict=True):
            column.append(number)
        self._count(samples=1)
        return new

    def extend(self, name: str, rows: NDArray[np.int64], numbers: _Values) -> tuple[int, NDArray[np.int64]]:
        """Add several samples of a vehicle, with the shape ``(samples, 5)``; `rows` are the numbers of their rows in the log."""
        series = self._series(name, int(rows[0]))
        before = len(series[0])
        last = [column[-1] if before else np.nan for column in series[1][:3]]
        with np.errstate(invalid="ignore", over="ignore"):  # `log` refuses numbers that are not finite
            steps = np.diff(np.vstack((last, numbers[:, :3])), axis=0)
            to_describe = np.flatnonzero(~((steps[:, 0] <= _COMPARABLE_TIME) & ~_impossible_steps(steps)))
        series[0].frombytes(rows.astype("=q").tobytes())
        for column, values in zip(series[1], numbers.T, strict=True):
            column.frombytes(values.astype("=d").tobytes())
        self._count(samples=len(rows))
        return before, to_describe

    def _count(self, *, samples: int = 0, vehicles: int = 0) -> None:
        self._samples += samples
        self._vehicles += vehicles
        if self._samples > _MOST_SAMPLES:
            raise RunError(f"{self.where}: the log has more than {_MOST_SAMPLES:,} samples: cut the log into several files")
        if self._vehicles > _MOST_VEHICLES:
            raise RunError(f"{self.where}: the log has more than {_MOST_VEHICLES:,} vehicles: cut the log into several files")

    def _series(self, name: str, row: int) -> tuple[array[int], tuple[array[float], ...]]:
        """Return rows and fields of the samples of a vehicle; `row` is the row of the next sample."""
        if name not in self._rows:
            self._count(vehicles=1)
            if not name or len(name) > 200 or not name.isprintable():
                self.refuse(name, row, "id", f"{name!r:.60} is no name, expected 1 to 200 printable characters")
            self._rows[name] = array("q"), tuple(array("d") for _ in FIELDS)
        return self._rows[name]

    def describe(
        self,
        name: str,
        size: tuple[float, float] | None = None,
        kind: Kind | str = Kind.CAR,
        ahead: float | None = None,
        at: int | None = None,
    ) -> None:
        """Set size and kind of a vehicle from the sample `at` on; None for the sample that was added last.

        A pedestrian is a circle of the diameter `PERSON` about the middle of its recorded body, and has no size here, because
        some data sets state 0.
        """
        bodies = self._bodies.setdefault(name, [])
        first = len(self._rows[name][0]) - 1 if at is None else at
        label, kind = ("", kind) if isinstance(kind, Kind) else (one_line(kind.strip(), 60), kind_of(kind))
        if kind is Kind.PEDESTRIAN:
            ahead = None if ahead is None or size is None else ahead + (PERSON - size[0]) / 2
            size = None
        body = _Body(first if bodies else 0, size, kind, ahead, label)
        if not bodies or bodies[-1].differs(body):
            bodies.append(body)
            self._count(vehicles=len(bodies) > 1)

    def refuse(self, name: str, row: int, column: str, why: str) -> None:
        """Leave a vehicle out because of a bad row."""
        message = f"{self.where}: row {row}, column {self._columns.get(column, column)}: {why}"
        if self._strict:
            raise RunError(one_line(message))
        self._refused.setdefault(one_line(name, 60) or f"row {row}", one_line(message))

    def log(self) -> Log:
        """Return all gathered vehicles as a `Log`, and remove them from this object."""
        vehicles: list[Samples] = []
        reused_ids: list[str] = []
        names = set(self._rows)
        while self._rows:
            name = next(iter(self._rows))
            rows, columns = self._rows.pop(name)
            if one_line(name, 60) in self._refused:
                continue
            numbers = np.array([np.frombuffer(column) for column in columns]) if len(rows) else np.zeros((len(FIELDS), 0))
            bodies = self._bodies.get(name, [_Body(0)])
            if all(body.kind is Kind.PEDESTRIAN for body in bodies):  # their places alone are read
                for column, values in zip(FIELDS[3:], numbers[3:], strict=True):
                    if not (np.abs(values) <= _LARGEST[column]).all():
                        values[:] = np.nan
            reason = self._first_bad_sample(name, numbers, bodies)
            if reason is not None:
                self.refuse(name, rows[reason[0]], *reason[1:])
                continue
            unique_name = name
            for number, (begin, end, body, why) in enumerate(_split_by_vehicle(numbers, bodies), start=1):
                if number > 1:
                    unique_name = f"{name}#{number}"
                    while unique_name in names:  # the log itself has a vehicle with this name
                        unique_name += "'"
                    sentence = f"{self.where}: row {rows[begin]}: {name!r} is {why}: this is another vehicle, named {unique_name}"
                    reused_ids.append(one_line(sentence))
                self._count(vehicles=number > 1)
                times, x, y, *optional = numbers[:, begin:end]
                heading, speed = (None if np.isnan(values).all() else values for values in optional)
                points = np.column_stack((x, y))
                vehicles.append(Samples(unique_name, times, points, heading, speed, body.size, body.kind, body.ahead, body.label))
        return Log(self.where, tuple(vehicles), tuple(self._refused.items()), self.lights, reused_ids=tuple(reused_ids))

    def _first_bad_sample(self, name: str, numbers: _Values, bodies: Sequence[_Body]) -> tuple[int, str, str] | None:
        """Return the first impossible sample of a vehicle, its field, and the reason; None if all samples are possible."""
        for column, values in zip(FIELDS, numbers, strict=True):
            if column in ("heading", "speed") and np.isnan(values).all():
                continue
            bad = ~(np.abs(values) <= _LARGEST[column])
            if bad.any():
                at = int(bad.argmax())
                return at, column, f"{values[at]:g} is no {column}, expected a number up to {_LARGEST[column]:g}"
        times = numbers[0]
        back = np.diff(times) <= 0.0
        if back.any():
            at = int(back.argmax()) + 1
            return at, "time", f"the time of {name!r} is {times[at]:g} s, expected more than {times[at - 1]:g} s"
        track = numbers[:3].T
        jumps = np.flatnonzero(_impossible_steps(np.diff(track, axis=0)))
        # If a second jump leads back to where the vehicle was before the first jump, the positions between the jumps are wrong.
        returns = ~_impossible_steps(track[jumps[1:] + 1] - track[jumps[:-1]])
        bad_rows = jumps if self._strict else jumps[:-1][returns]
        if len(bad_rows):
            at = int(bad_rows[0]) + 1
            return at, "x", f"{name!r} is {_jump_in_words(numbers, at)}"
        for body in bodies:
            if body.size is not None and not all(0.0 < number <= _LONGEST for number in body.size):
                reason = f"{body.size[0]:g} x {body.size[1]:g} m is no size, expected more than 0 and up to {_LONGEST:g} m"
                return body.at, "size", reason
        return None


def _impossible_steps(steps: _Values) -> NDArray[np.bool_]:
    """Return, for each step between samples, in time [s], x [m] and y [m], whether it is too long for a vehicle."""
    too_far: NDArray[np.bool_] = np.hypot(steps[:, 1], steps[:, 2]) > _FASTEST * steps[:, 0] + _JUMP
    return too_far


def _jump_in_words(numbers: _Values, at: int) -> str:
    """Return, in words, how far the vehicle moved between the sample `at` and the sample before `at`."""
    time, x, y = numbers[:3, at] - numbers[:3, at - 1]
    return f"{math.hypot(x, y):.1f} m from where it was {time:g} s before"


def _split_by_vehicle(numbers: _Values, bodies: Sequence[_Body]) -> Iterator[tuple[int, int, _Body, str]]:
    """Yield, per vehicle that used an id, its first sample, the end of its samples, its body, and why it is another."""
    why = {
        int(at) + 1: _jump_in_words(numbers, int(at) + 1)
        for at in np.flatnonzero(_impossible_steps(np.diff(numbers[:3].T, axis=0)))
    }
    for earlier, later in pairwise(bodies):
        why.setdefault(later.at, earlier.differs(later))
    starts = [body.at for body in bodies]
    for begin, end in pairwise([0, *sorted(why), numbers.shape[1]]):
        yield begin, end, bodies[bisect_right(starts, begin) - 1], why.get(begin, "")


def kind_of(text: str) -> Kind:
    """Return the kind of road user for a class named in a log; an unknown class is a car.

    The class ``pedestrian/bicycle`` of the data set INTERACTION is a pedestrian, who is matched to crosswalks only.
    """
    lowered = text.lower()
    if lowered == "pedestrian/bicycle":
        return Kind.PEDESTRIAN
    return next((kind for kind in Kind if kind is not Kind.CAR and any(word in lowered for word in kind.words)), Kind.CAR)
