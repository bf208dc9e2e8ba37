"""From what the instances of a rule say to what the rule says about a run: whose doing counts, and what nobody could help."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pytest_rvads.conduct.blame import cut_short_by
from pytest_rvads.conduct.predicates import extract
from pytest_rvads.conduct.rights import held
from pytest_rvads.conduct.standing import drives
from pytest_rvads.errors import RunError
from pytest_rvads.logic.judging.cycle import unavoidable
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import Judgement, asked, judge
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.judging.responsibility import is_about, waits
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import RuleBook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run

__all__ = ["Attribution", "attribute", "companions"]

_BROKEN = (Status.FAIL, Status.OPEN)


@dataclass(frozen=True, slots=True)
class Attribution:
    """What a rule says about a run."""

    status: Status
    asked: bool = True
    """Whether an instance bound the subject to act; without a subject, whether any was triggered. Who never moves never acts."""
    unavoidable: bool = False
    """Violated, and nobody could have kept it."""
    provoked: bool = False
    """Violated or open by the doing of the traffic alone."""


def attribute(found: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> Attribution:
    """Return what a rule says about a run, given what its instances say.

    Without a subject: FAIL if any instance, else OPEN if any, else PASS if any was triggered, else NA. With one, what it is to
    blame for counts first; what only others broke is provoked; and it passes only where it was bound to act itself. Nobody passes
    by never moving. What is UNSURE counts where it binds the subject; it is no violation, but nor is it excused or provoked.

    Args:
        found: what the instances say.
        rule: the rule.
        values: of the run.
        book: with the companions of the rule.
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
    """Return whether the subject has reason to leave something open: it has to wait itself, or others ended the run."""
    run, subject = values.run, values.run.subject or ""
    others = set(cut_short_by(run)) - {subject}
    return bool(others) or any(waits(j, subject) for j in found) or _held(rule, run, subject, book)


def _owes_the_way(run: Run, subject: str) -> bool:
    """Return whether the subject owes the way to a vehicle that comes or stands at its line as the run ends."""
    try:
        return any(held(run)[-1, column] for column, agent in enumerate(run.agents) if agent.name == subject)
    except RunError:
        return False


def _held(rule: Rule, run: Run, subject: str, book: RuleBook) -> bool:
    """Return whether another rule of its rulebook still makes the subject wait: then it keeps others waiting with good reason."""
    if _owes_the_way(run, subject):
        return True
    static = extract(run)
    shelf = (rules_for(name, run.junction) for name in ("paper", "road"))
    rules = {*(book[name] for name in rule.companions), *(r for rules in shelf if rule in rules for r in rules)}
    judged = (judge(prepare(r.formula, static, r.bound).templates, Values(run, r.tie)) for r in rules)
    return any(waits(j, subject) for found in judged for j in found)
