"""Wrong use of marks, told at the line that the user wrote."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from numbers import Integral
from typing import Any

import pytest

from pytest_rvads.errors import RvadsError, ScenarioError

__all__ = ["Misuse", "caller", "several", "told_at"]


class Misuse(ScenarioError, pytest.Collector.CollectError):
    """A mark asks for what does not exist, or for nothing.

    Cause: a wrong argument, or one that does not fit the junction, the session or the test.
    Remedy: the message begins with file and line of the mark; pytest shows it without a traceback.
    """


def caller() -> str:
    """Return file and line of the code that called the function that asks; the file as seen from the working directory."""
    frame = sys._getframe(2)
    return f"{frame.f_code.co_filename.removeprefix(os.getcwd() + os.sep)}:{frame.f_lineno}"


@contextmanager
def told_at(place: str) -> Iterator[None]:
    """Let the errors of the library begin with `place`.

    Raises:
        Misuse: instead of them.
    """
    try:
        yield
    except RvadsError as error:
        raise Misuse(f"{place}: {error}") from None


def several(name: str, value: Any, kind: type | tuple[type, ...], what: str) -> tuple[Any, ...] | None:
    """Return the values of an argument as a tuple, or None for None; whole numbers of numpy become numbers of Python.

    Raises:
        ScenarioError: values of another type, or none at all.
    """
    if value is None:
        return None
    alone = isinstance(value, (str, kind)) or not isinstance(value, Iterable)
    values = (value,) if alone else tuple(value)
    if not values:
        raise ScenarioError(f"{name} is empty: name {what}, or leave it out")
    if not all(isinstance(v, kind) and not isinstance(v, bool) for v in values):
        raise ScenarioError(f"{name} takes {what}, one or several, got {value!r}")
    return tuple(int(v) if isinstance(v, Integral) else v for v in values)
