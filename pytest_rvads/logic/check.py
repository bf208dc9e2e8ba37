"""Judges a run by a rule: Algorithm 1 of the paper, extended by a status for obligations that are open when the run ends.

`check` judges the instances of a rule (the rule for certain vehicles and entrances). `attribute` derives the status of the rule
from the instances: which vehicle caused a violation, and whether the violation could be avoided. Which vehicle must act follows
from the form of the rule's formula, or from the argument ``bound=`` of the rule. On a run with a subject (a vehicle under test),
a rule passes only if a triggered instance required an action of the subject. A violation is PROVOKED if only other vehicles are
to blame. A violation is UNAVOIDABLE if vehicles waited for each other in a circle, or if a search finds no path that keeps the
body of the vehicle in its lane in a bend.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from msgspec import structs

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.conduct.blame import cut_short_by
from pytest_rvads.logic.conduct.predicates import extract
from pytest_rvads.logic.conduct.presence import cut_off, on_each_way, without_jumps
from pytest_rvads.logic.conduct.rights import held
from pytest_rvads.logic.conduct.standing import drives
from pytest_rvads.logic.conduct.validate import damage
from pytest_rvads.logic.judging.evaluate import Values
from pytest_rvads.logic.judging.judge import asked, judge, nearest_miss
from pytest_rvads.logic.judging.judgement import Judgement, Template
from pytest_rvads.logic.judging.prepare import Prepared, prepare
from pytest_rvads.logic.judging.readings import agreed, doubted, tolerance
from pytest_rvads.logic.judging.responsibility import Cycle, by_walkers, find_cycle, is_about, unavoidable, waits
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome, counted
from pytest_rvads.logic.rules.book import RuleBook, current_book, get_rule, is_rulebook, rules_for
from pytest_rvads.logic.rules.parts import shape_of
from pytest_rvads.logic.rules.rule import LONGEST_TIE, Rule
from pytest_rvads.logic.telling.explain import tell
from pytest_rvads.logic.telling.phrase import undecided
from pytest_rvads.logic.telling.story import Story
from pytest_rvads.runs.run import Run, once
from pytest_rvads.support.errors import RunError, RvadsError, located, require
from pytest_rvads.support.wording import one_line

NOT_RECORDED = "not recorded"
"""First words of the reason of an NA verdict on a run that does not record the values that the rule needs."""
_QUIET = (Outcome.PASS, Outcome.NA)
"""Outcomes of rules whose messages the verdict of a rulebook leaves out; the verdict only counts these outcomes."""
CUT_OFF = "cut off: the run reached its duration before the subject had left the junction"
"""Reason of an NA verdict on a run that ended before the subject had left the junction; the subject had kept the rule so far."""
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
    """Judge a run by a rule, or by a rulebook (a named list of rules).

    The verdict of a rulebook is the worst verdict of its rules; rules about crosswalks are left out where nobody walks. The
    message of this verdict counts the verdicts of all rules of the book, and its notes hold the messages of the other verdicts
    that are neither PASS nor NA.

    Args:
        run: the run.
        rule: a rule, or the name of a rule or rulebook.
        tie: largest difference of waiting times that count as equal [s]; by default the value of the rule.
        itinerary: whether the predicate ``take`` (a vehicle turns in a direction) reads the turn from the known itinerary of the
            vehicle. If False, ``take`` is evaluated as the paper defines it, by what the vehicle does later in the run.
        standing: whether waiting times count from standstill, as the paper's text says. If False, waiting times count from the
            arrival at the entrance, as in the paper's implementation; the paper's tables require this.
        book: the book that holds the rule and its companions (the rules that can contradict it). By default the open book: the
            shipped rules and the rules registered for the running test, or in the process if no test runs.

    If a run has a vehicle under test (the subject, `Run.subject`), the status comes from the instances of the rule that the
    subject is to blame for. If the subject is to blame for no instance, a violation by the traffic is reported with ``provoked``
    set. The subject passes only if an instance required an action of the subject. A violation that no vehicle could have avoided
    is reported with ``unavoidable`` set.

    A run has limited accuracy if it states a `Run.spread`, is an `Excerpt` of a recording, or has longer steps than a simulation.
    An instance on such a run is UNSURE if other values of the measurements, within the accuracy, would change its status. An
    UNSURE instance makes the verdict UNSURE, unless other instances already make the verdict FAIL or OPEN. A vehicle whose way is
    not decided (`Agent.other_exits`) is judged on each of its possible ways, and an instance that depends on the way is UNSURE.

    Returns:
        The verdict. If a fault ended the run, the states before the fault are judged: a violation stands, any other status
        becomes an ERROR. The verdict on an empty or damaged run is an ERROR as well.

    Raises:
        FormulaError: the rule is unknown, or its monitor would be too large.
    """
    require(run, Run, "check takes a run, such as rvads.simulate(case) returns", RunError)
    book = current_book(book)
    if isinstance(rule, str) and is_rulebook(rule):
        rules = [candidate for candidate in rules_for(rule, book=book) if candidate.walked_at(run.junction)]
        verdicts = [check(run, r, tie=tie, itinerary=itinerary, standing=standing, book=book) for r in rules]
        worst = min(verdicts, key=lambda verdict: verdict.outcome.severity)
        others = tuple(f"{v.outcome} {v.message}" for v in verdicts if v is not worst and v.outcome not in _QUIET)
        tallied = counted(Counter[Outcome | None](verdict.outcome for verdict in verdicts))
        return structs.replace(worst, message=f"{rule}: {tallied}; {worst.message}", notes=(*worst.notes, *others))
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
    recorded = run.excerpt is not None and run.station is not None and run.speed is not None
    if story.status is Status.FAIL and not (story.unavoidable or story.provoked) and recorded:
        failed = tuple(j.template for j in story.judgements if j.status is Status.FAIL)

        def status_of(less_exact: Run) -> Status:
            values = Values(without_jumps(less_exact), window, standing=standing)
            return _overall(doubted(judge(failed, values), values, less_exact, standing=standing))

        story.tolerance = tolerance(run, status_of)
    if run.fault is None:
        return tell(story)
    if story.status is Status.FAIL and not (story.provoked or story.unavoidable):
        story.notes.append(f"later, at {run.fault.time:.2f} s, the run ended by a fault: {run.fault.reason}")
        return tell(story)
    return tell(Story(rule, run, Status.ERROR, reason=run.fault.reason))


def verdict_by(run: Run, rule: str | Rule) -> Verdict:
    """Return the verdict of a rule on a run; the verdict is ERROR with a reason if the rule can't judge the run."""
    try:
        return check(run, rule)
    except (Exception, SystemExit) as error:  # a predicate that a user wrote can raise any exception
        return unjudged(rule, sentence(error))


