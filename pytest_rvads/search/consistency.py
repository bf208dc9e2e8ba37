"""Decides, on a discrete model of a scenario and without simulation, whether vehicles can obey a set of rules.

The model of `abstraction` contains every behaviour that vehicles can show: every sequence of their places. The product of the
model and the monitors of the rules is searched for a behaviour that violates no rule and lets all vehicles pass the junction. If
no such behaviour exists, no autopilot can obey the rules. A behaviour of the model can be impossible in reality, because the
model has no time, speed or geometry. Values that the model leaves open (speeds, standstill, a user's predicates) are chosen in
favour of the rules.

A survey, which the command ``rvads rules check`` prints, decides all scenarios and orders of arrival at a junction.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, product

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.judging.judgement import Template
from pytest_rvads.logic.judging.prepare import prepare, template
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.finite import ALIVE, with_ending
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, encode, synthesize
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.orbits import Directions, Orbits, rotate
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.abstraction import Abstracted, Model, weak_orders
from pytest_rvads.search.remap import rotations_of
from pytest_rvads.support.errors import FormulaError, ScenarioError

__all__ = ["Answer", "Contradiction", "Survey", "core", "decide", "show", "survey"]

Letters = NDArray[np.int32]
"""Letters that monitors read, per configuration on the last axis; a letter numbers a combination of truth values of the atoms."""
MOST_OPEN = 10
"""Largest number of atoms of unknown value that a group of rules shares, because all combinations of their values are tried."""
APART = 60.0
"""Time between the arrivals of two vehicles that do not arrive together [s]; it is longer than any window for ties."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to the question whether vehicles can obey a set of rules in a scenario with a given order of arrival."""

    possible: bool
    """Whether a behaviour of the model satisfies all rules and lets all vehicles pass."""
    witness: tuple[int, ...] = ()
    """Configurations of a behaviour that satisfies all rules, in order; empty if there is no such behaviour."""


def decide(model: Model, rules: Iterable[Rule]) -> Answer:
    """Return whether a behaviour of a model satisfies all rules and lets all vehicles pass the junction.

    Args:
        model: scenario and order of arrival.
        rules: the rules; rules about other kinds of junctions are ignored.

    Raises:
        FormulaError: a monitor would be too large, or a group of rules shares more than `MOST_OPEN` atoms of unknown value.
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
    """Return a minimal subset of rules that vehicles can't obey together: without any one of its rules, they can.

    Args:
        model: scenario and order of arrival.
        rules: rules that vehicles can't obey together.
    """
    remaining = list(rules)
    for rule in rules:
        fewer = [r for r in remaining if r is not rule]
        if not decide(model, fewer).possible:
            remaining = fewer
    return tuple(remaining)


@dataclass(frozen=True, slots=True)
class Contradiction:
    """An abstract scenario and an order of arrival in which the vehicles can't obey the rules."""

    directions: Directions
    arrivals: tuple[float, ...]
    """Arrival time of the vehicle at each occupied entrance [s]."""
    rules: tuple[str, ...]
    """Names of a minimal set of rules that the vehicles can't obey together: without any one of the rules, they can."""


@dataclass(frozen=True, slots=True)
class Survey:
    """The result of `survey`: numbers of checked scenarios and orders of arrival, and the contradictions."""

    junction: Junction
    rules: tuple[Rule, ...]
    scenarios: int
    orders: int
    """Number of orders of arrival per scenario."""
    contradictions: tuple[Contradiction, ...]


