"""Cells: what one item runs and judges, and what it is selected by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.scenario import Scenario

__all__ = ["DEFAULT", "KEYS", "Cell", "cells_of"]

KEYS = ("junction", "cls", "scenario", "cfg", "rotation", "seat", "traffic", "rule")
"""Keywords that select cells, in ``-m "rvads(cls=7)"`` and in ``@rvads.known(cls=7)``."""

DEFAULT = "reference"
"""The traffic policy where a mark names none; ids leave it out."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What one item runs and judges."""

    scenario: Scenario
    rule: Rule | None
    """None where the test does not ask for the rule axis."""
    traffic: Policy | None
    """Drives the others where the scenario has a subject."""
    id: str = field(compare=False)
    """The part in brackets of the item's id."""
    run: str = field(compare=False)
    """The id without the rule: what cells of the same run share."""
    keys: dict[str, str | int] = field(compare=False)
    """What the cell is selected by; every value a str or an int."""
    requirements: tuple[str, ...] = field(compare=False)
    """What scenario and rule trace to."""


def cells_of(
    scenario: Scenario,
    policies: Sequence[Policy | None],
    rules: Sequence[Rule | None],
    requirements: tuple[str, ...] = (),
) -> Iterator[Cell]:
    """Yield the cells of a scenario, the rule innermost.

    There are thousands of cells, so what they share is worked out once.

    Args:
        scenario: what to run.
        policies: of the traffic.
        rules: to judge by.
        requirements: identifiers of the requirements that the scenario traces to.
    """
    from pytest_rvads.scenarios.classes import label

    shared: dict[str, str | int] = {
        "junction": scenario.place.name,
        "cls": scenario.number,
        "scenario": label(scenario.placed),
        "cfg": scenario.point,
        "rotation": scenario.rotation,
    }
    if scenario.subject is not None:
        shared["seat"] = scenario.subject
    name = scenario.name
    for policy in policies:
        run = name if policy is None or policy.name == DEFAULT else f"{name}-{policy.name}"
        keys = shared | {"traffic": policy.name} if policy else shared
        for rule in rules:
            if rule is None:
                yield Cell(scenario, rule, policy, run, run, keys, requirements)
            else:
                traced = (*requirements, rule.requirement) if rule.requirement else requirements
                yield Cell(scenario, rule, policy, f"{run}-{rule.name}", run, keys | {"rule": rule.name}, traced)
