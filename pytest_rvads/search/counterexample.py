"""Counterexamples of searches, and the errors that show a counterexample in a failed test, with code to reproduce it."""

from __future__ import annotations

from dataclasses import dataclass

from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.scenario import Scenario, usual_duration
from pytest_rvads.support.errors import OpenObligation, RuleViolation


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
