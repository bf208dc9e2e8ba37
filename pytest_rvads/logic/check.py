"""Judges a run by a rule: Algorithm 1 of the paper, extended by a status for obligations that are open when the run ends.

`check` makes the instances of a rule (`prepare`: the rule for certain vehicles and entrances), judges the instances (`judge`, and
`doubted` for other readings of a recording), and finds who is to blame (`blamed`) and what follows for the rule (`attribute`).
Then it makes the `Judgement`, and puts the judgement into words (`tell`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from msgspec import structs

from pytest_rvads.logic.conduct.static_model import cut_off, extract, on_each_way, without_jumps
from pytest_rvads.logic.conduct.validate import damage
from pytest_rvads.logic.judging.attribution import BROKEN, attribute, blamed, cycle_of, gravest_first, kept, scene_of
from pytest_rvads.logic.judging.instances import Prepared, prepare
from pytest_rvads.logic.judging.judge import Values, certain, judge, nearest_miss, undecided
from pytest_rvads.logic.judging.judgement import InstanceJudgement, Judgement, Reason
from pytest_rvads.logic.judging.readings import agreed, doubted, tolerance
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.outcome import Outcome, counted
from pytest_rvads.logic.rules.book import RuleBook, current_book, get_rule, is_rulebook, rules_for
from pytest_rvads.logic.rules.rule import LONGEST_TIE, Rule, shape_of
from pytest_rvads.logic.telling.explain import tell
from pytest_rvads.runs.run import Run, once
from pytest_rvads.support.errors import RunError, RvadsError, located, require
from pytest_rvads.support.wording import one_line

_QUIET = (Outcome.PASS, Outcome.NA)
"""Outcomes of rules whose messages the verdict of a rulebook leaves out; the verdict only counts these outcomes."""


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
    tie_window = rule.tie if tie is None else tie
    if not 0 <= tie_window <= LONGEST_TIE:
        raise RunError(f"the tie window must be a number of seconds from 0 to {LONGEST_TIE:,}, got {tie!r:.60}")
    broken = once(run, damage)
    if broken:
        return tell(Judgement(rule, Status.ERROR, Reason.DAMAGED, run.fault.reason if run.fault else str(broken[0])), run)
    values = Values(without_jumps(run), tie_window, standing=standing)
    judgement = _judgement(rule, values, book, run, itinerary=itinerary)
    if run.fault and (judgement.status is not Status.FAIL or judgement.provoked or judgement.unavoidable):
        judgement = Judgement(rule, Status.ERROR, Reason.DAMAGED, run.fault.reason)
    return tell(judgement, values.run)


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


def _judgement(rule: Rule, values: Values, book: RuleBook, sampled: Run, *, itinerary: bool) -> Judgement:
    """Judge the states of a run by a rule, and ignore a fault that ended the run; `sampled` is the run as recorded."""
    run = values.run
    if not rule.concerns(run.junction):
        return Judgement(rule, Status.NA, Reason.ELSEWHERE)

    def prepared(run: Run) -> Prepared:
        return prepare(rule.formula, once(run, extract), rule.bound, itinerary=itinerary)

    def judged(sampled: Run, values: Values) -> list[InstanceJudgement]:
        recorded = judge(prepared(values.run).templates, values)
        unmoved = all(lane.beyond is None for lane in values.run.junction.entrances)
        exact = not recorded or (certain(sampled) and unmoved)
        return recorded if exact else doubted(recorded, values, sampled)

    collapsed, ways = prepared(run).collapsed, undecided(run)
    try:
        on_ways = ((on, judged(on, values.of(without_jumps(on)))) for on in on_each_way(sampled))
        judgements = agreed(on_ways, ways) if ways else judged(sampled, values)
    except RunError as error:
        return Judgement(rule, Status.NA, Reason.NOT_RECORDED, str(error), collapsed=collapsed)
    if judgements:
        return _completed(blamed(judgements, run), rule, values, book, sampled, collapsed)
    if shape_of(rule.formula).premise is not None or not collapsed:
        return Judgement(rule, Status.NA, Reason.EXCLUDED, collapsed=collapsed)
    if cut_off(sampled):
        return Judgement(rule, Status.NA, Reason.CUT_OFF, asked=False)
    return Judgement(rule, Status.PASS, collapsed=collapsed)


def _completed(
    judgements: list[InstanceJudgement], rule: Rule, values: Values, book: RuleBook, sampled: Run, collapsed: int
) -> Judgement:
    """Return the judgement of a rule, given the judgements of its instances with the agents to blame."""
    run, templates = values.run, tuple(j.template for j in judgements)
    found = attribute(judgements, rule, values, book)
    status, reason, violated = found.status, None, found.status in BROKEN
    if status is Status.NA:
        idle = Reason.NOBODY_MOVED if run.subject is None else Reason.NOT_ASKED
        reason = Reason.NEVER_TRIGGERED if all(j.status is Status.NA for j in judgements) else idle
    elif status is Status.PASS and run.facts.strayed and run.subject in (None, *run.facts.strayed):
        status, reason = Status.OPEN, Reason.STRAYED
    elif status is Status.PASS and cut_off(sampled):
        return Judgement(rule, Status.NA, Reason.CUT_OFF, asked=False)
    untied, limits = None, None
    if values.tie > 0 and found.status is not Status.UNSURE:
        exact = values.untied()
        untied = attribute(blamed(judge(templates, exact), run), rule, exact, book).status
    recorded = sampled.excerpt is not None and sampled.station is not None and sampled.speed is not None
    if recorded and status is Status.FAIL and not (found.unavoidable or found.provoked):
        failed = tuple(j.template for j in judgements if j.status is Status.FAIL)
        limits = tolerance(sampled, failed, values)
    ordered = gravest_first(judgements, run)
    kept_count, binding = kept(judgements, values) if status is Status.PASS else (0, 0)
    return Judgement(
        rule,
        status,
        reason,
        instances=ordered,
        collapsed=collapsed,
        asked=found.asked,
        unavoidable=found.unavoidable,
        provoked=found.provoked,
        kept=kept_count,
        binding=binding,
        scene=scene_of(ordered[0], values) if violated else None,
        cycle=cycle_of(templates, rule, values, book) if found.unavoidable or found.status is Status.OPEN else None,
        nearest=nearest_miss(templates, values) if reason is Reason.NEVER_TRIGGERED else None,
        undecided=undecided(run) if violated else "",
        tie=values.tie,
        untied=None if untied is found.status else untied,
        tolerance=limits,
    )
