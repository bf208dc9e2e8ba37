"""Reads tracks from CSV files: files of the data sets inD and INTERACTION, and other files by the names of their columns."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.satellites.tracks.source import Source, Watch, opened
from pytest_rvads.satellites.tracks.table import TEXTS, Column, Rows, columns_of, log_of, numbers_of
from pytest_rvads.support.errors import RunError

_BATCH = 20_000
"""Number of rows that are converted together."""
_LONGEST, _COLUMNS = 2**15, 1000
"""Greatest length of a row [bytes], and largest number of columns; both limit the memory of a batch of `_BATCH` rows."""
_DECIMAL_COMMA = re.compile(r'(?<![^;"])(\s*[-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*)(?![^;"\r\n])')
"""A number with a decimal comma that is a whole cell between semicolons."""


def read_csv(
    path: Path,
    columns: Mapping[str, str] | None,
    *,
    strict: bool,
    watch: Watch | None,
    preset: str | None = None,
    classes: Mapping[str, str] | None = None,
) -> Log:
    """Return the vehicles of a CSV file; `columns_of` explains `columns` and `preset`, and `log_of` explains `classes`."""
    with opened(path, watch) as source:
        rows = rows_of(source)
        names = next(rows, (0, []))[1]
        fields = columns_of(columns, names, source.where, preset=preset)
        rows = _of_fcd(rows, names) if preset == "fcd" else rows
        return log_of(_batches(rows, names, fields), fields, source.where, strict=strict, classes=classes)


def is_fcd_table(path: Path) -> bool:
    """Return whether a file is floating car data of SUMO as CSV, given by the names of its columns."""
    with opened(path) as source:
        names = next(source.chunks(), b"").partition(b"\n")[0]
    return b"timestep_time" in names and b"vehicle_id" in names


def _of_fcd(rows: Iterator[tuple[int, list[str]]], names: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows, those of persons as rows of vehicles; a person can have a vehicle's id, so ``person`` precedes it."""
    for line, cells in rows:
        row = dict(zip(names, cells, strict=False))
        if row.get("person_id"):
            values = {"vehicle_id": f"person {row['person_id']}", "vehicle_type": "pedestrian"}
            on_foot = [values.get(name) or row.get(name.replace("vehicle_", "person_"), "") for name in names]
            if not row.get("vehicle_id"):
                yield line, on_foot
                continue
        if len(cells) != len(names) or row["vehicle_id"]:
            yield line, cells


def read_ind(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of ``NN_tracks.csv`` of the data sets inD, rounD, exiD and uniD.

    Frame rate and UTM coordinates of the origin are read from ``NN_recordingMeta.csv``, and classes from ``NN_tracksMeta.csv``,
    if the folder has these files.
    """
    named_columns = dict(columns or {})
    stem = path.name.partition("_tracks")[0]
    utm: complex | None = None
    for row in _rows_of_neighbour(path, f"{stem}_recordingMeta.csv"):
        if "time" not in named_columns and row.get("frameRate"):
            named_columns["time"] = f"frame:{row['frameRate']}hz"
        (east, north), _ = numbers_of([row.get("xUtmOrigin", ""), row.get("yUtmOrigin", "")])
        utm = complex(east, north) if math.isfinite(east + north) else None
    classes = {
        row["trackId"]: row["class"]
        for row in _rows_of_neighbour(path, f"{stem}_tracksMeta.csv")
        if {"trackId", "class"} <= row.keys()
    }
    log = read_csv(path, named_columns, strict=strict, watch=watch, preset="ind", classes=classes)
    return replace(log, utm=utm)


def read_interaction(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file of the data set INTERACTION.

    The pedestrians and cyclists beside ``vehicle_tracks_NNN.csv`` are read from ``pedestrian_tracks_NNN.csv``, if it is there.
    """
    log = read_csv(path, columns, strict=strict, watch=watch, preset="interaction")
    on_foot = path.with_name(path.name.replace("vehicle_tracks", "pedestrian_tracks"))
    if on_foot == path or not on_foot.is_file():
        return log
    beside = read_csv(on_foot, columns, strict=strict, watch=None, preset="interaction")
    return replace(log, vehicles=log.vehicles + beside.vehicles, refused=log.refused + beside.refused)


def _rows_of_neighbour(path: Path, name: str) -> Iterator[dict[str, str]]:
    """Yield the rows of the CSV file `name` in the folder of `path`, by column; no rows if the folder has no such file."""
    neighbour = path.with_name(name)
    if neighbour.is_file():
        with opened(neighbour) as source:
            rows = rows_of(source)
            names = next(rows, (0, []))[1]
            for _, cells in rows:
                yield dict(zip(names, cells, strict=False))


def rows_of(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each row of a CSV file with its line number. The first row holds the column names.

    Empty lines are skipped. A row is one line. A line with a quote that is not closed gives a row without cells.
    """
    lines = (
        line.decode("utf-8-sig" if number == 0 else "utf-8", "replace") for number, line in enumerate(source.lines(_LONGEST))
    )
    first = next(lines, "")
    if not first.strip():
        raise RunError(f"{source.where}: row 1 is empty, expected the names of columns")
    delimiter = max(",;\t", key=first.count)
    if first.count(delimiter) >= _COLUMNS:
        raise RunError(f"{source.where}: row 1 names more than {_COLUMNS:,} columns, expected fewer")
    yield 1, [name.strip() for name in _cells(first, delimiter)]
    for number, line in enumerate(lines, start=2):
        if delimiter == ";" and "," in line:
            line = _DECIMAL_COMMA.sub(r"\1.\2", line)
        if line.strip():
            yield number, _cells(line, delimiter)


def wrong_cells(cells: Sequence[str], names: Sequence[str]) -> str:
    """Return, in words, how the number of cells in a row differs from the number of columns."""
    if not cells:
        return "a quote in the row is not closed"
    return f"the row has {len(cells)} cells, expected {len(names)} as in row 1"


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line of CSV; no cells if a quote is not closed."""
    if '"' not in line:
        return line.rstrip("\r\n").split(delimiter, _COLUMNS)
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True, strict=True))
    except csv.Error:
        return []


def _batches(rows: Iterator[tuple[int, list[str]]], names: Sequence[str], columns: Mapping[str, Column]) -> Iterator[Rows]:
    places = {field: list(names).index(column.name) for field, column in columns.items()}
    while batch := list(islice(rows, _BATCH)):
        lines = np.array([line for line, _ in batch], dtype=np.int64)
        short = [k for k, (_, cells) in enumerate(batch) if len(cells) != len(names)]
        cells = [row if len(row) == len(names) else (row + [""] * len(names))[: len(names)] for _, row in batch]
        bad: list[tuple[int, str, str]] = [(k, "id", wrong_cells(batch[k][1], names)) for k in short]
        by_column = list(zip(*cells, strict=True))
        numbers, texts = {}, {}
        for field, place in places.items():
            if field in TEXTS:
                texts[field] = [cell.strip() for cell in by_column[place]]
                continue
            numbers[field], wrong = numbers_of(by_column[place])
            bad += [(k, field, f"{by_column[place][k]!r:.60} is no number") for k in wrong]
        yield Rows(numbers, texts, lines, bad)
