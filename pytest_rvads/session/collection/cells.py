"""Cells: a cell is the run and the rule of one test item, with the keys by which ``-m`` and ``@rvads.known`` select the item.

The marks of a test select cells: junctions, the runs at each junction, and a sample of the runs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from numbers import Integral
from typing import TYPE_CHECKING, Any, NamedTuple

from pytest_rvads.session.collection.misuse import refuse_unknown, several, told_at
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.stratified import draw

if TYPE_CHECKING:
    import pytest

    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.scenarios.selection import Selection

KEYS = ("junction", "cls", "scenario", "cfg", "rotation", "seat", "pedestrians", "traffic", "recording", "rule")
"""Keywords that select cells, in ``-m "rvads(cls=7)"`` and in ``@rvads.known(cls=7)``."""

_MARKS = (
    "rvads_scenario(junction, ...): run over scenarios; written as @rvads.scenario",
    "rvads_recorded(pattern, ...): run over recorded runs; written as @rvads.recorded",
    "rvads_known(name, ...): cells of a known deficiency; written as @rvads.known",
    f"rvads({', '.join(KEYS)}): on every item, to select by -m \"rvads(cls=7, rule='p1')\"",
)


def register_marks(config: pytest.Config) -> None:
    """Register the marks of the plugin with pytest, and refuse unknown keywords in ``-m "rvads(...)"``."""
    unquoted = re.sub(r"""'[^']*'|"[^"]*\"""", "", config.option.markexpr)
    selections = " ".join(re.findall(r"\brvads\s*\(([^)]*)", unquoted))
    refuse_unknown("-m rvads(...) selects by", re.findall(r"(\w+)\s*=", selections), KEYS)
    for line in _MARKS:
        config.addinivalue_line("markers", line)


def run_name(nodeid: str, cell: Cell | RecordedCell) -> str:
    """Return the id of a test item without the rule; all items of a test that judge one run share this name."""
    return nodeid.replace(cell.id, cell.run)


def _digest(rule: Rule | None) -> str:
    """Return a digest of a rule: its formula, its tie window, and the agents to which the rule applies; empty without a rule."""
    return sha256(repr((rule.text, rule.tie, rule.bound)).encode()).hexdigest()[:8] if rule else ""


def named(
    run: str, keys: dict[str, str | int], rule: Rule | None, requirements: tuple[str, ...]
) -> tuple[str, str, dict[str, str | int], tuple[str, ...]]:
    """Return id, run, keys and requirements of the cell of a run and a rule, the last fields of a cell."""
    if rule is None:
        return run, run, keys, requirements
    traced = (*requirements, rule.requirement) if rule.requirement else requirements
    return f"{run}-{rule.name}", run, {**keys, "rule": rule.name}, traced


@dataclass(frozen=True, slots=True)
class Cell:
    """The run and the rule of one test item that simulates a run."""

    scenario: Scenario
    rule: Rule | None
    """None if the test does not run over rules."""
    traffic: Policy | None
    """Policy (driver) of the traffic in a scenario with a subject; None in a scenario without a subject."""
    id: str = field(compare=False)
    """The part in brackets of the test item's id."""
    run: str = field(compare=False)
    """Name of the run: the id without the rule, which all cells of a run share."""
    keys: dict[str, str | int] = field(compare=False)
    """By key of `KEYS`, the value with which ``-m`` and ``@rvads.known`` select the cell."""
    requirements: tuple[str, ...] = field(compare=False)

    @property
    def ways(self) -> int:
        """Number of arms of the junction."""
        return self.scenario.ways

    @property
    def start(self) -> dict[str, str | int]:
        """The fields of the test item's record that are known before the item runs, by name."""
        place = self.scenario.place
        return {**self.keys, "orbit": self.scenario.orbit, "control": place.control.value, "formula": _digest(self.rule)}


