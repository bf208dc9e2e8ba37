"""LTL3 monitors (Bauer, Leucker, Schallhart: Runtime verification for LTL and TLTL, TOSEM 2011).

The verdict after a prefix is TRUE if every continuation satisfies the formula, FALSE if no continuation satisfies the formula,
and UNKNOWN otherwise. So a monitor is anticipatory: ``p U q`` is FALSE as soon as neither p nor q holds. The monitor is built
from two automata: of the prefixes that can be continued to a model of the formula, and of those that can be continued to a model
of its negation. The two automata are determinised together and minimised as one Moore machine.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.automaton import Nfa, prefixes
from pytest_rvads.logic.ltl.boolean import letters
from pytest_rvads.logic.ltl.effort import Budget
from pytest_rvads.logic.ltl.normal import Pool

__all__ = ["WORK_LIMIT", "Machine", "Truth", "synthesize"]

WORK_LIMIT = 700_000
"""Most elementary steps of a synthesis; a fraction of a second."""


class Truth(IntEnum):
    """The three verdicts."""

    FALSE = 0
    TRUE = 1
    UNKNOWN = 2

    def __str__(self) -> str:
        return "FT?"[self]


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """A minimal, complete, deterministic Moore machine; state 0 is initial, states are numbered breadth first."""

    formula: f.Formula
    atoms: tuple[f.Atom, ...]
    """The propositions of the formula, by first occurrence."""
    guards: tuple[f.Formula, ...]
    """Boolean formulas whose truth values together are the letter; bit k of a code is the value of guard k."""
    codes: tuple[int, ...]
    """The code of every letter; other codes never occur, because guards share propositions."""
    delta: NDArray[np.int32]
    """Next state per state and letter, shape ``(states, letters)``."""
    output: NDArray[np.int8]
    """`Truth` of every state, shape ``(states,)``."""
    lookup: NDArray[np.int32] = field(init=False, repr=False)
    """Letter per code if the table is small, else empty."""

    def __post_init__(self) -> None:
        table = np.full(1 << len(self.guards) if len(self.guards) <= 16 else 0, -1, dtype=np.int32)
        if len(table):
            table[list(self.codes)] = np.arange(len(self.codes))
        for array in (table, self.delta, self.output):
            array.setflags(write=False)
        object.__setattr__(self, "lookup", table)

    @property
    def states(self) -> int:
        """Number of states."""
        return len(self.output)

    def letter(self, code: int) -> int:
        """Return the letter with a code."""
        return int(self.lookup[code]) if len(self.lookup) else int(np.searchsorted(self.codes, code))


@lru_cache(maxsize=512)
def synthesize(formula: f.Formula) -> Machine:
    """Build the minimal LTL3 monitor of a formula without quantifiers.

    Args:
        formula: the formula; its atoms count as independent propositions.

    Raises:
        FormulaError: the monitor would be too large; the message says the size of the formula.
    """
    budget = Budget(WORK_LIMIT, f.size(formula))
    pool = Pool()
    budget.spend(f.size(formula))
    yes, no = pool.add(formula), pool.add(formula, False)
    guards = tuple(pool.guards)
    codes = letters(guards, budget)
    full = (1 << len(codes)) - 1
    where = tuple(sum(1 << i for i, code in enumerate(codes) if code >> k & 1) for k in range(len(guards)))
    can = prefixes(pool, yes, where, full, budget)
    may_fail = prefixes(pool, no, where, full, budget)
    delta, output = _minimise(*_determinise(can, may_fail, full, len(codes), budget))
    return Machine(formula, f.atoms(formula), guards, codes, delta, output)


def _determinise(can: Nfa, may_fail: Nfa, full: int, count: int, budget: Budget) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Run both automata together on sets of states; an empty set decides the verdict."""
    can_subsets = _Subsets(can, full, budget)
    fail_subsets = _Subsets(may_fail, full, budget)
    start = (can_subsets.initial, fail_subsets.initial)
    index = {start: 0}
    order = [start]
    rows: list[NDArray[np.int32]] = []
    width = (count + 7) // 8
    for can_states, fail_states in order:  # grows while it is walked
        row = np.zeros(count, dtype=np.int32)
        for la, ta in can_subsets.moves(can_states):
            for lb, tb in fail_subsets.moves(fail_states):
                common = la & lb
                if not common:
                    continue
                target = (ta, tb)
                if target not in index:
                    index[target] = len(order)
                    order.append(target)
                    budget.spend(10 + count // 8)
                bits = np.unpackbits(np.frombuffer(common.to_bytes(width, "little"), np.uint8), bitorder="little")[:count]
                row[bits.view(bool)] = index[target]
        budget.spend(20)
        rows.append(row)
    output = [
        Truth.FALSE if not can_states else Truth.TRUE if not fail_states else Truth.UNKNOWN for can_states, fail_states in order
    ]
    return np.array(rows), np.array(output, dtype=np.int8)


class _Subsets:
    """The subset construction of one automaton, done on demand."""

    def __init__(self, nfa: Nfa, full: int, budget: Budget) -> None:
        self._moves = nfa.moves
        self._full = full
        self._universal = 1 << nfa.universal if nfa.universal >= 0 else 0
        self._budget = budget
        self._memo: dict[int, list[tuple[int, int]]] = {}
        self.initial = self._reduced(1 << nfa.initial) if nfa.initial >= 0 else 0

    def _reduced(self, subset: int) -> int:
        return self._universal if subset & self._universal else subset

    def moves(self, subset: int) -> list[tuple[int, int]]:
        """Return pairs (letters, next subset); the letters are disjoint, and their union is all letters."""
        if subset in self._memo:
            return self._memo[subset]
        pieces = {0: self._full}
        pending = subset
        while pending:
            low = pending & -pending
            pending ^= low
            for letters_, target in self._moves[low.bit_length() - 1]:
                split: dict[int, int] = {}
                for states, piece in pieces.items():
                    inside, outside = piece & letters_, piece & ~letters_
                    if inside:
                        bigger = self._reduced(states | 1 << target)
                        split[bigger] = split.get(bigger, 0) | inside
                    if outside:
                        split[states] = split.get(states, 0) | outside
                self._budget.spend(2 * len(pieces))
                pieces = split
        successors = [(letters_, states) for states, letters_ in pieces.items()]
        self._memo[subset] = successors
        return successors


def _minimise(delta: NDArray[np.int32], output: NDArray[np.int8]) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Merge equivalent states (Moore's partition refinement) and number them breadth first."""
    _, block = np.unique(output, return_inverse=True)
    blocks = int(block.max()) + 1
    while True:
        table = np.column_stack((block, block[delta]))
        _, representatives, block = np.unique(table, axis=0, return_index=True, return_inverse=True)
        block = block.reshape(-1)
        if len(representatives) == blocks:
            break
        blocks = len(representatives)
    small = block[delta[representatives]]
    order = [int(block[0])]
    reached = {order[0]}
    for state in order:
        for target in dict.fromkeys(small[state].tolist()):
            if target not in reached:
                reached.add(target)
                order.append(target)
    rank = np.empty(blocks, dtype=np.int32)
    rank[order] = np.arange(blocks, dtype=np.int32)
    return rank[small[order]], output[representatives][order]
