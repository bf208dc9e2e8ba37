"""Finds the vehicles responsible for a violated or open instance of a rule, and obligations that can't be kept together.

Obligations contradict each other in cycles of waiting, such as four vehicles of which each must wait for the vehicle on its
right.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.logic.conduct.blame import Cause, pushed, stuck, surprised
from pytest_rvads.logic.conduct.blocks import window
from pytest_rvads.logic.conduct.lane import beyond_steering
from pytest_rvads.logic.conduct.rights import WAIVER, may_owe, waives
from pytest_rvads.logic.conduct.static_model import colourings, on_each_way
from pytest_rvads.logic.conduct.waiting import may_go
from pytest_rvads.logic.judging.instances import Template, columns
from pytest_rvads.logic.judging.judge import Values
from pytest_rvads.logic.judging.judgement import Judgement
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import evaluate, settle
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Kind, agents_of
from pytest_rvads.logic.rules.vocabulary import TightBend
from pytest_rvads.runs.run import Run, once
from pytest_rvads.support.errors import RunError


def responsible(j: Judgement, run: Run) -> tuple[f.Element, ...]:
    """Return the vehicles that broke a violated instance of a rule, or that still have to wait in an open instance."""
    if j.status is Status.FAIL:
        named = tuple(dict.fromkeys(e for a, _ in j.broken for e in agents_of(a))) or agents_of(j.template.formula)
        cause = cause_between(j, run)
        if cause is not None:
            return tuple(e for e in named if e.name in cause.agents)
        bound = {e for member in j.template.members for e in member.bound}
        return tuple(e for e in named if e in bound) or named
    if j.status is Status.OPEN:
        return _waiting(j)
    return ()


def is_about(j: Judgement, run: Run, subject: str) -> bool:
    """Return whether `subject` is to blame for a violated or open instance of a rule.

    The subject is not to blame for meeting a vehicle that had to wait and left the subject no time to react, for a violation
    right after another vehicle pushed the subject, or for going before a vehicle that waived its right. If an obligation to wait
    is open at the end of the run, the awaited vehicle is to blame if it could have gone for `WAIVER`, and the waiting vehicle is
    not. If an open obligation awaits no vehicle, the vehicles in the obligation are to blame, unless another vehicle is stuck.
    """
    me = next(column for column, agent in enumerate(run.agents) if agent.name == subject)
    if j.failed is not None:
        meets = j.template.shape.kind is Kind.STATE and cause_between(j, run) is None
        opponents = [e.index for e in agents_of(j.template.formula) if e.index != me] if meets else []
        excused = (len(opponents) == 1 and surprised(run, me, opponents[0], j.failed)) or pushed(run, me, j.failed)
        return not (excused or _forfeited(j, run)) and any(e.index == me for e in responsible(j, run))
    if j.status is not Status.OPEN:
        return False
    if awaited := _awaited(j):
        owed = (run.steps - 1 if j.ended is None else j.ended) - (j.trigger or 0)
        if me not in awaited or owed * run.dt < WAIVER:
            return False
        try:
            return bool(may_go(run, me)[-1])
        except RunError:  # the run does not record enough to decide
            return True
    return any(e.index == me for e in _waiting(j)) and not any(stuck(run, k) for k in range(len(run.agents)) if k != me)


def by_walkers(j: Judgement, run: Run) -> bool:
    """Return whether pedestrians alone are to blame for a violated instance of a rule."""
    guilty = responsible(j, run)
    return bool(guilty) and all(isinstance(run.agents[e.index].way, Crossing) for e in guilty)


def _forfeited(j: Judgement, run: Run) -> bool:
    """Return whether every awaited vehicle waived its right after the obligation began, or had to wait for one that did."""
    awaited, waiting = _awaited(j), {e.index for e in _waiting(j)}
    not_waiting = [k for k in range(len(run.agents)) if k not in waiting]
    if not awaited or not j.failed:
        return False
    try:
        waiving = {k for k in not_waiting if waives(run)[j.trigger : j.failed, k].any()}
        return all(k in waiving or any(may_owe(run, k, waiver) for waiver in waiving) for k in awaited)
    except RunError:
        return False


def waits(j: Judgement, subject: str) -> bool:
    """Return whether an instance of a rule makes `subject` wait for another vehicle at the end of the run."""
    return j.status is Status.OPEN and any(e.name == subject for e in _waiting(j)) and bool(_awaited(j))


def cause_between(j: Judgement, run: Run) -> Cause | None:
    """Return the vehicles to blame for the collision or meeting that broke an instance, and the reason.

    If the blame depends on the colour of a light that is not recorded, or on a way that is not decided, the result names every
    vehicle that can be to blame. The result is None if the instance was not broken by a collision or meeting of two vehicles.
    """
    for atom, _ in j.broken:
        word, agents = word_of(atom), [e.index for e in agents_of(atom)]
        if word is not None and word.cause is not None and j.failed is not None and len(agents) == 2:
            possible_runs = chain((run,), once(run, colourings), on_each_way(run))
            first, *others = (word.cause(possible, agents[0], agents[1], j.failed) for possible in possible_runs)
            if all(other is None or first is None or {*other.agents} == {*first.agents} for other in others):
                return first
            guilty = dict.fromkeys(name for cause in (first, *others) if cause is not None for name in cause.agents)
            ways = any(agent.other_exits for agent in run.agents)
            doubt = "the way of a vehicle is not decided" if ways else "a colour of a light was not recorded"
            return Cause(tuple(guilty), f"are to blame, or one of them is: {doubt}")
    return None


def _waiting(j: Judgement) -> tuple[f.Element, ...]:
    waits = j.template.shape.waits
    return agents_of(waits if waits is not None else j.template.shape.obligation)


def _awaited(j: Judgement) -> list[int]:
    """Return the columns of the vehicles that have to go first according to an instance of a rule."""
    goes, waiting = j.template.shape.goes, _waiting(j)
    return [e.index for e in agents_of(goes) if e not in waiting] if goes is not None else []


@dataclass(frozen=True, slots=True)
class Cycle:
    """Vehicles in a circle of waiting: each vehicle had to wait for the next vehicle, and the last vehicle for the first."""

    tick: int
    """First tick of the cycle."""
    agents: tuple[str, ...]
    alone: bool = True
    """Whether the obligations of the judged rule alone make the cycle; if False, obligations of its companions take part."""


def find_cycle(templates: Iterable[Template], values: Values) -> Cycle | None:
    """Return the earliest cycle of vehicles that must wait for each other; None if there is no cycle.

    In a cycle every vehicle must stay until another vehicle of the cycle has entered. Therefore no continuation of the run
    satisfies all obligations.
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

    In a cycle every vehicle must wait for the next vehicle: a vehicle has to break the rule, or all vehicles wait for ever. A
    violation outside a cycle, or violations by several vehicles in the same tick, could have been avoided. A bend is too tight if
    no path of the rear axle keeps the vehicle in its lane.
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
    """Return whether no driver could have kept an atom about one vehicle false, such as leaving the lane in a tight bend."""
    word, agents = word_of(atom), agents_of(atom)
    excuses = word is not None and word.bend is TightBend.EXCUSES
    return excuses and len(agents) == 1 and beyond_steering(run, agents[0].index)


