"""Tracks in CSV files: of data sets, or of one's own by naming the columns."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.samples import Log, kind_of
from pytest_rvads.satellites.tracks.source import Source, Watch, opened
from pytest_rvads.satellites.tracks.table import TEXTS, Column, Rows, columns_of, log_of, numbers_of

__all__ = ["read_csv", "read_ind", "read_interaction", "rows_of", "wrong_cells"]

_AT_ONCE = 20_000
"""Rows that are taken from text to numbers together."""
_LONGEST, _COLUMNS = 2**15, 1000
"""Longest row [bytes] and most columns: `_AT_ONCE` rows are in memory together."""
_DELIMITERS = ",;\t"


def read_csv(
    path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None, preset: str | None = None
) -> Log:
    """Return the vehicles of a CSV file, see `columns_of`.

    Raises:
        RunError: it can't be read, lacks a column, or has a bad row while reading is `strict`.
    """
    with opened(path, watch) as source:
        rows = rows_of(source)
        names = next(rows, (0, []))[1]
        found = columns_of(columns, names, source.where, preset=preset)
        return log_of(_pieces(rows, names, found), found, source.where, strict=strict)


def read_ind(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of ``NN_tracks.csv`` of inD, and of its like (rounD, exiD, uniD).

    Frame rate and classes are read from ``NN_recordingMeta.csv`` and ``NN_tracksMeta.csv`` where these are beside it.
    """
    told = dict(columns or {})
    stem = path.name.partition("_tracks")[0]
    for row in _beside(path, f"{stem}_recordingMeta.csv"):
        if "time" not in told and row.get("frameRate"):
            told["time"] = f"frame:{row['frameRate']}hz"
    log = read_csv(path, told, strict=strict, watch=watch, preset="ind")
    classes = {
        row["trackId"]: row["class"] for row in _beside(path, f"{stem}_tracksMeta.csv") if {"trackId", "class"} <= row.keys()
    }
    vehicles = (replace(v, kind=kind_of(classes[v.name])) if v.name in classes else v for v in log.vehicles)
    return replace(log, vehicles=tuple(vehicles))


def read_interaction(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the vehicles of a file of INTERACTION."""
    return read_csv(path, columns, strict=strict, watch=watch, preset="interaction")


def _beside(path: Path, name: str) -> Iterator[dict[str, str]]:
    """Yield the rows of another file in the folder, nothing where there is none."""
    other = path.with_name(name)
    if other.is_file():
        with opened(other) as source:
            rows = rows_of(source)
            names = next(rows, (0, []))[1]
            for _, cells in rows:
                yield dict(zip(names, cells, strict=False))


def rows_of(source: Source) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a CSV file that are not empty, the names of its columns first, each with the number of its line.

    A row is one line. Of a line that is no CSV, because a quote in it is not closed, no cells are yielded.

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
    """Return what is wrong with a row that has not a cell per column."""
    if not cells:
        return "a quote in the row is not closed"
    return f"the row has {len(cells)} cells, expected {len(names)} as in row 1"


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, none where it is no CSV."""
    if '"' not in line:
        return line.rstrip("\r\n").split(delimiter, _COLUMNS)
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True, strict=True))
    except csv.Error:
        return []


def _pieces(rows: Iterator[tuple[int, list[str]]], names: Sequence[str], columns: Mapping[str, Column]) -> Iterator[Rows]:
    """Yield the rows by field, as numbers and texts."""
    places = {field: list(names).index(column.name) for field, column in columns.items()}
    while some := list(islice(rows, _AT_ONCE)):
        lines = np.array([line for line, _ in some], dtype=np.int64)
        short = [k for k, (_, cells) in enumerate(some) if len(cells) != len(names)]
        cells = [row if len(row) == len(names) else (row + [""] * len(names))[: len(names)] for _, row in some]
        bad: list[tuple[int, str, str]] = [(k, "id", wrong_cells(some[k][1], names)) for k in short]
        by_column = list(zip(*cells, strict=True))
        numbers, texts = {}, {}
        for field, place in places.items():
            if field in TEXTS:
                texts[field] = [cell.strip() for cell in by_column[place]]
                continue
            numbers[field], wrong = numbers_of(by_column[place])
            bad += [(k, field, f"{by_column[place][k]!r:.60} is no number") for k in wrong]
        yield Rows(numbers, texts, lines, bad)
