"""Negation normal form over guards, from which automata are built.

Nodes are numbered. Equal nodes have the same number, so that sets of nodes are bit masks.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, auto

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj, disj, plain

__all__ = ["Kind", "Node", "Pool"]


class Kind(Enum):
    """The kind of a node."""

    TRUE = auto()
    FALSE = auto()
    GUARD = auto()
    AND = auto()
    OR = auto()
    NEXT = auto()
    UNTIL = auto()
    RELEASE = auto()


@dataclass(frozen=True, slots=True)
class Node:
    """A formula in negation normal form; only guards may be negated."""

    kind: Kind
    parts: tuple[int, ...] = ()
    """Numbers of the parts; for a guard, its number in `Pool.guards`."""
    positive: bool = True
    """False for a negated guard."""


@dataclass(slots=True)
class Pool:
    """All nodes of one synthesis, with their guards."""

    nodes: list[Node] = field(default_factory=list)
    guards: list[f.Formula] = field(default_factory=list)
    _numbers: dict[Node, int] = field(default_factory=dict)
    _guard_numbers: dict[f.Formula, int] = field(default_factory=dict)
    _known: dict[tuple[int, bool], int] = field(default_factory=dict)
    _alive: list[f.Formula] = field(default_factory=list)
    """Formulas kept alive, so that the id() of a key in `_known` can't be reused for another formula."""

    def add(self, formula: f.Formula, positive: bool = True) -> int:
        """Return the number of the node for `formula`, or for its negation."""
        key = (id(formula), positive)  # equivalences request both signs of both sides repeatedly
        if key not in self._known:
            self._known[key] = self._add(formula, positive)
            self._alive.append(formula)
        return self._known[key]

    def _add(self, formula: f.Formula, positive: bool) -> int:
        if f.is_boolean(formula):
            return self._guard(formula, positive)
        match formula:
            case f.Not(body):
                return self.add(body, not positive)
            case f.Next(body):
                return self._next(self.add(body, positive))
            # The negation of a U b is the R of the negations of a and b, and vice versa.
            case f.Always(body) | f.Eventually(body):  # F a = true U a, and G a = false R a
                a, until = self.add(body, positive), isinstance(formula, f.Eventually) is positive
                return self._lasting(until, self._number(Node(Kind.TRUE if until else Kind.FALSE)), a)
            case f.Until(left, right) | f.Release(left, right):
                a, b = self.add(left, positive), self.add(right, positive)
                return self._lasting(isinstance(formula, f.Until) is positive, a, b)
            case f.WeakUntil(left, right):  # a W b = b R (a | b)
                a, b = self.add(right, positive), self.add(f.Or((left, right)), positive)
                return self._lasting(not positive, a, b)
            case f.Implies(left, right):
                return self._join((f.Not(left), right), positive, conjunction=False)
            case f.Iff(left, right):  # (a & b) | (!a & !b), and its negation (a & !b) | (!a & b)
                same = self.join(Kind.AND, [self.add(left, True), self.add(right, positive)])
                opposite = self.join(Kind.AND, [self.add(left, False), self.add(right, not positive)])
                return self.join(Kind.OR, [same, opposite])
            case f.And(parts) | f.Or(parts):
                return self._join(parts, positive, conjunction=isinstance(formula, f.And))
        raise TypeError(f"quantifiers must be unfolded before a monitor is built: {formula}")

    def _join(self, parts: tuple[f.Formula, ...], positive: bool, *, conjunction: bool) -> int:
        # The parts without temporal operators together make one guard.
        plain = [p for p in parts if f.is_boolean(p)]
        numbers = [self.add(p, positive) for p in parts if not f.is_boolean(p)]
        if plain:
            numbers.insert(0, self._guard(conj(plain) if conjunction else disj(plain), positive))
        return self.join(Kind.AND if conjunction is positive else Kind.OR, numbers)

    def join(self, kind: Kind, numbers: list[int]) -> int:
        """Return the conjunction or disjunction of nodes, flat and without repetitions."""
        unit, zero = (Kind.TRUE, Kind.FALSE) if kind is Kind.AND else (Kind.FALSE, Kind.TRUE)
        flat: set[int] = set()
        for n in numbers:
            node = self.nodes[n]
            if node.kind is zero:
                return n
            if node.kind is kind:
                flat.update(node.parts)
            elif node.kind is not unit:
                flat.add(n)
        if not flat:
            return self._number(Node(unit))
        return flat.pop() if len(flat) == 1 else self._number(Node(kind, tuple(sorted(flat))))

    def _guard(self, formula: f.Formula, positive: bool) -> int:
        formula = _fold(formula)
        if isinstance(formula, f.Const):
            return self._number(Node(Kind.TRUE if formula.value is positive else Kind.FALSE))
        if isinstance(formula, f.Not):
            formula, positive = formula.body, not positive
        k = self._guard_numbers.setdefault(formula, len(self.guards))
        if k == len(self.guards):
            self.guards.append(formula)
        return self._number(Node(Kind.GUARD, (k,), positive))

    def _next(self, a: int) -> int:
        return a if self.nodes[a].kind in (Kind.TRUE, Kind.FALSE) else self._number(Node(Kind.NEXT, (a,)))

    def _lasting(self, until: bool, a: int, b: int) -> int:
        """Return the node of ``a U b``, or of ``a R b``."""
        left_node, right_node = self.nodes[a], self.nodes[b]
        kind, unit, zero = (Kind.UNTIL, Kind.TRUE, Kind.FALSE) if until else (Kind.RELEASE, Kind.FALSE, Kind.TRUE)
        if right_node.kind in (Kind.TRUE, Kind.FALSE) or left_node.kind is zero or a == b:
            return b
        # a U (a U b) = a U b, and F (c U b) = F b; the same laws hold for R and G
        if right_node.kind is kind and (right_node.parts[0] == a or left_node.kind is unit):
            return self._lasting(until, a, right_node.parts[1])
        return self._number(Node(kind, (a, b)))

    def _number(self, node: Node) -> int:
        n = self._numbers.setdefault(node, len(self.nodes))
        if n == len(self.nodes):
            self.nodes.append(node)
        return n


def _fold(formula: f.Formula) -> f.Formula:
    """Simplify a boolean formula by its constants."""
    return plain(formula, tuple(map(_fold, f.children(formula))))
