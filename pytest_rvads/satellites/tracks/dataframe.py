"""Tracks in tables in memory: of pandas, polars, pyarrow, or a dictionary of columns; none of them is needed here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pytest_rvads.errors import RunError
from pytest_rvads.satellites.tracks.samples import Log
from pytest_rvads.satellites.tracks.table import TEXTS, Column, Rows, columns_of, log_of, numbers_of
from pytest_rvads.wording import one_line

__all__ = ["is_table", "read_table"]

_AT_ONCE = 200_000
"""Rows that are looked at together."""
_WHERE = "table"


def is_table(source: object) -> bool:
    """Return whether a value is a table: one with an interchange protocol, of dataframes or Arrow, or a mapping of columns."""
    return isinstance(source, Mapping) or hasattr(source, "__dataframe__") or hasattr(source, "__arrow_c_stream__")


def read_table(table: Any, columns: Mapping[str, str] | None, *, strict: bool, preset: str | None = None) -> Log:
    """Return the vehicles of a table, see `columns_of`; rows are counted from 0.

    Raises:
        RunError: it lacks a column, its columns differ in length, or a row is bad while reading is `strict`.
    """
    names = _names(table)
    found = columns_of(columns, names, _WHERE, preset=preset)
    values = {field: _values(table, column.name) for field, column in found.items()}
    lengths = {column.name: len(values[field]) for field, column in found.items()}
    if len(set(lengths.values())) > 1:
        raise RunError(f"{_WHERE}: its columns must be equally long, got {lengths}")
    return log_of(_pieces(values, found), found, _WHERE, strict=strict)


def _names(table: Any) -> list[str]:
    try:
        # Arrow calls them column_names; pandas and polars columns, which are the arrays themselves in Arrow.
        names = table.keys() if isinstance(table, Mapping) else getattr(table, "column_names", None) or table.columns
        return [str(name) for name in names]
    except Exception as error:  # of a library that we do not know
        raise RunError(f"{_WHERE}: can't be read: {one_line(str(error))}") from error


def _values(table: Any, name: str) -> Any:
    try:
        values = np.asarray(table[name])
    except Exception as error:  # likewise
        raise RunError(f"{_WHERE}: column {name!r:.60} can't be read: {one_line(str(error))}") from error
    if values.ndim != 1:
        raise RunError(f"{_WHERE}: column {name!r:.60} must be a column of values, got the shape {values.shape}")
    if values.dtype.kind == "m":  # times since a start
        return values.astype("timedelta64[ns]").astype(np.float64) * 1e-9
    return values


def _pieces(values: Mapping[str, Any], columns: Mapping[str, Column]) -> Iterator[Rows]:
    count = len(values["id"])
    for begin in range(0, count, _AT_ONCE):
        here = slice(begin, min(begin + _AT_ONCE, count))
        numbers, texts = {}, {}
        bad: list[tuple[int, str, str]] = []
        for field in columns:
            part: Sequence[Any] = values[field][here].tolist()
            if field in TEXTS:
                texts[field] = [_text(value) for value in part]
                continue
            numbers[field], wrong = numbers_of(values[field][here])
            bad += [(k, field, f"{one_line(repr(part[k]), 60)} is no number") for k in wrong]
        yield Rows(numbers, texts, np.arange(here.start, here.stop), bad)


def _text(value: Any) -> str:
    """Return an id as a text: 7 and 7.0, which is what a column of whole numbers with gaps becomes, are the same."""
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
