"""Formulas of the paper's first-order linear temporal logic (section 5.1): a small frozen syntax tree and its text form.

Printing and parsing are inverse: `parse(str(f)) == f` for every formula that the parser can produce. Conjunctions and
disjunctions are flat, so that ``a & (b & c)`` and ``a & b & c`` are the same formula.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from pytest_rvads.logic.ltl.terms import Attr, Binder, Element, Infix, Number, Term, Value, Var

__all__ = [
    "FALSE",
    "TRUE",
    "Always",
    "And",
    "Atom",
    "Attr",
    "Binder",
    "Const",
    "Element",
    "Eventually",
    "Exists",
    "Forall",
    "Formula",
    "Iff",
    "Implies",
    "Infix",
    "Next",
    "Not",
    "Number",
    "Or",
    "Release",
    "Term",
    "Until",
    "Value",
    "Var",
    "WeakUntil",
    "atoms",
    "children",
    "depth",
    "is_boolean",
    "size",
    "walk",
]


class Formula:
    """Base of all formulas."""

    __slots__ = ()

    def __str__(self) -> str:
        return _show(self, 0)


@dataclass(frozen=True, slots=True)
class Const(Formula):
    """Truth or falsity."""

    value: bool


TRUE, FALSE = Const(True), Const(False)


@dataclass(frozen=True, slots=True)
class Atom(Formula):
    """A predicate over terms; a proposition if there are no terms."""

    name: str
    terms: tuple[Term, ...] = ()
    at: int = field(default=0, compare=False, repr=False)
    """Position of the atom in the text, for error messages."""
    word: object = field(default=None, hash=False, repr=False)
    """The meaning of the name, if the name alone does not determine it."""

    def __eq__(self, other: object) -> bool:
        """Return whether both atoms have the same name, the same terms and the same word.

        Results are cached by atom, so the words must be one object, not two equal objects.
        """
        if not isinstance(other, Atom):
            return NotImplemented
        return self.name == other.name and self.terms == other.terms and self.word is other.word


@dataclass(frozen=True, slots=True)
class Not(Formula):
    """Negation."""

    body: Formula


@dataclass(frozen=True, slots=True)
class And(Formula):
    """Conjunction of two or more formulas, none of them a conjunction."""

    parts: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(q for p in self.parts for q in (p.parts if isinstance(p, And) else (p,))))


@dataclass(frozen=True, slots=True)
class Or(Formula):
    """Disjunction of two or more formulas, none of them a disjunction."""

    parts: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(q for p in self.parts for q in (p.parts if isinstance(p, Or) else (p,))))


@dataclass(frozen=True, slots=True)
class Implies(Formula):
    """Implication."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Iff(Formula):
    """Equivalence."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Next(Formula):
    """The body holds in the next state, which must exist (the paper's N)."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Always(Formula):
    """The body holds in this and every later state."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Eventually(Formula):
    """The body holds in this or some later state."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Until(Formula):
    """`right` comes to hold, and `left` holds until then."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class WeakUntil(Formula):
    """`left` holds until `right` comes to hold, or forever."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Release(Formula):
    """`right` holds up to and including the state in which `left` comes to hold, or forever."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Forall(Formula):
    """The body holds for all elements of the sorts of the variables."""

    variables: tuple[Binder, ...]
    body: Formula


@dataclass(frozen=True, slots=True)
class Exists(Formula):
    """The body holds for some elements of the sorts of the variables."""

    variables: tuple[Binder, ...]
    body: Formula


def children(formula: Formula) -> tuple[Formula, ...]:
    """Return the direct subformulas."""
    match formula:
        case Not(body) | Next(body) | Always(body) | Eventually(body) | Forall(_, body) | Exists(_, body):
            return (body,)
        case And(parts) | Or(parts):
            return parts
        case Implies(left, right) | Iff(left, right) | Until(left, right) | WeakUntil(left, right) | Release(left, right):
            return (left, right)
    return ()


def walk(formula: Formula) -> Iterator[tuple[Formula, int]]:
    """Yield every subformula with its depth, from left to right, without recursion; a bound variable adds one to the depth."""
    stack = [(formula, 1)]
    while stack:
        node, level = stack.pop()
        yield node, level
        below = level + (len(node.variables) if isinstance(node, Forall | Exists) else 1)
        stack.extend((child, below) for child in reversed(children(node)))


def size(formula: Formula) -> int:
    """Return the number of operators and atoms; a conjunction of n parts has n - 1 operators."""
    return sum(len(n.parts) - 1 if isinstance(n, And | Or) else 1 for n, _ in walk(formula))


def depth(formula: Formula) -> int:
    """Return the nesting depth of operators and bound variables."""
    return max(level for _, level in walk(formula))


def atoms(formula: Formula) -> tuple[Atom, ...]:
    """Return the distinct atoms in the order of their first occurrence."""
    return tuple(dict.fromkeys(n for n, _ in walk(formula) if isinstance(n, Atom)))


_TEMPORAL = (Next, Always, Eventually, Until, WeakUntil, Release)


def is_boolean(formula: Formula) -> bool:
    """Say whether the formula speaks about the present state alone."""
    return not isinstance(formula, _TEMPORAL) and all(map(is_boolean, children(formula)))


_UNARY = {Not: "!", Next: "N ", Always: "G ", Eventually: "F "}
_BINARY = {
    Iff: (1, "<->"),
    Implies: (2, "->"),
    Or: (3, "|"),
    And: (4, "&"),
    Until: (5, "U"),
    WeakUntil: (5, "W"),
    Release: (5, "R"),
}


def _show(formula: Formula, level: int) -> str:
    """Return the text, in parentheses if a surrounding operator of binding strength `level` needs them."""
    match formula:
        case Const(value):
            return "true" if value else "false"
        case Atom(name, terms):
            return _show_atom(name, terms)
        case Not(Atom(Infix() as name, terms)):
            # Without parentheses the text would look like a comparison of a negated term.
            return f"!({_show_atom(name, terms)})"
        case Not(body) | Next(body) | Always(body) | Eventually(body):
            inner = _show(body, 6)
            word = _UNARY[type(formula)]
            return word.rstrip() + inner if inner.startswith("(") else word + inner
        case Forall(variables, body) | Exists(variables, body):
            word = "forall" if isinstance(formula, Forall) else "exists"
            text = f"{word} {', '.join(map(str, variables))}. {_show(body, 0)}"
            return f"({text})" if level else text
        case And(parts) | Or(parts):
            strength, sign = _BINARY[type(formula)]
            text = f" {sign} ".join(_show(p, strength + 1) for p in parts)
        case Implies(left, right) | Iff(left, right) | Until(left, right) | WeakUntil(left, right) | Release(left, right):
            strength, sign = _BINARY[type(formula)]
            # Equivalence groups to the left, the other operators to the right.
            low, high = (strength, strength + 1) if isinstance(formula, Iff) else (strength + 1, strength)
            text = f"{_show(left, low)} {sign} {_show(right, high)}"
        case _:
            raise TypeError(f"not a formula: {formula!r}")
    return f"({text})" if strength < level else text


def _show_atom(name: str, terms: tuple[Term, ...]) -> str:
    if name == "@":
        return f"{terms[0]}@{terms[1]}"
    if isinstance(name, Infix):
        return f"{terms[0]} {name} {terms[1]}"
    return f"{name}({', '.join(map(str, terms))})" if terms else name
