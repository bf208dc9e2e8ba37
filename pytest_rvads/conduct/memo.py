"""What is found out about a run is kept with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pytest_rvads.runs.run import Run

__all__ = ["each", "once"]

_Result = TypeVar("_Result")


def once(run: Run, work: Callable[[Run], _Result]) -> _Result:
    """Return what `work` finds out about a run, which is then known: a run is judged by many rules, and never changes."""
    known = run.__dict__.setdefault("found", {})
    if work not in known:
        known[work] = work(run)
    result: _Result = known[work]
    return result


def each(run: Run, work: Callable[..., _Result], *columns: int) -> _Result:
    """Return what `work` finds out about some agents of a run, given by column, which is then known."""
    known = run.__dict__.setdefault("found", {})
    if (work, columns) not in known:
        known[work, columns] = work(run, *columns)
    result: _Result = known[work, columns]
    return result
