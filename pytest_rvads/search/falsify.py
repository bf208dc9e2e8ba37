"""The search for a counterexample: Hypothesis varies the scenario, guided by the distance of each run from a violation.

A run in which no vehicles could have obeyed the rule (see `consistency`) is no counterexample.

The import of Hypothesis takes a quarter of a second, and so the functions that search import Hypothesis themselves.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Unpack

import numpy as np

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.blame import cut_short_by
from pytest_rvads.logic.conduct.presence import crossed
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.abstraction import Model
from pytest_rvads.search.consistency import decide
from pytest_rvads.search.counterexample import Counterexample
from pytest_rvads.search.space import Space, explored
from pytest_rvads.simulators.choice import Choice, choice, choosing
from pytest_rvads.simulators.patience import Limits
from pytest_rvads.simulators.simulator import Simulator, meant, simulate
from pytest_rvads.support.errors import RunError, ScenarioError
from pytest_rvads.support.executors import spread

__all__ = ["Search", "avoidable", "look_for", "score"]


class SearchResult(NamedTuple):
    """The result of a search."""

    counterexample: Counterexample | None
    rule: str
    """Name of the rule."""
    triggered: bool
    """Whether the rule applied in a simulation that shows a crossing, see `crossed`."""
    simulations: int
    """Number of simulations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """The rule to break and the scenarios to search, independent of the driver."""

    place: Junction
    rule: str | Rule
    traffic: Factory | None
    """Driver of the vehicles around a subject; None for a search without a subject."""
    budget: int
    seed: int
    space: Space

    @classmethod
    def of(
        cls, junction: str | Junction, rule: str | Rule, traffic: str | Factory | None, budget: int, seed: int, space: Space
    ) -> Search:
        """Check the arguments, and find the junction. The rule is looked up at the begin of the search, when it must be defined.

        Raises:
            RvadsError: an argument has a wrong type or is out of its range.
        """
        place = explored(junction, space)
        if not isinstance(rule, str | Rule):
            raise ScenarioError(f"rule must be the name of a rule in quotes, or a rule, got {rule!r}")
        if type(budget) is not int or budget < 1:
            raise ScenarioError(f"budget must be a number of simulations, at least 1, got {budget!r}")
        if type(seed) is not int:
            raise ScenarioError(f"seed must be a whole number, got {seed!r}")
        if space.get("subject") is not None:
            around = Policy.of("reference" if traffic is None else traffic).factory
        elif traffic is None:
            around = None
        else:
            raise ScenarioError("traffic= drives the vehicles around a subject: add subject=0, or leave traffic= out")
        space = {**space, "map": None}  # the junction is found
        return cls(place=place, rule=rule, traffic=around, budget=budget, seed=seed, space=space)

    def begin(
        self,
        driver: Factory,
        fleet: Fleet,
        simulator: Simulator | None,
        name: str | None = None,
        searches: int = 1,
        executor: Executor | int | None = None,
    ) -> Counterexample | None:
        """Look for a counterexample; `look_for` explains the arguments."""
        parts = replace(self, rule=get_rule(self.rule)).parts(searches)
        if searches == 1 and not isinstance(executor, Executor):
            return self.settled([self.look(driver, fleet, simulator, name)])
        work = partial(_run_search, driver, fleet, meant(simulator), choice().limits._replace(dump=None))
        with closing(spread(work, [(part, None if k else name) for k, part in enumerate(parts)], executor, batch=1)) as searched:
            return self.settled(searched)

    def look(self, driver: Factory, fleet: Fleet, simulator: Simulator | None, name: str | None = None) -> SearchResult:
        """Return the result of a single search in this process."""
        trial = _Trial(self.rule, self.budget, lambda s: Case(s, driver, self.traffic, fleet), simulator)
        return SearchResult(_falsify(self, trial, fleet.vehicle, name), trial.rule.name, trial.triggered, trial.simulations)

    def parts(self, searches: int) -> list[Search]:
        """Return searches with consecutive seeds and equal parts of the budget.

        Raises:
            ScenarioError: the number of searches is not from 1 to the budget.
        """
        if type(searches) is not int or not 1 <= searches <= self.budget:
            raise ScenarioError(f"searches must be a number from 1 to the budget of {self.budget} simulations, got {searches!r}")
        share, more = divmod(self.budget, searches)
        return [replace(self, seed=self.seed + k, budget=share + (k < more)) for k in range(searches)]

    def settled(self, searched: Iterable[SearchResult]) -> Counterexample | None:
        """Return the first counterexample of several searches.

        Raises:
            ScenarioError: no search has a counterexample, and the rule was triggered in none of them.
        """
        failed = []
        for result in searched:
            if result.counterexample is not None:
                return result.counterexample
            failed.append(result)
        if not any(result.triggered for result in failed):
            simulations = sum(result.simulations for result in failed)
            raise ScenarioError(
                f"{failed[0].rule} was not triggered in any of {simulations} simulations at {self.place.name} with a crossing, "
                "so nothing was tried: choose another rule, junction or space, or give the runs more time"
            )
        return None


