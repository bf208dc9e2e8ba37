"""Finite-trace semantics: the truth value of a formula at every state of a finished run.

The operators U, F and N are strong: the awaited state must come before the run ends, and the next state must exist. The operators
G, W and R are weak: they are true if they are not violated before the run ends. The negation of a formula is true if the formula
is false (De Giacomo, Vardi: Linear temporal logic and linear dynamic logic on finite traces, IJCAI 2013).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import connect, evaluate

Truths = NDArray[np.bool_]


def settle(formula: f.Formula, values: Mapping[f.Atom, Truths], steps: int) -> Truths:
    """Return the truth value of a formula at every state of a finite trace, from those of its atoms, shape ``(steps,)``."""
    if isinstance(formula, f.Atom | f.Const):
        return evaluate(formula, values, (steps,))
    parts = [settle(child, values, steps) for child in f.children(formula)]
    match formula:
        case f.Next():
            return np.append(parts[0][1:], False)
        case f.Eventually():
            return np.logical_or.accumulate(parts[0][::-1])[::-1]
        case f.Always():
            return np.logical_and.accumulate(parts[0][::-1])[::-1]
        case f.Until():
            return _until(*parts)
        case f.WeakUntil():
            return _until(*parts) | np.logical_and.accumulate(parts[0][::-1])[::-1]
        case f.Release():
            return ~_until(~parts[0], ~parts[1])
        case f.Forall() | f.Exists():
            raise TypeError(f"quantifiers must be unfolded before a formula is evaluated: {formula}")
    return connect(formula, parts)


def _until(left: Truths, right: Truths) -> Truths:
    """Return in which states ``left U right`` is true: `right` comes to hold no later than `left` ceases to hold."""
    tick = np.arange(len(left))
    # For every state, the first state from this state on in which `right` holds, and in which `left` does not hold.
    holds, ceases = (np.minimum.accumulate(np.where(values, tick, len(left))[::-1])[::-1] for values in (right, ~left))
    return (holds <= ceases) & (holds < len(left))


def settle_empty(formula: f.Formula) -> bool:
    """Return the truth value of a formula on the empty trace: atoms and strong operators are false, weak operators true."""
    match formula:
        case f.Const(value):
            return value
        case f.Not() | f.And() | f.Or() | f.Implies() | f.Iff():
            return bool(connect(formula, [np.array(settle_empty(part)) for part in f.children(formula)]))
    return isinstance(formula, f.Always | f.WeakUntil | f.Release)
