"""Monitors written as a table in words, as Graphviz and as HOA."""

from __future__ import annotations

from collections.abc import Callable

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj, disj, neg
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.support.errors import FormulaError

__all__ = ["describe", "label", "to_dot", "to_hoa"]

_MOST_WORK = 100_000_000
"""Most comparisons of letters for the labels of edges; some 5 s."""
_COLOURS = {Truth.FALSE: "#f4b6b6", Truth.TRUE: "#b9e3b9", Truth.UNKNOWN: "#ffffff"}
_MEANING = {
    Truth.FALSE: "no continuation satisfies the formula",
    Truth.TRUE: "every continuation satisfies the formula",
    Truth.UNKNOWN: "still undecided",
}


def label(machine: Machine, letters: frozenset[int]) -> f.Formula:
    """Return a boolean formula over the guards that holds in exactly the given letters.

    Cubes of as few guards as possible are taken, the widest first, until all letters are covered. Codes that never occur don't
    matter.
    """
    codes = {machine.codes[i] for i in letters}
    excluded = set(machine.codes) - codes
    if not excluded:
        return f.TRUE
    bits = range(len(machine.guards))
    cubes = []
    for code in sorted(codes):
        mask = sum(1 << k for k in bits)
        for k in bits:  # drop a guard as long as no other letter matches
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
    """Return the edges (state, target, label), in order.

    Raises:
        FormulaError: the labels would need more than `_MOST_WORK` comparisons.
    """
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
    """Return the machine in words: states with verdicts and edges."""
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
    """Return the machine for Graphviz; the label of a state contains its verdict."""
    lines = ["digraph monitor {", "  rankdir=LR;", '  node [shape=circle, style=filled, fontname="sans-serif"];']
    lines.append('  start [shape=point, style=""]; start -> 0;')
    for state in range(machine.states):
        truth = Truth(int(machine.output[state]))
        lines.append(f'  {state} [label="{state}\\n{truth}", fillcolor="{_COLOURS[truth]}"];')
    lines += [f'  {s} -> {t} [label="{_quoted(str(g))}"];' for s, t, g in _edges(machine)]
    return "\n".join([*lines, "}"]) + "\n"


def to_hoa(machine: Machine) -> str:
    """Return the machine in the Hanoi Omega-Automata format, version 1; the name of a state is its verdict ``T F ?``."""
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
