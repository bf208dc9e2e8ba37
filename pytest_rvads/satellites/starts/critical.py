"""Finds critical starts: on a line of starts, the two neighbours between which the subject turns from waiting to going.

A line of starts holds scenarios of two vehicles that differ only in which vehicle is ahead and by how much. The critical starts
are found by bisection. At the last start at which the subject waits and at the first start at which the subject goes, a safe
policy is only just possible. A driver that passes at a critical start has to pass at every less critical start of the line (Li et
al., arXiv 2405.16914); a driver that fails at a less critical start is irrational.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.relations.metamorphic import side_by_side
from pytest_rvads.satellites.starts.lines import STEP, Fault, Line, Setting, Start, Trial, fault_of, rank
from pytest_rvads.search.falsify import pasteable
from pytest_rvads.support.errors import OpenObligation, RuleViolation, RunError, ScenarioError
from pytest_rvads.support.executors import Progress, spread

_FARTHER = tuple(round(seconds / STEP) for seconds in (0.1, 0.3, 1.0, 3.0))
"""Distances of the less critical starts from the critical start that are tried [steps of `STEP`]."""
_WIDE = round(0.64 / STEP)
"""First step of the search for the turn of a line, away from a lead of 0 [steps of `STEP`]."""
_AT_ALL = (Outcome.PASS, Outcome.PROVOKED, Outcome.UNAVOIDABLE, Outcome.NA)


class Order(StrEnum):
    """The two sides of a line of starts: the starts at which the subject goes, and the starts at which the subject waits."""

    GOES = "goes"
    """The subject enters the junction before the other vehicle; at the end of its green, before the other vehicle has green."""
    WAITS = "waits"
    """The subject enters the junction later, or not at all."""


@dataclass(frozen=True, slots=True)
class CriticalStart:
    """A side of a line of starts (waiting or going), with its critical start."""

    line: Line
    order: Order
    start: Start | None
    """The critical start; None if the subject shows this order at no start of the line."""
    tried: tuple[Start, ...]
    """All starts of this side that were simulated, the critical start first."""
    failed: Start | None = None
    """The start that fails: the critical start, or a less critical start whose more critical neighbour does not fail."""
    rule: str = ""
    """The rule that fails at the start `failed`; empty if all starts pass."""
    fault: Fault | None = None
    explanation: str = ""
    """The violation in words; if the driver is irrational, both runs side by side."""
    unfit: str = ""
    """The reason why the line has no starts; empty for a line with starts."""
    shrunk: tuple[Start, ...] = ()
    """Further starts, which were simulated to find the failing start with a passing neighbour."""
    error: str = ""
    """The reason why a run of the line has no verdict, such as a fault of the driver; empty without errors."""

    @property
    def status(self) -> Outcome:
        """The outcome of the rule that fails; otherwise the best outcome at the critical start, NA without a start.

        ERROR for a line with an error.
        """
        if self.error:
            return Outcome.ERROR
        if self.failed is not None:
            return dict(self.failed.outcomes)[self.rule]
        outcomes = {outcome for _, outcome in self.start.outcomes} if self.start else set()
        return next((outcome for outcome in _AT_ALL if outcome in outcomes), Outcome.NA)


def critical_starts(
    groups: Sequence[Sequence[Line]],
    setting: Setting,
    executor: Executor | int | None = None,
    progress: Progress | None = None,
) -> Generator[CriticalStart, None, None]:
    """Yield both sides (waiting and going) of every line of starts, each with its critical start, in the order of the lines.

    The search of the first line of a group begins at simultaneous arrivals. The search of each further line begins at the
    critical start of the line before, and needs fewer runs if the driver does the same on both lines. An error of the driver or
    of a rule ends the search of its line only.
    """
    for found in spread(partial(_search_group, setting), [tuple(group) for group in groups], executor, progress, batch=1):
        yield from found


def _search_group(setting: Setting, group: Sequence[Line]) -> list[CriticalStart]:
    sides: list[CriticalStart] = []
    turn, apart, farther = 0, _WIDE, _FARTHER
    for line in group:
        trial = Trial(setting, line)
        try:
            turn = _turn(trial, turn, apart)
            sides += [_side(trial, order, turn, farther) for order in Order]
        except ScenarioError as error:
            sides += [CriticalStart(line, order, None, (), unfit=str(error)) for order in Order]
            continue
        except RunError as error:
            sides += [CriticalStart(line, order, None, (), error=str(error)) for order in Order]
            continue
        apart, farther = 1, _FARTHER[1:3]  # the lines are equal up to a rotation
    return sides


def failing(sides: Sequence[CriticalStart]) -> list[CriticalStart]:
    """Return the sides of lines with a failing start, the worst failure first."""
    return sorted((side for side in sides if side.fault), key=lambda side: (rank(side.rule), side.fault is Fault.IRRATIONAL))


def failure(sides: Sequence[CriticalStart], setting: Setting) -> RuleViolation | None:
    """Return the failures of a test of critical starts as a single error, the worst failure first; None if all starts pass."""
    for side in sides:
        if side.error:
            raise RunError(side.error)
    if all(side.start is None for side in sides):
        raise ScenarioError(f"no start could be simulated: {next((s.unfit for s in sides if s.unfit), 'no vehicle has room')}")
    failed = failing(sides)
    if not failed:
        return None
    first = failed[0]
    assert first.failed is not None
    scenario = first.line.scenario(first.failed.lead)
    more = f", and {len(failed) - 1} more of {len(sides)} orders" if len(failed) > 1 else ""
    error = (OpenObligation if first.status is Outcome.OPEN else RuleViolation)(
        f"{first.line}, {first.fault} where it {first.order}: {first.rule} {first.status}, lead "
        f"{first.failed.lead * STEP:+.2f} s, in {setting.id(scenario)}{more}"
    )
    error.add_note(first.explanation)
    if not scenario.elapsed:
        error.add_note(f"to see it again:\n\n{pasteable(scenario, first.rule)}")
    return error


def bisected(holds: Callable[[int], bool], low: int, high: int) -> int:
    """Return the least number up to `high` for which `holds` is true, if `holds` is false for `low` and true for `high`.

    If `holds` changes several times, `holds` is true for the returned number, and false for the number before.
    """
    while high - low > 1:
        middle = (low + high) // 2
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def _turn(trial: Trial, guess: int, apart: int) -> int:
    """Return the least lead at which the subject goes [steps]; a lead beyond the line's end if the subject never goes.

    The search begins at the lead `guess`. Its first step away is `apart`, and the steps double until the subject waits at one
    start and goes at another.
    """

    def goes(lead: int) -> bool:
        return trial.start(lead).goes

    low = high = min(max(guess, trial.low), trial.high)
    step = apart
    while low > trial.low and goes(low):
        low, high, step = max(low - step, trial.low), low, 2 * step
    step = apart
    while high < trial.high and not goes(high):
        low, high, step = high, min(high + step, trial.high), 2 * step
    if goes(low):
        return low
    return bisected(goes, low, high) if goes(high) else high + 1


def _side(trial: Trial, order: Order, turn: int, farther: Sequence[int]) -> CriticalStart:
    """Return a side of a line of starts with its critical start, after trying less critical starts of this side."""
    sign, lead = (1, turn) if order is Order.GOES else (-1, turn - 1)
    if not trial.low <= lead <= trial.high:
        return CriticalStart(trial.line, order, None, ())
    critical = trial.start(lead)
    for more in farther:
        near = any(more / 2 < sign * (start.lead - lead) < 2 * more for start in trial.tried())
        if not near and trial.low <= lead + sign * more <= trial.high:
            trial.start(lead + sign * more)
    side = tuple([start for start in trial.tried() if sign * (start.lead - lead) >= 0][::sign])
    failures = [(rank(rule), number, rule) for number, start in enumerate(side) for rule, _ in start.failed()]
    if not failures:
        return CriticalStart(trial.line, order, critical, side)
    _, number, rule = min(failures)
    failed, fault = side[number], fault_of(rule)
    shrunk: tuple[Start, ...] = ()
    if number:
        tried = trial.tried()
        begin = side[number - 1].lead

        def fails(more: int) -> bool:
            return rule in dict(trial.start(begin + sign * more).failed())

        failed = trial.start(begin + sign * bisected(fails, 0, abs(failed.lead - begin)))
        shrunk = tuple(start for start in trial.tried() if start not in tried)
        passed = trial.start(failed.lead - sign)
        if fault is not Fault.MANNERS and dict(passed.outcomes)[rule] in (Outcome.PASS, Outcome.NA):
            (run, verdict), (failed_run, other) = _again(trial, passed, rule), _again(trial, failed, rule)
            away = f"{abs(failed.lead - passed.lead) * STEP:.2f} s less critical"
            table = side_by_side(run, verdict, failed_run, other, range(len(run.junction.starts)), away)
            return CriticalStart(trial.line, order, critical, side, failed, rule, Fault.IRRATIONAL, table, shrunk=shrunk)
    explanation = _again(trial, failed, rule)[1].explanation
    return CriticalStart(trial.line, order, critical, side, failed, rule, fault, explanation, shrunk=shrunk)


def _again(trial: Trial, start: Start, rule: str) -> tuple[Run, Verdict]:
    """Simulate a start again, and return the run and the verdict of a rule on the run."""
    run, verdicts = trial.setting.judged(trial.line.scenario(start.lead))
    return run, next(verdict for verdict in verdicts if verdict.rule == rule)
