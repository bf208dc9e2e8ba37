"""Results of functions of a run, kept beside the run so that all rules that judge the run share them.

A result must not hold the run: the circle of references would keep the run in memory.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, TypeVar

from pytest_rvads.runs.run import Run

__all__ = ["given", "once"]

_Result = TypeVar("_Result")
_JUDGINGS: dict[int, dict[object, Any]] = {}
"""The results of every run by the id of the run, deleted with the run; a result must not hold the run itself."""


def once(run: Run, work: Callable[..., _Result], *columns: int) -> _Result:
    """Return the result of `work` on a run, or on some of its agents, given by column; `work` is called once."""
    results, key = _judging(run), (work, columns)
    if key not in results:
        results[key] = work(run, *columns)
    result: _Result = results[key]
    return result


def given(run: Run, work: Callable[[Run], _Result], result: _Result) -> None:
    """Have `once` return this result for a run instead of calling `work`."""
    _judging(run)[work, ()] = result


def _judging(run: Run) -> dict[object, Any]:
    if id(run) not in _JUDGINGS:
        _JUDGINGS[id(run)] = {}
        weakref.finalize(run, _JUDGINGS.pop, id(run)).atexit = False
    return _JUDGINGS[id(run)]
