"""Laws of the monitors on random formulas, against evaluators of our own that share nothing with the library but the tree.

The truth of a formula on an ultimately periodic word (a lasso) follows from the fixpoint definitions of the operators;
the verdict after a prefix follows from the truth of its continuations.
"""

import itertools
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import rebuild
from pytest_rvads.logic.ltl.export import label
from pytest_rvads.logic.ltl.ltl3 import Machine, Monitor, Truth, encode, run_machine, settle, synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from tests.words import holds_on, verdicts_on

P, Q = f.Atom("p"), f.Atom("q")
LETTERS: tuple[list[str], ...] = ([], ["p"], ["q"], ["p", "q"])
STEM, LOOP = 3, 2

LAW = settings(deadline=None, derandomize=True, max_examples=100)


def unary(inner: st.SearchStrategy[f.Formula]) -> st.SearchStrategy[f.Formula]:
    return st.one_of(*(st.builds(kind, inner) for kind in (f.Not, f.Next, f.Always, f.Eventually)))


def binary(inner: st.SearchStrategy[f.Formula]) -> st.SearchStrategy[f.Formula]:
    kinds = (f.Until, f.WeakUntil, f.Release, f.Implies, f.Iff)
    pairs = st.tuples(inner, inner)
    return st.one_of(*(st.builds(kind, inner, inner) for kind in kinds), st.builds(f.And, pairs), st.builds(f.Or, pairs))


LEAVES = st.sampled_from([P, Q, P, Q, f.TRUE, f.FALSE])
FORMULAS = st.recursive(LEAVES, lambda inner: unary(inner) | binary(inner), max_leaves=4).filter(lambda x: f.size(x) <= 8)
WORDS = st.lists(st.sampled_from(LETTERS), max_size=5)


def truth(formula: f.Formula, values: Mapping[str, Any], after: Any) -> Any:  # noqa: C901 - one case per operator
    """Truth at every position of many lassos: `values` per proposition, shape (words, positions); `after` the successor."""

    def go(x: f.Formula) -> Any:
        match x:
            case f.Atom(name):
                return values[name]
            case f.Const(value):
                return np.full_like(values["p"], value)
            case f.Not(a):
                return ~go(a)
            case f.And(parts):
                return np.logical_and.reduce([go(a) for a in parts])
            case f.Or(parts):
                return np.logical_or.reduce([go(a) for a in parts])
            case f.Implies(a, b):
                return ~go(a) | go(b)
            case f.Iff(a, b):
                return go(a) == go(b)
            case f.Next(a):
                return go(a)[:, after]
            case f.Eventually(a):
                return least(np.ones_like(values["p"]), go(a))
            case f.Always(a):
                return ~least(np.ones_like(values["p"]), ~go(a))
            case f.Until(a, b):
                return least(go(a), go(b))
            case f.Release(a, b):
                return ~least(~go(a), ~go(b))
            case f.WeakUntil(a, b):
                left, right = go(a), go(b)
                return least(left, right) | ~least(np.ones_like(left), ~left)
        raise TypeError(x)

    def least(a: Any, b: Any) -> Any:
        """Least fixpoint of b | (a & next)."""
        found = b
        for _ in range(len(after)):
            found = b | (a & found[:, after])
        return found

    return go(formula)


@cache
def continuations() -> Any:
    """All lassos with STEM and LOOP letters over {p, q}, shape (words, positions) per proposition."""
    words = np.array(list(itertools.product(range(4), repeat=STEM + LOOP)))
    return words & 1 == 1, words & 2 == 2


def outcomes(formula: f.Formula, prefix: list[list[str]]) -> set[bool]:
    """Truth values that the continuations of a prefix yield."""
    p, q = continuations()
    count = len(p)
    head = {name: np.tile([name in s for s in prefix], (count, 1)).reshape(count, len(prefix)) for name in "pq"}
    values = {"p": np.hstack((head["p"].astype(bool), p)), "q": np.hstack((head["q"].astype(bool), q))}
    length = len(prefix) + STEM + LOOP
    after = np.arange(1, length + 1)
    after[-1] = length - LOOP
    return {bool(v) for v in truth(formula, values, after)[:, 0]}


