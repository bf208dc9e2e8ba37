"""Judges the instances of a rule on a run: status, broken atoms, first tick of the obligation, and margin of every instance.

`Values` evaluates atoms without variables on a run: a truth value per state. The monitors of the instances read these values.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.blocks import Block, Signal, everybody, ticks, window
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.judging.instances import Template, columns
from pytest_rvads.logic.judging.judgement import Hinge, InstanceJudgement, Nearest
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import Truth, encode, evaluate, holds, run_machine, settle
from pytest_rvads.logic.rules.lexicon import ATTRIBUTES, at, word_of
from pytest_rvads.logic.rules.rule import Form, conjuncts
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import FormulaError

FINE = 0.02
"""Longest step of a run whose states alone say in which order vehicles came to zones and lights changed [s].

On the runs of the paper's authors no verdict changes up to this step, and some verdicts change at 0.05 s.
"""
OPERATORS: Mapping[str, Callable[[Any, Any], NDArray[np.bool_]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def certain(run: Run) -> bool:
    """Return whether the order of events in a run is certain: its steps are at most `FINE`, and it is no recording."""
    return run.dt <= FINE and run.spread is None and run.excerpt is None


def undecided(run: Run) -> str:
    """Return the ways that are not decided in words; empty if all ways are decided."""
    names = [agent.name for agent in run.agents if agent.other_exits]
    return f"the undecided way{'s' if len(names) > 1 else ''} of {' and '.join(names)}" if names else ""


class Values(Mapping[f.Atom, NDArray[np.bool_]]):
    """The truth values of atoms on a run, arrays of shape ``(steps,)``, each computed at its first use.

    Waiting times are equal if they differ by at most `tie` [s]. For `standing` see `check`.
    """

    def __init__(self, run: Run, tie: float = 0.0, *, standing: bool = False) -> None:
        self.run = run
        self.standing = standing
        readers = {name: attribute.standing for name, attribute in ATTRIBUTES.items() if attribute.standing and standing}
        self._readers: dict[str, Callable[[Run, int], NDArray[Any]]] = readers
        self.tie = tie
        self._ticks = ticks(run, tie)
        self._truths: dict[f.Atom, NDArray[np.bool_]] = {}

    def __getitem__(self, atom: f.Atom) -> NDArray[np.bool_]:
        truths = self._truths.get(atom)
        if truths is not None:
            return truths
        if atom.name in OPERATORS:
            compare, (left, right) = OPERATORS[atom.name], atom.terms
            if isinstance(left, f.Attr) and isinstance(right, f.Attr) and ATTRIBUTES[left.name].waited:
                longer = self._read(left) - self._read(right)
                truths = compare(np.where(np.abs(longer) <= self._ticks, 0, longer), 0)
            else:
                truths = compare(self._operand(left, right), self._operand(right, left))
        else:
            word = word_of(atom)
            if word is None or word.holds is None:
                raise FormulaError(f"nothing tells the value of {atom} on a run: register the predicate {atom.name!r}")
            truths = word.on(self.run, *word.arguments(atom))
        self._truths[atom] = truths
        return truths

    @property
    def steps(self) -> int:
        """Number of states."""
        return self.run.steps

    def of(self, run: Run) -> Values:
        """Return the truth values on another run, with the same tie window and the same beginning of waiting times."""
        return Values(run, self.tie, standing=self.standing)

    def within(self, begin: int, end: int) -> Values | Part:
        """Return the truth values from tick `begin` up to, but not including, tick `end`."""
        return self if (begin, end) == (0, self.run.steps) else Part(self, begin, end)

    def untied(self) -> Values:
        """Return the truth values with a tie window of 0, in which waiting times count as equal only if they are equal."""
        exact = copy(self)
        exact.tie, exact._ticks = 0.0, 0
        exact._truths = {
            atom: values
            for atom, values in self._truths.items()
            if not any(isinstance(term, f.Attr) and ATTRIBUTES[term.name].waited for term in atom.terms)
        }
        return exact

    def __iter__(self) -> Iterator[f.Atom]:
        return iter(self._truths)

    def __len__(self) -> int:
        return len(self._truths)

    def _operand(self, term: f.Term, other: f.Term) -> NDArray[Any] | float:
        """Return the numbers of a side of a comparison; the attribute on the other side gives the number of a named value."""
        match term, other:
            case f.Number(value), _:
                return value
            case f.Value(name), f.Attr(_, asked) if codes := ATTRIBUTES[asked].codes:
                return codes(name)
            case f.Attr(_, asked), _:
                return _seconds(asked, self._read(term), self.run.dt)
        raise FormulaError(f"{term} has no value to compare")

    def _read(self, term: f.Attr) -> NDArray[Any]:
        if not isinstance(term.of, f.Element):
            raise FormulaError(f"{term} has no value as long as {term.of} is a variable")
        read = self._readers.get(term.name) or ATTRIBUTES[term.name].read
        return read(self.run, term.of.index)


def _seconds(attribute: str, values: NDArray[Any], dt: float) -> NDArray[Any]:
    """Return the values of an attribute, with waiting times turned from ticks into seconds."""
    # Rounded, so that a waiting time of 300 ticks of 0.01 s equals exactly 3 s.
    return np.round(values * dt, 9) if ATTRIBUTES[attribute].waited else values


def signal_of(atom: f.Atom, entrances: int, ticks: int) -> Signal[NDArray[np.bool_]] | None:
    """Return the signal (a quantity per state) with the truth values of an atom, for live monitors; None if the atom has none."""
    word = word_of(atom)
    if word is not None and isinstance(word.holds, Signal):
        return word.holds
    match atom.name, atom.terms:
        case "@", (f.Element(Sort.AGENT), f.Element() as place):
            return at(place, entrances)
        case _, (f.Attr(f.Element(Sort.AGENT, one), left), f.Attr(f.Element(Sort.AGENT, two), right)) if one != two:
            return _between(atom.name, left, right, ticks)
        case _, (f.Attr(f.Element(), asked), f.Number(value)):
            return _against(atom.name, asked, value)
        case _, (f.Attr(f.Element(), asked), f.Value(name)) if codes := ATTRIBUTES[asked].codes:
            return _against(atom.name, asked, codes(name))
    return None


@lru_cache(maxsize=256)
def _between(sign: str, left: str, right: str, ticks: int) -> Signal[NDArray[np.bool_]]:
    """Return the signal that compares an attribute of a pair's first vehicle with an attribute of its second vehicle."""

    def work(block: Block) -> NDArray[np.bool_]:
        if ATTRIBUTES[left].waited:
            return OPERATORS[sign](_order(left, right, ticks)(block), 0)
        both = block.cast.static(everybody)
        one, two = both.first(ATTRIBUTES[left].read(block)), both.second(ATTRIBUTES[right].read(block))
        return OPERATORS[sign](one, _seconds(right, two, block.dt))

    return Signal(work, pairs=everybody)


