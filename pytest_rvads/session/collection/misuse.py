"""Errors in the use of marks, reported with the file and line of the mark."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from numbers import Integral
from pathlib import Path
from typing import Any

import pytest

from pytest_rvads.support.errors import RvadsError, ScenarioError, suggest


class Misuse(ScenarioError, pytest.Collector.CollectError):
    """A mark has wrong arguments, or selects no run.

    Cause: a wrong argument, or an argument that does not fit the junction, the session or the test.
    Remedy: correct the mark; the message begins with its file and line, and pytest shows the message without a traceback.
    """


def caller() -> str:
    """Return file and line of the caller of the calling function; the file is relative to the working directory."""
    frame = sys._getframe(2)
    return f"{frame.f_code.co_filename.removeprefix(os.getcwd() + os.sep)}:{frame.f_lineno}"


@contextmanager
def told_at(place: str) -> Iterator[None]:
    """Turn every `RvadsError` that is raised inside the context into a `Misuse`, with `place` in front of the message."""
    try:
        yield
    except RvadsError as error:
        raise Misuse(f"{place}: {error}") from None


def folder(place: str) -> Path:
    """Return the folder of the file of a place that `caller` returned."""
    return Path(place.rpartition(":")[0]).parent


def beside(folder: Path, map: Any) -> Any:
    """Return the path of a map file below the folder of a test; `map` itself if there is no such file."""
    if isinstance(map, str | os.PathLike) and (folder / map).is_file():
        return str(folder / map)
    return map


def refuse_unknown(what: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Raise a `ScenarioError` for a given keyword that is not known; `what` are the first words of the message."""
    for keyword in given:
        if keyword not in known:
            raise ScenarioError(f"{what} {', '.join(known)}, got {keyword!r}{suggest(keyword, known)}")


def several(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> tuple[Any, ...] | None:
    """Return the value or values of an argument as a tuple, or None for None; numpy integers become Python integers."""
    if value is None:
        return None
    single = isinstance(value, (str, kind)) or not isinstance(value, Iterable)
    values = (value,) if single else tuple(value)
    if not values:
        raise ScenarioError(f"{name} is empty: name {what}, or leave it out")
    if not all(isinstance(v, kind) and not isinstance(v, bool) for v in values):
        raise ScenarioError(f"{name} takes {what}, one or several, got {value!r}")
    return tuple(int(v) if isinstance(v, Integral) else v for v in values)