def other_verdicts(run: Run, rules: Iterable[str | Rule], but: str = "") -> Iterator[Verdict]:
    """Yield the verdicts of rules on a run as `verdict_by` gives them, each rule once, without the rule named `but`."""
    names = {rule if isinstance(rule, str) else rule.name: rule for rule in rules}
    return (verdict_by(run, rule) for name, rule in names.items() if name != but)


def unjudged(rule: str | Rule, reason: str) -> Verdict:
    """Return the verdict ERROR of a rule that could not judge a run."""
    name, requirement = (rule, None) if isinstance(rule, str) else (rule.name, rule.requirement)
    return Verdict(name, Status.ERROR, f"{name} ERROR: {reason}", reason=reason, requirement=requirement)


def sentence(error: BaseException) -> str:
    """Return the message of an error in a line; errors other than RvadsError and OSError get the names of type, file and line."""
    text = one_line(str(error)) if isinstance(error, RvadsError | OSError) else ""
    return text or located(error)


def _judged(rule: Rule, values: Values, book: RuleBook, sampled: Run, *, itinerary: bool, standing: bool) -> Story:
    """Judge the states of a run by a rule, and ignore a fault that ended the run; `sampled` is the run as recorded."""
    run = values.run
    if not rule.concerns(run.junction):
        return Story(rule, run, Status.NA, reason=_elsewhere(rule, run.junction))

    def prepared(run: Run) -> Prepared:
        return prepare(rule.formula, once(run, extract), rule.bound, itinerary=itinerary)

    def judged(sampled: Run, values: Values) -> list[Judgement]:
        templates = prepared(values.run).templates
        return doubted(judge(templates, values), values, sampled, standing=standing) if templates else []

    collapsed, ways = prepared(run).collapsed, undecided(run)
    try:
        on_ways = ((on, judged(on, Values(without_jumps(on), values.tie, standing=standing))) for on in on_each_way(sampled))
        judgements = agreed(on_ways, ways) if ways else judged(sampled, values)
    except RunError as error:
        return Story(rule, run, Status.NA, reason=f"{NOT_RECORDED}: {error}", collapsed=collapsed)
    templates = tuple(j.template for j in judgements)
    if not templates:
        if shape_of(rule.formula).premise is not None or not collapsed:
            reason = "no vehicle is in a position that the rule is about: what is static already excludes every instance"
            return Story(rule, run, Status.NA, reason=reason, collapsed=collapsed)
        return Story(rule, run, Status.PASS, collapsed=collapsed)
    attribution = attribute(judgements, rule, values, book)
    story = Story(rule, run, attribution.status, tuple(judgements), values, collapsed=collapsed)
    story.asked, story.unavoidable, story.provoked = attribution.asked, attribution.unavoidable, attribution.provoked
    if ways and attribution.status in _BROKEN:
        story.notes.append(f"the verdict does not depend on {ways}")
    if attribution.status is Status.NA:
        if all(j.status is Status.NA for j in judgements):
            story.reason = "never triggered: the premise of the rule never holds on the run"
            story.near = nearest_miss(templates, values)
        elif run.subject is None:
            story.reason = "no vehicle moved, so no vehicle kept the rule by an action"
        else:
            story.reason = f"only traffic was asked: no instance that was triggered bound {run.subject}, the subject, to act"
    if attribution.unavoidable or attribution.status is Status.OPEN:
        story.cycle = _cycle(rule, values, templates, book)
    if attribution.status is Status.PASS and run.facts.strayed and run.subject in (None, *run.facts.strayed):
        story.status = Status.OPEN
        story.reason = f"{' and '.join(run.facts.strayed)} left the route, which ended the run: the rest of the way is not known"
    if values.tie > 0 and attribution.status is not Status.UNSURE:
        exact = values.untied()
        status = attribute(judge(templates, exact), rule, exact, book).status
        if status is not attribution.status:
            story.notes.append(f"the tie window of {values.tie:g} s decides: without it the verdict would be {status}")
    return story


