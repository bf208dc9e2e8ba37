"""The grammars of rules and of propositional LTL, and the builder of syntax trees that runs inside the parser.

A `Language` holds the sorts, the letters of the variables of each sort, the named values and the relations of rules.
"""

# ruff: noqa: D102 - the methods of the builder are named after the rules of the grammar

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lark import Token, Transformer, v_args

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.support.errors import suggest


@dataclass(frozen=True)
class Language:
    """The sorts, letters, values and relations that a parser of rules has to know; other predicates are checked after parsing."""

    sorts: tuple[str, ...]
    letters: Mapping[str, str]
    """Maps the letters of a variable to its sort: ``x``, or ``x.part`` for a part of the element that ``x`` stands for."""
    values: tuple[str, ...]
    """Names of values, such as colours; a variable can't have such a name."""
    relations: tuple[str, ...]
    """Predicates of two terms that are written between the terms."""
    keywords: tuple[str, ...] = ()
    """Further names that error messages suggest for misspelt words."""

    def __hash__(self) -> int:
        return hash((self.sorts, self.values, self.relations))

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """The letters that are allowed after the dot in names of variables such as ``x.part``."""
        return tuple(dict.fromkeys(letters.partition(".")[2] for letters in self.letters if "." in letters))

    def sort_of(self, name: str) -> str | None:
        """Return the sort that the letters of a variable such as ``x'`` or ``x.part2`` imply, or None if they imply no sort."""
        match = re.fullmatch(rf"([A-Za-z_]+)\d*'*(?:\.({'|'.join(self.parts)})\d*'*)?", name)
        return self.letters.get(".".join(filter(None, match.groups()))) if match else None


_OPERATORS = r"""
?formula: equivalence
?equivalence: implication | equivalence IFF implication -> iff
?implication: disjunction | disjunction IMPLIES implication -> implies
?disjunction: exclusive (OR exclusive)* -> disjunction
?exclusive: conjunction | exclusive XOR conjunction -> xor
?conjunction: binary (AND binary)* -> conjunction
?binary: unary | unary UNTIL binary -> until | unary WEAK binary -> weak | unary RELEASE binary -> release
?unary: NOT unary -> negation
      | NEXT unary -> next_
      | ALWAYS unary -> always
      | EVENTUALLY unary -> eventually
      | "(" formula ")"
      | "[" formula "]"
      | TRUE -> true
      | FALSE -> false
      | atom

IFF: "<->" | "<=>" | "↔" | "⇔"
IMPLIES: "->" | "=>" | "→" | "⇒"
OR: "||" | "|" | "\\/" | "∨"
AND: "&&" | "&" | "/\\" | "∧"
XOR: "^" | "⊕"
NOT: "!" | "~" | "¬"
NEXT.2: /[NX○◯](?![A-Za-z0-9_'])/
ALWAYS.2: /G(?![A-Za-z0-9_'])/ | "[]" | "□"
EVENTUALLY.2: /F(?![A-Za-z0-9_'])/ | "<>" | "◇" | "◊"
UNTIL.2: /U(?![A-Za-z0-9_'])/
WEAK.2: /W(?![A-Za-z0-9_'])/
RELEASE.2: /R(?![A-Za-z0-9_'])/
COMMENT: /#[^\n]*/
%ignore COMMENT
%ignore /\s+/
"""

LTL = (
    _OPERATORS
    + r"""
start: formula
?atom: NAME -> proposition
TRUE.2: /true(?![A-Za-z0-9_'])/ | /1(?![A-Za-z0-9_'])/ | "⊤"
FALSE.2: /false(?![A-Za-z0-9_'])/ | /0(?![A-Za-z0-9_'])/ | "⊥"
NAME: /[A-Za-z_][A-Za-z0-9_.']*/
"""
)

_RULE = (
    _OPERATORS
    + r"""
start: definition* formula
definition: NAME "(" terms ")" ":=" formula ";"
atom: term AT NAME -> place
    | term RELATION term -> infix
    | term COMPARISON term -> infix
    | NAME "(" terms ")" -> predicate
    | NAME -> proposition
    | FORALL binders "." formula -> forall
    | EXISTS binders "." formula -> exists
binders: binder ("," binder)*
binder: NAME (":" NAME)?
terms: term ("," term)*
term: NAME -> name
    | ATTRIBUTE -> attribute
    | NUMBER -> number
TRUE.2: /true(?![A-Za-z0-9_'])/ | "⊤"
FALSE.2: /false(?![A-Za-z0-9_'])/ | "⊥"
FORALL.2: /forall(?![A-Za-z0-9_'])/ | "∀"
EXISTS.2: /exists(?![A-Za-z0-9_'])/ | "∃"
AT: "@"
RELATION.2: /(?:RELATIONS)(?![A-Za-z0-9_'])/
COMPARISON: "=" | "!=" | "≠" | "<" | "<=" | "≤" | ">" | ">=" | "≥"
ATTRIBUTE.1: /[A-Za-z_][A-Za-z0-9_]*'*\.(?!(?:PARTS)[0-9]*'*(?![A-Za-z0-9_']))[a-z]+'*(?![A-Za-z0-9_'(@])/
NAME: /[A-Za-z_][A-Za-z0-9_]*'*(?:\.(?:PARTS)[0-9]*'*(?![A-Za-z0-9_']))?/
NUMBER: /[0-9]+(\.[0-9]+)?/
"""
)

