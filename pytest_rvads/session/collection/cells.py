"""Cells: a cell is the run and the rule of one item of pytest, with the keys by which ``-m`` and known deficiencies select it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from numbers import Integral
from typing import TYPE_CHECKING, Any

from pytest_rvads.session.collection.misuse import several
from pytest_rvads.support.errors import ScenarioError, suggest

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
    """Return a digest of the formula of a rule, its tie window and the agents that it binds; empty without a rule."""
    return sha256(repr((rule.text, rule.tie, rule.bound)).encode()).hexdigest()[:8] if rule else ""


@dataclass(frozen=True, slots=True)
class Cell:
    """The run and the rule of one item with a simulated run."""

    scenario: Scenario
    rule: Rule | None
    """None if the test does not run over rules."""
    traffic: Policy | None
    """Policy of the traffic in a scenario with a subject, else None."""
    id: str = field(compare=False)
    """The part in brackets of the item's id."""
    run: str = field(compare=False)
    """The id without the rule, which all cells of a run share."""
    keys: dict[str, str | int] = field(compare=False)
    """Keys and values that select the cell."""
    requirements: tuple[str, ...] = field(compare=False)
    """Identifiers of the requirements that scenario and rule trace to."""

    @property
    def ways(self) -> int:
        """Number of arms of the junction."""
        return self.scenario.ways

    @property
    def start(self) -> dict[str, str | int]:
        """The first fields of the record of the item."""
        place = self.scenario.place
        return {**self.keys, "orbit": self.scenario.orbit, "control": place.control.value, "formula": _digest(self.rule)}


@dataclass(frozen=True, slots=True)
class RecordedCell:
    """The run and the rule of one item with a recorded run."""

    path: str
    index: int
    """Index of the run in its file."""
    rule: Rule | None
    """None if the test does not run over rules."""
    trouble: str = field(compare=False)
    """Reason why the file can't be read; empty for a readable file."""
    ways: int = field(compare=False)
    """Number of arms of the junction."""
    control: str = field(compare=False)
    """Control of the junction; empty if the file can't be read."""
    id: str = field(compare=False)
    """The part in brackets of the item's id."""
    run: str = field(compare=False)
    """The id without the rule, which all cells of a run share."""
    keys: dict[str, str | int] = field(compare=False)
    """Keys and values that select the cell."""
    requirements: tuple[str, ...] = field(compare=False)
    """Identifiers of the requirements that mark and rule trace to."""

    @property
    def start(self) -> dict[str, str | int]:
        """The first fields of the record of the item."""
        return {**self.keys, "control": self.control, "formula": _digest(self.rule)}


@dataclass(slots=True)
class Unfit:
    """Counts the scenarios that are left out because a vehicle has no room at its start."""

    count: int = 0
    first: ScenarioError | None = None
    """Reason for the first scenario that was left out."""

    def add(self, error: ScenarioError) -> None:
        """Count a scenario."""
        self.count += 1
        self.first = self.first or error


def runs_of(selection: Selection, policies: Sequence[Policy | None], unfit: Unfit) -> Iterator[tuple[Scenario, Policy | None]]:
    """Yield the runs of a selection: each scenario with each policy of the traffic.

    Args:
        selection: the scenarios.
        policies: policies of the traffic; only None without traffic.
        unfit: counts the scenarios that are left out.
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
    """The arguments of ``@rvads.known``: the cells of a known deficiency."""

    place: str
    """File and line of the mark."""
    name: str
    reason: str
    where: Mapping[str, tuple[str | int, ...]]
    """Key of cells to the values that match."""

    @classmethod
    def of(cls, place: str, name: str, reason: str, where: Mapping[str, Any]) -> Known:
        """Check the arguments of a mark.

        Raises:
            ScenarioError: a key is unknown, or a value is neither a word nor a number.
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
        """Return whether a cell has the deficiency."""
        return all(cell.keys.get(key) in values for key, values in self.where.items())
