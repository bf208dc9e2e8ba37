"""Instances of rules in groups, which read a state together.

`Plans` makes the instances of rules for vehicles that come and go: per vehicle, and per pair of vehicles. A `Group` holds the
undecided instances that have the same monitor and whose atoms are columns of the same signals. `Groups` lets all instances read
a state. A user's predicate is evaluated on a run of a single state, only if the next state of a monitor depends on its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.conduct.blocks import Block, Cast, Signal
from pytest_rvads.logic.conduct.static_model import Static, extract
from pytest_rvads.logic.judging.instances import Template, prepare, unfold
from pytest_rvads.logic.judging.judge import Values, signal_of
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth, encode
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Rule, agents_of, split
from pytest_rvads.logic.rules.vocabulary import Follower, Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import ABSENT, Agent
from pytest_rvads.satellites.live.instant import alone
from pytest_rvads.support.errors import FormulaError


@dataclass(slots=True, eq=False)
class Mover:
    """A vehicle that a live monitor reads, with its column, which stays the same."""

    agent: Agent
    column: int
    last: tuple[float, float, float] = int(ABSENT), math.nan, math.nan
    """Zone, station and spread in the last state."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """An instance of a rule for any vehicles on certain ways, numbered in the order of the ways."""

    rule: Rule
    template: Template
    signals: tuple[Signal[NDArray[np.bool_]] | None, ...]
    """Per atom, the signal with its truth values; None for a user's predicate, or a comparison that no signal makes."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """An instance of a rule for certain vehicles."""

    plan: Plan
    movers: tuple[Mover, ...]
    columns: tuple[tuple[int, ...], ...]
    """Per atom, the columns of its vehicles, or the number of its entrance."""
    asks: Mapping[int, Callable[[], bool]]
    """Per atom without a signal, given by number, a function that returns its value in the present state."""


def plans(rule: Rule, static: Static, dt: float) -> Iterator[Plan]:
    """Yield the instances of a rule for the agents of a static model."""
    for template in prepare(rule.formula, static, rule.bound).templates:
        signals = (signal_of(atom, static.entrances, round(rule.tie / dt)) for atom in template.atoms)
        yield Plan(rule, template, tuple(signals))


class Plans:
    """Makes the instances of rules for vehicles that come and go, once per combination of ways of the vehicles.

    An entrance with a colour other than none among `lights`, the colours of the first state, has a light.
    """

    def __init__(self, rules: tuple[Rule, ...], junction: Junction, dt: float, lights: NDArray[Any]) -> None:
        self._rules, self._junction, self._dt, self._lights = rules, junction, dt, lights
        self._made: dict[tuple[Key, ...], tuple[Plan, ...]] = {}
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

    def of(self, *movers: Mover) -> tuple[Plan, ...]:
        """Return the instances of rules about one or two vehicles."""
        ways = tuple(mover.agent.way.key for mover in movers)
        if ways not in self._made:
            static = self._static(ways)
            made = (plan for rule in self._rules for plan in plans(rule, static, self._dt))
            self._made[ways] = tuple(plan for plan in made if _about(plan.template) == set(range(len(ways))))
        return self._made[ways]

    def _static(self, ways: tuple[Key, ...]) -> Static:
        agents = tuple(Agent(f"v{number}", self._junction.every_way[way]) for number, way in enumerate(ways))
        zone = np.zeros((1, len(agents)), dtype=np.int8)
        return extract(Run("live", self._junction, agents, zone, np.array([self._lights], dtype=np.int8)))


def _about(template: Template) -> set[int]:
    """Return the numbers of the vehicles that an instance is about."""
    named = (e for member in template.members for _, e in member.binding)
    return {e.index for e in chain(named, *map(_elements, template.atoms)) if e.sort == Sort.AGENT}


def _elements(atom: f.Atom) -> list[f.Element]:
    """Return the vehicles and places that an atom is about."""
    terms = (term.of if isinstance(term, f.Attr) else term for term in atom.terms)
    return [term for term in terms if isinstance(term, f.Element)]


