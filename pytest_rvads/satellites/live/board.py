"""The instances of rules, and the present truth values of their atoms (facts), that live monitors read.

`Instances` makes the instances of rules for vehicles that come and go: per vehicle, and per pair of vehicles. `Board` holds the
facts of the atoms in these instances. Equal atoms of different rules share a fact. Signals (quantities per state) are evaluated
in every state for all vehicles at once, and a fact is set only when its signal changes. A user's predicate is evaluated on a run
of a single state, when a monitor asks for the predicate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import Block, Signal
from pytest_rvads.logic.conduct.cast import Cast
from pytest_rvads.logic.conduct.predicates import Static, extract
from pytest_rvads.logic.judging.instances import Template, prepare, unfold
from pytest_rvads.logic.judging.judge import OPERATORS, Values, signal_of
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Rule, agents_of, split
from pytest_rvads.logic.rules.vocabulary import Follower, Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent
from pytest_rvads.satellites.live.instant import Instant, Mover
from pytest_rvads.satellites.live.watch import Fact
from pytest_rvads.support.errors import FormulaError

_Entry = TypeVar("_Entry")


class Board:
    """The present truth values of atoms (facts) in a run that goes on; `Instant.go_on` moves `now` to the next state."""

    def __init__(self, now: Instant) -> None:
        self.now = now
        self._facts: dict[object, Fact] = {}
        self._signals: dict[Signal[Any], list[tuple[Fact, tuple[Mover | int, ...]]]] = {}
        """Per signal, the facts that the signal determines, each with its vehicles or its entrance."""
        self._columns: dict[Signal[Any], tuple[int, list[tuple[Fact, int]]]] = {}
        """Per signal, the number of its facts, and the column of each fact; valid as long as the cast is the same."""
        self._cast: Cast | None = None
        self._rows: dict[Signal[Any], list[bool]] = {}
        """The values of every signal in the state that was read last."""
        self._block: Block | None = None
        self._values: list[tuple[Signal[Any], list[list[bool]]]] = []
        """The values, in all states of the present block, of every signal that determines a fact."""
        self._followed: list[tuple[Fact, Follower]] = []
        self._bodily: dict[Mover, set[Fact]] = {}
        self._ends: dict[Mover, list[Callable[[], None]]] = {}

    def drop(self, mover: Mover) -> None:
        """Remove the facts of a vehicle that no monitor is about any more."""
        for end in self._ends.pop(mover, ()):
            end()
        self._bodily.pop(mover, None)
        for key in [key for key, fact in self._facts.items() if not fact.watches]:
            del self._facts[key]

    def bodily(self, movers: Iterable[Mover]) -> frozenset[Fact]:
        """Return the facts (truth values of atoms) that are false while any of the given vehicles is absent."""
        return frozenset(fact for mover in movers for fact in self._bodily.get(mover, ()))

    def read(self) -> None:
        """Update the truth values of all atoms to the present state of the run."""
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
                facts, (count, columns) = self._signals[signal], self._columns.get(signal, (-1, []))
                if count != len(facts):
                    cast = now.block.cast
                    columns = []
                    for fact, places in facts:
                        column = signal.column(cast, [place.slot if isinstance(place, Mover) else place for place in places])
                        if column is not None:
                            columns.append((fact, column))
                    self._columns[signal] = len(facts), columns
                for fact, column in columns:
                    fact.tell(row[column])
        for fact, follow in self._followed:
            fact.tell(bool(follow(now.run)))

    def fact(self, atom: f.Atom, movers: Sequence[Mover], tie: float) -> Fact:
        """Return the fact of an atom: its present truth value, which `read` keeps up to date; `tie` is in seconds."""
        terms: list[object] = []
        in_columns: list[f.Term] = []  # the terms, with agents numbered by their columns in the present state
        agents: list[Mover] = []
        entrances: list[int] = []
        for term in atom.terms:
            element = term.of if isinstance(term, f.Attr) else term
            if isinstance(element, f.Element) and element.sort == Sort.AGENT:
                mover = movers[element.index]
                agents.append(mover)
                moved_element = f.Element(element.sort, mover.slot, mover.agent.name)
                terms.append((mover, term.name) if isinstance(term, f.Attr) else mover)
                in_columns.append(f.Attr(moved_element, term.name) if isinstance(term, f.Attr) else moved_element)
            else:
                terms.append(term)
                in_columns.append(term)
                entrances += [element.index] if isinstance(element, f.Element) else []
        key = (atom.word or atom.name, tuple(terms), tie if atom.name in OPERATORS else 0.0)
        fact = self._facts.get(key)
        if fact is None:
            now, word = self.now, word_of(atom)
            signal = signal_of(atom, len(now.junction.entrances), round(tie / now.dt))
            if signal is not None:
                places: tuple[Mover | int, ...] = tuple(agents or entrances)
                fact = Fact(bool(signal(now.block, *([mover.slot for mover in agents] or entrances))[now.row]))
                self._columns.pop(signal, None)
                self._block = None
                self._keep(fact, self._signals.setdefault(signal, []), (fact, places))
            else:  # computed on a run of one state
                moved = f.Atom(atom.name, tuple(in_columns), atom.at, atom.word)
                if word is not None and word.follow is not None:
                    follow = word.follow(now.run, *word.arguments(moved))
                    fact = Fact(bool(follow(now.run)))
                    self._keep(fact, self._followed, (fact, follow), *movers)
                else:
                    fact = Fact(False, lambda: bool(Values(now.run, tie)[moved][0]))
            self._facts[key] = fact
            if word is not None and word.present:
                for mover in agents:
                    self._bodily.setdefault(mover, set()).add(fact)
            fact.homes.append(partial(self._facts.pop, key, None))
        return fact

    def _keep(self, fact: Fact, where: list[_Entry], entry: _Entry, *until: Mover) -> None:
        """Put an entry into a list until a vehicle of `until` is dropped, or, without such, until no monitor reads the fact."""
        where.append(entry)

        def end() -> None:
            if entry in where:
                where.remove(entry)

        if until:
            for mover in until:
                self._ends.setdefault(mover, []).append(end)
        else:
            fact.homes.append(end)


class Instances:
    """Makes the instances of rules for vehicles that come and go, once per combination of ways of the vehicles.

    An entrance with a colour other than none among `lights`, the colours of the first state, has a light.
    """

    def __init__(self, rules: tuple[Rule, ...], junction: Junction, lights: list[int]) -> None:
        self._rules, self._junction, self._lights = rules, junction, lights
        self._prepared: dict[tuple[Key, ...], tuple[tuple[int, Template], ...]] = {}
        routes = [next(iter(junction.movements))] * 3
        static = replace(self._static(tuple(routes)), entrances=1, exits=1, lights=(0,), signs=())
        for rule in rules:
            quantifiers = (node for node, _ in f.walk(rule.formula) if isinstance(node, f.Exists))
            some_agent = any(variable.sort == Sort.AGENT for node in quantifiers for variable in node.variables)
            for instance in unfold(rule.formula, static).instances:
                named = {e for _, e in instance.binding if e.sort == Sort.AGENT}
                if some_agent or any(len(named | set(agents_of(part))) > 2 for part in split(instance.formula)):
                    raise FormulaError(
                        f"rule {rule.name!r} is about more than two vehicles at once, and who comes later would count: "
                        "give the monitor its agents"
                    )

    def of(self, *ways: Key) -> tuple[tuple[int, Template], ...]:
        """Return the instances of rules about vehicles on one or two given ways, each with the number of its rule.

        The agents of an instance are numbered in the order of the ways.
        """
        instances = self._prepared.get(ways)
        if instances is None:
            static, about_all = self._static(ways), []
            for number, rule in enumerate(self._rules):
                for template in prepare(rule.formula, static, rule.bound).templates:
                    named = {e.index for member in template.members for _, e in member.binding if e.sort == Sort.AGENT}
                    if named | {e.index for e in agents_of(template.formula)} == set(range(len(ways))):
                        about_all.append((number, template))
            instances = self._prepared[ways] = tuple(about_all)
        return instances

    def _static(self, ways: tuple[Key, ...]) -> Static:
        agents = tuple(Agent(f"v{number}", self._junction.every_way[way]) for number, way in enumerate(ways))
        zone = np.zeros((1, len(agents)), dtype=np.int8)
        return extract(Run("live", self._junction, agents, zone, np.array([self._lights], dtype=np.int8)))
