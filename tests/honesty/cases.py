"""What one drive tells an honest judge: by every rule of the road, who broke it and whose doing it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import pytest_rvads as rvads
from pytest_rvads.logic.rules.book import rules_for

from .drivers import REFERENCE

__all__ = ["BROKEN", "Case", "at", "told", "verdicts"]

BROKEN = ("ERROR", "FAIL", "OPEN", "UNAVOIDABLE", "PROVOKED")


@dataclass(frozen=True, slots=True)
class Case:
    """A drive, and what the rules of the road say of it."""

    scenario: rvads.Scenario
    driver: Callable[[], Any]
    """Drives the subject; everybody, where there is none."""
    tells: Mapping[str, str]
    """Rule to outcome and who is to blame, such as ``FAIL a0``; under ``end``, where that matters, why the run ended. What is
    not named here is PASS or NA."""
    traffic: Callable[[], Any] = REFERENCE
    """Drives the others, where there is a subject."""

    def run(self) -> rvads.Run:
        """Simulate it."""
        return rvads.simulate(
            rvads.Case(self.scenario, self.driver, traffic=None if self.scenario.subject is None else self.traffic)
        )

    def told(self, run: rvads.Run | None = None) -> dict[str, str]:
        """Return what is to be compared with `tells`."""
        run = run or self.run()
        found = verdicts(run) | {"end": run.provenance["end"]}
        return {what: text for what, text in found.items() if what in self.tells or text.split()[0] in BROKEN}


def at(
    junction: str | rvads.Junction, directions: str, *, distance: Any = 20.0, duration: float = 40.0, **more: Any
) -> rvads.Scenario:
    """Return a scenario whose subject, if nothing else is said, comes from entrance 0."""
    place = rvads.find(junction) if isinstance(junction, str) else junction
    return rvads.Scenario(place, directions, distance=distance, duration=duration, **{"subject": 0, **more})


def told(verdict: rvads.Verdict) -> str:
    """Return a verdict as the catalogue writes it: the outcome, and who is to blame for what was broken."""
    outcome = "UNAVOIDABLE" if verdict.unavoidable else "PROVOKED" if verdict.provoked else str(verdict.status)
    return " ".join((outcome, *sorted(verdict.responsible)))


def verdicts(run: rvads.Run) -> dict[str, str]:
    """Judge a run by every rule of the road that is about its junction."""
    return {rule.name: told(rvads.check(run, rule)) for rule in rules_for("road", run.junction)}