WANTED = {(True,): Truth.TRUE, (False,): Truth.FALSE, (False, True): Truth.UNKNOWN}


@pytest.mark.extended
@settings(LAW, max_examples=1000)
@given(FORMULAS, WORDS)
def test_the_verdict_is_what_the_continuations_say(formula: f.Formula, word: list[list[str]]) -> None:
    got = [Truth(int(synthesize(formula).output[0])), *verdicts_on(synthesize(formula), word)]
    for n, verdict in enumerate(got):
        assert verdict is WANTED[tuple(sorted(outcomes(formula, word[:n])))], (str(formula), word[:n])


@LAW
@given(FORMULAS, WORDS)
def test_negation_swaps_the_verdict(formula: f.Formula, word: list[list[str]]) -> None:
    swapped = {Truth.TRUE: Truth.FALSE, Truth.FALSE: Truth.TRUE, Truth.UNKNOWN: Truth.UNKNOWN}
    yes, no = synthesize(formula), synthesize(f.Not(formula))
    assert yes.states == no.states
    assert [swapped[v] for v in verdicts_on(yes, word)] == verdicts_on(no, word)


@LAW
@given(FORMULAS)
def test_true_and_false_absorb_and_every_state_counts(formula: f.Formula) -> None:
    machine = synthesize(formula)
    for state in range(machine.states):
        if machine.output[state] != Truth.UNKNOWN:
            assert (machine.delta[state] == state).all()
    assert reachable(machine) == set(range(machine.states))
    assert not equivalent(machine), "two states that no word tells apart"


def reachable(machine: Machine) -> set[int]:
    found, work = {0}, [0]
    while work:
        for target in machine.delta[work.pop()].tolist():
            if target not in found:
                found.add(target)
                work.append(target)
    return found


def equivalent(machine: Machine) -> set[tuple[int, int]]:
    """Pairs of states that the table-filling algorithm can't distinguish."""
    pairs = set(itertools.combinations(range(machine.states), 2))
    apart = {(a, b) for a, b in pairs if machine.output[a] != machine.output[b]}
    while True:
        more = {
            (a, b)
            for a, b in pairs - apart
            if any((min(s, t), max(s, t)) in apart for s, t in zip(machine.delta[a], machine.delta[b], strict=True))
        }
        if not more:
            return pairs - apart
        apart |= more


@pytest.mark.extended
@LAW
@given(FORMULAS, FORMULAS)
def test_equal_languages_have_equal_sizes(one: f.Formula, two: f.Formula) -> None:
    # Both sides are written differently and mean the same.
    assert synthesize(f.Until(one, two)).states == synthesize(f.Not(f.Release(f.Not(one), f.Not(two)))).states
    assert synthesize(f.WeakUntil(one, two)).states == synthesize(f.Or((f.Until(one, two), f.Always(one)))).states


@LAW
@given(FORMULAS, WORDS)
def test_step_by_step_equals_all_at_once(formula: f.Formula, word: list[list[str]]) -> None:
    machine = synthesize(formula)
    monitor = Monitor(machine)
    assert [monitor.step(s) for s in word] == verdicts_on(machine, word)
    monitor.reset()
    assert monitor.verdict is Truth(int(machine.output[0]))


@LAW
@given(FORMULAS, st.lists(st.lists(st.sampled_from(LETTERS), min_size=6, max_size=6), min_size=1, max_size=4))
def test_many_words_are_run_like_each_alone(formula: f.Formula, words: list[list[list[str]]]) -> None:
    machine = synthesize(formula)
    for repeat in (1, 500):  # states that change all the time, and long stretches of equal ones
        steps = 6 * repeat
        long = [[state for state in word for _ in range(repeat)] for word in words]
        letters = np.array([encode(machine, {a: np.array([a.name in s for s in w]) for a in machine.atoms}, steps) for w in long])
        states = run_machine(machine, letters)
        for row, word in zip(states.tolist(), letters.tolist(), strict=True):
            state = 0
            for got, letter in zip(row, word, strict=True):
                state = int(machine.delta[state, letter])
                assert got == state