def look_for(  # noqa: PLR0913 - keywords; a search has many settings
    junction: str | Junction,
    autopilot: Factory,
    rule: str | Rule,
    *,
    traffic: str | Factory | None = None,
    budget: int = 200,
    seed: int = 0,
    fleet: Fleet | None = None,
    name: str | None = None,
    simulator: Simulator | None = None,
    searches: int = 1,
    executor: Executor | int | None = None,
    **space: Unpack[Space],
) -> Counterexample | None:
    """Look for a scenario in which a rule is broken.

    Several searches may run in parallel. The answer is the counterexample of the lowest seed that has a counterexample, so the
    answer does not depend on the executor.

    Args:
        junction: built-in name, or id of a junction in ``map``; or the junction itself.
        autopilot: drives all vehicles, or the subject.
        rule: the rule to break.
        traffic: driver of the vehicles around a ``subject``; the reference by default.
        budget: most simulations before a counterexample, and most simulations to simplify it.
        seed: seed of the search.
        fleet: the bodies of the vehicles; passenger cars by default.
        name: name of the search in the example database of Hypothesis; None to store no counterexamples.
        simulator: the simulator of the runs, as for `simulate`.
        searches: number of searches, with the seeds from `seed` on and equal parts of the budget.
        executor: executor or number of processes for several searches, as for `campaign`; a single search runs in this process.
        space: bounds of the scenarios; `strategies.scenarios` explains the bounds.

    Returns:
        The simplest counterexample; None if the search found none.

    Raises:
        RunError: a run ended by a fault; the scenario is in the message.
        ScenarioError: an argument is out of its range, or the rule was never triggered.
        FormulaError: the rule is unknown, or has the name of a shipped rule.
    """
    search = Search.of(junction, rule, traffic, budget, seed, space)
    return search.begin(autopilot, fleet or Fleet(), simulator, name, searches, executor)


def _run_search(
    driver: Factory, fleet: Fleet, simulator: Simulator, limits: Limits, job: tuple[Search, str | None]
) -> SearchResult:
    search, name = job
    with choosing(Choice(simulator, limits)):
        return search.look(driver, fleet, simulator, name)


def _falsify(search: Search, trial: _Trial, vehicle: Vehicle, name: str | None) -> Counterexample | None:
    """Let Hypothesis try scenarios until a scenario breaks the rule, and then simplify this scenario."""
    from hypothesis import HealthCheck, Phase, Verbosity, given, settings, target
    from hypothesis import seed as seeded

    from pytest_rvads.search import strategies

    simplest: list[Scenario] = []

    def attempt(scenario: Scenario) -> None:
        verdict = trial.judge(scenario)
        if verdict is None:
            return
        if trial.counts[scenario]:
            simplest[:] = [scenario]
            raise _Broken
        target(score(verdict))

    # The name of the function is part of the key in the example database of Hypothesis.
    attempt.__name__ = re.sub(r"\W", "_", f"{name}__{search.place.name}__{trial.rule.name}")
    configured = settings(
        max_examples=trial.budget,
        deadline=None,
        phases=(Phase.reuse, Phase.generate, Phase.target, Phase.shrink),
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
        print_blob=False,
        report_multiple_bugs=False,
        database=settings().database if name else None,
    )
    # A seed switches the database off, and so the settings must be applied to the seeded test.
    scenarios = strategies.scenarios(search.place, vehicle=vehicle, simulator=trial.simulator, **search.space)
    try:
        configured(seeded(search.seed)(given(scenarios)(attempt)))()
    except _Broken:
        return Counterexample(simplest[0], trial.verdicts[simplest[0]], trial.first or 0, trial.simulations)
    return None


