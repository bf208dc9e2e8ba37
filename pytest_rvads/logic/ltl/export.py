"""Writes monitors as text for readers, for Graphviz and in the HOA format, and gives verdicts of formulas on given words.

A word is a sequence of states, each given by its true propositions. ``rvads monitor --jsonl`` reads a formula and words per line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj, disj, neg
from pytest_rvads.logic.ltl.finite import settle, settle_empty
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, encode, run_machine, synthesize
from pytest_rvads.logic.ltl.parser import parse_ltl
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import FormulaError
from pytest_rvads.support.wording import printable

_MOST_WORK = 100_000_000
"""Largest number of comparisons of letters for the labels of edges; so many comparisons take some 5 s."""
_COLOURS = {Truth.FALSE: "#f4b6b6", Truth.TRUE: "#b9e3b9", Truth.UNKNOWN: "#ffffff"}
_MEANING = {
    Truth.FALSE: "no continuation satisfies the formula",
    Truth.TRUE: "every continuation satisfies the formula",
    Truth.UNKNOWN: "still undecided",
}

Word = Sequence[Sequence[str]]
"""Per state, the propositions that are true in the state."""


def label(machine: Machine, letters: frozenset[int]) -> f.Formula:
    """Return a boolean formula over the guards that is true for the given letters of a monitor and false for its other letters.

    The formula is a disjunction of conjunctions of few guards. Its value for combinations of guards that never occur is
    arbitrary.
    """
    codes = {machine.codes[i] for i in letters}
    excluded = set(machine.codes) - codes
    if not excluded:
        return f.TRUE
    bits = range(len(machine.guards))
    cubes = []
    for code in sorted(codes):
        mask = sum(1 << k for k in bits)
        for k in bits:  # leave out a guard if no excluded letter then matches the conjunction
            smaller = mask & ~(1 << k)
            if not any((excluded_code ^ code) & smaller == 0 for excluded_code in excluded):
                mask = smaller
        cubes.append((mask, code & mask))
    chosen = []
    uncovered = set(codes)
    for mask, value in sorted(set(cubes), key=lambda c: (c[0].bit_count(), c)):
        covered = {code for code in uncovered if code & mask == value}
        if covered:
            chosen.append((mask, value))
            uncovered -= covered
    return disj(
        conj(machine.guards[k] if value >> k & 1 else neg(machine.guards[k]) for k in bits if mask >> k & 1)
        for mask, value in chosen
    )


def _edges(machine: Machine) -> list[tuple[int, int, f.Formula]]:
    """Return the edges of a monitor, sorted by state and target: the state, the target, and the label, a boolean formula."""
    edges: list[tuple[int, int, frozenset[int]]] = []
    for state, row in enumerate(machine.delta.tolist()):
        targets: dict[int, set[int]] = {}
        for letter, target in enumerate(row):
            targets.setdefault(target, set()).add(letter)
        edges += [(state, target, frozenset(letters)) for target, letters in sorted(targets.items())]
    count = len(machine.codes)
    work = sum(len(letters) * (count - len(letters)) * len(machine.guards) for _, _, letters in edges)
    if work > _MOST_WORK:
        raise FormulaError(
            f"the monitor has {machine.states} states and {len(edges)} edges over {count} letters, too many to be written out: "
            "ask `rvads monitor --jsonl` for its verdicts, or write out its parts"
        )
    return [(state, target, label(machine, letters)) for state, target, letters in edges]


def describe(machine: Machine) -> str:
    """Return a description of a monitor in words: its states with their verdicts, and its edges."""
    count = machine.states
    lines = [
        f"formula       {machine.formula}",
        f"propositions  {', '.join(map(str, machine.atoms)) or 'none'}",
        f"states        {count}, the smallest monitor there is; it starts in 0",
    ]
    edges = _edges(machine)
    for state in range(count):
        truth = Truth(int(machine.output[state]))
        lines.append(f"{state}  {truth}  {_MEANING[truth]}")
        for source, target, guard in edges:
            if source == state:
                lines.append(f"     {'stays' if target == state else f'to {target}'} when {guard}" if count > 1 else "     stays")
    return "\n".join(lines)


def to_dot(machine: Machine) -> str:
    """Return the text of a monitor for Graphviz; the label of a state contains the verdict of the state."""
    lines = ["digraph monitor {", "  rankdir=LR;", '  node [shape=circle, style=filled, fontname="sans-serif"];']
    lines.append('  start [shape=point, style=""]; start -> 0;')
    for state in range(machine.states):
        truth = Truth(int(machine.output[state]))
        lines.append(f'  {state} [label="{state}\\n{truth}", fillcolor="{_COLOURS[truth]}"];')
    lines += [f'  {s} -> {t} [label="{_quoted(str(g))}"];' for s, t, g in _edges(machine)]
    return "\n".join([*lines, "}"]) + "\n"


def to_hoa(machine: Machine) -> str:
    """Return a monitor in the Hanoi Omega-Automata format, version 1; the name of a state is its verdict, T, F or ?."""
    names = " ".join(f'"{_quoted(str(a))}"' for a in machine.atoms)
    index = {a: k for k, a in enumerate(machine.atoms)}
    lines = [
        "HOA: v1",
        f'name: "LTL3 monitor of {_quoted(str(machine.formula))}"',
        f"States: {machine.states}",
        "Start: 0",
        f"AP: {len(machine.atoms)} {names}".rstrip(),
        "acc-name: all",
        "Acceptance: 0 t",
        "properties: trans-labels explicit-labels deterministic complete",
        "--BODY--",
    ]
    edges = _edges(machine)
    for state in range(machine.states):
        lines.append(f'State: {state} "{Truth(int(machine.output[state]))}"')
        lines += [f"[{_hoa(g, index.__getitem__)}] {t}" for s, t, g in edges if s == state]
    return "\n".join([*lines, "--END--"]) + "\n"


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _hoa(guard: f.Formula, number: Callable[[f.Atom], int]) -> str:
    match guard:
        case f.Atom():
            return str(number(guard))
        case f.Const(value):
            return "t" if value else "f"
        case f.Not(body):
            return f"!{_hoa(body, number)}" if isinstance(body, f.Atom) else f"!({_hoa(body, number)})"
        case f.And(parts) | f.Or(parts):
            return (" & " if isinstance(guard, f.And) else " | ").join(f"({_hoa(p, number)})" for p in parts)
        case f.Implies(left, right):
            return f"!({_hoa(left, number)}) | ({_hoa(right, number)})"
        case f.Iff(left, right):
            a, b = _hoa(left, number), _hoa(right, number)
            return f"(({a}) & ({b})) | (!({a}) & !({b}))"
    raise TypeError(f"not a boolean formula: {guard}")


class _Named(Struct, frozen=True):
    id: str | int | float | None = None


class _Task(Struct, frozen=True):
    formula: str
    words: list[list[list[str]]] = []


def verdicts_on(machine: Machine, word: Word) -> list[Truth]:
    """Return the LTL3 verdict after every non-empty prefix of a word."""
    if not word:
        return []
    letters = encode(machine, _arrays(machine.formula, word), len(word))
    return [Truth(v) for v in machine.output[run_machine(machine, letters[None, :])[0]].tolist()]


def holds_on(formula: f.Formula, word: Word) -> bool:
    """Return the truth of a formula on a finite word, by finite-trace semantics; in an empty word no proposition is true."""
    return bool(settle(formula, _arrays(formula, word), len(word))[0]) if word else settle_empty(formula)


def _arrays(formula: f.Formula, word: Word) -> dict[f.Atom, Any]:
    states = [frozenset(state) for state in word]
    return {a: np.array([a.name in state for state in states], dtype=np.bool_) for a in f.atoms(formula)}


def answer(line: bytes) -> dict[str, Any]:
    """Return the answer to a line of the input of ``rvads monitor --jsonl``.

    Returns:
        ``{"id", "states", "verdicts", "finite"}``: the number of states of the monitor, its verdicts after every state of every
        word, and the truth of the formula on every word. ``{"id", "error"}`` if the line can't be read or the formula is refused.
        The id, a text or number, is None if the id can't be read.
    """
    name = None
    try:
        name = decode(line, _Named, "task", FormulaError).id
        task = decode(line, _Task, "task", FormulaError)
        formula = parse_ltl(task.formula)
        machine = synthesize(formula)
        verdicts = [[str(v) for v in verdicts_on(machine, word)] for word in task.words]
        finite = [holds_on(formula, word) for word in task.words]
    except FormulaError as error:
        return {"id": name, "error": printable(str(error))}
    return {"id": name, "states": machine.states, "verdicts": verdicts, "finite": finite}
