"""Judges an autopilot with a random waiting time for all waiting times in a range; bisection locates changes of the verdict.

The waiting time, which the autopilot would draw at random, is a field of the scenario (`Scenario.wait`), so that runs can be
repeated. It is called the draw.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.patience import Choice, choice, choosing
from pytest_rvads.simulators.simulator import Simulator, meant, simulate
from pytest_rvads.support.errors import RuleViolation, RunError, ScenarioError, require
from pytest_rvads.support.executors import spread

__all__ = ["Interval", "Spread", "intervals", "sweep"]

STEP = 0.1
"""Difference between neighbouring draws that are tried before the bisection [s]."""
_WORST = (Status.FAIL, Status.OPEN, Status.PASS, Status.NA)


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval of draws [s], including its two ends, for which the verdict of a rule has the same status."""

    low: float
    high: float
    status: Status

    def __str__(self) -> str:
        return f"{self.status} from {self.low:.2f} to {self.high:.2f} s"


@dataclass(frozen=True, slots=True)
class Spread:
    """The statuses of a rule for all draws (random waiting times of an autopilot) in a range."""

    rule: str
    scenario: Scenario
    intervals: tuple[Interval, ...]
    """Intervals in increasing order; an interval begins one tick of 0.01 s after the end of the interval before."""

    @property
    def shares(self) -> dict[Status, float]:
        """By status that occurs, its share of the draws, beginning with the worst status."""
        total = math.fsum(self._width(i) for i in self.intervals)
        shares = {s: math.fsum(self._width(i) for i in self.intervals if i.status is s) / total for s in _WORST}
        return {status: share for status, share in shares.items() if share}

    @property
    def status(self) -> Status:
        """The worst status that occurs in the range of draws."""
        return next(iter(self.shares))

    def check(self) -> None:
        """Raise an error if the rule is violated for any draw.

        Raises:
            RuleViolation: the rule is violated for some draws; the message names the intervals.
            ScenarioError: the rule applies to the run of no draw, so nothing was tested.
        """
        __tracebackhide__ = True
        bad = [i for i in self.intervals if i.status in (Status.FAIL, Status.OPEN)]
        if bad:
            raise RuleViolation(f"{self.rule} depends on the draw in {self.scenario.name}: {', '.join(map(str, bad))}")
        if self.status is Status.NA:
            raise ScenarioError(f"{self.rule} never applies in {self.scenario.name} for any draw, so nothing was tried")

    def __str__(self) -> str:
        shares = ", ".join(f"{share:.1%} {status}" for status, share in self.shares.items())
        return f"{self.rule}: {shares}; " + ", ".join(map(str, self.intervals))

    def _width(self, interval: Interval) -> float:
        return interval.high - interval.low + DT


def sweep(
    case: Case,
    rule: str | Rule,
    low: float,
    high: float,
    *,
    step: float = STEP,
    simulator: Simulator | None = None,
    executor: Executor | int | None = 1,
) -> Spread:
    """Judge a case by a rule for all draws (random waiting times of its autopilot) in a range.

    Draws at distances of `step` are tried first. If two neighbouring draws have different statuses, bisection locates the change
    to a tick of 0.01 s. An interval that lies between two neighbouring draws with equal statuses is not found.

    Args:
        case: the case; each draw replaces ``wait`` of its scenario.
        rule: the rule to judge by.
        low: least draw [s].
        high: greatest draw [s].
        step: difference between neighbouring draws that are tried before the bisection [s].
        simulator: the simulator of the runs, as for `simulate`.
        executor: executor or number of processes for the runs, as for `campaign`; this process by default.

    Returns:
        The `intervals` of draws with equal statuses, the share of the range that each status has (`shares`), and a method
        `check`, which raises an error if the rule is violated for any draw.

    Raises:
        ScenarioError: the range is empty, or the step is below a tick.
        FormulaError: the rule is unknown, or has the name of a shipped rule.
        RunError: a run ended by a fault.
    """
    require(case, Case, "sweep takes a rvads.Case(scenario, driver)", ScenarioError)
    (checked_rule,) = rules_for(get_rule(rule))
    work = partial(_status_of_draw, case, checked_rule, Choice(meant(simulator), choice().limits._replace(dump=None)))
    constant_intervals = intervals(lambda draws: spread(work, draws, executor, batch=1), low, high, step)
    return Spread(checked_rule.name, case.scenario, constant_intervals)


def _status_of_draw(case: Case, rule: Rule, settings: Choice, wait: float) -> Status:
    with choosing(settings):
        verdict = check(simulate(case.but(wait=wait)), rule)
    if verdict.status is Status.ERROR:
        raise RunError(f"{case.scenario.name} with a draw of {wait:g} s can't be judged: {verdict.reason}")
    return verdict.status


def intervals(
    statuses: Callable[[Sequence[float]], Iterable[Status]], low: float, high: float, step: float = STEP
) -> tuple[Interval, ...]:
    """Return the intervals of a range on which a function of time is constant, located by bisection.

    Args:
        statuses: function that returns the values at several times, in the order of the times.
        low: least time [s].
        high: greatest time [s].
        step: difference between neighbouring times that are evaluated before the bisection [s].

    Raises:
        ScenarioError: the range is empty, or the step is below a tick.
    """
    if not (0 <= low <= high < math.inf):
        raise ScenarioError(f"the range of a draw must begin at 0 s or more and not end before, got {low!r} to {high!r}")
    if not DT <= step < math.inf:
        raise ScenarioError(f"the step of a sweep must be at least one tick of {DT:g} s, got {step!r}")
    first, last, stride = round(low / DT), round(high / DT), round(step / DT)
    statuses_by_tick: dict[int, Status] = {}
    ticks = list(dict.fromkeys((*range(first, last, stride), last)))
    while ticks:
        statuses_by_tick |= zip(ticks, statuses([round(tick * DT, 6) for tick in ticks]), strict=True)
        # Each round bisects all changes, so that the runs of a round can be simulated in parallel.
        neighbours = pairwise(sorted(statuses_by_tick))
        ticks = [
            (lower + upper) // 2
            for lower, upper in neighbours
            if upper - lower > 1 and statuses_by_tick[lower] is not statuses_by_tick[upper]
        ]
    merged: list[Interval] = []
    for tick in sorted(statuses_by_tick):
        point = Interval(round(tick * DT, 6), round(tick * DT, 6), statuses_by_tick[tick])
        if merged and merged[-1].status is point.status:
            merged[-1] = Interval(merged[-1].low, point.high, point.status)
        else:
            merged.append(point)
    return tuple(merged)
