"""Takes the formula of a rule apart: the premise, the obligation, the vehicles that wait, and the event that the vehicles await.

An example is ``G(premise -> waits U goes)``: the obligation ``waits U goes`` holds while a vehicle waits, until the event comes.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj
from pytest_rvads.logic.rules.vocabulary import Sort


class Kind(StrEnum):
    """The forms that the formula of a rule can have."""

    YIELD = "yield"
    """``G(t -> (N w) U g)``: whenever t holds, w must hold from the next state on, up to and including the state in which g comes
    to hold."""
    HOLD = "hold"
    """``G(t -> w U g)`` or ``G(t -> w W g)``: whenever t holds, w must hold in all states before the state in which g comes to
    hold."""
    STATE = "state"
    """``G c`` or ``G(t -> c)`` with no temporal operator inside: a condition on every single state."""
    OTHER = "other"
    """Any other form."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The parts of an instance of a rule (the rule for certain vehicles and entrances)."""

    kind: Kind
    premise: f.Formula | None
    """The condition of the obligation; None if the instance does not have the form ``G(premise -> obligation)``."""
    obligation: f.Formula
    waits: f.Formula | None = None
    """The formula w of the forms YIELD and HOLD, which holds while a vehicle waits."""
    goes: f.Formula | None = None
    """The formula g of the forms YIELD and HOLD, the awaited event."""


def shape_of(formula: f.Formula) -> Shape:
    """Return the premise, obligation and further parts of a rule's formula; outermost universal quantifiers are skipped."""
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
    """Return the formulas whose conjunction is a formula ``G(t -> ...)``; other formulas are not split.

    ``G(t -> (p & (q -> r)))`` is split into ``G(t -> p)`` and ``G(t & q -> r)``, which get separate verdicts.
    """
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
    """Return the parts of a conjunction; of any other formula, the formula itself."""
    return formula.parts if isinstance(formula, f.And) else (formula,)


def agents_of(formula: f.Formula) -> tuple[f.Element, ...]:
    """Return the agents in a formula without variables, in the order of their first occurrence."""
    agents: dict[f.Element, None] = {}
    for atom in f.atoms(formula):
        for term in atom.terms:
            element = term.of if isinstance(term, f.Attr) else term
            if isinstance(element, f.Element) and element.sort == Sort.AGENT:
                agents[element] = None
    return tuple(agents)


def outermost(formula: f.Formula) -> tuple[f.Binder, ...]:
    """Return the variables of the outermost universal quantifiers of a formula."""
    variables: list[f.Binder] = []
    while isinstance(formula, f.Forall):
        variables += formula.variables
        formula = formula.body
    return tuple(variables)
