"""Rewrites formulas, and finds the letters of a monitor.

A monitor reads a letter per state. A letter is a combination of truth values of all guards, and not of all propositions. Guards
are the largest subformulas without temporal operators: ``!(a | b | c) U d`` has two guards and therefore four letters, while its
four propositions have sixteen combinations of truth values.

The work for a formula is limited in steps and not in seconds. Therefore the same formula is accepted or refused on every machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.support.errors import FormulaError

LETTER_LIMIT = 1024
"""Largest number of letters of a monitor."""
_ATOM_LIMIT = 200
"""Largest number of propositions in a group of guards with common propositions; a larger number would exceed Python's limit of
recursion."""


def rebuild(formula: f.Formula, parts: tuple[f.Formula, ...]) -> f.Formula:
    """Return `formula` with its direct subformulas replaced by `parts`."""
    match formula:
        case f.And() | f.Or():
            return type(formula)(parts)
        case f.Forall(variables, _) | f.Exists(variables, _):
            return type(formula)(variables, parts[0])
        case f.Const() | f.Atom():
            return formula
    return type(formula)(*parts)


def replaced(formula: f.Formula, by: Callable[[f.Atom], f.Formula]) -> f.Formula:
    """Return `formula` with every atom replaced by the result of `by` for the atom."""
    if isinstance(formula, f.Atom):
        return by(formula)
    return rebuild(formula, tuple(replaced(child, by) for child in f.children(formula)))


def substitute(formula: f.Formula, terms: Mapping[str, f.Term]) -> f.Formula:
    """Return a formula with its free variables replaced by terms; a quantified variable is renamed if a term has its name."""
    match formula:
        case f.Atom(name, arguments, at, word):
            inserted: list[f.Term] = []
            for term in arguments:
                if isinstance(term, f.Attr) and isinstance(term.of, f.Var):
                    of = terms.get(term.of.name, term.of)
                    inserted.append(f.Attr(of, term.name) if isinstance(of, f.Var | f.Element) else term)
                else:
                    inserted.append(terms.get(term.name, term) if isinstance(term, f.Var) else term)
            return f.Atom(name, tuple(inserted), at, word)
        case f.Forall(variables, body) | f.Exists(variables, body):
            inner = {name: term for name, term in terms.items() if name not in {v.name for v in variables}}
            used_names = {str(t.of if isinstance(t, f.Attr) else t) for t in inner.values()}
            fresh: dict[str, f.Term] = {}
            renamed = []
            for v in variables:
                new = v.name
                while new in used_names:
                    new += "'"
                if new != v.name:
                    fresh[v.name] = f.Var(new)
                used_names.add(new)
                renamed.append(f.Binder(new, v.sort, v.implied))
            return type(formula)(tuple(renamed), substitute(body, {**inner, **fresh}))
    return rebuild(formula, tuple(substitute(c, terms) for c in f.children(formula)))


@dataclass(slots=True)
class Budget:
    """A limit of the work for a formula, counted in steps; a formula that needs more steps is refused."""

    limit: int
    size: int
    """Size of the formula, for the message."""
    spent: int = 0
    what: str = "a monitor too large to build"
    """The result that needs more steps than the limit, for the message."""

    def spend(self, work: int) -> None:
        """Count `work` further steps."""
        self.spent += work
        if self.spent > self.limit:
            raise FormulaError(
                f"the formula, of size {self.size}, needs {self.what} "
                f"(more than {self.limit:,} steps): split it into smaller rules"
            )


def neg(body: f.Formula) -> f.Formula:
    """Return the negation of a formula, simplified."""
    if isinstance(body, f.Const):
        return f.FALSE if body.value else f.TRUE
    return body.body if isinstance(body, f.Not) else f.Not(body)


def conj(parts: Iterable[f.Formula]) -> f.Formula:
    """Return the conjunction of formulas without repetitions; FALSE if a formula occurs together with its negation."""
    return _join(parts, f.And, f.TRUE, f.FALSE)


def disj(parts: Iterable[f.Formula]) -> f.Formula:
    """Return the disjunction of formulas without repetitions; TRUE if a formula occurs together with its negation."""
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
    """Return the equivalence of two formulas, simplified."""
    if isinstance(left, f.Const):
        return right if left.value else neg(right)
    if isinstance(right, f.Const):
        return left if right.value else neg(left)
    return f.TRUE if left == right else f.Iff(left, right)


def letters(guards: tuple[f.Formula, ...], budget: Budget) -> tuple[int, ...]:
    """Return the combinations of truth values of `guards` that are possible; bit k of a combination is the value of guard k.

    For guards with common atoms, both values of an atom are tried, one atom after the other (Shannon expansion).
    """
    group_of: dict[f.Atom, list[int]] = {}
    for k, guard in enumerate(guards):
        merged = [k]
        atoms = f.atoms(guard)
        for group in {id(group_of[a]): group_of[a] for a in atoms if a in group_of}.values():
            merged += group
        for a in (*atoms, *(a for g in merged for a in f.atoms(guards[g]))):
            group_of[a] = merged
    # Guards of different groups have no common atom, and are independent of each other.
    groups = [sorted(group) for group in {id(group): group for group in group_of.values()}.values()]
    choices = []
    total = 1
    for members in groups:
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