@dataclass(frozen=True, slots=True)
class RecordedCell:
    """The run and the rule of one test item that judges a recorded run."""

    path: str
    index: int
    rule: Rule | None
    trouble: str = field(compare=False)
    """Reason why the file can't be read; empty for a readable file."""
    ways: int = field(compare=False)
    control: str = field(compare=False)
    """Control of the junction; empty if the file can't be read."""
    id: str = field(compare=False)
    run: str = field(compare=False)
    keys: dict[str, str | int] = field(compare=False)
    requirements: tuple[str, ...] = field(compare=False)

    @property
    def start(self) -> dict[str, str | int]:
        """The fields of the test item's record that are known before the item runs, by name."""
        return {**self.keys, "control": self.control, "formula": _digest(self.rule)}


@dataclass(slots=True)
class Unfit:
    """Counts the scenarios that are left out."""

    count: int = 0
    """Number of scenarios in which a vehicle has no room at its start."""
    crossed: int = 0
    """Number of scenarios in which a pedestrian would have crossed before the run begins."""
    first: ScenarioError | None = None
    """Reason for the first scenario that was left out."""

    def add(self, error: ScenarioError) -> None:
        """Count a scenario that is left out, with the reason."""
        from pytest_rvads.scenarios.pedestrians import Crossed

        if isinstance(error, Crossed):
            self.crossed += 1
        else:
            self.count += 1
        self.first = self.first or error


def runs_of(selection: Selection, policies: Sequence[Policy | None], unfit: Unfit) -> Iterator[tuple[Scenario, Policy | None]]:
    """Yield the runs of a selection: each scenario with each traffic policy; without traffic, the only policy is None."""
    for scenario in selection.fitting(unfit.add):
        yield from ((scenario, policy) for policy in policies)


def cells_of(
    scenario: Scenario, policy: Policy | None, rules: Sequence[Rule | None], requirements: tuple[str, ...]
) -> Iterator[Cell]:
    """Yield the cells of a run, one cell per rule; None is the only rule of a test that does not run over rules."""
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
    if scenario.pedestrians:
        keys["pedestrians"] = scenario.walking
    if policy:
        keys["traffic"] = policy.name
    for rule in rules:
        yield Cell(scenario, rule, policy, *named(run, keys, rule, requirements))


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """The arguments of ``@rvads.known``: a known deficiency of the driver, and the test items that fail because of it."""

    place: str
    """File and line of the mark."""
    name: str
    reason: str
    where: Mapping[str, tuple[str | int, ...]]
    """By key of `KEYS`, the values of the test items that the deficiency makes fail."""

    @classmethod
    def of(cls, place: str, name: str, reason: str, where: Mapping[str, Any]) -> Known:
        """Check the arguments of a mark."""
        for argument, text in (("name", name), ("reason", reason)):
            if not isinstance(text, str):
                raise ScenarioError(f"{argument} of @rvads.known must be a text in quotes, got {text!r}")
        refuse_unknown("@rvads.known selects by", where, KEYS)
        values = {}
        for key, value in where.items():
            values[key] = several(key, (value,) if value is None else value, (str, Integral), "words or numbers") or ()
        return cls(place, name, reason, values)

    def __str__(self) -> str:
        return f"@rvads.known({self.name!r}{''.join(f', {key}={values!r}' for key, values in self.where.items())})"

    def matches(self, cell: Cell | RecordedCell) -> bool:
        """Return whether the known deficiency makes the test item of a cell fail."""
        return all(cell.keys.get(key) in values for key, values in self.where.items())


class NoRoom(ScenarioError):
    """No scenario of a junction has room for its vehicles.

    Cause: approaches that are shorter than the distances asked for.
    Remedy: smaller distances, fewer followers, or other junctions.
    """