def _elsewhere(rule: Rule, junction: Junction) -> str:
    kind = _KINDS[junction.control]
    if junction.control not in rule.kinds:
        if len(rule.kinds) == 1:
            return f"{rule.name} is about junctions with {_KINDS[rule.kinds[0]]}, and this junction has {kind}"
        return f"{rule.name} is not about junctions with {kind}, such as this junction"
    if rule.crosswalks and not rule.concerns(junction):
        return f"{rule.name} is about {rule.crosswalks}, and none walk at this junction"
    return f"{rule.name} is about junctions with several lanes on an arm, and this junction has one lane on each"


def _cycle(rule: Rule, values: Values, templates: tuple[Template, ...], book: RuleBook) -> Cycle | None:
    """Return vehicles that must wait for each other in a circle because of the rule, or of the rule and its companions."""
    cycle = find_cycle(templates, values)
    if cycle is None and rule.companions:
        cycle = find_cycle([*templates, *companions(rule, values.run, book)], values)
        cycle = cycle and replace(cycle, alone=False)
    return cycle


_BROKEN = (Status.FAIL, Status.OPEN)


@dataclass(frozen=True, slots=True)
class Attribution:
    """The status of a rule on a run, and whether the subject (the vehicle under test) or the traffic caused the status."""

    status: Status
    asked: bool = True
    """Whether a triggered instance required an action of the subject. In a run without a subject, whether an instance was
    triggered and a vehicle moved."""
    unavoidable: bool = False
    """Whether the rule was violated and no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation; without a subject, whether pedestrians did."""


