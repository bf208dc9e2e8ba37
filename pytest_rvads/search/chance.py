"""Where an autopilot draws at random: the verdict over the range of the draw, its changes located by bisection.

The draw is a field of the scenario (`Scenario.wait`), so a run is as repeatable with it as without.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from pytest_rvads.errors import RuleViolation, RunError, ScenarioError, require
from pytest_rvads.executors import spread
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.choice import Choice, choice, choosing
from pytest_rvads.simulators.simulator import Simulator, meant, simulate

__all__ = ["Interval", "Spread", "intervals", "sweep"]

STEP = 0.1
"""Distance of the draws that are tried first [s]."""
_WORST = (Status.FAIL, Status.OPEN, Status.PASS, Status.NA)


@dataclass(frozen=True, slots=True)
class Interval:
    """Draws that give the same status, both ends included."""

    low: float
    high: float
    status: Status

    def __str__(self) -> str:
        return f"{self.status} from {self.low:.2f} to {self.high:.2f} s"


@dataclass(frozen=True, slots=True)
class Spread:
    """The verdict of a rule over a range of draws."""

    rule: str
    scenario: Scenario
    intervals: tuple[Interval, ...]
    """In order of the draw, without gaps but for one tick between them."""

    @property
    def shares(self) -> dict[Status, float]:
        """Share of the range with each status that occurs, the worst first."""
        total = math.fsum(self._width(i) for i in self.intervals)
        found = {s: math.fsum(self._width(i) for i in self.intervals if i.status is s) / total for s in _WORST}
        return {status: share for status, share in found.items() if share}

    @property
    def status(self) -> Status:
        """The worst status that occurs."""
        return next(iter(self.shares))

    def check(self) -> None:
        """Require that no draw breaks the rule.

        Raises:
            RuleViolation: some do; the message says which.
            ScenarioError: the rule applies for none of them, so nothing was tried.
        """
        __tracebackhide__ = True
        bad = [i for i in self.intervals if i.status in (Status.FAIL, Status.OPEN)]
        if bad:
            raise RuleViolation(f"{self.rule} depends on the draw in {self.scenario.name}: {', '.join(map(str, bad))}")
        if self.status is Status.NA:
            raise ScenarioError(f"{self.rule} never applies in {self.scenario.name}, whatever is drawn, so nothing was tried")

    def __str__(self) -> str:
        shares = ", ".join(f"{share:.1%} {status}" for status, share in self.shares.items())
        return f"{self.rule}: {shares}; " + ", ".join(map(str, self.intervals))

    def _width(self, interval: Interval) -> float:
        return interval.high - interval.low + DT


def sweep(  # noqa: PLR0913 - what to sweep by position, how by keyword
    case: Case,
    rule: str | Rule,
    low: float,
    high: float,
    *,
    step: float = STEP,
    simulator: Simulator | None = None,
    executor: Executor | int | None = 1,
) -> Spread:
    """Judge a case over a range of the draw of its autopilot.

    Draws `step` apart are tried, and between two with different statuses the change is located to one tick of 0.01 s. What
    begins and ends within one step is not seen.

    Args:
        case: the ``wait`` of its scenario is replaced.
        rule: to judge by.
        low: least draw [s].
        high: greatest draw [s].
        step: distance of the draws tried first [s].
        simulator: the simulator of the runs, as for `simulate`.
        executor: executor or number of processes for the runs, as for `campaign`; this process by default.

    Raises:
        ScenarioError: an empty range, or a step below one tick.
        FormulaError: an unknown rule, or another one that bears the name of a shipped one.
        RunError: a run ended by a fault.
    """
    require(case, Case, "sweep takes a rvads.Case(scenario, driver)", ScenarioError)
    (chosen,) = rules_for(get_rule(rule))
    work = partial(_status, case, chosen, Choice(meant(simulator), choice().limits._replace(dump=None)))
    found = intervals(lambda draws: spread(work, draws, executor, batch=1), low, high, step)
    return Spread(chosen.name, case.scenario, found)


def _status(case: Case, rule: Rule, made: Choice, wait: float) -> Status:
    with choosing(made):
        verdict = check(simulate(case.but(wait=wait)), rule)
    if verdict.status is Status.ERROR:
        raise RunError(f"{case.scenario.name} with a draw of {wait:g} s can't be judged: {verdict.reason}")
    return verdict.status


def intervals(
    statuses: Callable[[Sequence[float]], Iterable[Status]], low: float, high: float, step: float = STEP
) -> tuple[Interval, ...]:
    """Return the intervals of a range on which a function is constant, as far as points `step` apart show them.

    Args:
        statuses: returns the values of the function at several points, in their order.
        low: least point [s].
        high: greatest point [s].
        step: distance of those that are asked for first [s].

    Raises:
        ScenarioError: an empty range, or a step below one tick.
    """
    if not (0 <= low <= high < math.inf):
        raise ScenarioError(f"the range of a draw goes from 0 s or more upwards, got {low!r} to {high!r}")
    if not DT <= step < math.inf:
        raise ScenarioError(f"the step of a sweep must be at least one tick of {DT:g} s, got {step!r}")
    first, last, stride = round(low / DT), round(high / DT), round(step / DT)
    known: dict[int, Status] = {}
    asked = list(dict.fromkeys((*range(first, last, stride), last)))
    while asked:
        known |= zip(asked, statuses([round(tick * DT, 6) for tick in asked]), strict=True)
        # Every change is halved at once, until it lies between neighbours.
        around = pairwise(sorted(known))
        asked = [(one + two) // 2 for one, two in around if two - one > 1 and known[one] is not known[two]]
    found: list[Interval] = []
    for tick in sorted(known):
        here = Interval(round(tick * DT, 6), round(tick * DT, 6), known[tick])
        if found and found[-1].status is here.status:
            found[-1] = Interval(found[-1].low, here.high, here.status)
        else:
            found.append(here)
    return tuple(found)
