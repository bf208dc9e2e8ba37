"""Boolean reasoning on formulas: constructors that simplify, guards, and the joint valuations of guards.

The letters of a monitor are not the 2^n valuations of its propositions but the joint valuations of its guards, the largest
subformulas without temporal operators: ``!(a | b | c) U d`` has two guards and three letters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from itertools import product
from operator import and_, or_

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.effort import Budget
from pytest_rvads.support.errors import FormulaError

__all__ = ["LETTER_LIMIT", "assign", "conj", "connect", "disj", "evaluate", "holds", "iff", "letters", "neg", "plain"]

LETTER_LIMIT = 1024
"""Most letters a monitor may have."""
_ATOM_LIMIT = 200
"""Most propositions of guards with common propositions; keeps the recursion over the propositions inside Python's limit."""


def neg(body: f.Formula) -> f.Formula:
    """Return the negation, simplified."""
    if isinstance(body, f.Const):
        return f.FALSE if body.value else f.TRUE
    return body.body if isinstance(body, f.Not) else f.Not(body)


def conj(parts: Iterable[f.Formula]) -> f.Formula:
    """Return the conjunction, without repetitions; FALSE when a part occurs with its negation."""
    return _join(parts, f.And, f.TRUE, f.FALSE)


def disj(parts: Iterable[f.Formula]) -> f.Formula:
    """Return the disjunction, without repetitions; TRUE when a part occurs with its negation."""
    return _join(parts, f.Or, f.FALSE, f.TRUE)


def _join(parts: Iterable[f.Formula], kind: type[f.And | f.Or], unit: f.Formula, zero: f.Formula) -> f.Formula:
    terms: dict[f.Formula, None] = {}
    for part in parts:
        for p in part.parts if isinstance(part, kind) else (part,):
            if isinstance(p, f.Const):
                if p == zero:
                    return zero
            elif terms and neg(p) in terms:
                return zero
            else:
                terms[p] = None
    if not terms:
        return unit
    return next(iter(terms)) if len(terms) == 1 else kind(tuple(terms))


def assign(formula: f.Formula, atom: f.Atom, value: bool) -> f.Formula:
    """Return a boolean formula with `atom` replaced by `value`, simplified."""
    if isinstance(formula, f.Atom):
        return (f.TRUE if value else f.FALSE) if formula == atom else formula
    return plain(formula, tuple(assign(part, atom, value) for part in f.children(formula)))


def plain(formula: f.Formula, parts: tuple[f.Formula, ...]) -> f.Formula:
    """Return a boolean formula with its direct subformulas replaced by `parts`, simplified and without implications."""
    match formula:
        case f.Not():
            return neg(parts[0])
        case f.And():
            return conj(parts)
        case f.Or():
            return disj(parts)
        case f.Implies():
            return disj((neg(parts[0]), parts[1]))
        case f.Iff():
            return iff(*parts)
    return formula


def iff(left: f.Formula, right: f.Formula) -> f.Formula:
    """Return the equivalence, simplified."""
    if isinstance(left, f.Const):
        return right if left.value else neg(right)
    if isinstance(right, f.Const):
        return left if right.value else neg(left)
    return f.TRUE if left == right else f.Iff(left, right)


def letters(guards: tuple[f.Formula, ...], budget: Budget) -> tuple[int, ...]:
    """Return every joint valuation of `guards` that some truth values of the atoms realise.

    Bit k of a valuation is the value of guard k. Guards without a common atom vary independently. Guards with common atoms are
    split by Shannon expansion, and equal remainders are expanded only once.

    Raises:
        FormulaError: there are more than `LETTER_LIMIT` valuations, or finding the valuations takes more than the budget.
    """
    choices = []
    total = 1
    for members in _groups(guards):
        memo: dict[tuple[f.Formula, ...], frozenset[int]] = {}
        cells = _cells(tuple(guards[k] for k in members), memo, budget, 0)
        total *= len(cells)
        if total > LETTER_LIMIT:
            raise FormulaError(
                f"the formula distinguishes more than {LETTER_LIMIT} valuations of its propositions, too many for a monitor: "
                "use fewer propositions, or split it into rules"
            )
        choices.append([sum((code >> i & 1) << k for i, k in enumerate(members)) for code in sorted(cells)])
    return tuple(sorted(sum(parts) for parts in product(*choices)))


def _groups(guards: tuple[f.Formula, ...]) -> list[list[int]]:
    """Return the groups of guards that are connected by common atoms, by number."""
    group_of: dict[f.Atom, list[int]] = {}
    for k, guard in enumerate(guards):
        merged = [k]
        atoms = f.atoms(guard)
        for group in {id(group_of[a]): group_of[a] for a in atoms if a in group_of}.values():
            merged += group
        for a in (*atoms, *(a for g in merged for a in f.atoms(guards[g]))):
            group_of[a] = merged
    return [sorted(group) for group in {id(g): g for g in group_of.values()}.values()]


def _cells(
    guards: tuple[f.Formula, ...], memo: dict[tuple[f.Formula, ...], frozenset[int]], budget: Budget, deep: int
) -> frozenset[int]:
    if guards in memo:
        return memo[guards]
    budget.spend(16 * sum(map(f.size, guards)))  # the cost of simplifying the guards twice
    if deep > _ATOM_LIMIT:
        raise FormulaError(f"the formula joins more than {_ATOM_LIMIT} propositions in one state: split it into rules")
    atom = next((a for g in guards for a in f.atoms(g)), None)
    if atom is None:
        cells = frozenset([sum(1 << k for k, g in enumerate(guards) if g == f.TRUE)])
    else:
        remainders = (tuple(assign(g, atom, v) for g in guards) for v in (False, True))
        cells = frozenset().union(*(_cells(remainder, memo, budget, deep + 1) for remainder in remainders))
    memo[guards] = cells
    return cells


def evaluate(formula: f.Formula, values: Mapping[f.Atom, NDArray[np.bool_]], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the truth values of a boolean formula, one per entry of arrays of shape `shape`."""
    if isinstance(formula, f.Atom):
        return values[formula]
    if isinstance(formula, f.Const):
        return np.full(shape, formula.value)
    return connect(formula, [evaluate(part, values, shape) for part in f.children(formula)])


def connect(formula: f.Formula, parts: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Return the truth values of a boolean operator, given the truth values of its parts."""
    match formula:
        case f.Not():
            return ~parts[0]
        case f.And():
            return reduce(and_, parts)
        case f.Or():
            return reduce(or_, parts)
        case f.Implies():
            return ~parts[0] | parts[1]
        case f.Iff():
            return ~(parts[0] ^ parts[1])
    raise TypeError(f"not a boolean formula: {formula}")


def holds(formula: f.Formula, true: frozenset[f.Atom]) -> bool:
    """Return the truth value of a boolean formula in the state in which exactly the atoms in `true` hold."""
    return bool(evaluate(formula, {atom: np.array(atom in true) for atom in f.atoms(formula)}, ()))
