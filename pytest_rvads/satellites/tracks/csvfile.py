"""Tracks in CSV files: files of the data sets inD and INTERACTION, and other files by the names of their columns."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from pytest_rvads.satellites.tracks.samples import Log, kind_of
from pytest_rvads.satellites.tracks.source import Source, Watch, opened
from pytest_rvads.satellites.tracks.table import TEXTS, Column, Rows, columns_of, log_of, numbers_of
from pytest_rvads.support.errors import RunError

__all__ = ["read_csv", "read_ind", "read_interaction", "rows_of", "wrong_cells"]

_BATCH = 20_000
"""Number of rows that are converted together."""
_LONGEST, _COLUMNS = 2**15, 1000
"""Longest row [bytes] and most columns, because `_BATCH` rows are in memory together."""
_DELIMITERS = ",;\t"


def read_csv(
    path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None, preset: str | None = None
) -> Log:
    """Return the vehicles of a CSV file; `columns_of` explains `columns` and `preset`.

    Raises:
        RunError: the file can't be read, lacks a column, or has a bad row while reading is `strict`.
    """
    with opened(path, watch) as source:
        rows = rows_of(source)
        names = next(rows, (0, []))[1]
        fields = columns_of(columns, names, source.where, preset=preset)
        return log_of(_batches(rows, names, fields), fields, source.where, strict=strict)


def read_ind(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of ``NN_tracks.csv`` of the data sets inD, rounD, exiD and uniD.

    Frame rate and classes are read from ``NN_recordingMeta.csv`` and ``NN_tracksMeta.csv`` if the folder has these files.
    """
    named_columns = dict(columns or {})
    stem = path.name.partition("_tracks")[0]
    for row in _rows_of_neighbour(path, f"{stem}_recordingMeta.csv"):
        if "time" not in named_columns and row.get("frameRate"):
            named_columns["time"] = f"frame:{row['frameRate']}hz"
    log = read_csv(path, named_columns, strict=strict, watch=watch, preset="ind")
    classes = {
        row["trackId"]: row["class"]
        for row in _rows_of_neighbour(path, f"{stem}_tracksMeta.csv")
        if {"trackId", "class"} <= row.keys()
    }
    vehicles = (replace(v, kind=kind_of(classes[v.name])) if v.name in classes else v for v in log.vehicles)
    return replace(log, vehicles=tuple(vehicles))


def read_interaction(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file of the data set INTERACTION."""
    return read_csv(path, columns, strict=strict, watch=watch, preset="interaction")


def _rows_of_neighbour(path: Path, name: str) -> Iterator[dict[str, str]]:
    """Yield the rows of another file in the folder of `path`; nothing if the folder has no such file."""
    neighbour = path.with_name(name)
    if neighbour.is_file():
        with opened(neighbour) as source:
            rows = rows_of(source)
            names = next(rows, (0, []))[1]
            for _, cells in rows:
                yield dict(zip(names, cells, strict=False))


def rows_of(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a CSV file that are not empty, each with its line number. The first row holds the column names.

    A row is one line. A line with a quote that is not closed gives a row without cells.

    Raises:
        RunError: the file has no row of column names, or a line or the number of columns exceeds its bound.
    """
    lines = (
        line.decode("utf-8-sig" if number == 0 else "utf-8", "replace") for number, line in enumerate(source.lines(_LONGEST))
    )
    first = next(lines, "")
    if not first.strip():
        raise RunError(f"{source.where}: row 1 is empty, expected the names of columns")
    delimiter = max(_DELIMITERS, key=first.count)
    if first.count(delimiter) >= _COLUMNS:
        raise RunError(f"{source.where}: row 1 names more than {_COLUMNS:,} columns, expected fewer")
    yield 1, [name.strip() for name in _cells(first, delimiter)]
    for number, line in enumerate(lines, start=2):
        if line.strip():
            yield number, _cells(line, delimiter)


def wrong_cells(cells: Sequence[str], names: Sequence[str]) -> str:
    """Return in words why a row does not have a cell per column."""
    if not cells:
        return "a quote in the row is not closed"
    return f"the row has {len(cells)} cells, expected {len(names)} as in row 1"


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line; none if a quote is not closed."""
    if '"' not in line:
        return line.rstrip("\r\n").split(delimiter, _COLUMNS)
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True, strict=True))
    except csv.Error:
        return []


def _batches(rows: Iterator[tuple[int, list[str]]], names: Sequence[str], columns: Mapping[str, Column]) -> Iterator[Rows]:
    """Yield batches of rows, each with its numbers and texts by field."""
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
