"""Builds, from a formula, the automaton of the prefixes that can still be continued.

A state is a set of obligations (nodes in negation normal form, as a bit mask). Reading a letter, every obligation unfolds by the
expansion laws ``a U b = b | (a & X(a U b))`` and ``a R b = b & (a | X(a R b))``. An U that is put off is marked, and a run is
accepting if no U is put off forever: a transition-based generalised Büchi automaton (Couvreur, On-the-fly verification of linear
temporal logic, FM 1999). Sets of letters are bit masks too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

import networkx as nx

from pytest_rvads.logic.ltl.effort import Budget
from pytest_rvads.logic.ltl.normal import Kind, Node, Pool

__all__ = ["Nfa", "prefixes"]

_Move = tuple[int, int, int]
"""Letters (mask), obligations for the next state (mask), U nodes put off (mask)."""


@dataclass(frozen=True, slots=True)
class Nfa:
    """A nondeterministic automaton without acceptance: every state can be continued to a word of the language."""

    initial: int
    """The initial state; -1 if the language is empty."""
    moves: tuple[tuple[tuple[int, int], ...], ...]
    """Per state, pairs of letters (mask) and target."""

    @property
    def universal(self) -> int:
        """The state from which every word can be read, or -1; at most one such state exists, as equivalent states are merged."""
        return next((q for q, moves in enumerate(self.moves) if len(moves) == 1 and moves[0] == (self._full, q)), -1)

    @property
    def _full(self) -> int:
        letters_of_moves = 0
        for moves in self.moves:
            for letters, _ in moves:
                letters_of_moves |= letters
        return letters_of_moves


def prefixes(pool: Pool, root: int, where: tuple[int, ...], full: int, budget: Budget) -> Nfa:
    """Build the automaton of the prefixes that some continuation turns into a model of node `root`.

    Args:
        pool: the nodes.
        root: number of the node.
        where: per guard, the letters in which the guard holds (mask).
        full: all letters (mask).
        budget: the budget of the construction.
    """
    index, edges = _Explorer(pool.nodes, where, full, budget).states(root)
    live = _live(edges, [n for n, node in enumerate(pool.nodes) if node.kind is Kind.UNTIL])
    budget.spend(len(index))
    return _merge(edges, live, budget)


@dataclass(frozen=True, slots=True)
class _Explorer:
    """Unfolds nodes into the letters that satisfy them now and the obligations for the next state."""

    nodes: Sequence[Node]
    where: tuple[int, ...]
    full: int
    budget: Budget
    memo: dict[int, list[_Move]] = field(default_factory=dict)

    def states(self, root: int) -> tuple[dict[int, int], list[list[_Move]]]:
        """Return the states by number, and per state its moves (letters, target, U nodes put off)."""
        start = self.obligations(root)
        index = {start: 0}
        order = [start]
        edges: list[list[_Move]] = []
        for state in order:  # grows while it is walked
            moves: list[_Move] = [(self.full, 0, 0)]
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
                numbered.append((letters, index[target], off))
            self.budget.spend(20 + 4 * len(numbered))
            edges.append(numbered)
        return index, edges

    def unfold(self, n: int) -> list[_Move]:
        """Return the moves that keep a node."""
        if n not in self.memo:
            self.memo[n] = self._unfold(n)
        return self.memo[n]

    def _unfold(self, n: int) -> list[_Move]:
        node, now = self.nodes[n], (self.full, 0, 0)
        match node.kind:
            case Kind.GUARD:
                letters = self.where[node.parts[0]] if node.positive else self.full & ~self.where[node.parts[0]]
                return [(letters, 0, 0)] if letters else []
            case Kind.AND:
                return reduce(self.both, map(self.unfold, node.parts), [now])
            case Kind.OR:
                return self.prune([move for part in node.parts for move in self.unfold(part)])
            case Kind.NEXT:
                return [(self.full, self.obligations(node.parts[0]), 0)]
            case Kind.UNTIL:
                later = [(self.full, 1 << n, 1 << n)]
                return self.prune(self.unfold(node.parts[1]) + self.both(self.unfold(node.parts[0]), later))
            case Kind.RELEASE:
                later = [(self.full, 1 << n, 0)]
                return self.both(self.unfold(node.parts[1]), self.prune(self.unfold(node.parts[0]) + later))
        return [now] if node.kind is Kind.TRUE else []

    def obligations(self, n: int) -> int:
        """Return the nodes whose conjunction is a node (mask)."""
        node = self.nodes[n]
        if node.kind is Kind.TRUE:
            return 0
        return sum(1 << p for p in node.parts) if node.kind is Kind.AND else 1 << n

    def both(self, moves: list[_Move], others: list[_Move]) -> list[_Move]:
        """Return the moves that keep the obligations of both lists at once."""
        self.budget.spend(1 + len(moves) * len(others) // 4)
        return self.prune([(a & d, b | e, c | g) for a, b, c in moves for d, e, g in others if a & d])

    def prune(self, moves: list[_Move]) -> list[_Move]:
        """Take from every move the letters on which another move leads to fewer obligations and puts off less."""
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
                minimal.append((letters, target, off))
        return minimal


def _live(edges: list[list[_Move]], untils: list[int]) -> list[bool]:
    """Return which states have a non-empty language: the states that reach a component in which no U is put off forever."""
    graph = nx.DiGraph()
    graph.add_nodes_from(range(len(edges)))
    graph.add_edges_from((state, target) for state, moves in enumerate(edges) for _, target, _ in moves)
    components = nx.condensation(graph)
    live = [False] * len(edges)
    all_untils = sum(1 << u for u in untils)
    for component in reversed(list(nx.topological_sort(components))):  # targets of a component come before the component
        states = components.nodes[component]["members"]
        inner = [off for s in states for _, target, off in edges[s] if target in states]
        missing = all_untils
        for off in inner:
            missing &= off
        good = bool(inner) and missing == 0
        if good or any(live[target] for s in states for _, target, _ in edges[s]):
            for s in states:
                live[s] = True
    return live


def _merge(edges: list[list[_Move]], live: list[bool], budget: Budget) -> Nfa:
    """Drop states with empty language, then merge states that read the same words (bisimulation)."""
    if not live[0]:
        return Nfa(-1, ())
    states = [s for s in range(len(edges)) if live[s]]
    block = dict.fromkeys(states, 0)
    blocks = 1

    def reach(state: int) -> dict[int, int]:
        """Return, per block, the letters that lead to the block."""
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