class Group:
    """Undecided instances with the same monitor and the same signals, and the states of their monitors."""

    def __init__(self, machine: Machine, signals: Sequence[Signal[NDArray[np.bool_]] | None]) -> None:
        self.machine, self.signals = machine, signals
        self.watched: list[Watched] = []
        self._states = np.zeros(0, dtype=np.int32)
        self._cast: Cast | None = None
        self._columns: list[NDArray[np.int64]] = []
        """Per atom, the columns of all instances in the values of its signal, for the vehicles in `_cast`."""
        self._rests = False
        """Whether no monitor changes its state when it reads the same truth values again."""

    def add(self, watched: Watched) -> None:
        """Add an instance, with its monitor in the initial state."""
        self.watched.append(watched)
        self._cast = None

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove all instances but some."""
        self._states = self._states[kept[: len(self._states)]]
        self.watched = [watched for watched, stays in zip(self.watched, kept.tolist(), strict=True) if stays]
        self._cast = None

    def read(
        self, cast: Cast, truths: Mapping[Signal[Any], NDArray[np.bool_]], changed: Set[Signal[Any]]
    ) -> list[tuple[Watched, Truth]]:
        """Read the next state, and return the instances that it decides, with their verdicts.

        Args:
            cast: the vehicles.
            truths: the values of all signals.
            changed: the signals whose values differ from those in the state before.
        """
        if self._cast is not cast:
            self._place(cast)
        elif self._rests and changed.isdisjoint(self.signals):
            return []
        values, asked = {}, []
        for number, (atom, signal) in enumerate(zip(self.machine.atoms, self.signals, strict=True)):
            if signal is None:
                asked.append(number)
                values[atom] = np.zeros(len(self.watched), dtype=np.bool_)
            else:
                values[atom] = truths[signal].take(self._columns[number])
        for number in self._doubtful(values, asked) if asked else ():
            for k in asked:
                values[self.machine.atoms[k]][number] = self.watched[number].asks[k]()
        before, self._states = self._states, self._after(values)
        self._rests = not asked and bool((self._states == before).all())
        output = self.machine.output[self._states]
        open_ones = output == Truth.UNKNOWN
        if open_ones.all():
            return []
        decided = [(self.watched[k], Truth(output[k])) for k in np.flatnonzero(~open_ones).tolist()]
        self.keep(open_ones)
        return decided

    def can_fail(self, number: int, absent: Collection[Mover]) -> bool:
        """Return whether an instance, given by number, can still be violated while some of its vehicles stay absent."""
        watched, false = self.watched[number], set()
        for atom, own in zip(watched.plan.template.atoms, self.machine.atoms, strict=True):
            word = word_of(atom)
            if word is not None and word.present and any(watched.movers[e.index] in absent for e in agents_of(atom)):
                false.add(own)
        return _can_fail(self.machine, int(self._states[number]), frozenset(false))

    def _place(self, cast: Cast) -> None:
        """Find the columns of the instances in the values of the signals, -1 for pairs that a signal is not about."""
        added = len(self.watched) - len(self._states)
        self._states, self._cast = np.append(self._states, np.zeros(added, dtype=np.int32)), cast
        self._columns = []
        for number, signal in enumerate(self.signals):
            found = [None if signal is None else signal.column(cast, watched.columns[number]) for watched in self.watched]
            self._columns.append(np.array([-1 if column is None else column for column in found], dtype=np.int64))

    def _after(self, values: Mapping[f.Atom, NDArray[np.bool_]]) -> NDArray[np.int32]:
        """Return the states of the monitors after they have read the given truth values of their atoms."""
        after: NDArray[np.int32] = self.machine.delta[self._states, encode(self.machine, values, len(self._states))]
        return after

    def _doubtful(self, values: Mapping[f.Atom, NDArray[np.bool_]], asked: Sequence[int]) -> list[int]:
        """Return the numbers of the instances whose next states depend on the atoms in `asked`."""
        if len(asked) > _MOST_ASKED:
            return list(range(len(self.watched)))
        after = []
        for choice in product((False, True), repeat=len(asked)):
            assumed = {self.machine.atoms[k]: np.full(len(self.watched), truth) for k, truth in zip(asked, choice, strict=True)}
            after.append(self._after({**values, **assumed}))
        return np.flatnonzero((np.array(after) != after[0]).any(axis=0)).tolist()


@lru_cache(maxsize=4096)
def _can_fail(machine: Machine, state: int, false: frozenset[f.Atom]) -> bool:
    """Return whether a monitor in a state can still reach a violation while some atoms stay false."""
    free = [atom for atom in machine.atoms if atom not in false]
    if len(free) > _MOST_FREE:
        return True
    choices = np.array(list(product((False, True), repeat=len(free))), dtype=np.bool_)
    values = dict.fromkeys(machine.atoms, np.zeros(len(choices), dtype=np.bool_)) | dict(zip(free, choices.T, strict=True))
    after = machine.delta[:, np.unique(encode(machine, values, len(choices)))].tolist()
    reached, pending = {state}, [state]
    while pending:
        new = set(after[pending.pop()]) - reached
        reached |= new
        pending += new
    return any(machine.output[s] == Truth.FALSE for s in reached)


_MOST_FREE = 8
"""Largest number of atoms of which all combinations of values are tried to decide whether a violation is reachable."""
_MOST_ASKED = 6
"""Largest number of atoms of which all combinations of values are tried to decide whether the next state depends on them."""


@dataclass(slots=True, eq=False)
class _Followed:
    """A user's predicate that depends on earlier states, and its value in the present state."""

    follow: Follower
    movers: tuple[Mover, ...]
    value: bool = False