class _Broken(Exception):
    """Signals a counterexample to Hypothesis, which runs the simplest counterexample last."""


class _Trial:
    """Simulates and judges scenarios, each once, within a budget of simulations."""

    def __init__(self, rule: str | Rule, budget: int, case: Callable[[Scenario], Case], simulator: Simulator | None) -> None:
        (self.rule,) = rules_for(get_rule(rule))
        self.budget = budget
        self.simulations = 0
        self.triggered = False
        """Whether the rule applied in a run that shows a crossing, see `crossed`; other runs test nothing."""
        self.first: int | None = None
        """Number of simulations up to the first counterexample."""
        self.counts: dict[Scenario, bool] = {}
        """By scenario, whether its run is a counterexample: broken, although the vehicles could have obeyed."""
        self.verdicts: dict[Scenario, Verdict] = {}
        self.errors: dict[Scenario, Exception] = {}
        """Errors of the simulator by scenario. Hypothesis repeats a failed scenario and must get the same error."""
        self._case = case
        self.simulator = simulator

    def judge(self, scenario: Scenario) -> Verdict | None:
        """Return the verdict on a scenario; None if the budget is spent.

        Raises:
            RunError: the run can't be judged.
        """
        if scenario in self.errors:
            raise self.errors[scenario]
        if scenario not in self.verdicts:
            if self.simulations - (self.first or 0) >= self.budget:
                return None
            self.simulations += 1
            try:
                run = simulate(self._case(scenario), self.simulator)
            except Exception as error:
                self.first = self.first or self.simulations
                self.errors[scenario] = error
                raise
            verdict = self.verdicts[scenario] = check(run, self.rule)
            self.triggered = self.triggered or (verdict.status not in (Status.NA, Status.ERROR) and crossed(run))
            self.counts[scenario] = broken(run, verdict) and avoidable(run, self.rule)
            if self.first is None and (self.counts[scenario] or verdict.status is Status.ERROR):
                self.first = self.simulations
        verdict = self.verdicts[scenario]
        if verdict.status is Status.ERROR:
            raise RunError(f"{scenario!r} can't be judged by {self.rule.name}: {verdict.reason}")
        return verdict


def score(verdict: Verdict) -> float:
    """Return how near a run was to a violation; a greater number is nearer.

    For a triggered rule, the number is the greatest margin of its instances [s]. Otherwise the number is far below, and falls
    with the number of missing conditions of the premise.
    """
    margins = [i.margin for i in verdict.instances if i.margin is not None]
    if verdict.status is Status.NA:
        return -100.0 - 10.0 * (len(verdict.near.missing) if verdict.near else 10)
    return max(margins, default=-50.0)


def broken(run: Run, verdict: Verdict) -> bool:
    """Return whether a run breaks a rule, apart from violations provoked by traffic and obligations cut short by a collision."""
    if verdict.provoked:
        return False
    return verdict.status is Status.FAIL or (verdict.status is Status.OPEN and not cut_short_by(run))


def avoidable(run: Run, rule: Rule) -> bool:
    """Return whether vehicles with the arrival times of a run could have obeyed a rule."""
    arrived = run.zone >= Zone.ENTRANCE
    arrivals = np.where(arrived.any(axis=0), arrived.argmax(axis=0), run.steps) * run.dt
    return decide(Model(run.junction, run.agents, [float(time) for time in arrivals]), [rule]).possible
