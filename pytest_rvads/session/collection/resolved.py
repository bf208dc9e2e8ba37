"""What the marks of a test select: junctions, the runs at each junction, and a sample of the runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from pytest_rvads.session.collection.cells import Cell, Traced, Unfit, cells_of, runs_of
from pytest_rvads.session.collection.misuse import told_at
from pytest_rvads.support.errors import ScenarioError
from pytest_rvads.support.stratified import draw

if TYPE_CHECKING:
    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.scenarios.selection import Selection

__all__ = ["NoRoom", "PlannedRun", "Resolved", "Runs", "Selected"]


class NoRoom(ScenarioError):
    """No scenario of a junction has room for its vehicles.

    Cause: approaches that are shorter than the distances asked for.
    Remedy: smaller distances, fewer followers, or other junctions.
    """


@dataclass(frozen=True)
class Resolved:
    """What one mark selects at one junction."""

    mark: str
    """File and line of the mark."""
    selection: Selection
    traffic: tuple[Policy | None, ...]
    """Policies of the traffic; only None without a subject."""
    rules: tuple[Rule | None, ...]
    """Rules of the items; only None if the test does not run over rules."""
    requirement: tuple[str, ...]

    @cached_property
    def axis(self) -> list[tuple[Rule | None, Traced]]:
        """The rules, with the requirements that each rule traces to in this test."""
        of_mark = self.requirement
        return [(rule, (*of_mark, rule.requirement) if rule and rule.requirement else of_mark) for rule in self.rules]

    @property
    def runs(self) -> int:
        """Number of runs, including runs without room for their vehicles."""
        return self.selection.count() * self.selection.points * len(self.traffic)

    def check(self) -> None:
        """Check that every named scenario exists, and that at least one scenario has room for its vehicles.

        Raises:
            ScenarioError: a named scenario does not exist.
            NoRoom: no scenario has room.
        """
        if self.selection.scenarios is not None:
            for _ in replace(self.selection, configurations=self.selection.configurations[:1]):
                pass
        unfit = Unfit()
        if self.selection.count() and next(runs_of(self.selection, self.traffic, unfit), None) is None and unfit.first:
            raise NoRoom(str(unfit.first))


@dataclass(frozen=True, slots=True)
class Selected:
    """What a mark selects."""

    resolved: tuple[Resolved, ...]
    """What the mark selects at each junction that fits the mark."""
    left_out: tuple[tuple[str, str], ...]
    """Junctions that the mark names and that can't be used, with the reason for each junction."""
    passed_over: int
    """Number of further junctions that fit the mark and exceed its limit."""


class PlannedRun(NamedTuple):
    """A planned run of a test."""

    resolved: Resolved
    scenario: Scenario
    policy: Policy | None

    def cells(self) -> Iterator[Cell]:
        """Yield the cells of the run, one per rule."""
        return cells_of(self.scenario, self.policy, self.resolved.axis)

    @property
    def name(self) -> str:
        """The id of the run within ids of items."""
        from pytest_rvads.scenarios.ids import run_id

        return run_id(self.scenario, None if self.policy is None else self.policy.name)

    @property
    def stratum(self) -> tuple[str, str, str]:
        """Junction, class and configuration."""
        scenario = self.scenario
        return scenario.place.name, scenario.orbit or str(scenario.number), scenario.point


class Runs:
    """The runs that the marks of a test select, made at each iteration, because they may not fit into memory.

    Args:
        resolved: what the marks select, in the order of the marks.
        test: node id of the test.
        watch: yields the runs and shows the progress, at each iteration.
    """

    def __init__(
        self, resolved: Sequence[Resolved], test: str, watch: Callable[[Iterator[PlannedRun]], Iterator[PlannedRun]] = iter
    ) -> None:
        self._resolved = resolved
        self._test = test
        self._watch = watch
        self._repeats = len({at_junction.selection.place.name for at_junction in resolved}) < len(resolved)
        """Whether several marks may select the same run."""
        self.total = 0
        """Number of runs at the last iteration."""
        self.unfit = 0
        """Number of scenarios without room for their vehicles at the last iteration."""

    def __iter__(self) -> Iterator[PlannedRun]:
        """Yield each run once per distinct mark that asks for the run."""
        return self._watch(self._distinct())

    def _distinct(self) -> Iterator[PlannedRun]:
        self.total, self.unfit = 0, 0
        runs: dict[str, PlannedRun] = {}
        for resolved in self._resolved:
            unfit = Unfit()
            with told_at(f"{resolved.mark}: {self._test}"):
                for scenario, policy in runs_of(resolved.selection, resolved.traffic, unfit):
                    run = PlannedRun(resolved, scenario, policy)
                    if self._repeats and (first := runs.setdefault(run.name, run)) is not run and first[1:] == run[1:]:
                        continue
                    self.total += 1
                    yield run
            self.unfit += unfit.count

    def drawn(self, size: int, seed: int) -> list[PlannedRun]:
        """Return a sample of `size` runs, spread over junctions, classes and configurations."""
        return draw(self, size, seed, lambda run: run.stratum, lambda run: run.name)
