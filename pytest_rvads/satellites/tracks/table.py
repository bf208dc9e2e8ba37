"""Tables of tracks: which column holds what, and in which unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import RunError, suggest
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.wording import one_line

__all__ = ["PRESETS", "TEXTS", "Column", "Rows", "columns_of", "log_of", "numbers_of", "parse_columns"]

_REQUIRED = ("time", "id", "x", "y")
_OPTIONAL = ("heading", "speed", "vx", "vy", "length", "width", "class", "case")
TEXTS = ("id", "class", "case")
"""Fields that are texts, not numbers."""
_UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "heading": {"rad": 1.0, "deg": math.pi / 180, "north": -math.pi / 180},
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6},
    "vx": {"m/s": 1.0, "km/h": 1 / 3.6},
    "vy": {"m/s": 1.0, "km/h": 1 / 3.6},
}
"""Per field what a number is multiplied by; ``north``: degrees clockwise from north."""
_RATE = re.compile(r"(\d+(?:\.\d+)?)hz", re.IGNORECASE)
"""A unit of time: so many rows a second, as in ``time=frame:25hz``."""
_USUAL = {
    "time": ("time", "t", "timestamp", "time_s", "timestamp_s", "sim_time", "timestamp_ms:ms", "time_ms:ms", "timestamp_ns:ns"),
    "id": ("id", "track_id", "trackid", "vehicle_id", "vehicle", "agent_id", "object_id", "agent", "name"),
    "x": ("x", "x_m", "xcenter", "pos_x", "position_x", "x_center", "center_x"),
    "y": ("y", "y_m", "ycenter", "pos_y", "position_y", "y_center", "center_y"),
    "heading": ("heading", "yaw", "psi", "theta", "psi_rad", "heading_rad", "yaw_rad", "heading_deg:deg", "yaw_deg:deg"),
    "speed": ("speed", "v", "velocity", "speed_mps", "speed_kmh:km/h"),
    "vx": ("vx", "xvelocity", "velocity_x", "v_x"),
    "vy": ("vy", "yvelocity", "velocity_y", "v_y"),
    "length": ("length", "l", "length_m"),
    "width": ("width", "w", "width_m"),
    "class": ("class", "type", "kind", "agent_type", "category", "object_type"),
}
"""Names that columns usually have, in small letters."""
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
}
"""Columns of data sets; those that a file has not are left out, where they are not needed."""


@dataclass(frozen=True, slots=True)
class Column:
    """Where a field stands, and by what its numbers are multiplied."""

    name: str
    factor: float = 1.0
    north: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The rows of a table, by field."""

    numbers: Mapping[str, NDArray[np.float64]]
    """Of shape ``(rows,)``, NaN where there is none."""
    texts: Mapping[str, Sequence[str]]
    """Values of the text fields (`TEXTS`)."""
    lines: NDArray[np.int64]
    """Line number of each row in the file, for messages, shape ``(rows,)``."""
    bad: Sequence[tuple[int, str, str]] = ()
    """Bad rows: index, field and reason."""


def parse_columns(text: str) -> dict[str, str]:
    """Return the columns of a text such as ``time=t:ms,id=track,x=X,y=Y,heading=yaw:deg``.

    Raises:
        RunError: another kind of text.
    """
    found = {}
    for part in text.split(","):
        name, equals, column = part.partition("=")
        if not (equals and name.strip() and column.strip()):
            raise RunError(f"--columns takes pairs such as time=t:ms,id=track,x=X,y=Y,heading=yaw:deg, got {part!r:.60}")
        found[name.strip()] = column.strip()
    return found


def columns_of(
    given: Mapping[str, str] | None, names: Sequence[str], where: str, *, preset: str | None = None
) -> dict[str, Column]:
    """Return where the fields of a table stand.

    Args:
        given: field to column, with a unit after a colon where it is not the usual one; None: found by the usual names.
        names: the columns that there are.
        where: begins messages.
        preset: a name in `PRESETS` that `given` is added to; None: one that fits.

    Raises:
        RunError: a field, column or unit that is not known, or one that is needed and missing.
    """
    known = {name.strip().lower(): name for name in reversed(names)}
    chosen = PRESETS.get(preset or (_fitting(known) if given is None else ""), {})
    told = {} if given is None else dict(given)
    for field in told:
        if field not in (*_REQUIRED, *_OPTIONAL):
            fields = (*_REQUIRED, *_OPTIONAL)
            raise RunError(
                f"{where}: {field!r:.60} is no field of a track, known are {', '.join(fields)}{suggest(field, fields)}"
            )
    found = {}
    for field in (*_REQUIRED, *_OPTIONAL):
        texts = (told[field],) if field in told else (chosen[field],) if field in chosen else _USUAL.get(field, ())
        for text in texts:
            column = _column(field, text, known, where)
            if column is not None:
                found[field] = column
                break
        else:
            if field in told or field in _REQUIRED:
                wanted = f"column {told[field]!r:.60}" if field in told else f"column for the {field} ({', '.join(texts)})"
                listed = one_line(", ".join(names[:20]), 300)
                raise RunError(f"{where}: row 1 has no {wanted}, it has {listed}: name it by --columns {field}=...")
    return found


