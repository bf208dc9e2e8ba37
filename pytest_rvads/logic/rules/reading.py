"""Parses and checks the text of a rule: every variable bound, every predicate known, every sort right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.parser import caret, parse_rule
from pytest_rvads.logic.ltl.rewrite import replaced
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, BUILT_IN
from pytest_rvads.logic.rules.sorts import DIRECTIONS, LANGUAGE, Sort
from pytest_rvads.logic.rules.vocabulary import Vocabulary, sorts_in
from pytest_rvads.support.errors import FormulaError, suggest

__all__ = ["COMPARISONS", "parse"]

COMPARISONS = ("=", "!=", "<", "<=", ">", ">=")
_VERTICES = {Sort.ENTRANCE, Sort.EXIT, Sort.VERTEX}


def parse(text: str, vocabulary: Vocabulary = BUILT_IN) -> f.Formula:
    """Parse a rule and check it: every variable bound (but ``j``, the junction under test), known predicates, right sorts.

    Args:
        text: the text of the rule.
        vocabulary: the predicates that the rule may use. The atoms of the formula hold the words that are not shipped.

    Raises:
        FormulaError: the text is not a rule; the message shows the line, a caret and the nearest valid word.
    """
    formula = parse_rule(text, LANGUAGE)
    _Check(text, vocabulary).formula(formula, {"j": Sort.JUNCTION})
    own = vocabulary.keys() - BUILT_IN.keys()

    def filled(atom: f.Atom) -> f.Atom:
        return replace(atom, word=vocabulary[atom.name]) if atom.name in own else atom

    return replaced(formula, filled) if own else formula


@dataclass(frozen=True, slots=True)
class _Check:
    text: str
    vocabulary: Vocabulary

    def formula(self, formula: f.Formula, scope: Mapping[str, str]) -> None:
        if isinstance(formula, f.Atom):
            self.atom(formula, scope)
        elif isinstance(formula, f.Forall | f.Exists):
            names = [v.name for v in formula.variables]
            if len(set(names)) < len(names):
                raise FormulaError(f"a quantifier binds a variable twice: {', '.join(names)}")
            self.formula(formula.body, {**scope, **{v.name: v.sort for v in formula.variables}})
        else:
            for child in f.children(formula):
                self.formula(child, scope)

    def atom(self, atom: f.Atom, scope: Mapping[str, str]) -> None:
        kinds = [self.term(t, scope, atom.at) for t in atom.terms]
        name = atom.name
        if name in COMPARISONS:
            self.comparison(atom, kinds)
            return
        if name not in self.vocabulary:
            what = f"unknown predicate {name!r}" if atom.terms else f"{name!r} is neither a formula nor a known predicate"
            near = suggest(name, self.vocabulary) or ": register it before the rule, or give the rule its Word by words="
            raise FormulaError(caret(what + near, self.text, atom.at))
        wanted = self.vocabulary[name].sorts
        if len(kinds) != len(wanted):
            message = f"{name} takes {len(wanted)} arguments ({', '.join(wanted)}), got {len(kinds)}"
            raise FormulaError(caret(message, self.text, atom.at))
        for term, kind, sorts in zip(atom.terms, kinds, wanted, strict=True):
            if kind not in sorts_in(sorts):
                raise FormulaError(caret(f"{atom}: expected {sorts}, got {term}, of sort {kind}", self.text, atom.at))

    def comparison(self, atom: f.Atom, kinds: list[str]) -> None:
        left, right = kinds
        alike = left == right or {left, right} <= _VERTICES
        ordered = atom.name not in ("=", "!=")
        if not alike or (ordered and left != "number"):
            rule = "only numbers have an order" if alike else "both sides must have the same sort"
            raise FormulaError(caret(f"{atom}: can't compare {left} with {right}, {rule}", self.text, atom.at))
        if not any(isinstance(t, f.Attr | f.Var) for t in atom.terms):
            raise FormulaError(caret(f"{atom}: a comparison needs an attribute or a variable", self.text, atom.at))
        mixed = {t.name for t in atom.terms if isinstance(t, f.Attr)}
        if len(mixed) == 2:
            raise FormulaError(caret(f"{atom}: can't compare {' with '.join(sorted(mixed))}", self.text, atom.at))

    def term(self, term: f.Term, scope: Mapping[str, str], at: int) -> str:
        match term:
            case f.Var(name):
                if name not in scope:
                    near = suggest(name, scope) or f": quantify it, `forall {name}.`"
                    raise FormulaError(caret(f"unbound variable {name}{near}", self.text, term.at))
                return scope[name]
            case f.Attr(of, name):
                return self.attribute(term, self.term(of, scope, at), of.at if isinstance(of, f.Var) else 0)
            case f.Value(name):
                return "direction" if name in DIRECTIONS else "colour"
            case f.Number():
                return "number"
            case f.Element(sort):
                return sort

    def attribute(self, term: f.Attr, sort: str, at: int) -> str:
        known = ATTRIBUTES.get(term.name)
        if known is None:
            raise FormulaError(caret(f"unknown attribute {term.name!r}{suggest(term.name, ATTRIBUTES)}", self.text, at))
        if sort != known.owner:
            message = f"{term}: {term.name} belongs to {known.owner}s, {term.of} is of sort {sort}"
            raise FormulaError(caret(message, self.text, at))
        return known.kind
