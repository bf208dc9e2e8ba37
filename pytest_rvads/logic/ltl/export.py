"""Writes monitors as text for readers and for Graphviz."""

from __future__ import annotations

from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import conj, disj, neg
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.support.errors import FormulaError

_MOST_WORK = 100_000_000
"""Largest number of comparisons of letters for the labels of edges; so many comparisons take some 5 s."""
_COLOURS = {Truth.FALSE: "#f4b6b6", Truth.TRUE: "#b9e3b9", Truth.UNKNOWN: "#ffffff"}
_MEANING = {
    Truth.FALSE: "no continuation satisfies the formula",
    Truth.TRUE: "every continuation satisfies the formula",
    Truth.UNKNOWN: "still undecided",
}


def label(machine: Machine, letters: frozenset[int]) -> f.Formula:
    """Return a disjunction of conjunctions of few guards that is true for the given letters and false for the other letters."""
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
            "write out its parts"
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
    for state, target, guard in _edges(machine):
        quoted = str(guard).replace("\\", "\\\\").replace('"', '\\"')
        lines.append(f'  {state} -> {target} [label="{quoted}"];')
    return "\n".join([*lines, "}"]) + "\n"