def _fitting(known: Mapping[str, str]) -> str:
    """Return the preset whose columns a table has, but for what only some files have; empty where none fits."""
    for name, fields in PRESETS.items():
        wanted = {text.partition(":")[0].lower() for field, text in fields.items() if field != "case"}
        if wanted <= known.keys():
            return name
    return ""


def _column(field: str, text: str, known: Mapping[str, str], where: str) -> Column | None:
    """Return the column that a text names, with an optional unit after a colon; None if no column has the name."""
    if text.strip().lower() in known:
        return Column(known[text.strip().lower()])
    name, _, unit = text.rpartition(":")
    if name.strip().lower() not in known:
        return None
    units = _UNITS.get(field, {})
    rate = _RATE.fullmatch(unit.strip()) if field == "time" else None
    if rate is not None and float(rate[1]) > 0.0:
        return Column(known[name.strip().lower()], 1.0 / float(rate[1]))
    if unit not in units:
        offered = ", ".join((*units, *(["25hz"] if field == "time" else []))) or "no other unit"
        raise RunError(f"{where}: {unit!r:.40} is no unit of {field}, expected {offered}")
    return Column(known[name.strip().lower()], units[unit], unit == "north")


def log_of(chunks: Iterable[Rows], columns: Mapping[str, Column], where: str, *, strict: bool) -> Log:
    """Return the vehicles of a table that comes in pieces.

    Raises:
        RunError: it holds too much, or a bad row while it is `strict`.
    """
    told = {field: column.name for field, column in columns.items()}
    told.setdefault("speed", told.get("vx", "speed"))
    told["size"] = told.get("length", "length")
    gather = Gather(where, told, strict=strict)
    cases: dict[str, int] = {}
    for rows in chunks:
        _add(gather, rows, columns, cases)
    return gather.log()


def _add(gather: Gather, rows: Rows, columns: Mapping[str, Column], cases: dict[str, int]) -> None:
    """Add some rows, vehicle by vehicle."""
    nothing = np.full(len(rows.numbers["x"]), np.nan)
    times = rows.numbers["time"] * columns["time"].factor
    names = rows.texts["id"]
    if "case" in columns:
        numbers = [cases.setdefault(case, len(cases)) for case in rows.texts["case"]]
        times = times + _CASE * np.array(numbers, dtype=np.float64)
        names = [f"{case}.{name}" for case, name in zip(rows.texts["case"], names, strict=True)]
    heading = rows.numbers.get("heading", nothing)
    if "heading" in columns:
        heading = heading * columns["heading"].factor + (math.pi / 2 if columns["heading"].north else 0.0)
    speed = rows.numbers.get("speed")
    if speed is not None:
        speed = speed * columns["speed"].factor
    elif {"vx", "vy"} <= columns.keys():
        east, north = (rows.numbers[field] * columns[field].factor for field in ("vx", "vy"))
        # Noise makes the length of a velocity too long, and never its part along the heading.
        speed = east * np.cos(heading) + north * np.sin(heading) if "heading" in columns else np.hypot(east, north)
    table = np.column_stack((times, rows.numbers["x"], rows.numbers["y"], heading, nothing if speed is None else speed))
    for at, field, why in rows.bad:
        gather.refuse(names[at], int(rows.lines[at]), field, why)
    codes: dict[str, int] = {}
    code = np.array([codes.setdefault(name, len(codes)) for name in names], dtype=np.int64)
    order = np.argsort(code, kind="stable")
    ends = np.cumsum(np.bincount(code, minlength=len(codes)))
    for name, begin, end in zip(codes, [0, *ends[:-1].tolist()], ends.tolist(), strict=True):
        mine = order[begin:end]
        before, again = gather.extend(name, rows.lines[mine], table[mine])
        for k in again.tolist():
            _describe(gather, name, rows, int(mine[k]), before + k)


_CASE = 1000.0
"""Time between the starts of two cases of a file [s]. A case is a scene of some seconds whose clock begins at zero."""


def _describe(gather: Gather, name: str, rows: Rows, at: int, sample: int) -> None:
    size = tuple(float(rows.numbers[field][at]) for field in ("length", "width") if field in rows.numbers)
    known = (size[0], size[1]) if len(size) == 2 and not any(math.isnan(number) for number in size) else None
    gather.describe(name, known, kind_of(rows.texts["class"][at] if "class" in rows.texts else ""), at=sample)


def numbers_of(values: Any) -> tuple[NDArray[np.float64], list[int]]:
    """Return values as numbers, NaN for what is none, and the places of those that are neither a number nor missing."""
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
