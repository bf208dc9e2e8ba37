"""What is found out about a run is kept with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from pytest_rvads.runs.run import Run

__all__ = ["once"]

_Result = TypeVar("_Result")


def once(run: Run, work: Callable[[Run], _Result]) -> _Result:
    """Return what `work` finds out about a run, which is then known: a run is judged by many rules, and never changes."""
    known = run.__dict__.setdefault("found", {})
    if work not in known:
        known[work] = work(run)
    result: _Result = known[work]
    return result
