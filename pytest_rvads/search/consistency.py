"""Decides on the discrete abstraction, before any simulation, whether vehicles can obey a set of rules.

The model of `abstraction` contains every behaviour that vehicles can show. The product of the model and the monitors of the rules
is searched for a behaviour that breaks no rule and lets all vehicles pass. If there is none, the answer holds for every
autopilot. If there is such a behaviour, it may still be impossible, because the model leaves out time, speed and geometry. Open
values (speeds, standstill, a user's predicates) are chosen in favour of the rules.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.judging.prepare import Template, prepare, template
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.finite import ALIVE, with_ending
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, synthesize
from pytest_rvads.logic.ltl.monitor import encode
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.search.abstraction import Abstracted, Model
from pytest_rvads.support.errors import FormulaError

__all__ = ["Answer", "core", "decide"]

Letters = NDArray[np.int32]
"""Letters that monitors read; the last axis has the configurations."""
MOST_OPEN = 10
"""Most atoms of unknown value in a group of linked rules, because all combinations of values are tried."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer for a set of rules, a scenario and an order of arrival."""

    possible: bool
    """Whether a behaviour of the model satisfies all rules and lets all vehicles pass."""
    witness: tuple[int, ...] = ()
    """Configurations of such a behaviour; empty if there is none."""


def decide(model: Model, rules: Iterable[Rule]) -> Answer:
    """Return whether a behaviour of a model satisfies all rules and lets all vehicles pass.

    Args:
        model: scenario and order of arrival.
        rules: the rules; rules about other kinds of junctions are ignored.

    Raises:
        FormulaError: a monitor would be too large, or too many atoms of unknown value are linked.
    """
    watched = [
        (part, values)
        for rule in rules
        if rule.concerns(model.junction)
        for values in [model.values(rule.tie)]
        for part in prepare(rule.formula, model.static).templates
    ]
    settled = _values_that_suit_every_rule(watched)
    parts = [_Part(group, settled) for group in _linked_groups(watched, settled)]
    return _search(model, parts)


def core(model: Model, rules: Sequence[Rule]) -> tuple[Rule, ...]:
    """Return a minimal set of contradicting rules: vehicles can keep the set as soon as any rule of the set is dropped."""
    remaining = list(rules)
    for rule in rules:
        fewer = [r for r in remaining if r is not rule]
        if not decide(model, fewer).possible:
            remaining = fewer
    return tuple(remaining)


def _search(model: Model, parts: Sequence[_Part]) -> Answer:
    """Search depth first for a behaviour that lets all vehicles pass; a node is a configuration with a state of every part."""
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
            return Answer(True, tuple(_path_to(node, before)))
        for follower in reversed(model.after(configuration)):
            enter(follower, states, node)
    return Answer(False)


def _path_to(
    node: tuple[int, tuple[int, ...]] | None, before: dict[tuple[int, tuple[int, ...]], tuple[int, tuple[int, ...]] | None]
) -> list[int]:
    configurations = []
    while node is not None:
        configurations.append(node[0])
        node = before[node]
    return configurations[::-1]


def _values_that_suit_every_rule(watched: Sequence[tuple[Template, Abstracted]]) -> dict[f.Atom, bool]:
    """Return the atoms of unknown value that occur with a single sign, with the value that suits every rule."""
    signs: dict[f.Atom, set[bool]] = {}
    for part, values in watched:
        for atom, sign in _signs(part.formula, True):
            if values.open(atom) is not False:
                signs.setdefault(atom, set()).add(sign)
    return {atom: sign for atom, occurring in signs.items() if len(occurring) == 1 for sign in occurring}


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


def _linked_groups(
    watched: Sequence[tuple[Template, Abstracted]], settled: Collection[f.Atom]
) -> Iterator[list[tuple[Template, Abstracted]]]:
    """Yield groups of instances. Instances that share an atom of unknown value are in one group; all others are alone."""
    groups: list[tuple[set[f.Atom], list[tuple[Template, Abstracted]]]] = []
    for entry in watched:
        part, values = entry
        shared = {a for a in part.atoms if a not in settled and values.open(a) is True}
        members = [entry]
        unrelated = []
        for atoms, related in groups:
            if atoms & shared:
                shared |= atoms
                members = [*related, *members]
            else:
                unrelated.append((atoms, related))
        groups = [*unrelated, (shared, members)]
    for _, members in groups:
        yield members


class _Part:
    """The monitors of a group of linked instances as a deterministic automaton, built on demand by the subset construction.

    A state is a set of possible states of the monitors, because the unknown values are not determined. State 0 is initial.
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
        """Return the state after a configuration; -1 if every choice of the unknown values breaks a rule."""
        key = (state, configuration)
        number = self._memo.get(key)
        if number is None:
            after = self._read(self._sets[state], self._letters, configuration)
            possible = frozenset(s for s in after if all(o[k] != Truth.FALSE for o, k in zip(self._output, s, strict=True)))
            number = -1
            if possible:
                number = self._numbers.setdefault(possible, len(self._sets))
                if number == len(self._sets):
                    self._sets.append(possible)
            self._memo[key] = number
        return number

    def content(self, state: int, configuration: int) -> bool:
        """Return whether a run that ends with this configuration satisfies all rules for some choice of the unknown values."""
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
    """Return the letters of each choice of the unknown values in every configuration, shape ``(choices, machines, size)``.

    Args:
        members: the instances.
        machines: the monitors of the instances.
        settled: values of the atoms of unknown value that suit every rule.
        alive: True for configurations during a run, False for the end of a run.
    """
    atoms = dict.fromkeys(a for part, values in members for a in part.atoms if values.open(a) is not False)
    unknown = [a for a in atoms if a not in settled]
    if len(unknown) > MOST_OPEN:
        raise FormulaError(
            f"{len(unknown)} conditions without a value on an abstract run are linked ({unknown[0]}, {unknown[1]}, ...), "
            f"expected at most {MOST_OPEN}: check fewer rules at once"
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
    letters = {ALIVE: np.full(size, alive)}
    for k, atom in enumerate(part.atoms):
        unknown = values.open(atom)
        if unknown is True:
            truth = np.full(size, chosen[atom])
        else:
            truth = values[atom] if unknown is False else np.where(unknown, chosen[atom], values[atom])
        letters[f.Atom(f"p{k}")] = truth
    return encode(machine, letters, size)