_SIGNS = {"≠": "!=", "≤": "<=", "≥": ">="}


def rule_grammar(language: Language) -> str:
    """Return the text of the LALR grammar of rules in a language."""
    relations, parts = ("|".join(map(re.escape, names)) for names in (language.relations, language.parts))
    return _RULE.replace("RELATIONS", relations).replace("PARTS", parts)


class Mistake(Exception):
    """A mistake in the text of a formula, found while the syntax tree is built, with its position in the text."""

    def __init__(self, at: int, message: str) -> None:
        self.at = at
        self.message = message


def _operator(kind: Callable[..., f.Formula]) -> Callable[..., f.Formula]:
    return lambda _self, *parts: kind(*(part for part in parts if isinstance(part, f.Formula)))


@v_args(inline=True)
class Build(Transformer[Token, Any]):
    """Builds the syntax tree of a formula bottom-up while the parser runs, so that deeply nested text causes no recursion."""

    def __init__(self, language: Language | None = None) -> None:
        super().__init__()
        self._language = language or Language((), {}, (), ())

    def start(self, *parts: Any) -> Any:
        return parts

    def definition(self, name: Token, terms: tuple[f.Term, ...], body: f.Formula) -> Any:
        for term in terms:
            if not isinstance(term, f.Var):
                raise Mistake(name.start_pos or 0, f"the parameters of {name!s} must be variables, got {term}")
        return (str(name), terms, body)

    iff, implies, until, weak, release = map(_operator, (f.Iff, f.Implies, f.Until, f.WeakUntil, f.Release))
    negation, next_, always, eventually = map(_operator, (f.Not, f.Next, f.Always, f.Eventually))

    def xor(self, left: f.Formula, _: Token, right: f.Formula) -> f.Formula:
        return f.Not(f.Iff(left, right))

    def disjunction(self, *parts: f.Formula | Token) -> f.Formula:
        return f.Or(tuple(p for p in parts if isinstance(p, f.Formula))) if len(parts) > 1 else parts[0]  # type: ignore[return-value]

    def conjunction(self, *parts: f.Formula | Token) -> f.Formula:
        return f.And(tuple(p for p in parts if isinstance(p, f.Formula))) if len(parts) > 1 else parts[0]  # type: ignore[return-value]

    def true(self, _: Token) -> f.Formula:
        return f.TRUE

    def false(self, _: Token) -> f.Formula:
        return f.FALSE

    def proposition(self, name: Token) -> f.Formula:
        return f.Atom(str(name), (), name.start_pos or 0)

    def place(self, term: f.Term, sign: Token, where: Token) -> f.Formula:
        return f.Atom("@", (term, f.Var(str(where), where.start_pos or 0)), sign.start_pos or 0)

    def infix(self, left: f.Term, sign: Token, right: f.Term) -> f.Formula:
        return f.Atom(f.Infix(_SIGNS.get(str(sign), str(sign))), (left, right), sign.start_pos or 0)

    def predicate(self, name: Token, terms: tuple[f.Term, ...]) -> f.Formula:
        return f.Atom(str(name), terms, name.start_pos or 0)

    def terms(self, *terms: f.Term) -> tuple[f.Term, ...]:
        return terms

    def name(self, name: Token) -> f.Term:
        return f.Value(str(name)) if name in self._language.values else f.Var(str(name), name.start_pos or 0)

    def attribute(self, text: Token) -> f.Term:
        of, _, name = text.rpartition(".")
        return f.Attr(f.Var(of, text.start_pos or 0), name)

    def number(self, text: Token) -> f.Term:
        return f.Number(float(text))

    def binder(self, name: Token, declared: Token | None = None) -> f.Binder:
        at, implied, sorts = name.start_pos or 0, self._language.sort_of(name), self._language.sorts
        if name in self._language.values:
            raise Mistake(at, f"{name!s} is a value, it can't be a variable")
        if declared is not None and declared not in sorts:
            raise Mistake(declared.start_pos or 0, f"unknown sort {declared!s}{suggest(declared, map(str, sorts))}")
        sort = implied if declared is None else sorts[sorts.index(declared)]
        if sort is None:
            raise Mistake(at, f"the letters of {name!s} tell no sort: declare one, such as `forall {name!s}: {sorts[0]}.`")
        return f.Binder(str(name), sort, sort == implied)

    def binders(self, *binders: f.Binder) -> tuple[f.Binder, ...]:
        return binders

    def forall(self, _: Token, binders: tuple[f.Binder, ...], body: f.Formula) -> f.Formula:
        return f.Forall(binders, body)

    def exists(self, _: Token, binders: tuple[f.Binder, ...], body: f.Formula) -> f.Formula:
        return f.Exists(binders, body)
