"""Builds the automaton that reads the prefixes of models of a formula: finite words with a continuation that satisfies it.

A formula is brought into negation normal form over guards (its largest parts without temporal operators). The nodes of the normal
form are numbered. Equal nodes have the same number. Sets of nodes and sets of letters are bit masks.

A state of the automaton is a set of nodes, called obligations. Reading a letter (the values of all guards) unfolds every
obligation by the expansion laws ``a U b = b | (a & X(a U b))`` and ``a R b = b & (a | X(a R b))``. A move of the automaton marks
every U that the move puts off, because the right side of the U does not hold yet. An infinite run of the automaton is accepting
if no U is put off forever. Such an automaton is a transition-based generalised Büchi automaton (Couvreur, On-the-fly verification
of linear temporal logic, FM 1999).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import reduce
from operator import and_, or_
from typing import NamedTuple

import networkx as nx

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import Budget, conj, disj, plain


class _Move(NamedTuple):
    """A move of the automaton: three masks."""

    letters: int
    """The letters on which the automaton moves."""
    target: int
    """The obligations for the next state, or the number of the target state."""
    off: int
    """The U nodes that the move puts off."""


class Kind(Enum):
    """The operator of a node of a formula in negation normal form."""

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
    """A node of a formula in negation normal form: an operator over other nodes, or a guard; only guards are negated."""

    kind: Kind
    parts: tuple[int, ...] = ()
    """Numbers of the nodes of the operands; for a guard, the number of the guard in `Pool.guards`."""
    positive: bool = True
    """False for a negated guard."""


@dataclass(slots=True)
class Pool:
    """The numbered nodes of the formulas of an automaton construction, with their guards."""

    nodes: list[Node] = field(default_factory=list)
    guards: list[f.Formula] = field(default_factory=list)
    _numbers: dict[Node, int] = field(default_factory=dict)
    _guard_numbers: dict[f.Formula, int] = field(default_factory=dict)
    _known: dict[tuple[int, bool], int] = field(default_factory=dict)
    _alive: list[f.Formula] = field(default_factory=list)
    """The formulas of the keys of `_known`, kept alive so that no other formula gets the id() of a key."""

    def add(self, formula: f.Formula, positive: bool = True) -> int:
        """Return the number of the node for `formula`, or, if not `positive`, for the negation of `formula`."""
        key = (id(formula), positive)  # stored, because an equivalence needs both sides, negated and not, several times
        if key in self._known:
            return self._known[key]
        match formula:
            case _ if f.is_boolean(formula):
                number = self._guard(formula, positive)
            case f.Not(body):
                number = self.add(body, not positive)
            case f.Next(body):
                a = self.add(body, positive)
                number = a if self.nodes[a].kind in (Kind.TRUE, Kind.FALSE) else self._number(Node(Kind.NEXT, (a,)))
            # The negation of a U b is the R of the negations of a and b, and vice versa.
            case f.Always(body) | f.Eventually(body):  # F a = true U a, and G a = false R a
                a, until = self.add(body, positive), isinstance(formula, f.Eventually) is positive
                number = self._lasting(until, self._number(Node(Kind.TRUE if until else Kind.FALSE)), a)
            case f.Until(left, right) | f.Release(left, right):
                a, b = self.add(left, positive), self.add(right, positive)
                number = self._lasting(isinstance(formula, f.Until) is positive, a, b)
            case f.WeakUntil(left, right):  # a W b = b R (a | b)
                a, b = self.add(right, positive), self.add(f.Or((left, right)), positive)
                number = self._lasting(not positive, a, b)
            case f.Implies(left, right):
                number = self._join((f.Not(left), right), positive, conjunction=False)
            case f.Iff(left, right):  # (a & b) | (!a & !b), and its negation (a & !b) | (!a & b)
                same = self.join(Kind.AND, [self.add(left, True), self.add(right, positive)])
                opposite = self.join(Kind.AND, [self.add(left, False), self.add(right, not positive)])
                number = self.join(Kind.OR, [same, opposite])
            case f.And(parts) | f.Or(parts):
                number = self._join(parts, positive, conjunction=isinstance(formula, f.And))
            case _:
                raise TypeError(f"quantifiers must be unfolded before a monitor is built: {formula}")
        self._known[key] = number
        self._alive.append(formula)
        return number

    def _join(self, parts: tuple[f.Formula, ...], positive: bool, *, conjunction: bool) -> int:
        # All parts without temporal operators make a single guard.
        plain = [p for p in parts if f.is_boolean(p)]
        numbers = [self.add(p, positive) for p in parts if not f.is_boolean(p)]
        if plain:
            numbers.insert(0, self._guard(conj(plain) if conjunction else disj(plain), positive))
        return self.join(Kind.AND if conjunction is positive else Kind.OR, numbers)

    def join(self, kind: Kind, numbers: list[int]) -> int:
        """Return the number of the node for the conjunction or disjunction of nodes, flattened and without repetitions."""
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

    def _lasting(self, until: bool, a: int, b: int) -> int:
        """Return the number of the node of ``a U b`` if `until`, and of ``a R b`` if not."""
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
    """Return a boolean formula simplified, without the constants true and false inside."""
    return plain(formula, tuple(map(_fold, f.children(formula))))


@dataclass(frozen=True, slots=True)
class Nfa:
    """A nondeterministic automaton without an acceptance condition: from every state, some continuation is in the language."""

    initial: int
    """The initial state; -1 if the language is empty."""
    moves: tuple[tuple[tuple[int, int], ...], ...]
    """Per state, pairs of the letters (mask) and the target state of a move."""

    @property
    def universal(self) -> int:
        """The state from which the automaton reads every word, or -1 if no state reads every word."""
        all_letters = reduce(or_, (letters for moves in self.moves for letters, _ in moves), 0)
        return next((q for q, moves in enumerate(self.moves) if moves == ((all_letters, q),)), -1)


def prefixes(pool: Pool, root: int, where: tuple[int, ...], full: int, budget: Budget) -> Nfa:
    """Return the automaton that reads the finite words with a continuation that satisfies the formula of node `root`."""
    edges = _Explorer(pool.nodes, where, full, budget).states(root)
    # A live state accepts some infinite word: it reaches a strongly connected component in which no U is put off forever.
    live = [False] * len(edges)
    untils = sum(1 << n for n, node in enumerate(pool.nodes) if node.kind is Kind.UNTIL)
    graph = nx.DiGraph()
    graph.add_nodes_from(range(len(edges)))
    graph.add_edges_from((state, target) for state, moves in enumerate(edges) for _, target, _ in moves)
    components = nx.condensation(graph)
    for component in reversed(list(nx.topological_sort(components))):  # targets of a component come before the component
        states = components.nodes[component]["members"]
        inner = [off for s in states for _, target, off in edges[s] if target in states]
        good = bool(inner) and reduce(and_, inner, untils) == 0
        if good or any(live[target] for s in states for _, target, _ in edges[s]):
            for s in states:
                live[s] = True
    budget.spend(len(edges))
    return _merge(edges, live, budget)


@dataclass(frozen=True, slots=True)
class _Explorer:
    """Unfolds nodes into moves: the letters allowed in the present state, the obligations for the next state, the U put off."""

    nodes: Sequence[Node]
    where: tuple[int, ...]
    full: int
    budget: Budget
    memo: dict[int, list[_Move]] = field(default_factory=dict)

    def states(self, root: int) -> list[list[_Move]]:
        """Return the moves of every state reachable from a node; the targets are numbers of states."""
        start = self.obligations(root)
        index = {start: 0}
        order = [start]
        edges: list[list[_Move]] = []
        for state in order:  # the loop appends new states to `order`
            moves = [_Move(self.full, 0, 0)]
            pending = state
            while pending:
                low = pending & -pending
                moves = self.both(moves, self.unfold(low.bit_length() - 1))
                pending ^= low
            numbered = []
            for letters, target, off in moves:
                if target not in index:
                    index[target] = len(order)
                    order.append(target)
                numbered.append(_Move(letters, index[target], off))
            self.budget.spend(20 + 4 * len(numbered))
            edges.append(numbered)
        return edges

    def unfold(self, n: int) -> list[_Move]:
        """Return the moves by which the formula of a node can be satisfied."""
        if n in self.memo:
            return self.memo[n]
        node, now = self.nodes[n], _Move(self.full, 0, 0)
        match node.kind:
            case Kind.GUARD:
                letters = self.where[node.parts[0]] if node.positive else self.full & ~self.where[node.parts[0]]
                moves = [_Move(letters, 0, 0)] if letters else []
            case Kind.AND:
                moves = reduce(self.both, map(self.unfold, node.parts), [now])
            case Kind.OR:
                moves = self.prune([move for part in node.parts for move in self.unfold(part)])
            case Kind.NEXT:
                moves = [_Move(self.full, self.obligations(node.parts[0]), 0)]
            case Kind.UNTIL:
                later = [_Move(self.full, 1 << n, 1 << n)]
                moves = self.prune(self.unfold(node.parts[1]) + self.both(self.unfold(node.parts[0]), later))
            case Kind.RELEASE:
                later = [_Move(self.full, 1 << n, 0)]
                moves = self.both(self.unfold(node.parts[1]), self.prune(self.unfold(node.parts[0]) + later))
            case _:
                moves = [now] if node.kind is Kind.TRUE else []
        self.memo[n] = moves
        return moves

    def obligations(self, n: int) -> int:
        """Return the nodes (mask) of which node `n` is the conjunction; node `n` itself if it is no conjunction."""
        node = self.nodes[n]
        if node.kind is Kind.TRUE:
            return 0
        return sum(1 << p for p in node.parts) if node.kind is Kind.AND else 1 << n

    def both(self, moves: list[_Move], others: list[_Move]) -> list[_Move]:
        """Return the combinations of a move of each list: their common letters, all their obligations and put-off nodes."""
        self.budget.spend(1 + len(moves) * len(others) // 4)
        return self.prune((a & d, b | e, c | g) for a, b, c in moves for d, e, g in others if a & d)

    def prune(self, moves: Iterable[tuple[int, int, int]]) -> list[_Move]:
        """Return the moves without those letters on which another move leaves fewer obligations and puts off fewer U nodes."""
        merged: dict[tuple[int, int], int] = {}
        for letters, target, off in moves:
            merged[target, off] = merged.get((target, off), 0) | letters
        minimal: list[_Move] = []
        for (target, off), letters in sorted(merged.items(), key=lambda m: (m[0][0].bit_count() + m[0][1].bit_count(), m[0])):
            self.budget.spend(1 + len(minimal) // 8)
            for covered, k_target, k_off in minimal:
                if k_target & ~target == 0 and k_off & ~off == 0:
                    letters &= ~covered
                    if not letters:
                        break
            if letters:
                minimal.append(_Move(letters, target, off))
        return minimal


def _merge(edges: list[list[_Move]], live: list[bool], budget: Budget) -> Nfa:
    """Return the automaton of the live states, in which states that read the same words are merged (bisimulation)."""
    if not live[0]:
        return Nfa(-1, ())
    states = [s for s in range(len(edges)) if live[s]]
    block = dict.fromkeys(states, 0)
    blocks = 1

    def reach(state: int) -> dict[int, int]:
        """Return, per block of equivalent states, the letters that lead from a state to the block."""
        letters_by_block: dict[int, int] = {}
        for letters, target, _ in edges[state]:
            if live[target]:
                letters_by_block[block[target]] = letters_by_block.get(block[target], 0) | letters
        return letters_by_block

    while True:
        budget.spend(sum(len(edges[s]) for s in states))
        signatures: dict[tuple[int, frozenset[tuple[int, int]]], int] = {}
        block = {s: signatures.setdefault((block[s], frozenset(reach(s).items())), len(signatures)) for s in states}
        if len(signatures) == blocks:
            break
        blocks = len(signatures)
    moves: list[tuple[tuple[int, int], ...]] = [()] * blocks
    for s in states:
        moves[block[s]] = tuple((letters, target) for target, letters in sorted(reach(s).items()))
    return Nfa(block[0], tuple(moves))
