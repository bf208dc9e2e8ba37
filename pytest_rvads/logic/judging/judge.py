"""Judges the instances of a rule on a run: status, broken atoms, first tick of the obligation, and margin of every instance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.presence import window
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.judging.evaluate import Part, Values
from pytest_rvads.logic.judging.judgement import Hinge, Judgement, Near, Template, columns
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate, holds
from pytest_rvads.logic.ltl.finite import settle
from pytest_rvads.logic.ltl.ltl3 import Truth, encode, run_machine
from pytest_rvads.logic.rules.parts import Kind, conjuncts


def judge(templates: tuple[Template, ...], values: Values) -> list[Judgement]:
    """Return the judgements of all instances, in order; where a monitor is undecided at the end, finite traces decide."""
    judgements = [Judgement(template, Status.NA) for template in templates]
    for i, begin, end, states in _walked(templates, values):
        template, part, steps = templates[i], values.within(begin, end), end - begin
        outputs = template.machine.output[states]
        last = int(outputs[-1])
        if last == Truth.FALSE:
            failed = int(np.argmax(outputs == last))
            since, goes = _since(template, part, failed + 1), template.shape.goes
            j = Judgement(
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
                j = Judgement(template, Status.NA)
            elif last == Truth.TRUE or settle(template.formula, part, steps)[0]:
                start = int(np.argmax(premise)) if template.premises else None
                j = Judgement(template, Status.PASS, start, margin=_margin(template, part, start))
            else:
                j = Judgement(template, Status.OPEN, _since(template, part, steps))
        judgements[i] = j
        if (begin, end) != (0, values.steps):  # count ticks from the start of the whole run
            begun, broken = (None if tick is None else begin + tick for tick in (j.trigger, j.failed))
            judgements[i] = replace(j, trigger=begun, failed=broken, ended=end - 1 if end < values.steps else None)
    return judgements


def unsure(judgement: Judgement, hinge: Hinge) -> Judgement:
    """Return a judgement with the status UNSURE, because measured values that are equally possible give another status."""
    return Judgement(judgement.template, Status.UNSURE, judgement.trigger, margin=hinge.apart, hinge=hinge)


def asked(template: Template, values: Values, agent: int) -> bool:
    """Return whether an instance was triggered, binds an agent (a column) to act, and the agent moved at some time."""
    members = [m for m in template.members if any(e.index == agent for e in m.bound)]
    applies = any(m.premise is None or settle(m.premise, values, values.run.steps).any() for m in members)
    return applies and drives(values.run, agent)


def walk(templates: tuple[Template, ...], values: Values) -> list[NDArray[np.int32]]:
    """Return the states of the monitor of every instance, ``(steps,)``; it reads states in which all its agents are present."""
    states_of_instances = [np.zeros(values.steps, dtype=np.int32) for _ in templates]
    for i, begin, end, states in _walked(templates, values):
        states_of_instances[i][begin:end], states_of_instances[i][end:] = states, states[-1]
    return states_of_instances


def _walked(templates: tuple[Template, ...], values: Values) -> Iterator[tuple[int, int, int, NDArray[np.int32]]]:
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
    if shape.kind is Kind.STATE and isinstance(template.formula, f.Always):
        bad = ~evaluate(template.formula.body, values, (steps,))
        return round(float(bad.sum()) * dt, 9)
    if start is None or shape.waits is None or shape.goes is None:
        return None
    departures = np.flatnonzero(~evaluate(shape.waits, values, (steps,))[start:])
    entries = np.flatnonzero(evaluate(shape.goes, values, (steps,))[start:])
    return round(float(entries[0] - departures[0]) * dt, 9) if len(departures) and len(entries) else None


def nearest_miss(templates: tuple[Template, ...], values: Values) -> Near | None:
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
                nearest = (t, begin + tick, false, int((missing == missing[tick]).sum()))
    return nearest
