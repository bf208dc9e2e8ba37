"""Truth values that depend on the states before: for how long something has been true, and what is true until it is reset."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["lasting", "latched"]


def lasting(truths: NDArray[np.bool_], before: NDArray[Any]) -> NDArray[np.int64]:
    """Return for how many states, up to each, something has been true without a break.

    Args:
        truths: shape ``(n, columns)``.
        before: for how many states it had been true before the first state, shape ``(columns,)``.
    """
    if len(truths) == 1:
        return np.where(truths, before + 1, 0)
    count = np.arange(1, len(truths) + 1)[:, None]
    return count - np.maximum.accumulate(np.where(truths, -before, count), axis=0)


def latched(set_: NDArray[np.bool_], reset: NDArray[np.bool_], before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what is true from the states in which it is set up to the states in which it is reset; never both in one state.

    Args:
        set_: where it is set, shape ``(n, columns)``.
        reset: where it is reset, likewise.
        before: whether it was true before the first state, shape ``(columns,)``.
    """
    if len(set_) == 1:
        return set_ | (before & ~reset)
    count = np.arange(1, len(set_) + 1)[:, None]
    last_set = np.maximum.accumulate(np.where(set_, count, 0), axis=0)
    last_reset = np.maximum.accumulate(np.where(reset, count, 0), axis=0)
    found: NDArray[np.bool_] = (last_set > last_reset) | (before & (last_reset == 0))
    return found