@LAW
@given(FORMULAS, WORDS)
def test_finite_semantics_by_its_definition(formula: f.Formula, word: list[list[str]]) -> None:
    assert holds_on(formula, word) is finite(formula, word, 0)


def finite(x: f.Formula, word: list[list[str]], k: int) -> bool:
    """De Giacomo and Vardi's definition, position by position; past the end nothing strong holds."""
    rest = range(k, len(word))
    match x:
        case f.Atom(name):
            return k < len(word) and name in word[k]
        case f.Const(value):
            return value
        case f.Not(a):
            return not finite(a, word, k)
        case f.And(parts):
            return all(finite(a, word, k) for a in parts)
        case f.Or(parts):
            return any(finite(a, word, k) for a in parts)
        case f.Implies(a, b):
            return not finite(a, word, k) or finite(b, word, k)
        case f.Iff(a, b):
            return finite(a, word, k) is finite(b, word, k)
        case f.Next(a):
            return k + 1 < len(word) and finite(a, word, k + 1)
        case f.Eventually(a):
            return any(finite(a, word, i) for i in rest)
        case f.Always(a):
            return all(finite(a, word, i) for i in rest)
        case f.Until(a, b):
            return any(finite(b, word, i) and all(finite(a, word, m) for m in range(k, i)) for i in rest)
        case f.WeakUntil(a, b):
            return finite(f.Until(a, b), word, k) or finite(f.Always(a), word, k)
        case f.Release(a, b):
            return not finite(f.Until(f.Not(a), f.Not(b)), word, k)
    raise TypeError(x)


@LAW
@given(FORMULAS)
def test_printing_and_parsing_are_inverse(formula: f.Formula) -> None:
    assert parse_ltl(str(formula)) == formula


@LAW
@given(FORMULAS)
def test_labels_hold_in_exactly_their_letters(formula: f.Formula) -> None:
    machine = synthesize(formula)
    for row in machine.delta.tolist():
        for target in set(row):
            letters = frozenset(i for i, t in enumerate(row) if t == target)
            shown = label(machine, letters)
            for state in LETTERS:
                held = {a: np.array([a.name in state]) for a in machine.atoms}
                code = int(encode(machine, held, 1)[0])
                assert holds_on(shown, [state]) is (code in letters)


ALIVE = f.Atom("alive")
"""True in every state of the trace, and false in every state after the trace."""


def with_ending(formula: f.Formula) -> f.Formula:
    """Return a formula that has on the trace, followed by states without `ALIVE`, the value of `formula` on the trace alone.

    As in section 4 of the paper, with weak operators released at the end.
    """
    if f.is_boolean(formula):
        return formula
    parts = tuple(with_ending(c) for c in f.children(formula))
    ended = f.Not(ALIVE)
    match formula:
        case f.Next():
            return f.Next(f.And((ALIVE, parts[0])))
        case f.Always():
            return f.WeakUntil(parts[0], ended)
        case f.Eventually():
            return f.Until(ALIVE, f.And((ALIVE, parts[0])))
        case f.Until():
            return f.Until(f.And((ALIVE, parts[0])), f.And((ALIVE, parts[1])))
        case f.WeakUntil():
            return f.WeakUntil(parts[0], f.Or((parts[1], ended)))
        case f.Release():
            return f.WeakUntil(parts[1], f.Or((f.And(parts), ended)))
    return rebuild(formula, parts)


@LAW
@given(FORMULAS, WORDS.filter(bool))
def test_the_end_of_a_trace_can_be_a_proposition(formula: f.Formula, word: list[list[str]]) -> None:
    """Finite-trace semantics by fixpoints over arrays, and the translation to infinite words, agree."""
    values = {atom: np.array([atom.name in letter for letter in word]) for atom in (P, Q)}
    monitor = Monitor(synthesize(with_ending(formula)))
    for letter in word:
        monitor.step([*letter, "alive"])
    decided = monitor.step([])
    assert decided is (Truth.TRUE if settle(formula, values, len(word))[0] else Truth.FALSE)
