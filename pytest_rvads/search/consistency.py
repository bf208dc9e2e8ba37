"""Can anybody obey these rules? Decided on the discrete abstraction, before any simulation.

The model of `abstraction` holds at least every behaviour that vehicles can show, whatever they are; its product with the
monitors of the rules is searched for one that breaks none and lets everyone through. So "none can pass" is final, for any
autopilot; "some may pass" says no more than that time, speed and geometry were left out. What the configurations do not
tell (speeds, standstill, a user's predicates) may be as it suits the rules.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import FormulaError
from pytest_rvads.logic.judging.prepare import Template, prepare, template
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ending import ALIVE, with_ending
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, synthesize
from pytest_rvads.logic.ltl.monitor import encode
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.search.abstraction import Abstracted, Model

__all__ = ["Answer", "core", "decide"]

Letters = NDArray[np.int32]
"""Letters of monitors by configuration, the last axis."""
MOST_OPEN = 10
"""Most atoms of unknown value that rules may share; their combinations are all tried."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What is known about a set of rules, a scenario and an order of arrival."""

    possible: bool
    """False: no behaviour of any vehicles satisfies all rules and lets everyone through."""
    witness: tuple[int, ...] = ()
    """Configurations of a behaviour that does, of `Model`; empty if there is none."""


def decide(model: Model, rules: Iterable[Rule]) -> Answer:
    """Say whether any behaviour of a model satisfies all rules and lets everyone through.

    Args:
        model: scenario and order of arrival.
        rules: those about another kind of junction don't count.

    Raises:
        FormulaError: a monitor would be too large, or too many atoms of unknown value hang together.
    """
    watched = [
        (part, values)
        for rule in rules
        if rule.concerns(model.junction)
        for values in [model.values(rule.tie)]
        for part in prepare(rule.formula, model.static).templates
    ]
    settled = _settled(watched)
    parts = [_Part(group, settled) for group in _together(watched, settled)]
    return _search(model, parts)


def core(model: Model, rules: Sequence[Rule]) -> tuple[Rule, ...]:
    """Return a minimal set of contradicting rules: vehicles can keep the set as soon as any rule of the set is dropped."""
    kept = list(rules)
    for rule in rules:
        fewer = [r for r in kept if r is not rule]
        if not decide(model, fewer).possible:
            kept = fewer
    return tuple(kept)


def _search(model: Model, parts: Sequence[_Part]) -> Answer:
    """Search depth first for a way through; states are a configuration and a state of every part."""
    stack: list[tuple[int, tuple[int, ...]]] = []
    before: dict[tuple[int, tuple[int, ...]], tuple[int, tuple[int, ...]] | None] = {}

    def enter(configuration: int, states: Iterable[int], source: tuple[int, tuple[int, ...]] | None) -> None:
        after = []
        for part, state in zip(parts, states, strict=True):
            state = part.step(state, configuration)
            if state < 0:
                return
            after.append(state)
        node = (configuration, tuple(after))
        if node not in before:
            before[node] = source
            stack.append(node)

    for start in reversed(model.starts()):
        enter(start, [0] * len(parts), None)
    while stack:
        node = stack.pop()
        configuration, states = node
        if model.through(configuration) and all(p.content(s, configuration) for p, s in zip(parts, states, strict=True)):
            return Answer(True, tuple(_path(node, before)))
        for follower in reversed(model.after(configuration)):
            enter(follower, states, node)
    return Answer(False)


def _path(
    node: tuple[int, tuple[int, ...]] | None, before: dict[tuple[int, tuple[int, ...]], tuple[int, tuple[int, ...]] | None]
) -> list[int]:
    found = []
    while node is not None:
        found.append(node[0])
        node = before[node]
    return found[::-1]


def _settled(watched: Sequence[tuple[Template, Abstracted]]) -> dict[f.Atom, bool]:
    """Return the atoms of unknown value that suit every rule in one way, because they occur with one sign only."""
    signs: dict[f.Atom, set[bool]] = {}
    for part, values in watched:
        for atom, sign in _signs(part.formula, True):
            if values.open(atom) is not False:
                signs.setdefault(atom, set()).add(sign)
    return {atom: sign for atom, found in signs.items() if len(found) == 1 for sign in found}


def _signs(formula: f.Formula, sign: bool) -> Iterator[tuple[f.Atom, bool]]:
    match formula:
        case f.Atom():
            yield formula, sign
        case f.Not(body):
            yield from _signs(body, not sign)
        case f.Implies(left, right):
            yield from _signs(left, not sign)
            yield from _signs(right, sign)
        case f.Iff():
            yield from ((atom, either) for atom in f.atoms(formula) for either in (True, False))
        case _:
            for child in f.children(formula):
                yield from _signs(child, sign)


