"""The formats of track files, and the reading of a log in any of these formats. A new format is a new row of `FORMATS`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from pytest_rvads.satellites.tracks.correcting import with_headings
from pytest_rvads.satellites.tracks.csvfile import is_fcd_table, read_csv, read_ind, read_interaction
from pytest_rvads.satellites.tracks.program_logs import (
    is_commonroad,
    read_carla,
    read_commonroad_tracks,
    read_fcd,
    read_osi,
    read_rosbag,
)
from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.satellites.tracks.table import PRESETS, is_table, read_table
from pytest_rvads.support.errors import RunError, suggest
from pytest_rvads.support.installed import entries, load

Point = Literal["front", "center", "rear_axle"]
"""The recorded point: the point of a vehicle to which x and y in a log refer."""


class Reader(Protocol):
    """Reads a file of tracks."""

    def __call__(self, path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
        """Return the vehicles of a file.

        Args:
            path: path of the file, or of the folder if the format is a folder.
            columns: the user's choice of a column per field, or None; a format with fixed columns refuses a choice.
            strict: whether a bad row is an error; without `strict`, a vehicle with a bad row is left out.
            watch: function that is called with the number of bytes read so far and the number of all bytes, or None.

        Raises:
            RunError: the file can't be read.
        """


@dataclass(frozen=True, slots=True)
class Format:
    """A format of track files."""

    read: Reader
    suffixes: tuple[str, ...] = ()
    """File suffixes by which the format is recognised, in lower case; empty if users must name the format."""
    point: Point = "center"
    """The point of a vehicle to which positions refer if the user names no point."""
    with_map: bool = False
    """Whether a file names its map, so that users need not name a junction."""


FORMATS: dict[str, Format] = {
    "csv": Format(read_csv, (".csv", ".csv.gz", ".tsv", ".txt")),
    "ind": Format(read_ind),
    "interaction": Format(read_interaction),
    "fcd": Format(read_fcd, (".xml", ".xml.gz"), "front"),
    "commonroad": Format(read_commonroad_tracks, with_map=True),
    "carla": Format(read_carla, (".jsonl", ".jsonl.gz"), "front"),
    "osi": Format(read_osi, (".mcap", ".osi")),
    "rosbag": Format(read_rosbag, (".db3", ".bag"), "rear_axle"),
}


def formats() -> dict[str, Format]:
    """Return all formats by name: the formats of this package, and the entry points of the group ``rvads.logs``."""
    return FORMATS | {name: load("logs", name) for name in entries("logs")}


def read_log(
    source: Any,
    *,
    format: str | None = None,
    columns: Mapping[str, str] | None = None,
    classes: Mapping[str, str] | None = None,
    strict: bool = False,
    watch: Watch | None = None,
) -> tuple[Log, Point]:
    """Return the vehicles of a file or table, and the recorded point of the vehicles; `read_tracks` explains the arguments."""
    if is_table(source):
        if format is not None and format not in PRESETS and format != "csv":
            raise RunError(f"the format of a table in memory must be csv, {' or '.join(PRESETS)}, got {format!r:.60}")
        log_format = FORMATS[format or "csv"]
        log = read_table(source, columns, strict=strict, preset=format if format in PRESETS else None)
    else:
        try:
            path = Path(source)
        except TypeError:
            raise RunError(f"tracks must come from a file or a table, got {type(source).__name__}") from None
        log_format = format_of(path, format)
        log = log_format.read(path, columns, strict=strict, watch=watch)
    log = log.of_kinds(classes or {})
    return log if log.degrees else with_headings(log), log_format.point  # headings of degrees are compared on the map


def format_of(path: Path, format: str | None) -> Format:
    """Return the named format, or without a name the format of a file by its suffix.

    XML is CommonRoad if its root says so. CSV with the columns of SUMO's floating car data is such data.
    """
    known_formats = formats()
    if format is not None and format not in known_formats:
        raise RunError(
            f"{format!r:.60} is no format of tracks, known are {', '.join(known_formats)}{suggest(str(format), known_formats)}"
        )
    by_suffix = (known for known, entry in known_formats.items() if path.name.lower().endswith(entry.suffixes))
    name = format or ("rosbag" if path.is_dir() else next(by_suffix, ""))
    if not name:
        suffixes = ", ".join(suffix for entry in known_formats.values() for suffix in entry.suffixes)
        raise RunError(
            f"{path} has none of the suffixes of formats of tracks ({suffixes}): name the format by --format (format=), one of "
            f"{', '.join(known_formats)}"
        )
    if name == "csv" and path.is_file() and is_fcd_table(path):
        return known_formats["fcd"]
    return known_formats["commonroad" if format is None and name == "fcd" and is_commonroad(path) else name]
