"""Finds what follows from the judgements of the instances of a rule: who is to blame, the status of the rule, circles of waiting.

In the order of `check`: `blamed`, `attribute`, `gravest_first`, `kept`, `scene_of` (what an explanation shows), `cycle_of`.

Which vehicle must act follows from the form of the rule's formula, or from the argument ``bound=`` of the rule. On a run with a
subject (a vehicle under test), a rule passes only if a triggered instance required an action of the subject. A violation is
PROVOKED if only other vehicles are to blame. A violation is UNAVOIDABLE if vehicles waited for each other in a circle, such as
four vehicles of which each must wait for the vehicle on its right, or if a search finds no path that keeps the body of the
vehicle in its lane in a bend.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.logic.conduct.blame import Cause, cut_short_by, pushed, stuck, surprised
from pytest_rvads.logic.conduct.blocks import window
from pytest_rvads.logic.conduct.lane import beyond_steering, too_tight
from pytest_rvads.logic.conduct.rights import WAIVER, ground_of, may_owe, waives
from pytest_rvads.logic.conduct.rights import held as held_up
from pytest_rvads.logic.conduct.standing import drives, wt
from pytest_rvads.logic.conduct.static_model import colourings, extract, last_seen, on_each_way
from pytest_rvads.logic.conduct.waiting import may_go
from pytest_rvads.logic.judging.instances import Template, columns, prepare
from pytest_rvads.logic.judging.judge import Values, asked, judge
from pytest_rvads.logic.judging.judgement import Bend, Blame, Course, Cycle, Debt, InstanceJudgement, Scene
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import evaluate, settle
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.rule import Form, Rule, agents_of
from pytest_rvads.logic.rules.vocabulary import TightBend
from pytest_rvads.runs.run import Run, once
from pytest_rvads.runs.states import Zone
from pytest_rvads.support.errors import RunError

BROKEN = (Status.FAIL, Status.OPEN)
_ORDER = (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS, Status.NA)
"""The statuses of instances, the worst first."""


@dataclass(frozen=True, slots=True)
class Attribution:
    """The status of a rule on a run, and whether the subject (the vehicle under test) or the traffic caused the status."""

    status: Status
    asked: bool = True
    """See `Verdict.asked`."""
    unavoidable: bool = False
    """Whether the rule was violated and no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation; without a subject, whether pedestrians did."""


def attribute(judgements: Sequence[InstanceJudgement], rule: Rule, values: Values, book: RuleBook) -> Attribution:
    """Return the status of a rule on a run, given the judgements of its instances with the agents to blame, see `blamed`.

    A violation that pedestrians alone are to blame for is provoked, because pedestrians are never under test. On a run with a
    subject (vehicle under test), violated or open instances that the subject is to blame for decide before all other instances.
    A run in which no vehicle moves does not pass, and a subject that never moves does not pass. If an instance that binds the
    subject is UNSURE, the status is neither unavoidable nor provoked.
    """
    run, status = values.run, overall(judgements)

    def hopeless(violations: Sequence[InstanceJudgement]) -> bool:
        templates = [*(j.template for j in judgements), *_companions(rule, run, book)]
        return unavoidable(violations, templates, values)

    if run.subject is None:
        excused = status is Status.FAIL and hopeless(judgements)
        if excused and any(j.status is Status.UNSURE for j in judgements):
            return Attribution(Status.UNSURE)
        vehicles = (column for column, agent in enumerate(run.agents) if not isinstance(agent.way, Crossing))
        acted = status is not Status.NA and any(drives(run, column) for column in vehicles)
        on_foot = status is Status.FAIL and not excused and all(j.blame.on_foot for j in judgements if j.status is status)
        return Attribution(Status.NA if status is Status.PASS and not acted else status, acted, excused, on_foot)
    me = column_of(run, run.subject)
    bound = any(j.status is not Status.NA and asked(j.template, values, me) for j in judgements)
    unsure_members = (member for j in judgements if j.status is Status.UNSURE for member in j.template.members)
    open_to_doubt = any(element.index == me for member in unsure_members for element in member.bound)
    if status not in BROKEN:
        return Attribution(Status.UNSURE if open_to_doubt else Status.PASS if bound else Status.NA, bound or open_to_doubt)
    attributed = [j for j in judgements if j.blame.subject]
    failed = [j for j in attributed if j.status is Status.FAIL]
    if failed and not hopeless(failed):
        return Attribution(Status.FAIL)
    if len(attributed) > len(failed) and not _excused(judgements, rule, values, book):
        return Attribution(Status.OPEN)
    if open_to_doubt:
        return Attribution(Status.UNSURE)
    if status is Status.FAIL and hopeless(judgements):
        return Attribution(status, bound, unavoidable=True)
    return Attribution(status, bound, provoked=True)


def overall(judgements: Iterable[InstanceJudgement]) -> Status:
    """Return the status of the worst instance."""
    statuses = {j.status for j in judgements}
    return next((s for s in _ORDER if s in statuses), Status.NA)


def gravest_first(judgements: Iterable[InstanceJudgement], run: Run) -> tuple[InstanceJudgement, ...]:
    """Return the judgements, sorted by severity and time; those that the subject is to blame for come before all others."""

    def key(j: InstanceJudgement) -> tuple[bool, int, int]:
        tick = j.failed if j.failed is not None else j.trigger
        elsewhere = not j.blame.subject if run.subject is not None else j.status is Status.FAIL and j.blame.on_foot
        return elsewhere, _ORDER.index(j.status), run.steps if tick is None else tick

    return tuple(sorted(judgements, key=key))


def column_of(run: Run, name: str) -> int:
    """Return the column of an agent, given by its name, in the arrays of a run."""
    return next(column for column, agent in enumerate(run.agents) if agent.name == name)


def _companions(rule: Rule, run: Run, book: RuleBook) -> tuple[Template, ...]:
    """Return the instances of the companions of `rule`, the rules whose obligations can contradict the obligations of `rule`."""
    static = once(run, extract)
    rules = (book[name] for name in rule.companions)
    return tuple(t for companion in rules for t in prepare(companion.formula, static, companion.bound).templates)


def _excused(judgements: Sequence[InstanceJudgement], rule: Rule, values: Values, book: RuleBook) -> bool:
    """Return whether the subject is excused for an open obligation: the subject has to wait, or other vehicles ended the run.

    The subject has to wait because of the rule, its companions, or the rules of the rulebooks that contain the rule.
    """
    run, subject = values.run, values.run.subject or ""
    if set(cut_short_by(run)) - {subject} or any(_waits_at_end(j, subject) for j in judgements):
        return True
    with suppress(RunError):
        if any(held_up(run)[-1, column] for column, agent in enumerate(run.agents) if agent.name == subject):
            return True
    static = once(run, extract)
    shelf = (rules_for(name, run.junction) for name in ("paper", "road"))
    rules = {*(book[name] for name in rule.companions), *(r for rules in shelf if rule in rules for r in rules)}
    judged = (judge(prepare(r.formula, static, r.bound).templates, Values(run, r.tie)) for r in rules)
    return any(_waits_at_end(j, subject) for judgements in judged for j in judgements)


def _waits_at_end(j: InstanceJudgement, subject: str) -> bool:
    """Return whether an instance of a rule makes `subject` wait for another vehicle at the end of the run."""
    return j.status is Status.OPEN and any(e.name == subject for e in _waiting(j)) and bool(_awaited(j))


def blamed(judgements: Iterable[InstanceJudgement], run: Run) -> list[InstanceJudgement]:
    """Return the judgements with the agents to blame for violated and open instances."""
    return [replace(j, blame=blame(j, run)) if j.status in BROKEN else j for j in judgements]


def blame(j: InstanceJudgement, run: Run) -> Blame:
    """Return the agents to blame for an instance; nobody for an instance that is neither violated nor open."""
    if j.status is Status.OPEN:
        cause, agents = None, _waiting(j)
    elif j.status is Status.FAIL:
        cause = _cause(j, run)
        agents = tuple(dict.fromkeys(e for a, _ in j.broken for e in agents_of(a))) or agents_of(j.template.formula)
        if cause is not None:
            agents = tuple(e for e in agents if e.name in cause.agents)
        else:
            bound = {e for member in j.template.members for e in member.bound}
            agents = tuple(e for e in agents if e in bound) or agents
    else:
        return Blame()
    on_foot = bool(agents) and all(isinstance(run.agents[e.index].way, Crossing) for e in agents)
    subject = run.subject is not None and _subject_to_blame(column_of(run, run.subject), j, agents, cause, run)
    return Blame(agents, cause, on_foot, subject)


def _subject_to_blame(me: int, j: InstanceJudgement, agents: tuple[f.Element, ...], cause: Cause | None, run: Run) -> bool:
    """Return whether the subject (column `me`) is to blame for an instance that `agents` violated or left open.

    The subject is not to blame for meeting a vehicle that had to wait and left the subject no time to react, for a violation
    right after another vehicle pushed the subject, or for going before a vehicle that waived its right. If an obligation to wait
    is open at the end of the run, the awaited vehicle is to blame if it could have gone for `WAIVER`, and the waiting vehicle is
    not. If an open obligation awaits no vehicle, the vehicles in the obligation are to blame, unless another vehicle is stuck.
    """
    if j.failed is not None:
        meets = j.template.shape.form is Form.STATE and cause is None
        opponents = [e.index for e in agents_of(j.template.formula) if e.index != me] if meets else []
        excused = (len(opponents) == 1 and surprised(run, me, opponents[0], j.failed)) or pushed(run, me, j.failed)
        return not (excused or _forfeited(j, run)) and any(e.index == me for e in agents)
    if awaited := _awaited(j):
        owed = (run.steps - 1 if j.ended is None else j.ended) - (j.trigger or 0)
        if me not in awaited or owed * run.dt < WAIVER:
            return False
        try:
            return bool(may_go(run, me)[-1])
        except RunError:  # the run does not record enough to decide
            return True
    return any(e.index == me for e in agents) and not any(stuck(run, k) for k in range(len(run.agents)) if k != me)


def _forfeited(j: InstanceJudgement, run: Run) -> bool:
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


def _cause(j: InstanceJudgement, run: Run) -> Cause | None:
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


def _waiting(j: InstanceJudgement) -> tuple[f.Element, ...]:
    """Return the agents that have to wait according to an instance of a rule, or else the agents of its obligation."""
    waits = j.template.shape.waits
    return agents_of(waits if waits is not None else j.template.shape.obligation)


def _awaited(j: InstanceJudgement) -> list[int]:
    """Return the columns of the vehicles that have to go first according to an instance of a rule."""
    goes, waiting = j.template.shape.goes, _waiting(j)
    return [e.index for e in agents_of(goes) if e not in waiting] if goes is not None else []


def kept(instances: Sequence[InstanceJudgement], values: Values) -> tuple[int, int]:
    """Return the number of kept instances and of all instances; with a subject, of those that bind the subject to act."""
    if values.run.subject is None:
        return sum(j.status is Status.PASS for j in instances), len(instances)
    me = column_of(values.run, values.run.subject)
    binding = [j for j in instances if any(e.index == me for m in j.template.members for e in m.bound)]
    return sum(j.status is Status.PASS and asked(j.template, values, me) for j in binding), len(binding)


def scene_of(j: InstanceJudgement, values: Values) -> Scene:
    """Return what the explanation of a violated or open instance shows of the run."""
    run, atoms = values.run, j.template.atoms
    last = next(t for t in (j.failed, j.ended, run.steps - 1) if t is not None)
    ticks = sorted({t for t in (j.trigger, last - 1, last) if t is not None and t >= 0})
    states = tuple((t, tuple(bool(values[atom][t]) for atom in atoms)) for t in ticks)
    words = [word_of(atom) for atom, _ in j.broken]
    bends: tuple[Bend, ...] = ()
    if any(word is not None and word.bend for word in words):
        narrow = ((e.name, too_tight(run, e.index)) for e in j.blame.agents)
        bends = tuple(Bend(name, bend[0].radius, bend[1]) for name, bend in narrow if bend is not None)
    courses = tuple(_course(run, e, last) for e in agents_of(j.template.formula))
    return Scene(j, last, states, courses, _debt(run, atoms), bends, last_seen(run, columns(j.template)))


def _course(run: Run, agent: f.Element, tick: int) -> Course:
    zones = run.zone[: tick + 1, agent.index]
    inside, ticks = np.flatnonzero(zones == Zone.JUNCTION), np.flatnonzero(zones == Zone.ENTRANCE)
    entered, arrived, waited = int(inside[0]) if len(inside) else None, None, 0
    if len(ticks):
        at_entrance = int(ticks[-1])
        away = np.flatnonzero(zones[:at_entrance] != Zone.ENTRANCE)
        arrived, waited = int(away[-1]) + 1 if len(away) else 0, int(wt(run, agent.index)[at_entrance])
    return Course(agent, arrived, waited, entered)


def _debt(run: Run, atoms: Iterable[f.Atom]) -> Debt | None:
    """Return why an agent has to give way to another agent; None if lights or the order of arrival decide."""
    words = ((word_of(atom), atom.terms) for atom in atoms)
    pair = next((terms for word, terms in words if word is not None and word.debt), ())
    both = [term.index for term in pair if isinstance(term, f.Element)]
    if len(both) != 2 or run.junction.control in (JunctionControl.STOP, JunctionControl.LIGHTS):
        return None
    me, you = (run.agents[column].way.key for column in both)
    ground = ground_of(run.junction, me, you)
    return None if ground is None else Debt(both[0], both[1], ground)


def cycle_of(templates: tuple[Template, ...], rule: Rule, values: Values, book: RuleBook) -> Cycle | None:
    """Return vehicles that must wait for each other in a circle because of the rule, or of the rule and its companions."""
    cycle = find_cycle(templates, values)
    if cycle is None and rule.companions:
        cycle = find_cycle([*templates, *_companions(rule, values.run, book)], values)
        cycle = cycle and replace(cycle, alone=False)
    return cycle


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


def unavoidable(judgements: Iterable[InstanceJudgement], templates: Iterable[Template], values: Values) -> bool:
    """Return whether no vehicle could have kept a violated rule: every violation broke a cycle, or happened in a tight bend.

    In a cycle every vehicle must wait for the next vehicle: a vehicle has to break the rule, or all vehicles wait for ever. A
    violation outside a cycle, or violations by several vehicles in the same tick, could have been avoided. A bend is too tight if
    no path of the rear axle keeps the vehicle in its lane.
    """
    owed = list(_owed(templates, values))
    broken = [j for j in judgements if j.status is Status.FAIL]
    breakers: dict[int, set[str]] = {}
    for j in broken:
        if j.broken and all(value and _excused_by_bend(atom, values.run) for atom, value in j.broken):
            continue
        both = _waiting_and_awaited(j.template)
        if both is None or not j.failed:
            return False
        waiting, awaited = both
        waits = _waits(owed, j.failed - 1)
        if awaited not in waits.get(waiting, ()) or not _around(awaited, waiting, waits, ()):
            return False
        breakers.setdefault(j.failed, set()).add(waiting)
    return bool(broken) and all(len(agents) == 1 for agents in breakers.values())


def _excused_by_bend(atom: f.Atom, run: Run) -> bool:
    """Return whether no driver could have kept an atom about one vehicle false, such as leaving the lane in a tight bend."""
    word, agents = word_of(atom), agents_of(atom)
    excuses = word is not None and word.bend is TightBend.EXCUSES
    return excuses and len(agents) == 1 and beyond_steering(run, agents[0].index)


_Owed = tuple[str, str, NDArray[np.bool_]]
"""The name of a vehicle, the name of the vehicle that it must wait for, and whether it must wait, shape ``(steps,)``."""


def _owed(templates: Iterable[Template], values: Values) -> Iterator[_Owed]:
    """Yield, per instance that makes a vehicle wait for another vehicle at some time, the two vehicles and when this is so."""
    steps = values.run.steps
    tick = np.arange(steps)
    for t in templates:
        shape, both = t.shape, _waiting_and_awaited(t)
        if both is None or shape.premise is None or shape.waits is None or shape.goes is None:
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
            yield *both, held


def _waiting_and_awaited(template: Template) -> tuple[str, str] | None:
    """Return the names of the waiting and the awaited vehicle of an instance that makes one wait until the other has gone."""
    shape = template.shape
    if shape.form is not Form.YIELD or shape.waits is None or shape.goes is None:
        return None
    waiting, awaited = agents_of(shape.waits), agents_of(shape.goes)
    return (waiting[0].name, awaited[0].name) if len(waiting) == len(awaited) == 1 else None


def _waits(owed: Iterable[_Owed], tick: int) -> dict[str, list[str]]:
    """Return, per vehicle that must wait in a tick, the vehicles that it must wait for."""
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
        if target not in path and (further := _around(target, goal, waits, path)):
            return further
    return None