def survey(
    place: Junction,
    rules: Sequence[Rule],
    *,
    scenarios: Sequence[Directions] | None = None,
    arrivals: Sequence[float] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Survey:
    """Find the scenarios and orders of arrival in which no behaviour satisfies all rules and lets all vehicles pass the junction.

    Args:
        place: the junction.
        rules: the rules; rules about other kinds of junctions are ignored.
        scenarios: abstract scenarios; by default all scenarios with a vehicle on each arm.
        arrivals: arrival time of the vehicle at each entrance [s]; by default all orders of arrival, with ties.
        progress: function that is called with the number of finished pairs of scenario and order, and the number of all pairs.

    Raises:
        ScenarioError: the number of arrivals is not the number of entrances.
        FormulaError: a rule can't be monitored.
    """
    count = len(place.entrances)
    chosen = list(Orbits.at(place).every()) if scenarios is None else list(scenarios)
    if arrivals is not None and len(arrivals) != count:
        raise ScenarioError(f"arrivals needs one time per entrance ({count}), got {len(arrivals)}: {tuple(arrivals)!r}")
    turns = [symmetry.rows for symmetry in rotations_of(place)]
    contradicting: dict[tuple[Directions, tuple[float, ...]], tuple[str, ...]] = {}
    contradictions = []
    pairs = [(code, times) for code in chosen for times in _arrival_patterns(code, arrivals)]
    for finished, (code, times) in enumerate(pairs, start=1):
        key = min((rotate(code, r), rotate(times, r)) for r in turns)
        if key not in contradicting:
            contradicting[key] = _contradicting_rules(place, rules, *key)
        if contradicting[key]:
            present = tuple(time for time, direction in zip(times, code, strict=True) if direction)
            contradictions.append(Contradiction(code, present, contradicting[key]))
        if progress:
            progress(finished, len(pairs))
    return Survey(place, tuple(rules), len(chosen), len(pairs) // len(chosen), tuple(contradictions))


def _arrival_patterns(code: Directions, arrivals: Sequence[float] | None) -> Iterator[tuple[float, ...]]:
    """Yield the arrival times per entrance [s] for each order of arrival, or only the given times; 0 at empty entrances."""
    if arrivals is not None:
        yield tuple(time if direction else 0.0 for time, direction in zip(arrivals, code, strict=True))
        return
    for ranks in weak_orders(sum(map(bool, code))):
        remaining = iter(ranks)
        yield tuple(APART * next(remaining) if direction else 0.0 for direction in code)


def _contradicting_rules(place: Junction, rules: Sequence[Rule], code: Directions, times: tuple[float, ...]) -> tuple[str, ...]:
    agents = Scenario(place, code).agents()
    model = Model(place, agents, [times[a.entrance] for a in agents])
    if decide(model, rules).possible:
        return ()
    return tuple(rule.name for rule in core(model, rules))


def show(result: Survey) -> str:
    """Return the result of a survey as text, with a line per set of contradicting rules."""
    names = " ".join(rule.name for rule in result.rules if rule.concerns(result.junction))
    pairs = result.scenarios * result.orders
    head = f"{result.junction.name}: {names}: {result.scenarios} scenarios x {result.orders} orders of arrival"
    if not result.contradictions:
        return f"{head}: nothing contradicts itself"
    lines = [f"{head}: in {len(result.contradictions)} of {pairs} no behaviour obeys and lets everyone through"]
    for rules, group in groupby(sorted(result.contradictions, key=lambda c: c.rules), key=lambda c: c.rules):
        members = list(group)
        orders = list(dict.fromkeys(map(_show_order, members)))
        codes = list(dict.fromkeys(label(m.directions, result.junction.lanes) for m in members))
        lines.append(f"  {' + '.join(rules):20}  arrival {_first_of(orders, 'orders')}; scenario {_first_of(codes, 'scenarios')}")
    return "\n".join(lines)


def _first_of(texts: Sequence[str], plural: str) -> str:
    return texts[0] if len(texts) == 1 else f"{texts[0]} and {len(texts) - 1} more {plural}"


def _show_order(contradiction: Contradiction) -> str:
    """Return the order of arrival in a contradiction as text, such as ``0 = 2 < 1`` for numbers of entrances."""
    entrances = [e for e, direction in enumerate(contradiction.directions) if direction]
    times = sorted(set(contradiction.arrivals))
    groups = [" = ".join(str(e) for e, t in zip(entrances, contradiction.arrivals, strict=True) if t == time) for time in times]
    return " < ".join(groups)


def _search(model: Model, parts: Sequence[_Part]) -> Answer:
    """Search depth first for a behaviour that satisfies the rules and lets all vehicles pass the junction."""
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
    """Return values for atoms of unknown value, if one value favours every rule.

    This is so for an atom that occurs in all rules only without negation (True), or only negated (False).
    """
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
    """Yield groups of rule instances (formulas for certain vehicles) that share an atom of unknown value."""
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
    """The monitors of a group of rule instances as one deterministic automaton, whose states are computed when they are needed.

    A state of the automaton stands for a set of combinations of monitor states, because different choices of unknown values lead
    to different combinations. The initial state is 0.
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
        """Return the automaton state after a configuration; -1 if every choice of unknown values violates a rule."""
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
        """Return whether a run that ends with this configuration satisfies all rules for a choice of the unknown values."""
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
    """Return the letters that the monitors read, shape ``(choices, machines, size)``.

    There is a letter for each combination of the unknown values, each monitor, and each configuration.

    Args:
        members: the instances.
        machines: the monitors of the instances.
        settled: values that favour every rule, by atom of unknown value.
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
