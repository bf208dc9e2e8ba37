"""Searches for a counterexample: Hypothesis varies the scenario, guided by the distance of each run from a violation.

The scenarios that Hypothesis generates depend on its number of examples. So a search runs Hypothesis again and again with the
same number of examples, in blocks, until the budget of simulations is spent. For this reason, a search with a smaller budget
simulates the first scenarios of a search with a greater budget.

A violation that is UNAVOIDABLE (see `check`) is no counterexample.

Hypothesis is imported only by the functions that search, because its import takes a quarter of a second.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple
from unittest import SkipTest

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.blame import cut_short_by
from pytest_rvads.logic.conduct.kpis import kpis
from pytest_rvads.logic.conduct.static_model import crossed
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.scenario import Scenario, usual_duration
from pytest_rvads.search.space import Space, explored
from pytest_rvads.simulators.simulator import Choice, Simulator, simulate
from pytest_rvads.support.errors import OpenObligation, RuleViolation, RunError, ScenarioError
from pytest_rvads.support.executors import spread

_BLOCK = 50
"""Number of examples of a block. In the second half of a block, Hypothesis varies the best scenarios of its first half."""
_FAR_APART = 10.0
"""Greatest post-encroachment time that guides the search [s]; vehicles farther apart in time do not influence each other."""
_SHARE_OF_APART = 0.1
"""Weight of the post-encroachment time in `score`, so small that it decides only between scenarios with about equal margins."""


@dataclass(frozen=True, slots=True)
class Counterexample:
    """The simplest scenario of a search in which a rule is violated, with the verdict on its run."""

    scenario: Scenario
    verdict: Verdict
    found: int
    """Number of simulations until the first counterexample was found."""
    simulations: int
    """Number of all simulations, including the simulations that simplified the scenario afterwards."""


def pasteable(scenario: Scenario, rule: str) -> str:
    """Return the code of a test that simulates a scenario and judges the run by a rule."""

    def text(values: tuple[float, ...]) -> str:
        return f"{values[0]:g}" if len(set(values)) == 1 else f"({', '.join(f'{v:g}' for v in values)})"

    place = scenario.place
    built_in = place.map is None
    arguments = [repr(place.name if built_in else place.id), f"scenarios={label(scenario.directions, place.lanes)!r}"]
    arguments += [f"distances={text(scenario.distances)}", f"speeds={text(scenario.speeds)}", f"rules={rule!r}"]
    arguments += [] if built_in else [f"map={place.map!r}"]
    for name, default in (("subject", None), ("wait", 1.5), ("aggression", 1), ("duration", usual_duration(place))):
        if getattr(scenario, name) != default:
            arguments.append(f"{name}={getattr(scenario, name)!r}")
    if scenario.pedestrians:
        walkers = (f"({w.crossing}, '{w.side}', {w.behaviour!r}, {w.difference:g})" for w in scenario.pedestrians)
        arguments.append(f"pedestrians=[{', '.join(f'rvads.Pedestrian{walker}' for walker in walkers)}]")
    lines = [
        f"@rvads.scenario({', '.join(arguments)})",
        "def test_counterexample(run, rule, monitor):",
        "    monitor.check(rule)",
    ]
    return "\n".join(lines)


def violation(counterexample: Counterexample) -> RuleViolation:
    """Return a counterexample as an error whose notes explain and reproduce the violation."""
    verdict = counterexample.verdict
    kind = OpenObligation if verdict.status is Status.OPEN else RuleViolation
    error = kind(f"{verdict.message}, in {counterexample.scenario.name}")
    error.add_note(verdict.explanation)
    simplifying = counterexample.simulations - counterexample.found
    error.add_note(
        f"found in simulation {counterexample.found}, made simpler in {simplifying} more; to see it again:\n\n"
        + pasteable(counterexample.scenario, verdict.rule)
    )
    return error


class SearchResult(NamedTuple):
    """The result of a search for a counterexample."""

    counterexample: Counterexample | None
    rule: str
    triggered: bool
    """Whether the rule applied in any simulation in which a vehicle crossed the junction, see `crossed`."""
    simulations: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """The settings of a search that do not depend on the driver: the rule to violate, the scenarios, the budget and the seed."""

    place: Junction
    rule: str | Rule
    traffic: Factory | None
    """Driver of the vehicles around the subject (the vehicle under test); None for a search without a subject."""
    budget: int
    seed: int
    space: Space

    @classmethod
    def of(
        cls, junction: str | Junction, rule: str | Rule, traffic: str | Factory | None, budget: int, seed: int, space: Space
    ) -> Search:
        """Check the arguments of a search and return the search; the rule is looked up only when the search begins."""
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
        space = {**space, "map": None}  # `explored` has looked up the junction in its map
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
        """Run the search, and return the simplest counterexample, or None if none was found.

        Searches with different seeds can run in parallel. Of their counterexamples, that of the lowest seed is returned, so the
        result does not depend on the executor. With None as `name`, Hypothesis stores no counterexample.
        """
        parts = replace(self, rule=get_rule(self.rule)).parts(searches)
        if searches == 1 and not isinstance(executor, Executor):
            return self.settled([self.look(driver, fleet, simulator, name)])
        work = partial(_run_search, driver, fleet, Choice.of(simulator))
        with closing(spread(work, [(part, None if k else name) for k, part in enumerate(parts)], executor, batch=1)) as searched:
            return self.settled(searched)

    def look(self, driver: Factory, fleet: Fleet, simulator: Simulator | None, name: str | None = None) -> SearchResult:
        """Run a single search in this process; its result is a stored counterexample that still violates the rule, if any."""
        for stored in (True, False) if name else (False,):
            trial = _Trial(self.rule, self.budget, lambda s: Case(s, driver, self.traffic, fleet), simulator)
            counterexample = _falsify(self, trial, fleet.vehicle, name, stored=stored)
            if counterexample is not None:
                break
        return SearchResult(counterexample, trial.rule.name, trial.triggered, trial.simulations)

    def parts(self, searches: int) -> list[Search]:
        """Split the search into searches with consecutive seeds and equal parts of the budget."""
        if type(searches) is not int or not 1 <= searches <= self.budget:
            raise ScenarioError(f"searches must be a number from 1 to the budget of {self.budget} simulations, got {searches!r}")
        share, more = divmod(self.budget, searches)
        return [replace(self, seed=self.seed + k, budget=share + (k < more)) for k in range(searches)]

    def settled(self, searched: Iterable[SearchResult]) -> Counterexample | None:
        """Return the counterexample of the first search with a counterexample; None if no search has one."""
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


def _run_search(driver: Factory, fleet: Fleet, simulator: Simulator, job: tuple[Search, str | None]) -> SearchResult:
    search, name = job
    return search.look(driver, fleet, simulator, name)


def _falsify(search: Search, trial: _Trial, vehicle: Vehicle, name: str | None, *, stored: bool) -> Counterexample | None:
    """Let Hypothesis try scenarios until the rule is violated, and then simplify the scenario of the violation."""
    from hypothesis import HealthCheck, Phase, Verbosity, given, settings, target
    from hypothesis import seed as seeded

    from pytest_rvads.search import strategies

    simplest: list[tuple[Scenario, Verdict]] = []

    def attempt(scenario: Scenario) -> None:
        judged = trial.judge(scenario)
        if judged is None:
            return
        if judged.broken:
            simplest[:] = [(scenario, judged.verdict)]
            raise _Broken
        target(judged.score)

    # The name of the function is part of the key in the example database of Hypothesis.
    attempt.__name__ = re.sub(r"\W", "_", f"{name}__{search.place.name}__{trial.rule.name}")
    configured = settings(
        max_examples=1 if stored else _BLOCK,
        deadline=None,
        phases=(*((Phase.reuse,) if stored else (Phase.generate, Phase.target)), Phase.shrink),
        verbosity=Verbosity.quiet,
        suppress_health_check=list(HealthCheck),
        print_blob=False,
        report_multiple_bugs=False,
        database=settings().database if name else None,
    )
    # `seed` switches the example database off, so `settings`, which switches it on, is applied after `seed`.
    scenarios = strategies.scenarios(search.place, vehicle=vehicle, simulator=trial.simulator, **search.space)
    block = 0
    while True:
        before = trial.simulations
        try:
            configured(seeded(f"{search.seed} block {block}")(given(scenarios)(attempt)))()
        except _Broken:
            return Counterexample(*simplest[0], trial.first or 0, trial.simulations)
        except SkipTest:  # the example database holds no scenario
            return None
        if stored or trial.simulations in (before, trial.budget):
            return None
        block += 1


class _Broken(Exception):
    """Tells Hypothesis that a scenario is a counterexample; Hypothesis ends with this error for the simplest counterexample."""


class _Judged(NamedTuple):
    """What a search keeps of the run of a scenario."""

    verdict: Verdict
    broken: bool
    """Whether the run is a counterexample: the rule is violated, and its vehicles could have obeyed it."""
    score: float
    """How near the run was to a violation, see `score`."""


class _Trial:
    """Simulates and judges scenarios within a budget of simulations; a scenario that comes again is not simulated again."""

    def __init__(self, rule: str | Rule, budget: int, case: Callable[[Scenario], Case], simulator: Simulator | None) -> None:
        (self.rule,) = rules_for(get_rule(rule))
        self.budget = budget
        self.simulations = 0
        self.triggered = False
        """Whether the rule applied in a run in which a vehicle crossed the junction, see `crossed`; other runs test nothing."""
        self.first: int | None = None
        """Number of simulations until the first counterexample or error; None before."""
        self.simulator = simulator
        self._case = case
        self._judged: dict[Scenario, _Judged | Exception] = {}
        """Judged runs, or errors; Hypothesis repeats a scenario with an error and must get the same error."""

    def judge(self, scenario: Scenario) -> _Judged | None:
        """Return the judged run of a scenario; None if the budget is spent."""
        if scenario not in self._judged:
            if self.simulations - (self.first or 0) >= self.budget:
                return None
            self.simulations += 1
            answer: _Judged | Exception
            try:
                run = simulate(self._case(scenario), self.simulator)
            except Exception as error:
                answer = error
            else:
                verdict = check(run, self.rule)
                if verdict.status is Status.ERROR:
                    answer = RunError(f"{scenario!r} can't be judged by {self.rule.name}: {verdict.reason}")
                else:
                    self.triggered = self.triggered or (verdict.status is not Status.NA and crossed(run))
                    answer = _Judged(verdict, broken(run, verdict), score(verdict, _apart(run, scenario.under_test)))
            if self.first is None and (isinstance(answer, Exception) or answer.broken):
                self.first = self.simulations
            self._judged[scenario] = answer
        answer = self._judged[scenario]
        if isinstance(answer, Exception):
            raise answer
        return answer


def score(verdict: Verdict, apart: float) -> float:
    """Return how near a run was to a violation; a greater number is nearer.

    If the rule applied, the number is the greatest margin of its instances [s] minus a share of `apart`, the shortest
    post-encroachment time [s]. The share distinguishes runs by rules such as ``no_collision``, whose margin is 0 in every run
    without a violation. If the rule did not apply, the number is far below, and is the lower the more conditions of the rule's
    premise were false.
    """
    margins = [i.margin for i in verdict.instances if i.margin is not None]
    if verdict.status is Status.NA:
        return -100.0 - 10.0 * (len(verdict.near.missing) if verdict.near else 10)
    return max(margins, default=-50.0) - _SHARE_OF_APART * apart


def _apart(run: Run, subject: str | None) -> float:
    """Return the shortest post-encroachment time of two vehicles, one of them the subject if any, at most `_FAR_APART` [s]."""
    pairs = (pair for pair in kpis(run).pairs if subject is None or subject in pair.agents)
    return min((pair.pet for pair in pairs if pair.pet is not None and pair.pet < _FAR_APART), default=_FAR_APART)


def broken(run: Run, verdict: Verdict) -> bool:
    """Return whether a run violates a rule.

    A violation that is provoked by the traffic or unavoidable does not count, nor an obligation that is left open because a
    collision ended the run.
    """
    if verdict.provoked or verdict.unavoidable:
        return False
    return verdict.status is Status.FAIL or (verdict.status is Status.OPEN and not cut_short_by(run))