def attribute(judgements: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> Attribution:
    """Return the status of a rule on a run, given the judgements of its instances.

    A violation that pedestrians alone are to blame for is provoked, because pedestrians are never under test. On a run with a
    subject (vehicle under test), violated or open instances that the subject is to blame for decide before all other instances.
    A run in which no vehicle moves does not pass, and a subject that never moves does not pass. If an instance that binds the
    subject is UNSURE, the status is neither unavoidable nor provoked.
    """
    run, status = values.run, _overall(judgements)
    subject = run.subject

    def hopeless(violations: Sequence[Judgement]) -> bool:
        templates = [*(j.template for j in judgements), *companions(rule, run, book)]
        return unavoidable(violations, templates, values)

    if subject is None:
        excused = status is Status.FAIL and hopeless(judgements)
        if excused and any(j.status is Status.UNSURE for j in judgements):
            return Attribution(Status.UNSURE)
        vehicles = (column for column, agent in enumerate(run.agents) if not isinstance(agent.way, Crossing))
        acted = status is not Status.NA and any(drives(run, column) for column in vehicles)
        on_foot = status is Status.FAIL and not excused and all(by_walkers(j, run) for j in judgements if j.status is status)
        return Attribution(Status.NA if status is Status.PASS and not acted else status, acted, excused, on_foot)
    me = next(column for column, agent in enumerate(run.agents) if agent.name == subject)
    bound = any(j.status is not Status.NA and asked(j.template, values, me) for j in judgements)
    unsure_members = (member for j in judgements if j.status is Status.UNSURE for member in j.template.members)
    open_to_doubt = any(element.index == me for member in unsure_members for element in member.bound)
    if status not in _BROKEN:
        return Attribution(Status.UNSURE if open_to_doubt else Status.PASS if bound else Status.NA, bound or open_to_doubt)
    attributed = [j for j in judgements if j.status in _BROKEN and is_about(j, run, subject)]
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


def companions(rule: Rule, run: Run, book: RuleBook) -> tuple[Template, ...]:
    """Return the instances of the companions of `rule`, the rules whose obligations can contradict the obligations of `rule`."""
    static = once(run, extract)
    rules = (book[name] for name in rule.companions)
    return tuple(t for companion in rules for t in prepare(companion.formula, static, companion.bound).templates)


def _overall(judgements: Iterable[Judgement]) -> Status:
    statuses = {j.status for j in judgements}
    return next((s for s in (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS) if s in statuses), Status.NA)


def _excused(judgements: Sequence[Judgement], rule: Rule, values: Values, book: RuleBook) -> bool:
    """Return whether the subject is excused for an open obligation: the subject has to wait, or other vehicles ended the run.

    The subject has to wait because of the rule, its companions, or the rules of the rulebooks that contain the rule.
    """
    run, subject = values.run, values.run.subject or ""
    if set(cut_short_by(run)) - {subject} or any(waits(j, subject) for j in judgements):
        return True
    with suppress(RunError):
        if any(held(run)[-1, column] for column, agent in enumerate(run.agents) if agent.name == subject):
            return True
    static = once(run, extract)
    shelf = (rules_for(name, run.junction) for name in ("paper", "road"))
    rules = {*(book[name] for name in rule.companions), *(r for rules in shelf if rule in rules for r in rules)}
    judged = (judge(prepare(r.formula, static, r.bound).templates, Values(run, r.tie)) for r in rules)
    return any(waits(j, subject) for judgements in judged for j in judgements)