_Owed = tuple[str, str, NDArray[np.bool_]]
"""The name of a vehicle, the name of the vehicle that it must wait for, and whether it must wait, shape ``(steps,)``."""


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
    """Return the names of the waiting and the awaited vehicle of an instance that makes one wait until the other has gone."""
    shape = template.shape
    if shape.kind is not Kind.YIELD or shape.waits is None or shape.goes is None:
        return None
    waiting, awaited = agents_of(shape.waits), agents_of(shape.goes)
    return (waiting[0].name, awaited[0].name) if len(waiting) == len(awaited) == 1 else None


def _waits(owed: Iterable[_Owed], tick: int) -> dict[str, list[str]]:
    awaited_by_vehicle: dict[str, list[str]] = {}
    for waiting, awaited, held in owed:
        if held[tick]:
            awaited_by_vehicle.setdefault(waiting, []).append(awaited)
    return awaited_by_vehicle


def _around(vehicle: str, goal: str, waits: Mapping[str, list[str]], path: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the chain of vehicles, each waiting for the next, from `vehicle` to `goal`; None if no chain exists."""
    path = (*path, vehicle)
    for target in sorted(waits.get(vehicle, ())):
        if target == goal:
            return path
        if target not in path and (chain := _around(target, goal, waits, path)):
            return chain
    return None
