"""Derives the status of a rule on a run from its instances: which vehicle caused a violation, and which could not be avoided.

A rule says which vehicle it binds, by its shape or by ``bound=``. With a subject, a rule passes only if an instance that was
triggered bound the subject. PROVOKED follows from blame. UNAVOIDABLE is a circle of waiting, which is proven, or a bend in which
a search finds no path that keeps the body in the lane.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pytest_rvads.logic.conduct.blame import cut_short_by
from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.conduct.rights import held
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.judging.cycle import unavoidable
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import Judgement, asked, judge
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.judging.responsibility import is_about, waits
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError

__all__ = ["Attribution", "attribute", "companions"]

_BROKEN = (Status.FAIL, Status.OPEN)


@dataclass(frozen=True, slots=True)
class Attribution:
    """The status of a rule on a run, with its attribution to the subject or the traffic."""

    status: Status
    asked: bool = True
    """Whether an instance bound the subject to act; without a subject, whether an instance was triggered and a vehicle moved."""
    unavoidable: bool = False
    """Whether the rule was violated and no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation."""


def attribute(found: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> Attribution:
    """Return the status of a rule on a run, given the judgements of its instances.

    Without a subject the status is FAIL if an instance failed, else OPEN if an instance is open, else UNSURE if an instance is
    unsure, else PASS if an instance was triggered, else NA. With a subject, the instances that the subject is to blame for count
    first. A violation by other vehicles alone is provoked. The subject passes only if an instance bound the subject to act. A run
    in which no vehicle moves does not pass, and a subject that never moves does not pass. An UNSURE instance counts if it binds
    the subject: the instance is no violation, but excludes the statuses unavoidable and provoked.

    Args:
        found: the judgements of the instances.
        rule: the rule.
        values: the truth values of the run.
        book: the book with the companions of the rule.
    """
    run, status = values.run, _overall(found)
    subject = run.subject
    if subject is None:
        excused = status is Status.FAIL and unavoidable(found, _with_companions(found, rule, run, book), values)
        if excused and any(j.status is Status.UNSURE for j in found):
            return Attribution(Status.UNSURE)
        acted = status is not Status.NA and any(drives(run, column) for column in range(len(run.agents)))
        return Attribution(Status.NA if status is Status.PASS and not acted else status, acted, excused)
    me = next(column for column, agent in enumerate(run.agents) if agent.name == subject)
    bound = any(j.status is not Status.NA and asked(j.template, values, me) for j in found)
    open_to_doubt = any(j.status is Status.UNSURE and _binds(j.template, me) for j in found)
    if status not in _BROKEN:
        return Attribution(Status.UNSURE if open_to_doubt else Status.PASS if bound else Status.NA, bound or open_to_doubt)
    own = [j for j in found if j.status in _BROKEN and is_about(j, run, subject)]
    failed = [j for j in own if j.status is Status.FAIL]
    if failed and not unavoidable(failed, _with_companions(found, rule, run, book), values):
        return Attribution(Status.FAIL)
    if len(own) > len(failed) and not _excused(found, rule, values, book):
        return Attribution(Status.OPEN)
    if open_to_doubt:
        return Attribution(Status.UNSURE)
    if status is Status.FAIL and unavoidable(found, _with_companions(found, rule, run, book), values):
        return Attribution(status, bound, unavoidable=True)
    return Attribution(status, bound, provoked=True)


def companions(rule: Rule, run: Run, book: RuleBook) -> tuple[Template, ...]:
    """Return the instances of the rules whose obligations can contradict those of `rule`."""
    static = extract(run)
    others = (book[name] for name in rule.companions)
    return tuple(t for other in others for t in prepare(other.formula, static, other.bound).templates)


def _overall(found: Iterable[Judgement]) -> Status:
    statuses = {j.status for j in found}
    return next((s for s in (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS) if s in statuses), Status.NA)


def _binds(template: Template, agent: int) -> bool:
    return any(e.index == agent for member in template.members for e in member.bound)


def _with_companions(found: Sequence[Judgement], rule: Rule, run: Run, book: RuleBook) -> list[Template]:
    return [*(j.template for j in found), *companions(rule, run, book)]


def _excused(found: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> bool:
    """Return whether the subject may leave an obligation open: the subject has to wait, or other vehicles ended the run."""
    run, subject = values.run, values.run.subject or ""
    others = set(cut_short_by(run)) - {subject}
    return bool(others) or any(waits(j, subject) for j in found) or _held(rule, run, subject, book)


def _owes_the_way(run: Run, subject: str) -> bool:
    """Return whether, at the end of the run, the subject owes the way to a vehicle that is coming or stands at its line."""
    try:
        return any(held(run)[-1, column] for column, agent in enumerate(run.agents) if agent.name == subject)
    except RunError:
        return False


def _held(rule: Rule, run: Run, subject: str, book: RuleBook) -> bool:
    """Return whether another rule still makes the subject wait, which excuses the subject for keeping other vehicles waiting.

    The other rules are the companions of `rule` and the rules of the rulebooks that contain `rule`.
    """
    if _owes_the_way(run, subject):
        return True
    static = extract(run)
    shelf = (rules_for(name, run.junction) for name in ("paper", "road"))
    rules = {*(book[name] for name in rule.companions), *(r for rules in shelf if rule in rules for r in rules)}
    judged = (judge(prepare(r.formula, static, r.bound).templates, Values(run, r.tie)) for r in rules)
    return any(waits(j, subject) for found in judged for j in found)
