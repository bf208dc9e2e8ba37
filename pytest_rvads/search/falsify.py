"""Looking for a counterexample: Hypothesis varies the scenario, guided by how near a rule was to being broken.

A run that breaks the rule only because nobody could have obeyed it (see `consistency`) is no counterexample.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pytest_rvads.conduct.blame import cut_short_by
from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.errors import OpenObligation, RuleViolation, RunError, ScenarioError
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.scenarios.case import Case, Fleet
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.search.abstraction import Model
from pytest_rvads.search.consistency import decide
from pytest_rvads.simulators.simulator import Simulator, simulate

__all__ = ["Counterexample", "avoidable", "falsify", "look_for", "pasteable", "score"]


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A scenario in which a rule is broken, as simple as it could be made."""

    scenario: Scenario
    verdict: Verdict
    found: int
    """Simulations up to the first counterexample."""
    simulations: int
    """All simulations, those of shrinking included."""


def falsify(
    junction: str,
    *,
    rule: str | Rule,
    autopilot: Factory | None = None,
    traffic: str | Factory | None = None,
    budget: int = 200,
    seed: int = 0,
    **space: Any,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Make a test that looks for a scenario in which a rule is broken, and fails with the simplest one it finds.

    The body of the test is called once nothing was found; its arguments are fixtures. What was found is kept in Hypothesis'
    example database and tried first the next time. A rule that never was triggered was not tried, which is an error.

    Args:
        junction: built-in name, or id of a junction in ``map``.
        rule: the rule to break.
        autopilot: the system under test; by default what an option names, else that of the fixture ``rvads_autopilot``.
        traffic: with ``subject``, what drives the others: a policy by name, or an autopilot of yours; the reference by default.
        budget: most simulations before a counterexample, and most for making it simpler.
        seed: other seeds look elsewhere.
        space: where to look, see `strategies.scenarios`: ``map``, ``subject``, ``partial``, ``near``, ``far``, ``pace``,
            ``wait``, ``aggression``, ``duration``.

    Example:
        >>> @falsify("stop4", rule="p1", budget=50)
        ... def test_nobody_meets_in_the_junction(): ...
    """
    if not isinstance(budget, int) or budget < 1:
        raise ScenarioError(f"budget must be a number of simulations, at least 1, got {budget!r}")
    around = _traffic(traffic, space)

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        wanted = inspect.signature(test)
        needed = ["rvads_vehicle", "rvads_simulator", *([] if autopilot is not None else ["rvads_sut", "rvads_autopilot"])]

        def wrapper(**fixtures: Any) -> None:
            __tracebackhide__ = True
            tested = (autopilot, fixtures.get("rvads_sut"), fixtures.get("rvads_autopilot"))
            driver = next(driver for driver in tested if driver is not None)
            name = f"{test.__module__}.{test.__qualname__}"
            fleet = Fleet(fixtures["rvads_vehicle"])
            trial = _Trial(rule, budget, lambda s: Case(s, driver, around, fleet), fixtures["rvads_simulator"])
            found = _search(junction, trial, seed, name, space)
            if found is not None:
                raise _violation(found)
            if not trial.triggered:
                raise ScenarioError(
                    f"{trial.rule.name} was not triggered in any of {trial.simulations} simulations at {junction}, so nothing "
                    "was tried: choose another rule or junction, or look elsewhere"
                )
            test(**{key: value for key, value in fixtures.items() if key in wanted.parameters})

        for attribute in ("__name__", "__qualname__", "__module__", "__doc__"):
            setattr(wrapper, attribute, getattr(test, attribute))
        wrapper.__dict__.update(test.__dict__)
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters = [p.replace(kind=keyword) for p in wanted.parameters.values()]
        parameters += [inspect.Parameter(name, keyword) for name in needed if name not in wanted.parameters]
        wrapper.__signature__ = wanted.replace(parameters=parameters)  # type: ignore[attr-defined]
        return wrapper

    return decorate


def _traffic(given: str | Factory | None, space: Mapping[str, Any]) -> Factory | None:
    """Return what drives the vehicles around a subject, None where there is none in the space to search."""
    if space.get("subject") is None:
        if given is not None:
            raise ScenarioError("traffic= drives the vehicles beside a subject: say subject=0, or leave traffic= out")
        return None
    return Policy.of("reference" if given is None else given).factory


def look_for(  # noqa: PLR0913 - keywords; a search has many settings
    junction: str,
    autopilot: Factory,
    rule: str | Rule,
    *,
    traffic: str | Factory | None = None,
    budget: int = 200,
    seed: int = 0,
    fleet: Fleet | None = None,
    name: str | None = None,
    simulator: Simulator | None = None,
    **space: Any,
) -> Counterexample | None:
    """Look for a scenario in which a rule is broken.

    Args:
        junction: built-in name, or id of a junction in ``map``.
        autopilot: drives all vehicles, or the subject.
        rule: the rule to break.
        traffic: with ``subject``, what drives the others; the reference by default.
        budget: most simulations before a counterexample, and most for making it simpler.
        seed: of the search.
        fleet: the bodies of the vehicles; passenger cars by default.
        name: under which counterexamples are kept in the example database; None keeps none.
        simulator: what makes the runs, as for `simulate`.
        space: where to look, see `strategies.scenarios`.

    Returns:
        The simplest counterexample that was found, or None.

    Raises:
        RunError: a run ended by a fault; the scenario is in the message.
    """
    around = _traffic(traffic, space)
    trial = _Trial(rule, budget, lambda s: Case(s, autopilot, around, fleet or Fleet()), simulator)
    return _search(junction, trial, seed, name, space)


def _search(junction: str, trial: _Trial, seed: int, name: str | None, space: Mapping[str, Any]) -> Counterexample | None:
    """Have Hypothesis try scenarios until one breaks the rule of `trial`; see `look_for`."""
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

    # Hypothesis tells stored examples apart by the name of the function.
    attempt.__name__ = re.sub(r"\W", "_", f"{name}__{junction}__{trial.rule.name}")
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
    # A seed turns the database off, so it comes first.
    search = configured(seeded(seed)(given(strategies.scenarios(junction, simulator=trial.simulator, **space))(attempt)))
    try:
        search()
    except _Broken:
        return Counterexample(simplest[0], trial.known[simplest[0]], trial.first or 0, trial.simulations)
    return None


class _Broken(Exception):
    """Tells Hypothesis of a counterexample; it runs the simplest one last."""


class _Trial:
    """Simulates every scenario once, and no more than the budget allows."""

    def __init__(self, rule: str | Rule, budget: int, case: Callable[[Scenario], Case], simulator: Simulator | None) -> None:
        self.rule = get_rule(rule)
        self.budget = budget
        self.simulations = 0
        self.triggered = False
        """Whether the rule applied in any of them."""
        self.first: int | None = None
        """Simulations up to the first counterexample."""
        self.counts: dict[Scenario, bool] = {}
        """Whether the violation in a scenario could have been avoided."""
        self.known: dict[Scenario, Verdict] = {}
        self._case = case
        self.simulator = simulator

    def judge(self, scenario: Scenario) -> Verdict | None:
        """Return the verdict, or None where the budget is spent."""
        if scenario not in self.known:
            if self.simulations - (self.first or 0) >= self.budget:
                return None
            self.simulations += 1
            run = simulate(self._case(scenario), self.simulator)
            verdict = self.known[scenario] = check(run, self.rule)
            self.triggered = self.triggered or verdict.status not in (Status.NA, Status.ERROR)
            self.counts[scenario] = broken(run, verdict) and avoidable(run, self.rule)
            if self.first is None and (self.counts[scenario] or verdict.status is Status.ERROR):
                self.first = self.simulations
        verdict = self.known[scenario]
        if verdict.status is Status.ERROR:
            raise RunError(f"{scenario!r} can't be judged by {self.rule.name}: {verdict.reason}")
        return verdict


def score(verdict: Verdict) -> float:
    """Return how near a run came to breaking the rule: seconds, greater is nearer.

    Where the rule was triggered, the greatest margin of its instances; else, far below, how much of its premise was missing.
    """
    margins = [i.margin for i in verdict.instances if i.margin is not None]
    if verdict.status is Status.NA:
        return -100.0 - 10.0 * (len(verdict.near.missing) if verdict.near else 10)
    return max(margins, default=-50.0)


def broken(run: Run, verdict: Verdict) -> bool:
    """Return whether a run breaks a rule; what a collision cut short in the middle is open, not broken."""
    return verdict.status is Status.FAIL or (verdict.status is Status.OPEN and not cut_short_by(run))


def avoidable(run: Run, rule: Rule) -> bool:
    """Return whether the vehicles, arriving as they do in a run, could have obeyed a rule."""
    there = run.zone >= Zone.ENTRANCE
    arrivals = np.where(there.any(axis=0), there.argmax(axis=0), run.steps) * run.dt
    return decide(Model(run.junction, run.agents, [float(time) for time in arrivals]), [rule]).possible


def pasteable(scenario: Scenario, rule: str) -> str:
    """Return a test that runs a scenario and judges it by a rule."""

    def text(values: tuple[float, ...]) -> str:
        return f"{values[0]:g}" if len(set(values)) == 1 else f"({', '.join(f'{v:g}' for v in values)})"

    place = scenario.place
    built_in = place.map is None
    arguments = [repr(place.name if built_in else place.id), f"scenarios={label(scenario.directions)!r}"]
    arguments += [f"distances={text(scenario.distances)}", f"speeds={text(scenario.speeds)}", f"rules={rule!r}"]
    arguments += [] if built_in else [f"map={place.map!r}"]
    for name, usual in (("subject", None), ("wait", 1.5), ("aggression", 1), ("duration", 60.0)):
        if getattr(scenario, name) != usual:
            arguments.append(f"{name}={getattr(scenario, name)!r}")
    lines = [
        f"@rvads.scenario({', '.join(arguments)})",
        "def test_counterexample(run, rule, monitor):",
        "    monitor.check(rule)",
    ]
    return "\n".join(lines)


def _violation(found: Counterexample) -> RuleViolation:
    verdict = found.verdict
    kind = OpenObligation if verdict.status is Status.OPEN else RuleViolation
    error = kind(f"{verdict.message}, in {found.scenario.name}")
    error.add_note(verdict.explanation)
    more = found.simulations - found.found
    error.add_note(
        f"found in simulation {found.found}, made simpler in {more} more; to see it again:\n\n"
        + pasteable(found.scenario, verdict.rule)
    )
    return error
