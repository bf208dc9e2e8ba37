"""Reads tables of tracks: finds the column and unit of each field, and gathers the vehicles from the rows.

A table is a CSV file, or a table in memory: of pandas, polars or pyarrow, or a dictionary of columns. This module imports none of
the three libraries.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.tracks.correcting import LEAST_AGREEMENT, agreement
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.support.errors import RunError, suggest
from pytest_rvads.support.wording import one_line

_REQUIRED = ("time", "id", "x", "y")
_OPTIONAL = ("heading", "speed", "vx", "vy", "length", "width", "class", "case")
TEXTS = ("id", "class", "case")
"""Fields whose values are texts; the values of all other fields are numbers."""
_LENGTHS, _SPEEDS = {"m": 1.0, "ft": 0.3048}, {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "ft/s": 0.3048}
_UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "heading": {"rad": 1.0, "deg": math.pi / 180, "north": -math.pi / 180},
    "x": {**_LENGTHS, "deg": 1.0},
    "y": {**_LENGTHS, "deg": 1.0},
    **dict.fromkeys(("speed", "vx", "vy"), _SPEEDS),
    **dict.fromkeys(("length", "width"), _LENGTHS),
}
"""By field and name of a unit, the factor from the unit to the SI unit. The unit ``north`` is degrees clockwise from north.
Degrees of x and y are longitudes and latitudes, which stay degrees."""
_PLACES = {"x": ("longitude", "lon", "lng"), "y": ("latitude", "lat")}
"""Names of columns of x and y that are in degrees without a unit."""
_RATE = re.compile(r"(\d+(?:\.\d+)?)hz", re.IGNORECASE)
"""Pattern of the unit of a time that counts frames: the number of frames per second, as in ``time=frame:25hz``."""
_BODY_ANGLES = ("yaw", "psi", "theta", "yaw_rad", "psi_rad", "orientation", "yaw_deg:deg")
_USUAL_NAMES = {
    "time": ("time", "t", "timestamp", "time_s", "timestamp_s", "sim_time", "timestamp_ms:ms", "time_ms:ms", "timestamp_ns:ns"),
    "id": ("id", "track_id", "trackid", "vehicle_id", "vehicle", "agent_id", "object_id", "agent", "name"),
    "x": ("x", "x_m", "xcenter", "pos_x", "position_x", "x_center", "center_x", *_PLACES["x"]),
    "y": ("y", "y_m", "ycenter", "pos_y", "position_y", "y_center", "center_y", *_PLACES["y"]),
    "heading": (*_BODY_ANGLES, "heading", "heading_rad", "heading_deg:deg"),
    "speed": ("speed", "v", "velocity", "speed_mps", "speed_kmh:km/h", "speed_mph:mph"),
    "vx": ("vx", "xvelocity", "velocity_x", "v_x"),
    "vy": ("vy", "yvelocity", "velocity_y", "v_y"),
    "length": ("length", "l", "length_m"),
    "width": ("width", "w", "width_m"),
    "class": ("class", "type", "kind", "agent_type", "category", "object_type"),
}
"""Per field, names of columns that are tried if the user names no column, in lower case, with a unit after a colon. Of several
columns of angles, `log_of` takes one; columns of the angle of the body come before columns of any angle."""
PRESETS = {
    "ind": {
        "time": "frame:25hz",
        "id": "trackId",
        "x": "xCenter",
        "y": "yCenter",
        "heading": "heading:deg",
        "vx": "xVelocity",
        "vy": "yVelocity",
        "length": "length",
        "width": "width",
    },
    "interaction": {
        "time": "timestamp_ms:ms",
        "id": "track_id",
        "case": "case_id",
        "x": "x",
        "y": "y",
        "heading": "psi_rad",
        "vx": "vx",
        "vy": "vy",
        "length": "length",
        "width": "width",
        "class": "agent_type",
    },
    "fcd": {
        "time": "timestep_time",
        "id": "vehicle_id",
        "x": "vehicle_x",
        "y": "vehicle_y",
        "heading": "vehicle_angle:north",
        "speed": "vehicle_speed",
        "length": "vehicle_length",
        "width": "vehicle_width",
        "class": "vehicle_type",
    },
}
"""By name of a data set, the column of each field. Files can lack the columns of optional fields."""
_CLEARLY = 0.05
"""Difference of two agreements with the direction of motion that counts, see `agreement`."""
_CASE_LENGTH = 1000.0
"""Time between the starts of two cases of a file of INTERACTION [s]; a case is a scene of some seconds with a clock from zero."""
_BATCH = 200_000
"""Number of rows that are converted together."""
_WHERE = "table"


@dataclass(frozen=True, slots=True)
class Column:
    """The column of a table that holds the values of a field (such as time or x), with the unit of the values."""

    name: str
    factor: float = 1.0
    """Factor from the unit of the column to the SI unit."""
    unit: str = ""
    """Name of the unit; empty for the SI unit. Angles in the unit ``north`` are measured from north, others from east."""


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """A batch of rows of a table, with the values of each field."""

    numbers: Mapping[str, NDArray[np.float64]]
    """Numbers of each field, shape ``(rows,)``, in the unit of the column; NaN if the cell has no number."""
    texts: Mapping[str, Sequence[str]]
    """Values of the text fields (`TEXTS`)."""
    lines: NDArray[np.int64]
    """Line number of each row in the file, for messages, shape ``(rows,)``."""
    bad: Sequence[tuple[int, str, str]] = ()
    """Per bad row, its index in the batch, the field with the bad value, and the reason."""


def parse_pairs(text: str | None, option: str, example: str) -> dict[str, str] | None:
    """Return the pairs of an option in the form of an example such as ``time=t:ms,id=track``; None without a text."""
    if text is None:
        return None
    pairs = {}
    for part in text.split(","):
        name, equals, value = (side.strip() for side in part.partition("="))
        if not (equals and name and value):
            raise RunError(f"{option} takes pairs such as {example}, got {part!r:.60}")
        pairs[name] = value
    return pairs


def columns_of(
    columns: Mapping[str, str] | None, names: Sequence[str], where: str, *, preset: str | None = None
) -> dict[str, Column]:
    """Return the column of each field of a table.

    The user names in `columns` the column of a field, with a unit after a colon unless it has SI units. Other fields get the
    columns of the preset, or of the preset whose columns the table has if the user names neither; without one, those with usual
    names.
    """
    table_columns = {name.strip().lower(): name for name in reversed(names)}
    preset_columns = {} if preset is None else PRESETS[preset]
    if preset is None and columns is None:
        for known_columns in PRESETS.values():  # only some files have the column of a case
            needed = {text.partition(":")[0].lower() for field, text in known_columns.items() if field != "case"}
            if needed <= table_columns.keys():
                preset_columns = known_columns
                break
    named_columns = {} if columns is None else dict(columns)
    all_fields = (*_REQUIRED, *_OPTIONAL)
    for field in named_columns:
        if field not in all_fields:
            raise RunError(
                f"{where}: {field!r:.60} is no field of a track, known are {', '.join(all_fields)}{suggest(field, all_fields)}"
            )
    fields: dict[str, Column] = {}
    for field in all_fields:
        chosen = named_columns.get(field) or preset_columns.get(field)
        texts = (chosen,) if chosen else _USUAL_NAMES.get(field, ())
        for text in texts:
            column = _column(field, text, table_columns, where)
            if column is not None:
                fields.setdefault(f"{field} {column.name}" if field in fields else field, column)
                if field != "heading":
                    break
        if field not in fields and (field in named_columns or field in _REQUIRED):
            missing = f"column {texts[0]!r:.60}" if field in named_columns else f"column for the {field} ({', '.join(texts)})"
            column_list = one_line(", ".join(names[:20]), 300)
            raise RunError(f"{where}: row 1 has no {missing}, it has {column_list}: name it by --columns {field}=...")
    return fields


def _column(field: str, text: str, table_columns: Mapping[str, str], where: str) -> Column | None:
    """Return the column that a text such as ``t:ms`` names, with an optional unit after a colon; None if the table lacks it."""
    if text.strip().lower() in table_columns:
        unit = "deg" if text.strip().lower() in _PLACES.get(field, ()) else ""
        return Column(table_columns[text.strip().lower()], unit=unit)
    name, _, unit = text.rpartition(":")
    if name.strip().lower() not in table_columns:
        return None
    units = _UNITS.get(field, {})
    rate = _RATE.fullmatch(unit.strip()) if field == "time" else None
    if rate is not None and float(rate[1]) > 0.0:
        return Column(table_columns[name.strip().lower()], 1.0 / float(rate[1]))
    if unit not in units:
        offered = ", ".join((*units, *(["25hz"] if field == "time" else []))) or "no other unit"
        raise RunError(f"{where}: {unit!r:.40} is no unit of {field}, expected {offered}")
    return Column(table_columns[name.strip().lower()], units[unit], unit)


def log_of(
    chunks: Iterable[Rows], columns: Mapping[str, Column], where: str, *, strict: bool, classes: Mapping[str, str] | None = None
) -> Log:
    """Return the vehicles of a table."""
    column_names = {field: column.name for field, column in columns.items()}
    column_names.setdefault("speed", column_names.get("vx", "speed"))
    column_names["size"] = column_names.get("length", "length")
    batches = iter(chunks)
    first = list(islice(batches, 1))
    angles = {field: column for field, column in columns.items() if field.partition(" ")[0] == "heading"}
    angle = "heading"
    if first and len(angles) > 1:
        fits = {}
        for field in angles:
            tried = Gather(where, {})
            _add_rows(tried, *_with_angle(first[0], columns, field), {}, {})
            fits[field] = agreement(tried.log())
        # An angle that differs from the direction of motion is no heading, and an angle that is noise at rest is that direction.
        standing = {field: at_rest for field, (moving, at_rest) in fits.items() if moving >= LEAST_AGREEMENT}
        best = max(standing.values(), default=0.0)
        angle = next((field for field, at_rest in standing.items() if at_rest >= best - _CLEARLY), "heading")
    gather = Gather(where, column_names, strict=strict)
    cases: dict[str, int] = {}
    for rows in chain(first, batches):
        _add_rows(gather, *_with_angle(rows, columns, angle), cases, classes or {})
    log = gather.log()
    if len(angles) > 1:
        names = ", ".join(column.name for column in angles.values())
        note = f"{where}: of the angles {names}, {angles[angle].name} is the heading: name another by --columns heading=COLUMN"
        log = replace(log, notes=(*log.notes, note))
    return replace(log, degrees=columns["x"].unit == "deg")


def _with_angle(rows: Rows, columns: Mapping[str, Column], angle: str) -> tuple[Rows, Mapping[str, Column]]:
    """Return a batch and the columns with one of several angles as the heading; bad values of the other angles do not matter."""
    if angle not in columns:
        return rows, columns
    bad = [entry for entry in rows.bad if entry[1] == angle or entry[1].partition(" ")[0] != "heading"]
    numbers = {**rows.numbers, "heading": rows.numbers[angle]}
    return replace(rows, numbers=numbers, bad=bad), {**columns, "heading": columns[angle]}


def _add_rows(
    gather: Gather, rows: Rows, columns: Mapping[str, Column], cases: dict[str, int], classes: Mapping[str, str]
) -> None:
    nothing = np.full(len(rows.numbers["x"]), np.nan)
    times = rows.numbers["time"] * columns["time"].factor
    names = rows.texts["id"]
    if "case" in columns:
        numbers = [cases.setdefault(case, len(cases)) for case in rows.texts["case"]]
        times = times + _CASE_LENGTH * np.array(numbers, dtype=np.float64)
        names = [f"{case}.{name}" for case, name in zip(rows.texts["case"], names, strict=True)]
    x, y = (rows.numbers[field] * columns[field].factor for field in ("x", "y"))
    heading = rows.numbers.get("heading", nothing)
    if "heading" in columns:
        heading = heading * columns["heading"].factor + (math.pi / 2 if columns["heading"].unit == "north" else 0.0)
    speed = rows.numbers.get("speed")
    if speed is not None:
        speed = speed * columns["speed"].factor
    elif {"vx", "vy"} <= columns.keys():
        east, north = (rows.numbers[field] * columns[field].factor for field in ("vx", "vy"))
        # Noise increases the magnitude of a velocity on average, but does not increase its component along the heading.
        speed = east * np.cos(heading) + north * np.sin(heading) if "heading" in columns else np.hypot(east, north)
    table = np.column_stack((times, x, y, heading, nothing if speed is None else speed))

    def label(at: int) -> str:
        return rows.texts["class"][at] if "class" in rows.texts else classes.get(names[at], "")

    for at, field, why in rows.bad:
        if field in _REQUIRED or kind_of(label(at)) is not Kind.PEDESTRIAN:  # of pedestrians, nothing else is read
            gather.refuse(names[at], int(rows.lines[at]), field, why)
    codes: dict[str, int] = {}
    code = np.array([codes.setdefault(name, len(codes)) for name in names], dtype=np.int64)
    order = np.argsort(code, kind="stable")
    ends = np.cumsum(np.bincount(code, minlength=len(codes)))
    for name, begin, end in zip(codes, [0, *ends[:-1].tolist()], ends.tolist(), strict=True):
        rows_of_vehicle = order[begin:end]
        before, to_describe = gather.extend(name, rows.lines[rows_of_vehicle], table[rows_of_vehicle])
        for k in to_describe.tolist():
            at = int(rows_of_vehicle[k])
            sizes = [float(rows.numbers[f][at]) * columns[f].factor for f in ("length", "width") if f in rows.numbers]
            size = (sizes[0], sizes[1]) if len(sizes) == 2 and not any(map(math.isnan, sizes)) else None
            gather.describe(name, size, label(at), at=before + k)


def numbers_of(values: Any) -> tuple[NDArray[np.float64], list[int]]:
    """Return values as numbers, NaN for a value that is no number, and the indices of bad values, which are not empty."""
    with suppress(TypeError, ValueError, OverflowError):
        return np.asarray(values, dtype=np.float64), []
    numbers, wrong = np.full(len(values), np.nan), []
    for k, value in enumerate(values):
        try:
            numbers[k] = float(value)
        except (TypeError, ValueError, OverflowError):
            if value is not None and str(value).strip():
                wrong.append(k)
    return numbers, wrong


def is_table(source: object) -> bool:
    """Return whether a value is a table: a mapping of columns, or an object with the protocol of dataframes or of Arrow."""
    return isinstance(source, Mapping) or hasattr(source, "__dataframe__") or hasattr(source, "__arrow_c_stream__")


def read_table(table: Any, columns: Mapping[str, str] | None, *, strict: bool, preset: str | None = None) -> Log:
    """Return the vehicles of a table in memory; `columns_of` explains `columns` and `preset`. Messages count rows from 0."""
    try:
        # pandas and polars have the names in `columns`; pyarrow has the arrays in `columns` and the names in `column_names`.
        raw_names = table.keys() if isinstance(table, Mapping) else getattr(table, "column_names", None) or table.columns
        names = [str(name) for name in raw_names]
    except Exception as error:  # an unknown library may raise any error
        raise RunError(f"{_WHERE}: can't be read: {one_line(str(error))}") from error
    fields = columns_of(columns, names, _WHERE, preset=preset)
    values: dict[str, Any] = {}
    for field, column in fields.items():
        try:
            content = np.asarray(table[column.name])
        except Exception as error:  # an unknown library may raise any error
            raise RunError(f"{_WHERE}: column {column.name!r:.60} can't be read: {one_line(str(error))}") from error
        if content.ndim != 1:
            raise RunError(f"{_WHERE}: column {column.name!r:.60} must be a column of values, got the shape {content.shape}")
        durations = content.dtype.kind == "m"
        values[field] = content.astype("timedelta64[ns]").astype(np.float64) * 1e-9 if durations else content
    lengths = {column.name: len(values[field]) for field, column in fields.items()}
    if len(set(lengths.values())) > 1:
        raise RunError(f"{_WHERE}: its columns must be equally long, got {lengths}")
    return log_of(_batches(values, fields), fields, _WHERE, strict=strict)


def _batches(values: Mapping[str, Any], columns: Mapping[str, Column]) -> Iterator[Rows]:
    count = len(values["id"])
    for begin in range(0, count, _BATCH):
        batch = slice(begin, min(begin + _BATCH, count))
        numbers, texts = {}, {}
        bad: list[tuple[int, str, str]] = []
        for field in columns:
            values_of_batch: Sequence[Any] = values[field][batch].tolist()
            if field in TEXTS:
                # The ids 7 and 7.0 give the same text, because pandas has floats in a column with gaps.
                texts[field] = [
                    str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
                    for value in values_of_batch
                ]
                continue
            numbers[field], wrong = numbers_of(values[field][batch])
            bad += [(k, field, f"{one_line(repr(values_of_batch[k]), 60)} is no number") for k in wrong]
        yield Rows(numbers, texts, np.arange(batch.start, batch.stop), bad)
