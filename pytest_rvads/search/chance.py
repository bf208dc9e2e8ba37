"""Where an autopilot draws at random: the verdict over the range of the draw, its changes located by bisection.

The draw is a field of the scenario (`Scenario.wait`), so a run is as repeatable with it as without.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from pytest_rvads.errors import RuleViolation, RunError, ScenarioError, require
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import DT
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import Simulator, simulate

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


def sweep(
    case: Case, rule: str | Rule, low: float, high: float, *, step: float = STEP, simulator: Simulator | None = None
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
        simulator: what makes the runs, as for `simulate`.

    Raises:
        ScenarioError: an empty range, or a step below one tick.
        FormulaError: an unknown rule, or another one that bears the name of a shipped one.
        RunError: a run ended by a fault.
    """
    require(case, Case, "sweep takes a rvads.Case(scenario, driver)", ScenarioError)
    (chosen,) = rules_for(get_rule(rule))

    def status(wait: float) -> Status:
        verdict = check(simulate(case.but(wait=wait), simulator), chosen)
        if verdict.status is Status.ERROR:
            raise RunError(f"{case.scenario.name} with a draw of {wait:g} s can't be judged: {verdict.reason}")
        return verdict.status

    return Spread(chosen.name, case.scenario, intervals(status, low, high, step))


def intervals(status: Callable[[float], Status], low: float, high: float, step: float = STEP) -> tuple[Interval, ...]:
    """Return the intervals of a range on which a function is constant, as far as points `step` apart show them.

    Raises:
        ScenarioError: an empty range, or a step below one tick.
    """
    if not (0 <= low <= high < math.inf):
        raise ScenarioError(f"the range of a draw goes from 0 s or more upwards, got {low!r} to {high!r}")
    if not DT <= step < math.inf:
        raise ScenarioError(f"the step of a sweep must be at least one tick of {DT:g} s, got {step!r}")
    known: dict[int, Status] = {}

    def at(tick: int) -> Status:
        if tick not in known:
            known[tick] = status(round(tick * DT, 6))
        return known[tick]

    first, last, stride = round(low / DT), round(high / DT), round(step / DT)
    points = [*range(first, last, stride), last]
    for one, two in pairwise(points):
        _refine(at, one, two)
    found: list[Interval] = []
    for tick in sorted(known) or [first]:
        here = Interval(round(tick * DT, 6), round(tick * DT, 6), at(tick))
        if found and found[-1].status is here.status:
            found[-1] = Interval(found[-1].low, here.high, here.status)
        else:
            found.append(here)
    return tuple(found)


def _refine(at: Callable[[int], Status], one: int, two: int) -> None:
    """Ask until every change between two ticks lies between neighbours."""
    if two - one > 1 and at(one) is not at(two):
        middle = (one + two) // 2
        _refine(at, one, middle)
        _refine(at, middle, two)
    else:
        at(one), at(two)
