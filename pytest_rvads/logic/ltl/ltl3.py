"""Evaluates formulas on runs, by LTL3 monitors and, at the end of a run, by the semantics of finite traces.

LTL3 monitors are those of Bauer, Leucker, Schallhart: Runtime verification for LTL and TLTL, TOSEM 2011.

The verdict after a prefix is TRUE if every continuation satisfies the formula, FALSE if no continuation satisfies the formula,
and UNKNOWN in all other cases. A monitor does not wait for the end: the verdict of ``p U q`` is FALSE as soon as neither p nor q
holds. The monitor is built from two automata. The first automaton reads the prefixes that some continuation turns into a word
that satisfies the formula; the second automaton does the same for the negation of the formula. Both automata are determinised
together and minimised to a single Moore machine.

A monitor reads state by state (`Monitor`), or many words of the same length at once (`run_machine`).

`settle` gives the truth value of a formula at every state of a finished run. The operators U, F and N are strong: the awaited
state must come before the run ends, and the next state must exist. The operators G, W and R are weak: they are true if they are
not violated before the run ends. The negation of a formula is true if the formula is false (De Giacomo, Vardi: Linear temporal
logic and linear dynamic logic on finite traces, IJCAI 2013).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import lru_cache, reduce
from itertools import accumulate
from operator import and_, or_

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.automaton import Nfa, Pool, prefixes
from pytest_rvads.logic.ltl.boolean import Budget, letters

WORK_LIMIT = 700_000
"""Largest number of elementary steps in the construction of a monitor; so many steps take a fraction of a second."""

_STRETCH = 100
"""Number of states whose separate reading costs about as much as the joint reading of a stretch of equal letters."""


class Truth(IntEnum):
    """The three verdicts of a monitor on the states read so far; the verdict on a whole run is a `Verdict` with a `Status`."""

    FALSE = 0
    TRUE = 1
    UNKNOWN = 2

    def __str__(self) -> str:
        return "FT?"[self]


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """A monitor as a minimal, complete, deterministic Moore machine; state 0 is initial, states are numbered breadth first."""

    formula: f.Formula
    atoms: tuple[f.Atom, ...]
    """The propositions of the formula, in the order of their first occurrence."""
    guards: tuple[f.Formula, ...]
    """Boolean formulas whose truth values determine the letter that the monitor reads."""
    codes: tuple[int, ...]
    """The code of every letter: bit k is the value of guard k. Guards share propositions; therefore not every code occurs."""
    delta: NDArray[np.int32]
    """Next state per state and letter, shape ``(states, letters)``."""
    output: NDArray[np.int8]
    """`Truth` of every state, shape ``(states,)``."""
    lookup: NDArray[np.int32] = field(init=False, repr=False)
    """Letter per code, -1 for a code that never occurs; empty if there are more than 16 guards."""

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
        """Return the number of the letter with a code, see `codes`."""
        return int(self.lookup[code]) if len(self.lookup) else int(np.searchsorted(self.codes, code))


@lru_cache(maxsize=512)
def synthesize(formula: f.Formula) -> Machine:
    """Return the minimal LTL3 monitor of a formula without quantifiers."""
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
    """Return the tables `delta` and `output` of a deterministic machine with a set of states of each automaton as its state."""
    can_subsets = _Subsets(can, full, budget)
    fail_subsets = _Subsets(may_fail, full, budget)
    start = (can_subsets.initial, fail_subsets.initial)
    index = {start: 0}
    order = [start]
    rows: list[NDArray[np.int32]] = []
    width = (count + 7) // 8
    for can_states, fail_states in order:  # the loop appends new states to `order`
        row = np.zeros(count, dtype=np.int32)
        for can_letters, can_target in can_subsets.moves(can_states):
            for fail_letters, fail_target in fail_subsets.moves(fail_states):
                common = can_letters & fail_letters
                if not common:
                    continue
                target = (can_target, fail_target)
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
    """The subset construction of an automaton, in which the moves of a set of states are computed when they are needed."""

    def __init__(self, nfa: Nfa, full: int, budget: Budget) -> None:
        self._moves = nfa.moves
        self._full = full
        self._universal = 1 << nfa.universal if nfa.universal >= 0 else 0
        self._budget = budget
        self._memo: dict[int, list[tuple[int, int]]] = {}
        self.initial = 0
        if nfa.initial >= 0:
            self.initial = self._universal if nfa.initial == nfa.universal else 1 << nfa.initial

    def moves(self, subset: int) -> list[tuple[int, int]]:
        """Return the moves of a set of states: pairs of letters (mask) and the next set; a letter occurs in exactly one pair."""
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
                        bigger = states | 1 << target
                        if bigger & self._universal:
                            bigger = self._universal
                        split[bigger] = split.get(bigger, 0) | inside
                    if outside:
                        split[states] = split.get(states, 0) | outside
                self._budget.spend(2 * len(pieces))
                pieces = split
        successors = [(letters_, states) for states, letters_ in pieces.items()]
        self._memo[subset] = successors
        return successors


def _minimise(delta: NDArray[np.int32], output: NDArray[np.int8]) -> tuple[NDArray[np.int32], NDArray[np.int8]]:
    """Return the tables of a machine with equivalent states merged (Moore's partition refinement), numbered breadth first."""
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


class Monitor:
    """A monitor that reads a word state by state; `step` takes the same time however many states the monitor has read."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._delta: list[list[int]] = machine.delta.tolist()
        self._output: list[Truth] = [Truth(v) for v in machine.output.tolist()]
        self._letters: dict[frozenset[str], int] = {}
        self._state = 0

    @property
    def verdict(self) -> Truth:
        """The verdict after the states that the monitor has read."""
        return self._output[self._state]

    def reset(self) -> None:
        """Bring the monitor back to its initial state."""
        self._state = 0

    def step(self, true: Iterable[str]) -> Truth:
        """Read a state, given by its true propositions spelt as in the formula, and return the verdict."""
        names = true if isinstance(true, frozenset) else frozenset(true)
        letter = self._letters.get(names)
        if letter is None:
            held = frozenset(a for a in self.machine.atoms if str(a) in names)
            code = sum(1 << k for k, g in enumerate(self.machine.guards) if holds(g, held))
            letter = self._letters[names] = self.machine.letter(code)
        self._state = self._delta[self._state][letter]
        return self._output[self._state]


def encode(machine: Machine, values: Mapping[f.Atom, NDArray[np.bool_]], steps: int) -> NDArray[np.int32]:
    """Return the letter that a monitor reads in every state, shape ``(steps,)``, from the truth values of its atoms."""
    codes = np.zeros(steps, dtype=np.int64)
    for k, guard in enumerate(machine.guards):
        codes |= evaluate(guard, values, (steps,)).astype(np.int64) << k
    if len(machine.lookup):
        return machine.lookup[codes]
    return np.searchsorted(machine.codes, codes).astype(np.int32)


def run_machine(machine: Machine, letters: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the state of the monitor after every letter of many words; both have the shape ``(words, steps)``.

    While a letter repeats, a monitor of LTL comes to a constant state, because its language is star-free. Only the repetitions
    before the constant state are computed. If the letters change often, every word is read separately.
    """
    words, steps = letters.shape
    states = np.zeros((words, steps), dtype=np.int32)
    if not words or not steps:
        return states
    changes = np.flatnonzero((letters[:, 1:] != letters[:, :-1]).any(axis=0)) + 1
    if len(changes) * _STRETCH > words * steps:
        table = machine.delta.tolist()
        for row, word in zip(states, letters.tolist(), strict=True):
            row[:] = list(accumulate(word, lambda state, letter: table[state][letter], initial=0))[1:]
        return states
    starts = [0, *changes.tolist()]
    state = np.zeros(words, dtype=np.int32)
    for start, end in zip(starts, [*starts[1:], steps], strict=True):
        letter = letters[:, start]
        for k in range(start, end):
            after = machine.delta[state, letter]
            states[:, k] = after
            if (after == state).all():
                states[:, k + 1 : end] = after[:, None]
                break
            state = after
    return states


def evaluate(formula: f.Formula, values: Mapping[f.Atom, NDArray[np.bool_]], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the truth values of a boolean formula, an array of shape `shape`, from the truth values of the formula's atoms."""
    if isinstance(formula, f.Atom):
        return values[formula]
    if isinstance(formula, f.Const):
        return np.full(shape, formula.value)
    return connect(formula, [evaluate(part, values, shape) for part in f.children(formula)])


def connect(formula: f.Formula, parts: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """Return the truth values of a boolean formula, given the truth values of its direct subformulas."""
    match formula:
        case f.Not():
            return ~parts[0]
        case f.And():
            return reduce(and_, parts)
        case f.Or():
            return reduce(or_, parts)
        case f.Implies():
            return ~parts[0] | parts[1]
        case f.Iff():
            return ~(parts[0] ^ parts[1])
    raise TypeError(f"not a boolean formula: {formula}")


def holds(formula: f.Formula, true: frozenset[f.Atom]) -> bool:
    """Return the truth value of a boolean formula in a state in which the atoms in `true` are true and all others false."""
    return bool(evaluate(formula, {atom: np.array(atom in true) for atom in f.atoms(formula)}, ()))


def settle(formula: f.Formula, values: Mapping[f.Atom, NDArray[np.bool_]], steps: int) -> NDArray[np.bool_]:
    """Return the truth value of a formula at every state of a finite trace, from those of its atoms, shape ``(steps,)``."""
    if isinstance(formula, f.Atom | f.Const):
        return evaluate(formula, values, (steps,))
    parts = [settle(child, values, steps) for child in f.children(formula)]
    match formula:
        case f.Next():
            return np.append(parts[0][1:], False)
        case f.Eventually():
            return np.logical_or.accumulate(parts[0][::-1])[::-1]
        case f.Always():
            return np.logical_and.accumulate(parts[0][::-1])[::-1]
        case f.Until():
            return _until(*parts)
        case f.WeakUntil():
            return _until(*parts) | np.logical_and.accumulate(parts[0][::-1])[::-1]
        case f.Release():
            return ~_until(~parts[0], ~parts[1])
        case f.Forall() | f.Exists():
            raise TypeError(f"quantifiers must be unfolded before a formula is evaluated: {formula}")
    return connect(formula, parts)


def _until(left: NDArray[np.bool_], right: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return in which states ``left U right`` is true: `right` comes to hold no later than `left` ceases to hold."""
    tick = np.arange(len(left))
    # For every state, the first state from this state on in which `right` holds, and in which `left` does not hold.
    holds, ceases = (np.minimum.accumulate(np.where(values, tick, len(left))[::-1])[::-1] for values in (right, ~left))
    return (holds <= ceases) & (holds < len(left))
