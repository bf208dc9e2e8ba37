"""The instances and the present facts that live monitors read.

`Instances` makes the instances of rules for vehicles that come and go: per vehicle, and per pair of vehicles. `Board` holds the
present values of the ground atoms in these instances; all rules share the value of an atom. Signals are evaluated in every state
for all vehicles at once, and facts are told where a signal changes. A user's word is evaluated on a run of one state, when a
monitor asks for the word.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from pytest_rvads.geometry.conflicts import Key
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blocks import Block, Signal
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.logic.conduct.predicates import Static, extract
from pytest_rvads.logic.judging.evaluate import OPERATORS, Values, signal_of
from pytest_rvads.logic.judging.ground import unfold
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.live.instant import Instant, Mover
from pytest_rvads.logic.live.watch import Fact
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.rules.shape import agents_of, split
from pytest_rvads.logic.rules.sorts import Sort
from pytest_rvads.logic.rules.vocabulary import Follower
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent
from pytest_rvads.support.errors import FormulaError

__all__ = ["Board", "Instances"]


_Entry = TypeVar("_Entry")


class Board:
    """The present facts of a run that goes on.

    Args:
        now: the present instant; the run goes on by advancing this instant.
    """

    def __init__(self, now: Instant) -> None:
        self.now = now
        self._facts: dict[object, Fact] = {}
        self._signals: dict[Signal[Any], list[tuple[Fact, tuple[Mover | int, ...]]]] = {}
        """The facts about every signal, and the vehicles or the entrance that they are about."""
        self._columns: dict[Signal[Any], tuple[int, list[tuple[Fact, int]]]] = {}
        """Per signal, the number of its facts, and the column of each fact; valid as long as the cast is the same."""
        self._cast: Cast | None = None
        self._rows: dict[Signal[Any], list[bool]] = {}
        """The state before, for every signal."""
        self._block: Block | None = None
        self._values: list[tuple[Signal[Any], list[list[bool]]]] = []
        """The states of every signal in the block, for the signals that facts are about."""
        self._followed: list[tuple[Fact, Follower]] = []
        self._bodily: dict[Mover, set[Fact]] = {}
        self._ends: dict[Mover, list[Callable[[], None]]] = {}

    def drop(self, mover: Mover) -> None:
        """Forget a vehicle about which no monitor is left."""
        for end in self._ends.pop(mover, ()):
            end()
        self._bodily.pop(mover, None)
        for key in [key for key, fact in self._facts.items() if not fact.watches]:
            del self._facts[key]

    def bodily(self, movers: Iterable[Mover]) -> frozenset[Fact]:
        """Return the facts that are false while any of these vehicles is absent."""
        return frozenset(fact for mover in movers for fact in self._bodily.get(mover, ()))

    def read(self) -> None:
        """Bring all facts up to this instant.

        Raises:
            RunError: a value that an atom asks for is not given.
        """
        now = self.now
        if now.block.cast is not self._cast:
            self._cast = now.block.cast
            self._columns.clear()
            self._rows.clear()
        if now.block is not self._block:
            self._block = now.block
            self._values = [(signal, signal(now.block).tolist()) for signal, facts in self._signals.items() if facts]
        for signal, rows in self._values:
            row = rows[now.row]
            if row != self._rows.get(signal):
                self._rows[signal] = row
                for fact, column in self._columns_of(signal):
                    fact.tell(row[column])
        for fact, follow in self._followed:
            fact.tell(bool(follow(now.run)))

    def _forget(self, key: object) -> None:
        self._facts.pop(key, None)

    def fact(self, atom: f.Atom, movers: Sequence[Mover], tie: float) -> Fact:
        """Return the fact of a ground atom, which `read` keeps up to date.

        Args:
            atom: the atom; its agents are numbered by their place in `movers`.
            movers: the vehicles.
            tie: waiting times that differ by at most this count as equal [s].

        Raises:
            RunError: a value that the atom asks for is not given.
        """
        terms = tuple(_key_of(term, movers) for term in atom.terms)
        key = (atom.word or atom.name, terms, tie if atom.name in OPERATORS else 0.0)
        fact = self._facts.get(key)
        if fact is None:
            elements = [element for element in map(_element_of, atom.terms) if element is not None]
            agents = [movers[element.index] for element in elements if element.sort == Sort.AGENT]
            signal = signal_of(atom, len(self.now.junction.entrances), round(tie / self.now.dt))
            if signal is None:
                fact = self._general(atom, movers, tie)
            else:
                fact = self._of_signal(signal, agents or [element.index for element in elements])
            self._facts[key] = fact
            word = word_of(atom)
            if word is not None and word.present:
                for mover in agents:
                    self._bodily.setdefault(mover, set()).add(fact)
            fact.homes.append(partial(self._forget, key))
        return fact

    def _of_signal(self, signal: Signal[Any], places: Sequence[Mover | int]) -> Fact:
        """Return a fact that is one column of a signal, about vehicles or an entrance."""
        fact = Fact(bool(signal(self.now.block, *map(_column, places))[self.now.row]))
        self._columns.pop(signal, None)
        self._block = None
        return self._keep(fact, self._signals.setdefault(signal, []), (fact, tuple(places)))

    def _columns_of(self, signal: Signal[Any]) -> list[tuple[Fact, int]]:
        """Return the facts about a signal, each with its column of the signal."""
        cast, facts, (count, columns) = self.now.block.cast, self._signals[signal], self._columns.get(signal, (-1, []))
        if count != len(facts):
            places_of_facts = ((fact, signal.column(cast, list(map(_column, places)))) for fact, places in facts)
            columns = [(fact, column) for fact, column in places_of_facts if column is not None]
            self._columns[signal] = len(facts), columns
        return columns

    def _general(self, atom: f.Atom, movers: Sequence[Mover], tie: float) -> Fact:
        """Return a fact that is worked out on a run of one state."""
        now, moved, word = self.now, _in_columns(atom, movers), word_of(atom)
        if word is not None and word.follow is not None:
            follow = word.follow(now.run, *word.arguments(moved))
            fact = Fact(bool(follow(now.run)))
            return self._keep(fact, self._followed, (fact, follow), *movers)
        return Fact(False, lambda: bool(Values(now.run, tie)[moved][0]))

    def _keep(self, fact: Fact, where: list[_Entry], entry: _Entry, *until: Mover) -> Fact:
        """Keep the entry of a fact in a list until a vehicle of `until` is dropped, or else until no watch reads the fact."""
        where.append(entry)

        def end() -> None:
            if entry in where:
                where.remove(entry)

        if until:
            for mover in until:
                self._ends.setdefault(mover, []).append(end)
        else:
            fact.homes.append(end)
        return fact


def _column(place: Mover | int) -> int:
    return place if isinstance(place, int) else place.slot


def _element_of(term: f.Term) -> f.Element | None:
    """Return the element of a term; None for a value."""
    inner = term.of if isinstance(term, f.Attr) else term
    return inner if isinstance(inner, f.Element) else None


def _key_of(term: f.Term, movers: Sequence[Mover]) -> object:
    """Return a key of a term: for an agent its mover, together with the name of an attribute; else the term."""
    element = _element_of(term)
    if element is None or element.sort != Sort.AGENT:
        return term
    mover = movers[element.index]
    return (mover, term.name) if isinstance(term, f.Attr) else mover


def _in_columns(atom: f.Atom, movers: Sequence[Mover]) -> f.Atom:
    """Return an atom whose agents are numbered by their columns."""

    def move(term: f.Term) -> f.Term:
        if isinstance(term, f.Attr) and isinstance(term.of, f.Element):
            return f.Attr(element(term.of), term.name)
        return element(term) if isinstance(term, f.Element) else term

    def element(old: f.Element) -> f.Element:
        if old.sort != Sort.AGENT:
            return old
        mover = movers[old.index]
        return f.Element(old.sort, mover.slot, mover.agent.name)

    return f.Atom(atom.name, tuple(map(move, atom.terms)), atom.at, atom.word)


class Instances:
    """The instances of rules by the ways of the vehicles, prepared once per combination of ways.

    Args:
        rules: the rules.
        junction: the junction.
        lights: colours of the first state; an entrance with a colour other than none has a light.

    Raises:
        FormulaError: a rule is about more than two vehicles at once, so that vehicles that come later would count.
    """

    def __init__(self, rules: tuple[Rule, ...], junction: Junction, lights: list[int]) -> None:
        self._rules, self._junction, self._lights = rules, junction, lights
        self._prepared: dict[tuple[Key, ...], tuple[tuple[int, Template], ...]] = {}
        routes = [next(iter(junction.movements))] * 3
        static = replace(self._static(tuple(routes)), entrances=1, exits=1, lights=(0,), signs=())
        for rule in rules:
            _refuse_crowds(rule, static)

    def of(self, *ways: Key) -> tuple[tuple[int, Template], ...]:
        """Return the instances about one vehicle or about two vehicles together, each with the number of its rule.

        The agents of the instances are numbered in the order of the ways.
        """
        instances = self._prepared.get(ways)
        if instances is None:
            static = self._static(ways)
            agents = range(len(ways))
            instances = self._prepared[ways] = tuple(
                (number, template)
                for number, rule in enumerate(self._rules)
                for template in prepare(rule.formula, static, rule.bound).templates
                if _about(template) == set(agents)
            )
        return instances

    def _static(self, ways: tuple[Key, ...]) -> Static:
        agents = tuple(Agent(f"v{number}", self._junction.every_way[way]) for number, way in enumerate(ways))
        zone = np.zeros((1, len(agents)), dtype=np.int8)
        return extract(Run("live", self._junction, agents, zone, np.array([self._lights], dtype=np.int8)))


def _about(template: Template) -> set[int]:
    """Return the columns of the agents in the variables and in the atoms of an instance."""
    named = {e.index for member in template.members for _, e in member.binding if e.sort == Sort.AGENT}
    return named | {e.index for e in agents_of(template.formula)}


def _refuse_crowds(rule: Rule, static: Static) -> None:
    for instance in unfold(rule.formula, static).instances:
        named = {e for _, e in instance.binding if e.sort == Sort.AGENT}
        if any(len(named | set(agents_of(part))) > 2 for part in split(instance.formula)) or _exists(rule.formula):
            raise FormulaError(
                f"rule {rule.name!r} is about more than two vehicles at once, and who comes later would count: "
                "give the monitor its agents"
            )


def _exists(formula: f.Formula) -> bool:
    """Return whether a formula has an existential quantifier over agents."""
    if isinstance(formula, f.Exists) and any(v.sort == Sort.AGENT for v in formula.variables):
        return True
    return any(_exists(child) for child in f.children(formula))
