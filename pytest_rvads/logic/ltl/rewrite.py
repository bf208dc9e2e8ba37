"""Rewriting formulas: replacing subformulas, atoms and variables."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pytest_rvads.logic.ltl import formula as f

__all__ = ["rebuild", "replaced", "substitute"]


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
    """Replace free variables by terms; bound variables are renamed if they would capture a variable of a term."""
    match formula:
        case f.Atom(name, arguments, at, word):
            return f.Atom(name, tuple(_substitute(t, terms) for t in arguments), at, word)
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
                renamed.append(f.Binder(new, v.sort, v.told))
            return type(formula)(tuple(renamed), substitute(body, {**inner, **fresh}))
    return rebuild(formula, tuple(substitute(c, terms) for c in f.children(formula)))


def _substitute(term: f.Term, terms: Mapping[str, f.Term]) -> f.Term:
    if isinstance(term, f.Var):
        return terms.get(term.name, term)
    if isinstance(term, f.Attr) and isinstance(term.of, f.Var):
        of = terms.get(term.of.name, term.of)
        return f.Attr(of, term.name) if isinstance(of, f.Var | f.Element) else term
    return term
