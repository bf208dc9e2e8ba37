"""Parses text into formulas: the language of rules, and propositional LTL with the spellings of other tools.

Both languages have LALR(1) grammars with the same operators. Unary operators bind tightest, followed by U, W and R, and by
``&``, ``|``, ``->`` and ``<->`` in this order. The scope of a quantifier extends as far to the right as possible. The syntax tree
is built inside the parser. A `Language` holds the sorts, the letters of the variables of each sort, the named values and the
relations of rules.
"""

# ruff: noqa: D102 - the methods of the builder are named after the rules of the grammar

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

from lark import Lark, Token, Transformer, UnexpectedInput, v_args

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import replaced, substitute
from pytest_rvads.support.errors import FormulaError, suggest


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


LENGTH_LIMIT = 20_000
"""Longest text of a formula [characters]."""
DEPTH_LIMIT = 150
"""Deepest nesting of operators and quantified variables; recursion over formulas thus stays well inside Python's limit."""
SIZE_LIMIT = 20_000
"""Largest number of operators and atoms of a formula after its definitions are written out; the text of a formula without
definitions is too short to exceed the limit."""

_SPELT_OUT = {
    "not": "!",
    "and": "&",
    "or": "|",
    "xor": "^",
    "implies": "->",
    "iff": "<->",
    "next": "N",
    "always": "G",
    "globally": "G",
    "eventually": "F",
    "finally": "F",
    "until": "U",
    "release": "R",
}
"""Maps words that people write for operators to the operators."""


@cache
def _parser(language: Language | None) -> Lark:
    grammar = LTL if language is None else rule_grammar(language)
    return Lark(grammar, parser="lalr", transformer=Build(language), maybe_placeholders=False)


def parse_ltl(text: str) -> f.Formula:
    """Return the formula of a text of propositional LTL; any identifier but ``G F X N U W R true false`` is a proposition."""
    (formula,) = _parse(None, text)
    return _bounded(formula, text)


def parse_rule(text: str, language: Language) -> f.Formula:
    """Return the formula of a rule, given as definitions ``name(x, y) := ...;`` and a formula, with the definitions written out.

    Sorts of terms and names of predicates are not checked.
    """
    *definitions, formula = _parse(language, text)
    defined: dict[str, _Definition] = {}
    for name, parameters, body in definitions:
        written_out = _expand(body, defined, text)
        defined[name] = _Definition(parameters, written_out, f.size(written_out))
    return _expand(formula, defined, text)


def _parse(language: Language | None, text: str) -> tuple[Any, ...]:
    if len(text) > LENGTH_LIMIT:
        raise FormulaError(f"the formula has {len(text):,} characters, at most {LENGTH_LIMIT:,} are read: split it into rules")
    try:
        parsed: tuple[Any, ...] = _parser(language).parse(text)  # type: ignore[assignment]
    except UnexpectedInput as error:
        keywords: tuple[str, ...] = ("true", "false")
        if language is not None:
            keywords = ("forall", "exists", *language.relations, *keywords, *language.keywords)
        raise FormulaError(_unexpected(error, text, keywords)) from None
    except Mistake as error:
        raise FormulaError(caret(error.message, text, error.at)) from None
    return parsed


def _bounded(formula: f.Formula, text: str) -> f.Formula:
    deep = f.depth(formula)
    if deep > DEPTH_LIMIT:
        shown = text if len(text) <= 40 else text[:40] + "..."
        raise FormulaError(
            f"the formula {shown!r} nests {deep} operators and variables, at most {DEPTH_LIMIT} are read: split it into rules"
        )
    return formula


def _unexpected(error: UnexpectedInput, text: str, keywords: tuple[str, ...]) -> str:
    """Return the message of a parse error: the unexpected word, the expected words, and a suggestion for a misspelt keyword.

    The parser often reads a misspelt keyword as a name and reports the error one word later. Therefore the word before the
    reported word is checked first.
    """
    at = error.pos_in_stream if isinstance(error.pos_in_stream, int) and error.pos_in_stream >= 0 else len(text)
    token = getattr(error, "token", None)
    terminals = set(getattr(error, "accepts", None) or getattr(error, "expected", None) or getattr(error, "allowed", None) or ())
    if token is not None and token.type == "$END":
        at, got = len(text.rstrip()), "the end"
    else:
        got = repr(str(token) if token is not None else text[at : at + 1])
    before = re.search(r"([A-Za-z_][A-Za-z_-]*)\s*$", text[:at])
    for word, place in ((before and before[1], before and before.start(1)), (str(token or ""), at)):
        if not word or place is None:
            continue
        sign = _SPELT_OUT.get(word.lower())
        hint = f"; did you mean {sign!r}?" if sign else suggest(word, [k for k in keywords if k != word]) if len(word) > 2 else ""
        if hint:
            return caret(f"unexpected {word!r}{hint}", text, place)
    expected = (
        "a formula" if "ALWAYS" in terminals else "a closing bracket or an operator" if terminals & {"RPAR", "RSQB"} else ""
    )
    expected = expected or ("a name" if terminals == {"NAME"} else "an operator or the end" if "$END" in terminals else "")
    return caret(f"unexpected {got}{', expected ' + expected if expected else ''}", text, at)


def caret(message: str, text: str, at: int) -> str:
    """Return `message` with the line of `text` that contains position `at`, and a caret below the position."""
    start = text.rfind("\n", 0, at) + 1
    end = text.find("\n", at)
    line = text[start : len(text) if end < 0 else end]
    column = at - start
    cut = max(0, column - 60)
    shown = ("..." if cut else "") + line[cut : cut + 100] + ("..." if len(line) > cut + 100 else "")
    place = column - cut + (3 if cut else 0)
    where = f" in line {text.count(chr(10), 0, at) + 1}" if "\n" in text.strip() else ""
    return f"{message}{where}\n  {shown}\n  {' ' * place}^"


class _Definition(NamedTuple):
    parameters: tuple[f.Var, ...]
    body: f.Formula
    size: int


def _expand(formula: f.Formula, defined: Mapping[str, _Definition], text: str) -> f.Formula:
    """Return a formula with the predicates that the text defines replaced by their definitions; neither exceeds the limits."""
    _bounded(formula, text)
    used = (defined[node.name].size - 1 for node, _ in f.walk(formula) if isinstance(node, f.Atom) and node.name in defined)
    size = f.size(formula) + sum(used)
    if size > SIZE_LIMIT:
        raise FormulaError(
            f"with its definitions written out, the formula has {size:,} operators and atoms, at most {SIZE_LIMIT:,} are read: "
            "split it into rules"
        )

    def body_of(atom: f.Atom) -> f.Formula:
        if atom.name not in defined:
            return atom
        parameters, body, _ = defined[atom.name]
        if len(parameters) != len(atom.terms):
            raise FormulaError(caret(f"{atom.name} takes {len(parameters)} arguments, got {len(atom.terms)}", text, atom.at))
        return substitute(body, dict(zip((p.name for p in parameters), atom.terms, strict=True)))

    return _bounded(replaced(formula, body_of), text) if defined else formula
