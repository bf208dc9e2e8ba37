"""A counterexample, and how it is told."""

from __future__ import annotations

from dataclasses import dataclass

from pytest_rvads.errors import OpenObligation, RuleViolation
from pytest_rvads.logic.judging.verdicts import Status, Verdict
from pytest_rvads.scenarios.classes import label
from pytest_rvads.scenarios.scenario import Scenario, usual_duration

__all__ = ["Counterexample", "pasteable", "violation"]


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A scenario in which a rule is broken, as simple as it could be made."""

    scenario: Scenario
    verdict: Verdict
    found: int
    """Simulations up to the first counterexample."""
    simulations: int
    """All simulations, those of shrinking included."""


def pasteable(scenario: Scenario, rule: str) -> str:
    """Return a test that runs a scenario and judges it by a rule."""

    def text(values: tuple[float, ...]) -> str:
        return f"{values[0]:g}" if len(set(values)) == 1 else f"({', '.join(f'{v:g}' for v in values)})"

    place = scenario.place
    built_in = place.map is None
    arguments = [repr(place.name if built_in else place.id), f"scenarios={label(scenario.directions, place.lanes)!r}"]
    arguments += [f"distances={text(scenario.distances)}", f"speeds={text(scenario.speeds)}", f"rules={rule!r}"]
    arguments += [] if built_in else [f"map={place.map!r}"]
    for name, usual in (("subject", None), ("wait", 1.5), ("aggression", 1), ("duration", usual_duration(place))):
        if getattr(scenario, name) != usual:
            arguments.append(f"{name}={getattr(scenario, name)!r}")
    lines = [
        f"@rvads.scenario({', '.join(arguments)})",
        "def test_counterexample(run, rule, monitor):",
        "    monitor.check(rule)",
    ]
    return "\n".join(lines)


def violation(found: Counterexample) -> RuleViolation:
    """Return the failure that tells of a counterexample."""
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
