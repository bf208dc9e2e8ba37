"""Which vehicles are responsible for a violated or open instance of a rule."""

from __future__ import annotations

from pytest_rvads.logic.conduct.blame import Cause, pushed, stuck, surprised
from pytest_rvads.logic.conduct.grounds import may_owe
from pytest_rvads.logic.conduct.progress import may_go
from pytest_rvads.logic.conduct.rights import WAIVER, waives
from pytest_rvads.logic.judging.judge import Judgement
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.shape import Kind, agents_of
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError

__all__ = ["cause_between", "is_about", "responsible", "waits"]


def responsible(j: Judgement, run: Run) -> tuple[f.Element, ...]:
    """Return the responsible vehicles: the vehicles that broke the instance, or that still have to wait."""
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
    """Return whether `subject` is to blame for a violated or open instance.

    The subject is not to blame for meeting a vehicle in the junction that had to wait and left the subject no time to react, for
    a violation right after a push by another vehicle, or for going before a vehicle that waived its right. A waiting vehicle
    keeps an open obligation. To blame for an open obligation is the awaited vehicle, if there is any, or a vehicle that is stuck
    in the way of all others.
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
        return me in awaited and owed * run.dt >= WAIVER and _could_go(run, me)
    return any(e.index == me for e in _waiting(j)) and not any(stuck(run, k) for k in range(len(run.agents)) if k != me)


def _forfeited(j: Judgement, run: Run) -> bool:
    """Return whether every awaited vehicle waived its right since the trigger, or waited for a vehicle that waived its right."""
    awaited, waiting = _awaited(j), {e.index for e in _waiting(j)}
    not_waiting = [k for k in range(len(run.agents)) if k not in waiting]
    if not awaited or not j.failed:
        return False
    try:
        waiving = {k for k in not_waiting if waives(run)[j.trigger : j.failed, k].any()}
        return all(k in waiving or any(may_owe(run, k, waiver) for waiver in waiving) for k in awaited)
    except RunError:
        return False


def _could_go(run: Run, agent: int) -> bool:
    """Return whether an agent could go at the end of the run, or the run does not record enough to decide."""
    try:
        return bool(may_go(run, agent)[-1])
    except RunError:
        return True


def waits(j: Judgement, subject: str) -> bool:
    """Return whether `subject` still has to wait for another vehicle."""
    waiting = _waiting(j)
    awaited = agents_of(j.template.shape.goes) if j.template.shape.goes is not None else ()
    return j.status is Status.OPEN and any(e.name == subject for e in waiting) and any(e not in waiting for e in awaited)


def cause_between(j: Judgement, run: Run) -> Cause | None:
    """Return the cause of the collision or meeting of two vehicles that broke an instance; None if neither vehicle caused it."""
    for atom, _ in j.broken:
        word, agents = word_of(atom), [e.index for e in agents_of(atom)]
        if word is not None and word.cause is not None and j.failed is not None and len(agents) == 2:
            return word.cause(run, agents[0], agents[1], j.failed)
    return None


def _waiting(j: Judgement) -> tuple[f.Element, ...]:
    waits = j.template.shape.waits
    return agents_of(waits if waits is not None else j.template.shape.obligation)


def _awaited(j: Judgement) -> list[int]:
    """Return the columns of the vehicles that are to go first."""
    goes, waiting = j.template.shape.goes, _waiting(j)
    return [e.index for e in agents_of(goes) if e not in waiting] if goes is not None else []