@lru_cache(maxsize=256)
def _order(left: str, right: str, ticks: int) -> Signal[NDArray[np.int8]]:
    """Return the signal that is 1 where a pair's first vehicle waited longer, -1 where the second waited longer, 0 for a tie."""

    def work(block: Block) -> NDArray[np.int8]:
        both = block.cast.static(everybody)
        longer = both.first(ATTRIBUTES[left].read(block)) - both.second(ATTRIBUTES[right].read(block))
        order: NDArray[np.int8] = (longer > ticks).view(np.int8) - (longer < -ticks).view(np.int8)
        return order

    return Signal(work, pairs=everybody)


@lru_cache(maxsize=256)
def _against(sign: str, attribute: str, constant: float) -> Signal[NDArray[np.bool_]]:
    """Return the signal (a quantity per state) that compares an attribute with a constant."""

    def work(block: Block) -> NDArray[np.bool_]:
        return OPERATORS[sign](_seconds(attribute, ATTRIBUTES[attribute].read(block), block.dt), constant)

    return Signal(work, of_entrances=ATTRIBUTES[attribute].read.of_entrances)


class Part(Mapping[f.Atom, NDArray[np.bool_]]):
    """The truth values of atoms in the part of a run from tick `begin` up to, but not including, tick `end`, counted from 0."""

    def __init__(self, values: Values, begin: int, end: int) -> None:
        self.run = values.run
        self.steps = end - begin
        self._whole, self._part = values, slice(begin, end)

    def __getitem__(self, atom: f.Atom) -> NDArray[np.bool_]:
        return self._whole[atom][self._part]

    def __iter__(self) -> Iterator[f.Atom]:
        return iter(self._whole)

    def __len__(self) -> int:
        return len(self._whole)


