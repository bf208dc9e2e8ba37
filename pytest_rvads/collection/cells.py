"""Cells: one cell is the run and the rule of one pytest item, with the keys that select the item and its known deficiencies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from numbers import Integral
from typing import TYPE_CHECKING, Any

from pytest_rvads.collection.misuse import several
from pytest_rvads.errors import ScenarioError, suggest

if TYPE_CHECKING:
    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.scenarios.selection import Selection

__all__ = ["KEYS", "Cell", "Known", "RecordedCell", "Unfit", "cells_of", "run_name", "runs_of"]

KEYS = ("junction", "cls", "scenario", "cfg", "rotation", "seat", "traffic", "recording", "rule")
"""Keywords that select cells, in ``-m "rvads(cls=7)"`` and in ``@rvads.known(cls=7)``."""

Traced = tuple[str, ...]
"""Identifiers of requirements."""


def run_name(nodeid: str, cell: Cell | RecordedCell) -> str:
    """Return the id of an item without the rule, the name that all items of one run of a test share.

    Args:
        nodeid: pytest's id of the item.
        cell: the run and the rule of the item.
    """
    return nodeid.replace(cell.id, cell.run)


def _digest(rule: Rule | None) -> str:
    """Return what tells the formula of a rule, its tie window and who is bound by it from others; empty without a rule."""
    return sha256(repr((rule.text, rule.tie, rule.bound)).encode()).hexdigest()[:8] if rule else ""


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

    @property
    def ways(self) -> int:
        """Number of arms of the junction."""
        return self.scenario.ways

    @property
    def start(self) -> dict[str, str | int]:
        """What its record begins with."""
        place = self.scenario.place
        return {**self.keys, "orbit": self.scenario.orbit, "control": place.control.value, "formula": _digest(self.rule)}


@dataclass(frozen=True, slots=True)
class RecordedCell:
    """What one item judges: a run of a file."""

    path: str
    index: int
    """Of the run among those of its file."""
    rule: Rule | None
    """None where the test does not ask for the rule axis."""
    trouble: str = field(compare=False)
    """Why the file can't be read, or nothing."""
    ways: int = field(compare=False)
    """Number of arms of the junction."""
    control: str = field(compare=False)
    """What regulates the junction, empty where the file can't be read."""
    id: str = field(compare=False)
    """The part in brackets of the item's id."""
    run: str = field(compare=False)
    """The id without the rule: what cells of the same run share."""
    keys: dict[str, str | int] = field(compare=False)
    """What the cell is selected by."""
    requirements: tuple[str, ...] = field(compare=False)
    """What mark and rule trace to."""

    @property
    def start(self) -> dict[str, str | int]:
        """What its record begins with."""
        return {**self.keys, "control": self.control, "formula": _digest(self.rule)}


@dataclass(slots=True)
class Unfit:
    """Scenarios that are left out since a vehicle has no room where it would start."""

    count: int = 0
    first: ScenarioError | None = None
    """Why the first of them is."""

    def add(self, error: ScenarioError) -> None:
        """Count one more."""
        self.count += 1
        self.first = self.first or error


def runs_of(selection: Selection, policies: Sequence[Policy | None], unfit: Unfit) -> Iterator[tuple[Scenario, Policy | None]]:
    """Yield the runs of a selection: scenario, and what drives the traffic.

    Args:
        selection: the scenarios.
        policies: what drives the traffic, one after the other.
        unfit: takes the scenarios that are left out.
    """
    for scenario in selection.fitting(unfit.add):
        yield from ((scenario, policy) for policy in policies)


def cells_of(scenario: Scenario, policy: Policy | None, axis: Sequence[tuple[Rule | None, Traced]]) -> Iterator[Cell]:
    """Yield the cells of a run: one cell per rule of the axis, with the requirements that the rule traces to."""
    from pytest_rvads.scenarios.ids import run_id

    run = run_id(scenario, None if policy is None else policy.name)
    keys: dict[str, str | int] = {
        "junction": scenario.place.name,
        "cls": scenario.number,
        "scenario": scenario.label,
        "cfg": scenario.point,
        "rotation": scenario.rotation,
    }
    if scenario.subject is not None:
        keys["seat"] = scenario.subject
    if policy:
        keys["traffic"] = policy.name
    for rule, traced in axis:
        if rule is None:
            yield Cell(scenario, rule, policy, run, run, keys, traced)
        else:
            yield Cell(scenario, rule, policy, f"{run}-{rule.name}", run, {**keys, "rule": rule.name}, traced)


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """Cells of a known deficiency, as ``@rvads.known`` asks for them."""

    place: str
    """File and line of the mark."""
    name: str
    reason: str
    where: Mapping[str, tuple[str | int, ...]]
    """The values that match, by key of cells."""

    @classmethod
    def of(cls, place: str, name: str, reason: str, where: Mapping[str, Any]) -> Known:
        """Check arguments.

        Raises:
            ScenarioError: another key, or something else than words and numbers.
        """
        for argument, text in (("name", name), ("reason", reason)):
            if not isinstance(text, str):
                raise ScenarioError(f"{argument} of @rvads.known must be a text in quotes, got {text!r}")
        values = {}
        for key, value in where.items():
            if key not in KEYS:
                raise ScenarioError(f"@rvads.known selects by {', '.join(KEYS)}, got {key!r}{suggest(key, KEYS)}")
            values[key] = several(key, (value,) if value is None else value, (str, Integral), "words or numbers") or ()
        return cls(place, name, reason, values)

    def __str__(self) -> str:
        return f"@rvads.known({self.name!r}{''.join(f', {key}={values!r}' for key, values in self.where.items())})"

    def matches(self, cell: Cell | RecordedCell) -> bool:
        """Tell whether a cell has the deficiency."""
        return all(cell.keys.get(key) in values for key, values in self.where.items())
