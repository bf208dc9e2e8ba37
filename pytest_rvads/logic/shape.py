"""The shape of an instance: what triggers it, what it obliges to, who has to wait for what."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.logic import formula as f
from pytest_rvads.logic.boolean import conj
from pytest_rvads.logic.sorts import Sort

__all__ = ["Kind", "Shape", "agents_of", "conjuncts", "shape_of", "split"]


class Kind(StrEnum):
    """The templates of the rules."""

    YIELD = "yield"
    """``G(t -> (N w) U g)``: w must still hold in the step in which g comes."""
    HOLD = "hold"
    """``G(t -> w U g)`` or ``G(t -> w W g)``: w may end in the very step in which g comes."""
    STATE = "state"
    """``G c`` or ``G(t -> c)`` with no temporal operator inside."""
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Shape:
    """An instance taken apart."""

    kind: Kind
    premise: f.Formula | None
    """None for an instance that is not of the form ``G(premise -> obligation)``: it is never vacuous."""
    obligation: f.Formula
    waits: f.Formula | None = None
    """The w of YIELD and HOLD."""
    goes: f.Formula | None = None
    """The g of YIELD and HOLD."""


def shape_of(formula: f.Formula) -> Shape:
    """Take a formula apart; outermost universal quantifiers don't matter."""
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
    """Write ``G(t -> (p & (q -> r)))`` as ``G(t -> p)`` and ``G(t & q -> r)``: what happened is then told part by part."""
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
    """Return the parts of a conjunction, or the formula alone."""
    return formula.parts if isinstance(formula, f.And) else (formula,)


def agents_of(formula: f.Formula) -> tuple[f.Element, ...]:
    """Return the agents a ground formula speaks about, by first occurrence."""
    found: dict[f.Element, None] = {}
    for atom in f.atoms(formula):
        for term in atom.terms:
            element = term.of if isinstance(term, f.Attr) else term
            if isinstance(element, f.Element) and element.sort is Sort.AGENT:
                found[element] = None
    return tuple(found)
