"""Ground atoms about vehicles, which elements name by number, and the vehicles of these atoms."""

from __future__ import annotations

from collections.abc import Sequence

from pytest_rvads.logic.live.instant import Mover
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.sorts import Sort

__all__ = ["element_of", "in_columns", "key_of"]


def element_of(term: f.Term) -> f.Element | None:
    """Return the element of a term; None for a value."""
    inner = term.of if isinstance(term, f.Attr) else term
    return inner if isinstance(inner, f.Element) else None


def key_of(term: f.Term, movers: Sequence[Mover]) -> object:
    """Return a key of a term: for an agent its mover, together with the name of an attribute; else the term."""
    element = element_of(term)
    if element is None or element.sort != Sort.AGENT:
        return term
    mover = movers[element.index]
    return (mover, term.name) if isinstance(term, f.Attr) else mover


def in_columns(atom: f.Atom, movers: Sequence[Mover]) -> f.Atom:
    """Return an atom whose agents are numbered by their columns."""

    def move(term: f.Term) -> f.Term:
        if isinstance(term, f.Attr) and isinstance(term.of, f.Element):
            return f.Attr(element(term.of), term.name)
        return element(term) if isinstance(term, f.Element) else term

    def element(old: f.Element) -> f.Element:
        if old.sort != Sort.AGENT:
            return old
        mover = movers[old.index]
        return f.Element(old.sort, mover.slot, mover.agent.name)

    return f.Atom(atom.name, tuple(map(move, atom.terms)), atom.at, atom.word)
