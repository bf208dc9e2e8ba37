"""Contradicting obligations: cycles of waiting, such as four vehicles of which each waits for the vehicle on its right."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.presence import window
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import Judgement, columns
from pytest_rvads.logic.judging.prepare import Template
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.boolean import evaluate
from pytest_rvads.logic.ltl.finite import settle
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.shape import Kind, agents_of
from pytest_rvads.runs.run import Run

__all__ = ["Cycle", "find_cycle", "unavoidable"]


@dataclass(frozen=True, slots=True)
class Cycle:
    """Vehicles in a circle of waiting: each had to wait for the next, and the last for the first."""

    tick: int
    """First tick of the cycle."""
    agents: tuple[str, ...]
    alone: bool = True
    """True if the obligations of the judged rule suffice, False if the cycle needs obligations of its companions."""


def find_cycle(templates: Iterable[Template], values: Values) -> Cycle | None:
    """Find the earliest cycle of vehicles that all wait for each other, among instances of the form YIELD.

    In a cycle every vehicle must stay until another vehicle of the cycle has entered, so no continuation satisfies all
    obligations.
    """
    owed = list(_owed(templates, values))
    begun = sorted({int(tick) for _, _, held in owed for tick in np.flatnonzero(np.diff(held, prepend=False) & held)})
    for tick in begun:
        waits = _waits(owed, tick)
        for first in sorted(waits):
            circle = _around(first, first, waits, ())
            if circle:
                return Cycle(tick, circle)
    return None


def unavoidable(judgements: Iterable[Judgement], templates: Iterable[Template], values: Values) -> bool:
    """Return whether no vehicle could have kept a violated rule: every violation broke a cycle, or happened in a tight bend.

    One vehicle of a cycle has to break the rule, or all vehicles of the cycle wait for ever. A violation outside a cycle, or
    violations by several vehicles in the same tick, could have been avoided. A vehicle can't keep its lane in a bend in which no
    path of the rear axle keeps the vehicle in its lane.

    Args:
        judgements: the judgements of the instances of the rule.
        templates: the instances of the rule and of its companions, whose obligations count as well.
        values: the truth values of the run.
    """
    owed = list(_owed(templates, values))
    broken = [j for j in judgements if j.status is Status.FAIL]
    breakers: dict[int, set[str]] = {}
    for j in broken:
        if j.broken and all(value and _beyond(atom, values.run) for atom, value in j.broken):
            continue
        ends = _ends(j.template)
        if ends is None or not j.failed:
            return False
        waiting, awaited = ends
        waits = _waits(owed, j.failed - 1)
        if awaited not in waits.get(waiting, ()) or not _around(awaited, waiting, waits, ()):
            return False
        breakers.setdefault(j.failed, set()).add(waiting)
    return bool(broken) and all(len(agents) == 1 for agents in breakers.values())


def _beyond(atom: f.Atom, run: Run) -> bool:
    """Return whether no driver could have kept an atom about one vehicle false."""
    word, agents = word_of(atom), agents_of(atom)
    return word is not None and word.beyond is not None and len(agents) == 1 and word.beyond(run, agents[0].index)


_Owed = tuple[str, str, NDArray[np.bool_]]
"""The waiting vehicle, the vehicle that it waits for, and the states of waiting, shape ``(steps,)``."""


def _owed(templates: Iterable[Template], values: Values) -> Iterator[_Owed]:
    steps = values.run.steps
    tick = np.arange(steps)
    for t in templates:
        shape, ends = t.shape, _ends(t)
        if ends is None or shape.premise is None or shape.waits is None or shape.goes is None:
            continue
        begin, end = window(values.run, columns(t))
        part = values.within(begin, end)
        due = np.zeros(steps, dtype=np.bool_)
        if begin < end:
            due[begin:end] = settle(shape.premise, part, part.steps)
        if due.any():
            over = evaluate(shape.goes, values, (steps,)) | ~evaluate(shape.waits, values, (steps,))
            last_due = np.maximum.accumulate(np.where(due, tick, -1))
            last_over = np.maximum.accumulate(np.where(over, tick, -1))
            held = last_due > last_over
            held[end:] = False  # no vehicle waits for an absent vehicle
            yield *ends, held


def _ends(template: Template) -> tuple[str, str] | None:
    """Return the waiting and the awaited vehicle of an instance of the form YIELD with one vehicle on either side, else None."""
    shape = template.shape
    if shape.kind is not Kind.YIELD or shape.waits is None or shape.goes is None:
        return None
    waiting, awaited = agents_of(shape.waits), agents_of(shape.goes)
    return (waiting[0].name, awaited[0].name) if len(waiting) == len(awaited) == 1 else None


def _waits(owed: Iterable[_Owed], tick: int) -> dict[str, list[str]]:
    """Return, for every waiting vehicle, the vehicles that it waits for in a state."""
    awaited_by_vehicle: dict[str, list[str]] = {}
    for waiting, awaited, held in owed:
        if held[tick]:
            awaited_by_vehicle.setdefault(waiting, []).append(awaited)
    return awaited_by_vehicle


def _around(vehicle: str, goal: str, waits: Mapping[str, list[str]], path: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the chain of waiting vehicles from `vehicle` to `goal`, or None if no chain exists."""
    path = (*path, vehicle)
    for target in sorted(waits.get(vehicle, ())):
        if target == goal:
            return path
        if target not in path and (chain := _around(target, goal, waits, path)):
            return chain
    return None
