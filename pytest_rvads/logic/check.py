"""Judging a run by a rule: Algorithm 1 of the paper, extended by the obligations that are open at the end of a finite run.

`check` judges the instances of a rule. `attribute` derives the status of the rule from the instances: which vehicle caused a
violation, and whether the violation could be avoided. A rule says which vehicle it binds, by its shape or by ``bound=``. With a
subject, a rule passes only if an instance that was triggered bound the subject. PROVOKED follows from blame. UNAVOIDABLE is a
circle of waiting, which is proven, or a bend in which a search finds no path that keeps the body in the lane.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from msgspec import structs

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blame import cut_short_by
from pytest_rvads.logic.conduct.memo import once
from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.conduct.presence import cut_off, without_jumps
from pytest_rvads.logic.conduct.rights import held
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.conduct.validate import damage
from pytest_rvads.logic.judging.cycle import Cycle, find_cycle, unavoidable
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.ground import ground, simplify, unfold
from pytest_rvads.logic.judging.judge import Judgement, Near, asked, judge, nearest_miss
from pytest_rvads.logic.judging.prepare import Template, prepare
from pytest_rvads.logic.judging.readings import doubted
from pytest_rvads.logic.judging.responsibility import is_about, waits
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome, counted
from pytest_rvads.logic.rules.book import RuleBook, current_book, get_rule, is_rulebook, rules_for
from pytest_rvads.logic.rules.rule import LONGEST_TIE, Rule
from pytest_rvads.logic.rules.shape import shape_of
from pytest_rvads.logic.telling.explain import tell
from pytest_rvads.logic.telling.story import Story
from pytest_rvads.runs.run import Run
from pytest_rvads.support.errors import RunError, require

__all__ = ["Attribution", "attribute", "check", "companions", "extract", "ground", "simplify", "unfold"]


NOT_RECORDED = "not recorded"
"""Start of the reason of a verdict if the run does not hold what the rule needs."""
_QUIET = (Outcome.PASS, Outcome.NA)
"""Outcomes that the message of a rulebook only counts; other outcomes beside the worst verdict are quoted in its notes."""
CUT_OFF = "cut off: the run reached its duration before the subject had left the junction"
"""Reason of an NA verdict: the subject kept the rule up to the end of the run, which says nothing about its crossing."""
_KINDS = {
    JunctionControl.STOP: "stop signs at all entrances",
    JunctionControl.LIGHTS: "lights at all entrances",
    JunctionControl.NONE: "no signs or lights",
    JunctionControl.YIELD: "yield or priority signs",
    JunctionControl.PARTIAL: "signs or lights at some entrances only",
}


def check(
    run: Run,
    rule: str | Rule,
    *,
    tie: float | None = None,
    itinerary: bool = True,
    standing: bool = False,
    book: RuleBook | None = None,
) -> Verdict:
    """Judge a run by a rule, or by a rulebook.

    The verdict of a rulebook is the worst verdict of its rules. Its message counts the verdicts of all these rules, and its notes
    hold the messages of the other verdicts that are neither PASS nor NA.

    Args:
        run: the run.
        rule: a rule, or the name of a rule or rulebook.
        tie: largest difference of waiting times that count as equal [s]; the rule's own by default.
        itinerary: use the known itineraries for ``take``; False evaluates the paper's definition, a future formula.
        standing: count waiting times from standstill, as the paper's text says, instead of from the arrival at the entrance, as
            the paper's implementation does and the paper's tables require.
        book: the book that holds the rule and its companions; by default the open book, which also holds the rules that you
            registered.

    With a subject among traffic (`Run.subject`) the status comes from the instances that the subject is to blame for. If the
    subject is to blame for no instance, a violation by the traffic is reported with ``provoked`` set. The subject passes only if
    an instance bound the subject to act. A violation that no vehicle could have avoided is reported with ``unavoidable`` set.

    A run whose accuracy is limited (`Run.spread`, `Excerpt`, a step longer than the step of a simulation) is UNSURE if another
    reading of the run within its accuracy would change the status of an instance, unless a definite status is worse.

    Returns:
        The verdict. The states before a fault are judged: a violation stands, any other status becomes an ERROR. The verdict on
        an empty or damaged run is an ERROR as well.

    Raises:
        FormulaError: the rule is unknown, or its monitor would be too large.
    """
    require(run, Run, "check takes a run, such as rvads.simulate(case) returns", RunError)
    book = current_book(book)
    if isinstance(rule, str) and is_rulebook(rule):
        rules = rules_for(rule, book=book)
        return _worst(rule, [check(run, r, tie=tie, itinerary=itinerary, standing=standing, book=book) for r in rules])
    rule = get_rule(rule, book)
    window = rule.tie if tie is None else tie
    if not 0 <= window <= LONGEST_TIE:
        raise RunError(f"the tie window must be a number of seconds from 0 to {LONGEST_TIE:,}, got {tie!r:.60}")
    broken = once(run, damage)
    if broken:
        return tell(Story(rule, run, Status.ERROR, reason=run.fault.reason if run.fault else str(broken[0])))
    values = Values(without_jumps(run), window, standing=standing)
    story = _judged(rule, values, book, run, itinerary=itinerary, standing=standing)
    if story.status is Status.PASS and cut_off(run):
        story = Story(rule, run, Status.NA, reason=CUT_OFF, asked=False)
    if run.fault is None:
        return tell(story)
    if story.status is Status.FAIL and not (story.provoked or story.unavoidable):
        story.notes.append(f"later, at {run.fault.time:.2f} s, the run ended by a fault: {run.fault.reason}")
        return tell(story)
    return tell(Story(rule, run, Status.ERROR, reason=run.fault.reason))


def _worst(rulebook: str, verdicts: Sequence[Verdict]) -> Verdict:
    """Return the worst verdict of the rules of a rulebook, with the messages of the other rules in its notes."""
    counts = Counter[Outcome | None](verdict.outcome for verdict in verdicts)
    worst = min(verdicts, key=lambda verdict: verdict.outcome.severity)
    other_stories = tuple(f"{v.outcome} {v.message}" for v in verdicts if v is not worst and v.outcome not in _QUIET)
    return structs.replace(worst, message=f"{rulebook}: {counted(counts)}; {worst.message}", notes=(*worst.notes, *other_stories))


def _judged(rule: Rule, values: Values, book: RuleBook, sampled: Run, *, itinerary: bool, standing: bool) -> Story:
    """Judge the states of a run by a rule, whatever ended the run; `sampled` is the run as recorded."""
    run = values.run
    if not rule.concerns(run.junction):
        return Story(rule, run, Status.NA, reason=_elsewhere(rule, run.junction))
    prepared = prepare(rule.formula, extract(run), rule.bound, itinerary=itinerary)
    templates, collapsed = prepared.templates, prepared.collapsed
    if not templates:
        if shape_of(rule.formula).premise is not None or not collapsed:
            reason = "no vehicle is in a position that the rule is about: what is static already excludes every instance"
            return Story(rule, run, Status.NA, reason=reason, collapsed=collapsed)
        return Story(rule, run, Status.PASS, collapsed=collapsed)
    try:
        judgements = doubted(judge(templates, values), values, sampled, standing=standing)
    except RunError as error:
        return Story(rule, run, Status.NA, reason=f"{NOT_RECORDED}: {error}", collapsed=collapsed)
    attribution = attribute(judgements, rule, values, book)
    story = Story(rule, run, attribution.status, tuple(judgements), values, collapsed=collapsed)
    story.asked, story.unavoidable, story.provoked = attribution.asked, attribution.unavoidable, attribution.provoked
    if attribution.status is Status.NA:
        story.reason, story.near = _idle(story, templates, values)
    if attribution.unavoidable or attribution.status is Status.OPEN:
        story.cycle = _cycle(rule, values, templates, book)
    if attribution.status is Status.PASS and run.facts.strayed and run.subject in (None, *run.facts.strayed):
        story.status = Status.OPEN
        story.reason = f"{' and '.join(run.facts.strayed)} left the route, which ended the run: what would have come is not known"
    if values.tie > 0 and attribution.status is not Status.UNSURE:
        exact = values.untied()
        status = attribute(judge(templates, exact), rule, exact, book).status
        if status is not attribution.status:
            story.notes.append(f"the tie window of {values.tie:g} s decides: without it the verdict would be {status}")
    return story


def _elsewhere(rule: Rule, junction: Junction) -> str:
    """Return the reason why a rule does not apply to a junction."""
    kind = _KINDS[junction.control]
    if junction.control not in rule.kinds:
        if len(rule.kinds) == 1:
            return f"{rule.name} is about junctions with {_KINDS[rule.kinds[0]]}, this one has {kind}"
        return f"{rule.name} is not about junctions with {kind}, as this one"
    return f"{rule.name} is about junctions with several lanes on an arm, this one has one lane on each"


def _idle(story: Story, templates: tuple[Template, ...], values: Values) -> tuple[str, Near | None]:
    """Return the reason why a rule was not applicable, and the place where the rule came closest to being triggered."""
    if any(j.status is not Status.NA for j in story.found):
        if story.subject is None:
            return "nobody moved, so nobody kept the rule by what it did", None
        return f"only traffic was asked: no instance that was triggered bound {story.subject}, the subject, to act", None
    return "never triggered: the premise of no instance ever holds on the run", nearest_miss(templates, values)


def _cycle(rule: Rule, values: Values, templates: tuple[Template, ...], book: RuleBook) -> Cycle | None:
    """Find a cycle of contradicting obligations: among the instances of the rule alone, else together with its companions."""
    cycle = find_cycle(templates, values)
    if cycle is None and rule.companions:
        cycle = find_cycle([*templates, *companions(rule, values.run, book)], values)
        cycle = cycle and replace(cycle, alone=False)
    return cycle


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


def attribute(judgements: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> Attribution:
    """Return the status of a rule on a run, given the judgements of its instances.

    Without a subject the status is FAIL if an instance failed, else OPEN if an instance is open, else UNSURE if an instance is
    unsure, else PASS if an instance was triggered, else NA. With a subject, the instances that the subject is to blame for count
    first. A violation by other vehicles alone is provoked. The subject passes only if an instance bound the subject to act. A run
    in which no vehicle moves does not pass, and a subject that never moves does not pass. An UNSURE instance counts if it binds
    the subject: the instance is no violation, but excludes the statuses unavoidable and provoked.

    Args:
        judgements: the judgements of the instances.
        rule: the rule.
        values: the truth values of the run.
        book: the book with the companions of the rule.
    """
    run, status = values.run, _overall(judgements)
    subject = run.subject
    if subject is None:
        excused = status is Status.FAIL and unavoidable(judgements, _with_companions(judgements, rule, run, book), values)
        if excused and any(j.status is Status.UNSURE for j in judgements):
            return Attribution(Status.UNSURE)
        acted = status is not Status.NA and any(drives(run, column) for column in range(len(run.agents)))
        return Attribution(Status.NA if status is Status.PASS and not acted else status, acted, excused)
    me = next(column for column, agent in enumerate(run.agents) if agent.name == subject)
    bound = any(j.status is not Status.NA and asked(j.template, values, me) for j in judgements)
    open_to_doubt = any(j.status is Status.UNSURE and _binds(j.template, me) for j in judgements)
    if status not in _BROKEN:
        return Attribution(Status.UNSURE if open_to_doubt else Status.PASS if bound else Status.NA, bound or open_to_doubt)
    attributed = [j for j in judgements if j.status in _BROKEN and is_about(j, run, subject)]
    failed = [j for j in attributed if j.status is Status.FAIL]
    if failed and not unavoidable(failed, _with_companions(judgements, rule, run, book), values):
        return Attribution(Status.FAIL)
    if len(attributed) > len(failed) and not _excused(judgements, rule, values, book):
        return Attribution(Status.OPEN)
    if open_to_doubt:
        return Attribution(Status.UNSURE)
    if status is Status.FAIL and unavoidable(judgements, _with_companions(judgements, rule, run, book), values):
        return Attribution(status, bound, unavoidable=True)
    return Attribution(status, bound, provoked=True)


def companions(rule: Rule, run: Run, book: RuleBook) -> tuple[Template, ...]:
    """Return the instances of the rules whose obligations can contradict those of `rule`."""
    static = extract(run)
    rules = (book[name] for name in rule.companions)
    return tuple(t for companion in rules for t in prepare(companion.formula, static, companion.bound).templates)


def _overall(judgements: Iterable[Judgement]) -> Status:
    statuses = {j.status for j in judgements}
    return next((s for s in (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS) if s in statuses), Status.NA)


def _binds(template: Template, agent: int) -> bool:
    return any(e.index == agent for member in template.members for e in member.bound)


def _with_companions(judgements: Sequence[Judgement], rule: Rule, run: Run, book: RuleBook) -> list[Template]:
    return [*(j.template for j in judgements), *companions(rule, run, book)]


def _excused(judgements: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> bool:
    """Return whether the subject may leave an obligation open: the subject has to wait, or other vehicles ended the run."""
    run, subject = values.run, values.run.subject or ""
    culprits = set(cut_short_by(run)) - {subject}
    return bool(culprits) or any(waits(j, subject) for j in judgements) or _held(rule, run, subject, book)


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
    return any(waits(j, subject) for judgements in judged for j in judgements)
