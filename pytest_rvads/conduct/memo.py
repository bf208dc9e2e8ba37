"""What is found out about a run is shared by all rules that judge the run."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, TypeVar

from pytest_rvads.runs.run import Run

__all__ = ["given", "once"]

_Result = TypeVar("_Result")
_JUDGINGS: dict[int, dict[object, Any]] = {}
"""By the id of a run what is known of it, until the run goes: results must not hold the run itself."""


def once(run: Run, work: Callable[..., _Result], *columns: int) -> _Result:
    """Return what `work` finds out about a run, or about some of its agents, given by column; the work is done once."""
    results, key = _judging(run), (work, columns)
    if key not in results:
        results[key] = work(run, *columns)
    result: _Result = results[key]
    return result


def given(run: Run, work: Callable[[Run], _Result], result: _Result) -> None:
    """Have `once` return a result that comes from elsewhere."""
    _judging(run)[work, ()] = result


def _judging(run: Run) -> dict[object, Any]:
    if id(run) not in _JUDGINGS:
        _JUDGINGS[id(run)] = {}
        weakref.finalize(run, _JUDGINGS.pop, id(run)).atexit = False
    return _JUDGINGS[id(run)]
