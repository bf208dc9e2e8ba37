"""Finite traces as infinite words: a proposition holds as long as the trace lasts.

A formula is translated so that its LTL3 monitor decides in the first state without the proposition, as `finite.settle` would on
the trace before this state (De Giacomo, Vardi: IJCAI 2013, section 4, with weak operators released at the end).
"""

from __future__ import annotations

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.rewrite import rebuild

__all__ = ["ALIVE", "with_ending"]

ALIVE = f.Atom("alive")
"""Holds in every state of the trace, and in no state after the trace."""
_ENDED = f.Not(ALIVE)


def with_ending(formula: f.Formula) -> f.Formula:
    """Return the formula whose truth on ``trace . (states without ALIVE)`` is that of `formula` on the finite trace."""
    if f.is_boolean(formula):
        return formula
    parts = tuple(with_ending(c) for c in f.children(formula))
    match formula:
        case f.Next():
            return f.Next(f.And((ALIVE, parts[0])))
        case f.Always():
            return f.WeakUntil(parts[0], _ENDED)
        case f.Eventually():
            return f.Until(ALIVE, f.And((ALIVE, parts[0])))
        case f.Until():
            return f.Until(f.And((ALIVE, parts[0])), f.And((ALIVE, parts[1])))
        case f.WeakUntil():
            return f.WeakUntil(parts[0], f.Or((parts[1], _ENDED)))
        case f.Release():
            return f.WeakUntil(parts[1], f.Or((f.And(parts), _ENDED)))
    return rebuild(formula, parts)
