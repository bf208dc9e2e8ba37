"""Formulas of the paper's first-order linear temporal logic (section 5.1) and their terms, as frozen syntax trees and as text.

The terms are variables, elements, named values, numbers and attributes. The text of a formula can be parsed again:
`parse(str(f)) == f` for every formula that the parser can produce. Conjunctions and disjunctions are flat: ``a & (b & c)`` and
``a & b & c`` are the same formula.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal


class Infix(str):
    """The name of a relation that is written between its two terms, such as a comparison."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Var:
    """An occurrence of a variable in a formula."""

    name: str
    at: int = field(default=0, compare=False, repr=False)
    """Position of the variable in the text, for error messages."""

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Element:
    """An element that a variable can stand for, such as a vehicle or an entrance."""

    sort: str = field(hash=False)  # the name determines the sort
    index: int
    """Number of the element among the elements of its sort."""
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Value:
    """A named value, such as a colour."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a comparison."""

    value: float

    def __str__(self) -> str:
        return format(Decimal(repr(self.value)).normalize(), "f")


@dataclass(frozen=True, slots=True)
class Attr:
    """An attribute of an element or of the element that a variable stands for: ``x.size``."""

    of: Var | Element
    name: str

    def __str__(self) -> str:
        return f"{self.of}.{self.name}"


Term = Var | Element | Value | Number | Attr


@dataclass(frozen=True, slots=True)
class Binder:
    """A quantified variable with its sort; the sort is printed only if the letters of the variable don't imply the sort."""

    name: str
    sort: str
    implied: bool = field(default=False, compare=False, repr=False)
    """Whether the letters of the name imply the sort; the text of a formula need not declare such a sort."""

    def __str__(self) -> str:
        return self.name if self.implied else f"{self.name}: {self.sort}"


class Formula:
    """The base class of all formulas."""

    __slots__ = ()

    def __str__(self) -> str:
        return _show(self, 0)


@dataclass(frozen=True, slots=True)
class Const(Formula):
    """The constant true or false."""

    value: bool


TRUE, FALSE = Const(True), Const(False)


@dataclass(frozen=True, slots=True)
class Atom(Formula):
    """A predicate applied to terms; a proposition if the atom has no terms."""

    name: str
    terms: tuple[Term, ...] = ()
    at: int = field(default=0, compare=False, repr=False)
    """Position of the atom in the text, for error messages."""
    word: object = field(default=None, hash=False, repr=False)
    """The definition of the predicate, if users defined the predicate; None if the name determines the predicate."""

    def __eq__(self, other: object) -> bool:
        """Return whether both atoms have the same name, the same terms and the same definition of the predicate.

        The definitions (`word`) must be the same object and not only equal, because atoms are keys of caches of truth values.
        """
        if not isinstance(other, Atom):
            return NotImplemented
        return self.name == other.name and self.terms == other.terms and self.word is other.word


@dataclass(frozen=True, slots=True)
class Not(Formula):
    """The negation of a formula."""

    body: Formula


@dataclass(frozen=True, slots=True)
class And(Formula):
    """The conjunction of two or more formulas, none of which is a conjunction."""

    parts: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(q for p in self.parts for q in (p.parts if isinstance(p, And) else (p,))))


@dataclass(frozen=True, slots=True)
class Or(Formula):
    """The disjunction of two or more formulas, none of which is a disjunction."""

    parts: tuple[Formula, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", tuple(q for p in self.parts for q in (p.parts if isinstance(p, Or) else (p,))))


@dataclass(frozen=True, slots=True)
class Implies(Formula):
    """An implication: if `left` holds, `right` holds."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Iff(Formula):
    """An equivalence: both sides have the same truth value."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Next(Formula):
    """The formula "the body holds in the next state, which must exist" (the paper's N)."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Always(Formula):
    """The formula "the body holds in this and every later state"."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Eventually(Formula):
    """The formula "the body holds in this or a later state"."""

    body: Formula


@dataclass(frozen=True, slots=True)
class Until(Formula):
    """The formula "`right` holds in this or a later state, and `left` holds in all states before"."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class WeakUntil(Formula):
    """The formula "`left` holds in all states before `right` holds, or in all states if `right` never holds"."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Release(Formula):
    """The formula "`right` holds up to and including the state in which `left` first holds, or always if `left` never holds"."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Forall(Formula):
    """The formula "the body holds for all elements of the sorts of the variables"."""

    variables: tuple[Binder, ...]
    body: Formula


@dataclass(frozen=True, slots=True)
class Exists(Formula):
    """The formula "the body holds for some elements of the sorts of the variables"."""

    variables: tuple[Binder, ...]
    body: Formula


def children(formula: Formula) -> tuple[Formula, ...]:
    """Return the direct subformulas of a formula."""
    match formula:
        case Not(body) | Next(body) | Always(body) | Eventually(body) | Forall(_, body) | Exists(_, body):
            return (body,)
        case And(parts) | Or(parts):
            return parts
        case Implies(left, right) | Iff(left, right) | Until(left, right) | WeakUntil(left, right) | Release(left, right):
            return (left, right)
    return ()


def walk(formula: Formula) -> Iterator[tuple[Formula, int]]:
    """Yield every subformula of a formula with its depth, from left to right; every quantified variable adds 1 to the depth."""
    stack = [(formula, 1)]
    while stack:
        node, level = stack.pop()
        yield node, level
        below = level + (len(node.variables) if isinstance(node, Forall | Exists) else 1)
        stack.extend((child, below) for child in reversed(children(node)))


def size(formula: Formula) -> int:
    """Return the number of operators and atoms of a formula; a conjunction of n parts has n - 1 operators."""
    return sum(len(n.parts) - 1 if isinstance(n, And | Or) else 1 for n, _ in walk(formula))


def depth(formula: Formula) -> int:
    """Return the nesting depth of the operators and quantified variables of a formula."""
    return max(level for _, level in walk(formula))


def atoms(formula: Formula) -> tuple[Atom, ...]:
    """Return the distinct atoms of a formula in the order of their first occurrence."""
    return tuple(dict.fromkeys(n for n, _ in walk(formula) if isinstance(n, Atom)))


_TEMPORAL = (Next, Always, Eventually, Until, WeakUntil, Release)


def is_boolean(formula: Formula) -> bool:
    """Return whether a formula has no temporal operator, and is therefore about the present state alone."""
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
    """Return the text of a formula, in parentheses if the surrounding operator, of binding strength `level`, needs them."""
    match formula:
        case Const(value):
            return "true" if value else "false"
        case Atom("@", (thing, place)):
            return f"{thing}@{place}"
        case Atom(Infix() as name, (left_term, right_term)):
            return f"{left_term} {name} {right_term}"
        case Atom(name, terms):
            return f"{name}({', '.join(map(str, terms))})" if terms else name
        case Not(Atom(Infix()) as atom):
            # Without parentheses, ``!a = b`` would look like a comparison of the negated term ``!a``.
            return f"!({_show(atom, 0)})"
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