@dataclass(frozen=True, slots=True)
class Resolved:
    """The scenarios, traffic policies and rules that one mark selects at one junction."""

    mark: str
    """File and line of the mark."""
    selection: Selection
    traffic: tuple[Policy | None, ...]
    rules: tuple[Rule | None, ...]
    """Rules of the items; None is the only entry if the test does not run over rules."""
    requirement: tuple[str, ...]

    @property
    def runs(self) -> int:
        """Number of selected runs, including runs whose vehicles have no room at the start; see `Selection.count`."""
        return self.selection.count() * self.selection.points * len(self.traffic)

    def check(self) -> None:
        """Check that every named scenario exists, and that at least one scenario has room for its vehicles."""
        if self.selection.scenarios is not None:
            for _ in replace(self.selection, configurations=self.selection.configurations[:1]):
                pass
        unfit, walks = Unfit(), self.selection.pedestrians
        if (walks or self.selection.count()) and next(runs_of(self.selection, self.traffic, unfit), None) is None:
            if unfit.first:
                raise unfit.first if unfit.crossed else NoRoom(str(unfit.first))
            if walks:
                raise ScenarioError(
                    f"no vehicle{'' if self.selection.subject is None else ' under test'} drives over a crosswalk at which "
                    f"pedestrians= lets pedestrians walk at junction {self.selection.place.name!r}: choose other crosswalks or "
                    "other scenarios"
                )


@dataclass(frozen=True, slots=True)
class Selected:
    """The junctions that a mark selects, with the runs at each junction."""

    resolved: tuple[Resolved, ...]
    """The scenarios, traffic policies and rules that the mark selects, per junction that fits the mark."""
    left_out: tuple[tuple[str, str], ...]
    """Junctions that the mark names and that can't be used, with the reason for each junction."""
    passed_over: int
    """Number of junctions that fit the mark but were not drawn, because the mark limits the number of junctions."""


class PlannedRun(NamedTuple):
    """A planned run of a test, with its rules."""

    resolved: Resolved
    scenario: Scenario
    policy: Policy | None

    def cells(self) -> Iterator[Cell]:
        """Yield the cells of the run, one cell per rule."""
        return cells_of(self.scenario, self.policy, self.resolved.rules, self.resolved.requirement)

    @property
    def name(self) -> str:
        """The id of the run within ids of items."""
        from pytest_rvads.scenarios.ids import run_id

        return run_id(self.scenario, None if self.policy is None else self.policy.name)


class Runs:
    """The runs that the marks of a test select; all runs can be larger than memory, so each iteration makes the runs again.

    The iteration yields what `watch` yields, which gets the runs and shows the progress.
    """

    def __init__(
        self, resolved: Sequence[Resolved], test: str, watch: Callable[[Iterator[PlannedRun]], Iterator[PlannedRun]]
    ) -> None:
        self._resolved = resolved
        self._test = test
        self._watch = watch
        self._repeats = len({at_junction.selection.place.name for at_junction in resolved}) < len(resolved)
        """Whether several marks can select the same run."""
        self.total = 0
        """Number of runs at the last iteration."""
        self.unfit = Unfit()
        """The scenarios that the last iteration left out."""

    def __iter__(self) -> Iterator[PlannedRun]:
        """Yield each run once per distinct mark that asks for the run."""
        return self._watch(self._distinct())

    def _distinct(self) -> Iterator[PlannedRun]:
        self.total, self.unfit = 0, Unfit()
        runs: dict[str, PlannedRun] = {}
        for resolved in self._resolved:
            with told_at(f"{resolved.mark}: {self._test}"):
                for scenario, policy in runs_of(resolved.selection, resolved.traffic, self.unfit):
                    run = PlannedRun(resolved, scenario, policy)
                    if self._repeats and (first := runs.setdefault(run.name, run)) is not run and first[1:] == run[1:]:
                        continue
                    self.total += 1
                    yield run

    def drawn(self, size: int, seed: int) -> list[PlannedRun]:
        """Return a sample of `size` runs, spread over junctions, classes and configurations."""

        def stratum(run: PlannedRun) -> tuple[str, str, str]:
            scenario = run.scenario
            return scenario.place.name, scenario.orbit or str(scenario.number), scenario.point

        return draw(self, size, seed, stratum, lambda run: run.name)