class Groups:
    """The undecided instances of all rules of a monitor."""

    def __init__(self) -> None:
        self._groups: dict[object, Group] = {}
        self._followed: dict[object, _Followed] = {}
        self._run: Run | None = None
        self._last: dict[Signal[Any], bytes] = {}
        """The values of every signal in the state that was read last."""

    def __iter__(self) -> Iterator[Watched]:
        return (watched for group in self._groups.values() for watched in group.watched)

    def begin(self, block: Block, row: int) -> None:
        """Make the state in a row of a block the present state."""
        self._block, self._row, self._run = block, row, None

    @property
    def tick(self) -> int:
        """Tick of the present state."""
        return self._block.tick + self._row

    @property
    def run(self) -> Run:
        """The present state as a run of one state."""
        if self._run is None:
            self._run = alone(self._block, self._row)
        return self._run

    def add(self, plan: Plan, movers: tuple[Mover, ...]) -> None:
        """Add an instance of a rule for certain vehicles, which reads the present state as its first.

        Raises:
            RunError: a value that the rule needs is not given.
        """
        columns, asks = [], {}
        for number, (atom, signal) in enumerate(zip(plan.template.atoms, plan.signals, strict=True)):
            elements = _elements(atom)
            own = [movers[e.index].column for e in elements if e.sort == Sort.AGENT] or [e.index for e in elements]
            columns.append(tuple(own))
            if signal is None:
                asks[number] = self._ask(atom, movers, plan.rule.tie)
            else:
                signal(self._block, *own)  # an error if the block does not hold enough
        machine = plan.template.machine
        group = self._groups.setdefault((machine, plan.signals), Group(machine, plan.signals))
        group.add(Watched(plan, movers, tuple(columns), asks))

    def end(self, leaving: Collection[Mover], present: Collection[Mover]) -> list[Watched]:
        """Remove and return the instances that can't be violated any more because some vehicles leave."""

        def over(group: Group, number: int) -> bool:
            movers = group.watched[number].movers
            absent = [mover for mover in movers if mover not in present]
            left = any(mover in leaving for mover in absent)
            return left and (len(absent) == len(movers) or not group.can_fail(number, absent))

        return self._remove(over)

    def drop(self, rule: Rule) -> None:
        """Remove the instances of a rule."""
        self._remove(lambda group, number: group.watched[number].plan.rule is rule)

    def _remove(self, goes: Callable[[Group, int], bool]) -> list[Watched]:
        """Remove and return the instances for whose group and number `goes` holds."""
        removed: list[Watched] = []
        for group in self._groups.values():
            kept = np.array([not goes(group, number) for number in range(len(group.watched))])
            if not kept.all():
                removed += [group.watched[number] for number in np.flatnonzero(~kept).tolist()]
                group.keep(kept)
        self._groups = {key: group for key, group in self._groups.items() if group.watched}
        return removed

    def forget(self, movers: Collection[Mover]) -> None:
        """Follow the predicates about other vehicles than the given ones no longer."""
        self._followed = {key: found for key, found in self._followed.items() if all(m in movers for m in found.movers)}

    def read(self) -> list[tuple[Watched, Truth]]:
        """Let all instances read the present state, and return the instances that it decides, with their verdicts."""
        for followed in self._followed.values():
            followed.value = bool(followed.follow(self.run))
        truths: dict[Signal[Any], NDArray[np.bool_]] = {}
        changed = set()
        for signal in dict.fromkeys(s for group in self._groups.values() for s in group.signals if s is not None):
            values = signal(self._block)[self._row]
            # The last column, -1, is about the pairs that the signal is not about.
            truths[signal] = values if signal.pairs is None else np.concatenate((values, _NEVER))
            if (seen := values.tobytes()) != self._last.get(signal):
                changed.add(signal)
                self._last[signal] = seen
        decided = [found for group in self._groups.values() for found in group.read(self._block.cast, truths, changed)]
        self._groups = {key: group for key, group in self._groups.items() if group.watched}
        return decided

    def _ask(self, atom: f.Atom, movers: tuple[Mover, ...], tie: float) -> Callable[[], bool]:
        """Return a function that returns the value of an atom without a signal in the present state."""

        def moved(term: f.Term) -> f.Term:
            match term:
                case f.Element(Sort.AGENT, number):
                    return f.Element(Sort.AGENT, movers[number].column, movers[number].agent.name)
                case f.Attr(f.Element(Sort.AGENT, number), name):
                    return f.Attr(f.Element(Sort.AGENT, movers[number].column, movers[number].agent.name), name)
            return term

        word, own = word_of(atom), f.Atom(atom.name, tuple(map(moved, atom.terms)), atom.at, atom.word)
        if word is None or word.follow is None:
            return lambda: bool(Values(self.run, tie)[own][0])
        about = tuple(movers[agent.index] for agent in agents_of(atom))
        if (own, about) not in self._followed:
            self._followed[own, about] = _Followed(word.follow(self.run, *word.arguments(own)), about)
        followed = self._followed[own, about]
        return lambda: followed.value


_NEVER = np.zeros(1, dtype=np.bool_)