def _together(
    watched: Sequence[tuple[Template, Abstracted]], settled: Collection[f.Atom]
) -> Iterator[list[tuple[Template, Abstracted]]]:
    """Yield instances that share an atom of unknown value together, all others alone."""
    groups: list[tuple[set[f.Atom], list[tuple[Template, Abstracted]]]] = []
    for entry in watched:
        part, values = entry
        shared = {a for a in part.atoms if a not in settled and values.open(a) is True}
        members = [entry]
        rest = []
        for atoms, others in groups:
            if atoms & shared:
                shared |= atoms
                members = [*others, *members]
            else:
                rest.append((atoms, others))
        groups = [*rest, (shared, members)]
    for _, members in groups:
        yield members


class _Part:
    """Instances watched together: their states are sets of what the monitors may have seen, determinised when needed.

    State 0 is initial. Of every combination of unknown values that breaks no rule, one will do.
    """

    def __init__(self, members: Sequence[tuple[Template, Abstracted]], settled: Mapping[f.Atom, bool]) -> None:
        machines = [synthesize(with_ending(template(part.formula)[0])) for part, _ in members]
        self._delta = [machine.delta.tolist() for machine in machines]
        self._output = [machine.output.tolist() for machine in machines]
        self._letters = _letters(members, machines, settled, True)
        self._last = _letters(members, machines, settled, False)
        start = frozenset({(0,) * len(machines)})
        self._sets = [start]
        self._numbers = {start: 0}
        self._memo: dict[tuple[int, int], int] = {}

    def step(self, state: int, configuration: int) -> int:
        """Return the state after a configuration, -1 where every choice breaks a rule."""
        key = (state, configuration)
        found = self._memo.get(key)
        if found is None:
            after = self._read(self._sets[state], self._letters, configuration)
            kept = frozenset(s for s in after if all(o[k] != Truth.FALSE for o, k in zip(self._output, s, strict=True)))
            found = -1
            if kept:
                found = self._numbers.setdefault(kept, len(self._sets))
                if found == len(self._sets):
                    self._sets.append(kept)
            self._memo[key] = found
        return found

    def content(self, state: int, configuration: int) -> bool:
        """Return whether a run that ends here leaves nothing owed."""
        after = self._read(self._sets[state], self._last, configuration)
        return any(all(o[k] == Truth.TRUE for o, k in zip(self._output, s, strict=True)) for s in after)

    def _read(self, states: frozenset[tuple[int, ...]], letters: Letters, configuration: int) -> set[tuple[int, ...]]:
        choices = letters[:, :, configuration].tolist()
        return {
            tuple([delta[k][letter] for delta, k, letter in zip(self._delta, state, choice, strict=True)])
            for state in states
            for choice in choices
        }


def _letters(
    members: Sequence[tuple[Template, Abstracted]], machines: Sequence[Machine], settled: Mapping[f.Atom, bool], alive: bool
) -> Letters:
    """Return the letters that can be read in every configuration, shape ``(choices, machines, size)``.

    Args:
        members: the instances.
        machines: their monitors.
        settled: what atoms of unknown value are best, where that is one value for all.
        alive: during a run; False for after its end.
    """
    atoms = dict.fromkeys(a for part, values in members for a in part.atoms if values.open(a) is not False)
    unknown = [a for a in atoms if a not in settled]
    if len(unknown) > MOST_OPEN:
        raise FormulaError(
            f"{len(unknown)} conditions whose values an abstract run does not tell hang together ({unknown[0]}, {unknown[1]}, "
            f"...), at most {MOST_OPEN} can be tried: check fewer rules at once"
        )
    table = [
        [
            _encode(*member, machine, {**settled, **dict(zip(unknown, choice, strict=True))}, alive)
            for member, machine in zip(members, machines, strict=True)
        ]
        for choice in product((False, True), repeat=len(unknown))
    ]
    return np.array(table, dtype=np.int32)


def _encode(part: Template, values: Abstracted, machine: Machine, chosen: dict[f.Atom, bool], alive: bool) -> Letters:
    size = values.run.steps
    named = {ALIVE: np.full(size, alive)}
    for k, atom in enumerate(part.atoms):
        where = values.open(atom)
        if where is True:
            held = np.full(size, chosen[atom])
        else:
            held = values[atom] if where is False else np.where(where, chosen[atom], values[atom])
        named[f.Atom(f"p{k}")] = held
    return encode(machine, named, size)
