"""The formats of tracks that are read: a format is a row here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from pytest_rvads.entrypoints import entries, load
from pytest_rvads.errors import RunError, suggest
from pytest_rvads.satellites.tracks.carla import read_carla
from pytest_rvads.satellites.tracks.csvfile import read_csv, read_ind, read_interaction
from pytest_rvads.satellites.tracks.dataframe import is_table, read_table
from pytest_rvads.satellites.tracks.facing import check_facing
from pytest_rvads.satellites.tracks.fcd import read_fcd
from pytest_rvads.satellites.tracks.osi import read_osi
from pytest_rvads.satellites.tracks.rosbag import read_rosbag
from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.satellites.tracks.table import PRESETS

__all__ = ["FORMATS", "Format", "Point", "Reader", "formats", "read_log"]

Point = Literal["front", "center", "rear_axle"]
"""Which point of a vehicle x and y are."""


class Reader(Protocol):
    """Reads a file of tracks."""

    def __call__(self, path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
        """Return its vehicles.

        Args:
            path: of the file, or of a folder where the format is one.
            columns: what a user calls the fields, None where nothing was said; a format that knows refuses them.
            strict: a bad row is an error, see `Gather`.
            watch: told how far reading is; None: nobody wants to know.

        Raises:
            RunError: it can't be read.
        """


@dataclass(frozen=True, slots=True)
class Format:
    """A format of tracks."""

    read: Reader
    suffixes: tuple[str, ...] = ()
    """File suffixes of the format, in lower case; none if another format reads files with these suffixes."""
    point: Point = "center"
    """The point of a vehicle to which the positions refer, unless the user names another point."""


FORMATS: dict[str, Format] = {
    "csv": Format(read_csv, (".csv", ".csv.gz", ".tsv", ".txt")),
    "ind": Format(read_ind),
    "interaction": Format(read_interaction),
    "fcd": Format(read_fcd, (".xml", ".xml.gz"), "front"),
    "carla": Format(read_carla, (".jsonl", ".jsonl.gz"), "front"),
    "osi": Format(read_osi, (".mcap", ".osi")),
    "rosbag": Format(read_rosbag, (".db3", ".bag"), "rear_axle"),
}
"""The formats of this folder by name."""


def formats() -> dict[str, Format]:
    """Return all formats by name, as ``--format`` takes it: those of this folder, and the entry points ``rvads.logs`` of others.

    Raises:
        RvadsError: an entry point can't be loaded.
    """
    return FORMATS | {name: load("logs", name) for name in entries("logs")}


def read_log(
    source: Any,
    *,
    format: str | None = None,
    columns: Mapping[str, str] | None = None,
    strict: bool = False,
    watch: Watch | None = None,
) -> tuple[Log, Point]:
    """Return the vehicles of a file or table, and which point of them its places are.

    Raises:
        RunError: it can't be read, its format is not known, or most vehicles head elsewhere than they go.
    """
    if is_table(source):
        if format is not None and format not in PRESETS and format != "csv":
            raise RunError(f"a table in memory has the format csv, {' or '.join(PRESETS)}, got {format!r:.60}")
        table = read_table(source, columns, strict=strict, preset=format if format in PRESETS else None)
        check_facing(table)
        return table, FORMATS["csv"].point
    try:
        path = Path(source)
    except TypeError:
        raise RunError(f"tracks are read from a file or a table, got {type(source).__name__}") from None
    rows = formats()
    if format is not None and format not in rows:
        raise RunError(f"{format!r:.60} is no format of tracks, known are {', '.join(rows)}{suggest(str(format), rows)}")
    chosen = rows[format or _format(path, rows)]
    log = chosen.read(path, columns, strict=strict, watch=watch)
    check_facing(log)
    return log, chosen.point


def _format(path: Path, rows: Mapping[str, Format]) -> str:
    if path.is_dir():
        return "rosbag"
    name = path.name.lower()
    for format, row in rows.items():
        if name.endswith(row.suffixes):
            return format
    known = ", ".join(suffix for row in rows.values() for suffix in row.suffixes)
    raise RunError(f"{path}: its name says no format of tracks ({known}): name one by --format (format=), of {', '.join(rows)}")