def judge(templates: tuple[Template, ...], values: Values) -> list[InstanceJudgement]:
    """Return the judgements of all instances, in order; where a monitor is undecided at the end, finite traces decide."""
    judgements = [InstanceJudgement(template, Status.NA) for template in templates]
    for i, begin, end, states in _monitored(templates, values):
        template, part, steps = templates[i], values.within(begin, end), end - begin
        outputs = template.machine.output[states]
        last = int(outputs[-1])
        if last == Truth.FALSE:
            failed = int(np.argmax(outputs == last))
            since, goes = _since(template, part, failed + 1), template.shape.goes
            j = InstanceJudgement(
                template,
                Status.FAIL,
                since,
                failed,
                _broken(template, part, failed, int(states[failed - 1]) if failed else 0),
                _margin(template, part, since),
                goes is not None and bool(evaluate(goes, part, (steps,))[failed]),
            )
        else:
            premise = np.zeros(steps, dtype=np.bool_)
            for p in template.premises:
                premise |= settle(p, part, steps)
            if template.premises and not premise.any():
                j = InstanceJudgement(template, Status.NA)
            elif last == Truth.TRUE or settle(template.formula, part, steps)[0]:
                start = int(np.argmax(premise)) if template.premises else None
                j = InstanceJudgement(template, Status.PASS, start, margin=_margin(template, part, start))
            else:
                j = InstanceJudgement(template, Status.OPEN, _since(template, part, steps))
        judgements[i] = j
        if (begin, end) != (0, values.steps):  # count ticks from the start of the whole run
            begun, broken = (None if tick is None else begin + tick for tick in (j.trigger, j.failed))
            judgements[i] = replace(j, trigger=begun, failed=broken, ended=end - 1 if end < values.steps else None)
    return judgements


def unsure(judgement: InstanceJudgement, hinge: Hinge) -> InstanceJudgement:
    """Return a judgement with the status UNSURE, because measured values that are equally possible give another status."""
    return InstanceJudgement(judgement.template, Status.UNSURE, judgement.trigger, margin=hinge.apart, hinge=hinge)


def asked(template: Template, values: Values, agent: int) -> bool:
    """Return whether an instance was triggered, binds an agent (a column) to act, and the agent moved at some time."""
    members = [m for m in template.members if any(e.index == agent for e in m.bound)]
    applies = any(m.premise is None or settle(m.premise, values, values.run.steps).any() for m in members)
    return applies and drives(values.run, agent)


def walk(templates: tuple[Template, ...], values: Values) -> list[NDArray[np.int32]]:
    """Return the states of the monitor of every instance, ``(steps,)``; it reads states in which all its agents are present."""
    states_of_instances = [np.zeros(values.steps, dtype=np.int32) for _ in templates]
    for i, begin, end, states in _monitored(templates, values):
        states_of_instances[i][begin:end], states_of_instances[i][end:] = states, states[-1]
    return states_of_instances


