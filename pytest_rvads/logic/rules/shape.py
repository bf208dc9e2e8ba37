"""The shape of an instance: its premise, its obligation, and in it the vehicles that wait and the awaited event."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import sorts_in

__all__ = ["Kind", "Shape", "agents_of", "conjuncts", "outermost", "shape_of", "split", "untimed"]


class Kind(StrEnum):
    """The forms of rules."""

    YIELD = "yield"
    """``G(t -> (N w) U g)``: w must still hold in the step in which g comes."""
    HOLD = "hold"
    """``G(t -> w U g)`` or ``G(t -> w W g)``: w may end in the same step in which g comes."""
    STATE = "state"
    """``G c`` or ``G(t -> c)`` with no temporal operator inside."""
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Shape:
    """The parts of an instance."""

    kind: Kind
    premise: f.Formula | None
    """The premise; None if the instance is not of the form ``G(premise -> obligation)``, so that it is never vacuous."""
    obligation: f.Formula
    waits: f.Formula | None = None
    """The w of YIELD and HOLD."""
    goes: f.Formula | None = None
    """The g of YIELD and HOLD."""


def shape_of(formula: f.Formula) -> Shape:
    """Return the parts of a formula; outermost universal quantifiers are skipped."""
    while isinstance(formula, f.Forall):
        formula = formula.body
    if not isinstance(formula, f.Always):
        return Shape(Kind.OTHER, None, formula)
    premise, obligation = None, formula.body
    if isinstance(formula.body, f.Implies):
        premise, obligation = formula.body.left, formula.body.right
    match obligation:
        case f.Until(f.Next(waits), goes) if f.is_boolean(waits) and f.is_boolean(goes):
            return Shape(Kind.YIELD, premise, obligation, waits, goes)
        case f.Until(waits, goes) | f.WeakUntil(waits, goes) if f.is_boolean(waits) and f.is_boolean(goes):
            return Shape(Kind.HOLD, premise, obligation, waits, goes)
    return Shape(Kind.STATE if f.is_boolean(formula.body) else Kind.OTHER, premise, obligation)


def split(formula: f.Formula) -> tuple[f.Formula, ...]:
    """Split ``G(t -> (p & (q -> r)))`` into ``G(t -> p)`` and ``G(t & q -> r)``, so that each part has a verdict."""
    if not (isinstance(formula, f.Always) and isinstance(formula.body, f.Implies)):
        return (formula,)
    premise, obligation = formula.body.left, formula.body.right
    if isinstance(obligation, f.And):
        parts = obligation.parts
        return tuple(g for part in parts for g in split(f.Always(f.Implies(premise, part))))
    if isinstance(obligation, f.Implies):
        return split(f.Always(f.Implies(conj((premise, obligation.left)), obligation.right)))
    return (formula,)


def conjuncts(formula: f.Formula) -> tuple[f.Formula, ...]:
    """Return the parts of a conjunction, or the formula itself."""
    return formula.parts if isinstance(formula, f.And) else (formula,)


def agents_of(formula: f.Formula) -> tuple[f.Element, ...]:
    """Return the agents of a ground formula, by first occurrence."""
    agents: dict[f.Element, None] = {}
    for atom in f.atoms(formula):
        for term in atom.terms:
            element = term.of if isinstance(term, f.Attr) else term
            if isinstance(element, f.Element) and element.sort == Sort.AGENT:
                agents[element] = None
    return tuple(agents)


def outermost(formula: f.Formula) -> tuple[f.Binder, ...]:
    """Return the variables of the outermost universal quantifiers."""
    variables: list[f.Binder] = []
    while isinstance(formula, f.Forall):
        variables += formula.variables
        formula = formula.body
    return tuple(variables)


def untimed(formula: f.Formula, sorts: Mapping[str, str] | None = None) -> f.Atom | None:
    """Return an atom that changes during a run but stands outside every temporal operator: only its first state counts."""
    sorts = sorts or {}
    match formula:
        case f.Atom():
            return None if _static(formula, sorts) else formula
        case f.Forall(variables, body) | f.Exists(variables, body):
            return untimed(body, {**sorts, **{v.name: v.sort for v in variables}})
        case f.Next() | f.Always() | f.Eventually() | f.Until() | f.WeakUntil() | f.Release():
            return None
    return next((atom for child in f.children(formula) if (atom := untimed(child, sorts))), None)


def _static(atom: f.Atom, sorts: Mapping[str, str]) -> bool:
    """Return whether the value of an atom is the same in every state."""
    if atom.name in ("=", "!="):
        return all(isinstance(term, f.Var) for term in atom.terms)
    word, first = word_of(atom), atom.terms[0] if atom.terms else None
    return word is not None and isinstance(first, f.Var) and sorts.get(first.name) in sorts_in(word.static)
