"""Parses text into formulas: the language of rules, and propositional LTL with the spellings of other tools.

Both languages have LALR(1) grammars with the same operators. Unary operators bind tightest, followed by U, W and R, and by
``&``, ``|``, ``->`` and ``<->`` in this order. The scope of a quantifier extends as far to the right as possible.

The library lark is imported when the first formula is parsed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

from lark import Lark, UnexpectedInput

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import replaced, substitute
from pytest_rvads.logic.ltl.grammar import LTL, Build, Language, Mistake, rule_grammar
from pytest_rvads.support.errors import FormulaError, suggest

LENGTH_LIMIT = 20_000
"""Longest text of a formula [characters]."""
DEPTH_LIMIT = 150
"""Deepest nesting of operators and quantified variables; recursion over formulas thus stays well inside Python's limit."""
SIZE_LIMIT = 20_000
"""Largest number of operators and atoms of a formula after its definitions are written out; the text of a formula without
definitions is too short to exceed the limit."""

_SIGNS = {
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
        sign = _SIGNS.get(word.lower())
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