def _monitored(templates: tuple[Template, ...], values: Values) -> Iterator[tuple[int, int, int, NDArray[np.int32]]]:
    """Yield the number, first tick, end tick and monitor states of every instance whose agents are present at the same time."""
    groups: dict[tuple[int, int, int], list[int]] = {}
    for i, t in enumerate(templates):
        groups.setdefault((id(t.machine), *window(values.run, columns(t))), []).append(i)
    for (_, begin, end), members in groups.items():
        if begin == end:
            continue
        machine = templates[members[0]].machine
        part = values.within(begin, end)
        propositions = [{f.Atom(f"p{k}"): part[atom] for k, atom in enumerate(templates[i].atoms)} for i in members]
        rows = [encode(machine, truths, part.steps) for truths in propositions]
        for i, states in zip(members, run_machine(machine, np.array(rows, dtype=np.int32)), strict=True):
            yield i, begin, end, states


def _since(template: Template, values: Values | Part, end: int) -> int:
    """Return the first tick in which an obligation of the instance begins that is not met before tick `end`."""
    if not isinstance(template.formula, f.Always):
        return 0
    cut = {a: values[a][:end] for a in template.atoms}
    shape = template.shape
    owed = ~settle(shape.obligation, cut, end)
    if shape.premise is not None:
        owed &= settle(shape.premise, cut, end)
    return int(np.argmax(owed)) if owed.any() else end - 1


def _broken(template: Template, values: Values | Part, failed: int, before: int) -> tuple[tuple[f.Atom, bool], ...]:
    """Return the atoms that broke an instance of a rule in the tick `failed`, with their truth values in this tick.

    An atom broke the instance if its opposite truth value would have kept the instance. If some of these atoms changed in the
    tick, only the changed atoms are returned. If no single atom could have kept the instance, all atoms that changed in the tick
    are returned. If no atom changed, all atoms are returned.
    """
    machine = template.machine
    now = {a: bool(values[a][failed]) for a in template.atoms}
    changed = [a for a in template.atoms if failed == 0 or bool(values[a][failed - 1]) != now[a]]
    saving = []
    for atom in template.atoms:
        otherwise = {**now, atom: not now[atom]}
        true = frozenset(f.Atom(f"p{k}") for k, a in enumerate(template.atoms) if otherwise[a])
        letter = machine.letter(sum(1 << k for k, guard in enumerate(machine.guards) if holds(guard, true)))
        # A negative letter stands for truth values that exclude each other, which no state of a run has.
        if letter >= 0 and machine.output[machine.delta[before, letter]] != Truth.FALSE:
            saving.append(atom)
    chosen = [a for a in saving if a in changed] or saving or changed or list(template.atoms)
    return tuple((a, now[a]) for a in chosen)


def _margin(template: Template, values: Values | Part, start: int | None) -> float | None:
    """Return the margin of an instance, see `InstanceVerdict.margin` [s]."""
    steps, dt, shape = values.steps, values.run.dt, template.shape
    if shape.form is Form.STATE and isinstance(template.formula, f.Always):
        bad = ~evaluate(template.formula.body, values, (steps,))
        return round(float(bad.sum()) * dt, 9)
    if start is None or shape.waits is None or shape.goes is None:
        return None
    departures = np.flatnonzero(~evaluate(shape.waits, values, (steps,))[start:])
    entries = np.flatnonzero(evaluate(shape.goes, values, (steps,))[start:])
    return round(float(entries[0] - departures[0]) * dt, 9) if len(departures) and len(entries) else None


def nearest_miss(templates: tuple[Template, ...], values: Values) -> Nearest | None:
    """Return the instance and the first tick with the fewest false conjuncts of the rule's premise, over all instances."""
    best: tuple[int, int, int] | None = None
    nearest = None
    for i, t in enumerate(templates):
        begin, end = window(values.run, columns(t))
        for premise in t.premises if begin < end else ():
            parts = conjuncts(premise)
            part = values.within(begin, end)
            truths = np.array([settle(p, part, part.steps) for p in parts])
            missing = (~truths).sum(axis=0)
            tick = int(np.argmin(missing))
            key = (int(missing[tick]), begin + tick, i)
            if best is None or key < best:
                best = key
                false = tuple(p for p, v in zip(parts, truths[:, tick], strict=True) if not v)
                nearest = Nearest(t, begin + tick, false, int((missing == missing[tick]).sum()))
    return nearest
