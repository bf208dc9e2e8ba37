"""Judging one instance of a rule on a run: its status, the broken atoms, the tick of its obligation, and its margin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.presence import window
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.judging.evaluate import Part, Values
from pytest_rvads.logic.judging.prepare import Template
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate, holds
from pytest_rvads.logic.ltl.finite import settle
from pytest_rvads.logic.ltl.ltl3 import Machine, Truth
from pytest_rvads.logic.ltl.monitor import encode, run_machine
from pytest_rvads.logic.rules.shape import Kind, conjuncts
from pytest_rvads.logic.rules.sorts import Sort

__all__ = ["Happening", "Hinge", "Judgement", "Near", "asked", "judge", "nearest_miss", "unsure", "walk"]

Near = tuple[Template, int, tuple[f.Formula, ...], int]
"""Where a rule came closest to being triggered: instance, tick, false conjuncts of the premise, number of equally close ticks."""


@dataclass(frozen=True, slots=True)
class Happening:
    """An event on which a verdict depends."""

    agent: int | None
    """Column of the vehicle; None for a light."""
    light: int | None
    """Entrance of the light; None for a vehicle."""
    code: int
    """The zone that the vehicle came to, or the colour that the light turned to."""
    time: float | None
    """Time since the first state of the run [s]; None if the recording of the vehicle ends before the event."""


@dataclass(frozen=True, slots=True)
class Hinge:
    """The doubt on which an UNSURE instance depends: the order of events, or the accuracy of a measurement."""

    what: tuple[Happening, ...] = ()
    """The two events, the earlier event first; or a single event that may not have happened."""
    known: float = 0.0
    """Accuracy of the time between the events [s]; infinite if an event may have happened at any time."""
    tie: float = 0.0
    """Longest time between two events that count as simultaneous [s]."""
    reading: str = ""
    """The measurement that would have to be different, in words; empty if the order of events decides."""

    @property
    def apart(self) -> float | None:
        """Time between the two events [s]."""
        times = [happening.time for happening in self.what if happening.time is not None]
        return round(times[1] - times[0], 9) if len(times) == 2 else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """The judgement of an instance on a run; ticks count from 0."""

    template: Template
    status: Status
    trigger: int | None = None
    """First tick of the violated or open obligation; of a kept instance, first tick of its first obligation."""
    failed: int | None = None
    broken: tuple[tuple[f.Atom, bool], ...] = ()
    """Atoms with their values in the failing tick; the opposite value of any of these atoms would have kept the rule."""
    margin: float | None = None
    together: bool = False
    """True if the awaited event came in the failing tick itself, one step too late."""
    ended: int | None = None
    """Last tick in which all agents of the instance were recorded, if an agent vanishes before the run ends."""
    hinge: Hinge | None = None
    """The doubt on which an UNSURE instance depends."""


def judge(templates: tuple[Template, ...], values: Values) -> list[Judgement]:
    """Judge all instances of a rule: by monitors, and by finite-trace semantics if the monitor stays undecided."""
    judgements = [Judgement(template, Status.NA) for template in templates]
    for i, begin, end, states in _walked(templates, values):
        outputs = templates[i].machine.output[states]
        last = int(outputs[-1])
        failed = int(np.argmax(outputs == last)) if last == Truth.FALSE else None
        before = int(states[failed - 1]) if failed else 0
        judged = _judge(templates[i], values.within(begin, end), failed, before, last == Truth.TRUE)
        judgements[i] = _placed(judged, begin, end, values.steps)
    return judgements


def columns(template: Template) -> tuple[int, ...]:
    """Return the columns of the agents that an instance is about."""
    return tuple(element.index for _, element in template.binding if element.sort == Sort.AGENT)


def _placed(j: Judgement, begin: int, end: int, steps: int) -> Judgement:
    """Return a judgement of a part of the run between two ticks, with ticks of the whole run."""
    if (begin, end) == (0, steps):
        return j
    trigger, failed = (None if tick is None else begin + tick for tick in (j.trigger, j.failed))
    return replace(j, trigger=trigger, failed=failed, ended=end - 1 if end < steps else None)


def unsure(judgement: Judgement, hinge: Hinge) -> Judgement:
    """Return the UNSURE judgement of an instance whose status is different in another reading of the run."""
    return Judgement(judgement.template, Status.UNSURE, judgement.trigger, margin=hinge.apart, hinge=hinge)


def asked(template: Template, values: Values, agent: int) -> bool:
    """Return whether an instance bound an agent, given by column, to act; an agent that never moves has not acted."""
    members = [m for m in template.members if any(e.index == agent for e in m.bound)]
    applies = any(m.premise is None or settle(m.premise, values, values.run.steps).any() for m in members)
    return applies and drives(values.run, agent)


def walk(templates: tuple[Template, ...], values: Values) -> list[NDArray[np.int32]]:
    """Return the states of the monitor of every instance, each of shape ``(steps,)``.

    The monitor reads the states of the run in which all agents of the instance are present. Before these states the monitor is in
    its initial state, and afterwards it keeps its last state.
    """
    states_of_instances = [np.zeros(values.steps, dtype=np.int32) for _ in templates]
    for i, begin, end, states in _walked(templates, values):
        states_of_instances[i][begin:end], states_of_instances[i][end:] = states, states[-1]
    return states_of_instances


def _walked(templates: tuple[Template, ...], values: Values) -> Iterator[tuple[int, int, int, NDArray[np.int32]]]:
    """Yield the number, first tick, end tick and monitor states of every instance whose agents are ever together."""
    groups: dict[tuple[int, int, int], list[int]] = {}
    for i, t in enumerate(templates):
        groups.setdefault((id(t.machine), *window(values.run, columns(t))), []).append(i)
    for (_, begin, end), members in groups.items():
        if begin == end:
            continue
        machine = templates[members[0]].machine
        part = values.within(begin, end)
        rows = [encode(machine, _propositions(templates[i], part), part.steps) for i in members]
        for i, states in zip(members, run_machine(machine, np.array(rows, dtype=np.int32)), strict=True):
            yield i, begin, end, states


def _propositions(template: Template, values: Values | Part) -> dict[f.Atom, NDArray[np.bool_]]:
    return {f.Atom(f"p{k}"): values[atom] for k, atom in enumerate(template.atoms)}


def _judge(template: Template, values: Values | Part, failed: int | None, before: int, satisfied: bool) -> Judgement:
    steps = values.steps
    if failed is not None:
        since = _since(template, values, failed + 1)
        goes = template.shape.goes
        return Judgement(
            template,
            Status.FAIL,
            since,
            failed,
            _broken(template, values, failed, before),
            _margin(template, values, since),
            goes is not None and bool(evaluate(goes, values, (steps,))[failed]),
        )
    premise = np.zeros(steps, dtype=np.bool_)
    for p in template.premises:
        premise |= settle(p, values, steps)
    if template.premises and not premise.any():
        return Judgement(template, Status.NA)
    if satisfied or settle(template.formula, values, steps)[0]:
        start = int(np.argmax(premise)) if template.premises else None
        return Judgement(template, Status.PASS, start, margin=_margin(template, values, start))
    return Judgement(template, Status.OPEN, _since(template, values, steps))


def _since(template: Template, values: Values | Part, end: int) -> int:
    """Return the first tick whose obligation is not met before tick `end`."""
    if not isinstance(template.formula, f.Always):
        return 0
    cut = {a: values[a][:end] for a in template.atoms}
    shape = template.shape
    owed = ~settle(shape.obligation, cut, end)
    if shape.premise is not None:
        owed &= settle(shape.premise, cut, end)
    return int(np.argmax(owed)) if owed.any() else end - 1


def _broken(template: Template, values: Values | Part, failed: int, before: int) -> tuple[tuple[f.Atom, bool], ...]:
    """Return the atoms whose opposite value in the failing tick would have kept the instance.

    If some of these atoms changed in the failing tick, only the changed atoms are returned. If no single atom could have kept the
    instance, all changed atoms are returned; if no atom changed, all atoms.
    """
    machine = template.machine
    now = {a: bool(values[a][failed]) for a in template.atoms}
    changed = [a for a in template.atoms if failed == 0 or bool(values[a][failed - 1]) != now[a]]
    saving = [a for a in template.atoms if _after(machine, template, before, {**now, a: not now[a]}) is not Truth.FALSE]
    chosen = [a for a in saving if a in changed] or saving or changed or list(template.atoms)
    return tuple((a, now[a]) for a in chosen)


def _after(machine: Machine, template: Template, state: int, now: dict[f.Atom, bool]) -> Truth:
    true = frozenset(f.Atom(f"p{k}") for k, a in enumerate(template.atoms) if now[a])
    letter = machine.letter(sum(1 << k for k, guard in enumerate(machine.guards) if holds(guard, true)))
    # A letter that the guards exclude can't be read, so the letter keeps nothing.
    return Truth(int(machine.output[machine.delta[state, letter]])) if letter >= 0 else Truth.FALSE


def _margin(template: Template, values: Values | Part, start: int | None) -> float | None:
    """Return how long before its permission the bound vehicle acted, or how long two vehicles were together [s]."""
    steps, dt, shape = values.steps, values.run.dt, template.shape
    if shape.kind is Kind.STATE and isinstance(template.formula, f.Always):
        bad = ~evaluate(template.formula.body, values, (steps,))
        return round(float(bad.sum()) * dt, 9)
    if start is None or shape.waits is None or shape.goes is None:
        return None
    departures = np.flatnonzero(~evaluate(shape.waits, values, (steps,))[start:])
    entries = np.flatnonzero(evaluate(shape.goes, values, (steps,))[start:])
    return round(float(entries[0] - departures[0]) * dt, 9) if len(departures) and len(entries) else None


def nearest_miss(templates: tuple[Template, ...], values: Values) -> Near | None:
    """Return where a rule came closest to being triggered.

    The tick is the first tick with the fewest false conjuncts of the premise, over all instances.
    """
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
                nearest = (t, begin + tick, false, int((missing == missing[tick]).sum()))
    return nearest
