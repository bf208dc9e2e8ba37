"""Judging a run by a rule: Algorithm 1 of the paper, and what it leaves open (facts on finite runs)."""

from __future__ import annotations

from dataclasses import replace

from pytest_rvads.errors import RunError
from pytest_rvads.logic.cycle import Cycle, find_cycle
from pytest_rvads.logic.evaluate import Values
from pytest_rvads.logic.explain import tell
from pytest_rvads.logic.ground import ground, simplify, unfold
from pytest_rvads.logic.judge import Judgement, judge, nearest_miss
from pytest_rvads.logic.prepare import prepare
from pytest_rvads.logic.rules import Rule, get_rule
from pytest_rvads.logic.shape import shape_of
from pytest_rvads.logic.story import Story, is_about, waits
from pytest_rvads.logic.verdicts import Status, Verdict
from pytest_rvads.maps.junction import JunctionControl
from pytest_rvads.semantics.predicates import extract
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.validate import damage

__all__ = ["check", "extract", "ground", "simplify", "unfold"]

NOT_RECORDED = "not recorded"
"""Begins the reason of a verdict on what a run does not hold."""
_KINDS = {
    JunctionControl.STOP: "stop signs at all entrances",
    JunctionControl.LIGHTS: "lights at all entrances",
    JunctionControl.NONE: "no signs or lights",
    JunctionControl.PARTIAL: "signs or lights at some entrances only",
}


def check(run: Run, rule: str | Rule, *, tie: float | None = None, itinerary: bool = True, standing: bool = False) -> Verdict:
    """Judge a run by a rule.

    Args:
        run: the run.
        rule: a rule or the name of one.
        tie: waiting times that differ by at most this count as equal [s]; the rule's own by default.
        itinerary: use the known itineraries for ``take``; False evaluates the paper's definition, a future formula.
        standing: count waiting times from standstill, as the paper's text says, instead of from the arrival at the
            entrance, as its implementation does and its tables require.

    With a subject among traffic (`Run.subject`) the status is that of the instances the subject is to blame for. Where it is
    to blame for none, whatever the traffic did is told with ``provoked`` set.

    Returns:
        The verdict; ERROR for a run that is empty, damaged or ended by a fault.

    Raises:
        FormulaError: an unknown rule, or one whose monitor would be too large.
    """
    rule = get_rule(rule) if isinstance(rule, str) else rule
    window = rule.tie if tie is None else tie
    if not window >= 0:
        raise RunError(f"the tie window must be a number of seconds, at least 0, got {tie!r}")
    trouble = _trouble(run)
    if trouble:
        return tell(Story(rule, run, Status.ERROR, reason=trouble))
    control = run.junction.control
    if rule.about not in (None, control):
        reason = f"{rule.name} is about junctions with {_KINDS[rule.about or control]}, this one has {_KINDS[control]}"
        return tell(Story(rule, run, Status.NA, reason=reason))
    prepared = prepare(rule.formula, extract(run), itinerary=itinerary)
    vacuous = shape_of(rule.formula).premise is not None
    if not prepared.templates:
        if vacuous or not prepared.collapsed:
            reason = "no vehicle is in a position that the rule is about: what is static already excludes every instance"
            return tell(Story(rule, run, Status.NA, reason=reason, collapsed=prepared.collapsed))
        return tell(Story(rule, run, Status.PASS, collapsed=prepared.collapsed))
    values = Values(run, window, standing=standing)
    try:
        found = judge(prepared.templates, values)
    except RunError as error:
        return tell(Story(rule, run, Status.NA, reason=f"{NOT_RECORDED}: {error}", collapsed=prepared.collapsed))
    status, provoked = _attributed(found, rule, run)
    story = Story(rule, run, status, tuple(found), values, collapsed=prepared.collapsed, tie=window)
    story.subject, story.provoked = run.subject, provoked
    if status is Status.NA:
        story.reason = "never triggered: the premise of no instance ever holds on the run"
        story.near = nearest_miss(prepared.templates, values)
    if status in (Status.FAIL, Status.OPEN):
        story.cycle = _cycle(rule, run, values, itinerary)
    if window > 0:
        exact, _ = _attributed(judge(prepared.templates, Values(run, standing=standing)), rule, run)
        if exact is not status:
            story.notes.append(f"the tie window of {window:g} s decides: without it the verdict would be {exact}")
    return tell(story)


def _overall(found: list[Judgement]) -> Status:
    """Combine the instances: FAIL if any, else OPEN if any, else PASS if any was triggered, else NA."""
    statuses = {j.status for j in found}
    return next((s for s in (Status.FAIL, Status.OPEN, Status.PASS) if s in statuses), Status.NA)


def _attributed(found: list[Judgement], rule: Rule, run: Run) -> tuple[Status, bool]:
    """Return the status, and whether it is the traffic's alone; what a subject is to blame for counts before all else."""
    status, subject = _overall(found), run.subject
    if subject is None or status not in (Status.FAIL, Status.OPEN):
        return status, False
    own = [j for j in found if j.status in (Status.FAIL, Status.OPEN) and is_about(j, run, subject)]
    if own and _overall(own) is Status.OPEN and (any(waits(j, subject) for j in found) or _held(rule, run, subject)):
        return status, True
    return (_overall(own), False) if own else (status, True)


def _held(rule: Rule, run: Run, subject: str) -> bool:
    """Return whether a companion of `rule` still makes the subject wait: then it keeps others waiting with good reason."""
    companions = map(get_rule, rule.companions)
    templates = ((r, prepare(r.formula, extract(run)).templates) for r in companions)
    return any(waits(j, subject) for r, some in templates for j in judge(some, Values(run, r.tie)))


def _trouble(run: Run) -> str:
    """Say why a run can't be judged."""
    if run.fault:
        return run.fault.reason
    found = damage(run)
    return str(found[0]) if found else ""


def _cycle(rule: Rule, run: Run, values: Values, itinerary: bool) -> Cycle | None:
    """Look for obligations that contradict each other: of the rule alone, else together with its companions."""
    static = extract(run)
    own = list(prepare(rule.formula, static, itinerary=itinerary).templates)
    found = find_cycle(own, values)
    if found is None and rule.companions:
        others = [t for name in rule.companions for t in prepare(get_rule(name).formula, static, itinerary=itinerary).templates]
        found = find_cycle([*own, *others], values)
        found = found and replace(found, alone=False)
    return found
