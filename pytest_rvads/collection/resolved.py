"""The marks of a test resolved: the junctions, the runs at each junction, and the sample of runs that is drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from pytest_rvads.collection.cells import Cell, Traced, Unfit, cells_of, runs_of
from pytest_rvads.collection.misuse import told_at
from pytest_rvads.errors import ScenarioError
from pytest_rvads.stratified import draw

if TYPE_CHECKING:
    from pytest_rvads.drivers.traffic import Policy
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.scenarios.selection import Selection

__all__ = ["Found", "NoRoom", "PlannedRun", "Resolved", "Runs"]


class NoRoom(ScenarioError):
    """No scenario of a junction has room for its vehicles.

    Cause: approaches that are shorter than the distances asked for.
    Remedy: smaller distances, fewer followers, or other junctions.
    """


@dataclass(frozen=True)
class Resolved:
    """What one mark asks for at one junction."""

    mark: str
    """File and line."""
    selection: Selection
    traffic: tuple[Policy | None, ...]
    """One after the other; None alone without a subject."""
    rules: tuple[Rule | None, ...]
    """To judge by; None alone where the test does not run over rules."""
    requirement: tuple[str, ...]

    @cached_property
    def axis(self) -> list[tuple[Rule | None, Traced]]:
        """The rules, with the requirements that each rule traces to in this test."""
        mine = self.requirement
        return [(rule, (*mine, rule.requirement) if rule and rule.requirement else mine) for rule in self.rules]

    @property
    def runs(self) -> int:
        """Number of runs, those included that have no room."""
        return self.selection.count() * self.selection.points * len(self.traffic)

    def check(self) -> None:
        """See that every scenario that is named exists, and that some scenario has room for its vehicles.

        Raises:
            ScenarioError: one does not.
            NoRoom: none has.
        """
        if self.selection.scenarios is not None:
            for _ in replace(self.selection, configurations=self.selection.configurations[:1]):
                pass
        unfit = Unfit()
        if self.selection.count() and next(runs_of(self.selection, self.traffic, unfit), None) is None and unfit.first:
            raise NoRoom(str(unfit.first))


@dataclass(frozen=True, slots=True)
class Found:
    """What a mark comes to."""

    resolved: tuple[Resolved, ...]
    """At the junctions that have what is asked for."""
    left_out: tuple[tuple[str, str], ...]
    """Junctions that the mark names and that can't be used, with the reason for each junction."""
    passed_over: int
    """How many junctions more would do, but for a limit."""


class PlannedRun(NamedTuple):
    """A run that a test asks for."""

    resolved: Resolved
    scenario: Scenario
    policy: Policy | None

    def cells(self) -> Iterator[Cell]:
        """Yield its cells, one per rule."""
        return cells_of(self.scenario, self.policy, self.resolved.axis)

    @property
    def name(self) -> str:
        """Its id, as in ids of items."""
        from pytest_rvads.scenarios.ids import run_id

        return run_id(self.scenario, None if self.policy is None else self.policy.name)

    @property
    def stratum(self) -> tuple[str, str, str]:
        """Junction, class and configuration."""
        scenario = self.scenario
        return scenario.place.name, scenario.orbit or str(scenario.number), scenario.point


class Runs:
    """The runs that the marks of a test ask for, made anew whenever they are gone through: there may be more than fit in memory.

    Args:
        resolved: what the marks come to, in their order.
        test: node id.
        watch: yields what it is given and tells how much of it is done, whenever they are gone through.
    """

    def __init__(
        self, resolved: Sequence[Resolved], test: str, watch: Callable[[Iterator[PlannedRun]], Iterator[PlannedRun]] = iter
    ) -> None:
        self._resolved = resolved
        self._test = test
        self._watch = watch
        self._twice = len({one.selection.place.name for one in resolved}) < len(resolved)
        """Whether marks may ask for the same run."""
        self.total = 0
        """How many there are, once they were gone through."""
        self.unfit = 0
        """How many scenarios have no room for their vehicles, likewise."""

    def __iter__(self) -> Iterator[PlannedRun]:
        """Yield each run once per distinct mark that asks for the run."""
        return self._watch(self._made())

    def _made(self) -> Iterator[PlannedRun]:
        self.total, self.unfit = 0, 0
        known: dict[str, PlannedRun] = {}
        for resolved in self._resolved:
            unfit = Unfit()
            with told_at(f"{resolved.mark}: {self._test}"):
                for scenario, policy in runs_of(resolved.selection, resolved.traffic, unfit):
                    run = PlannedRun(resolved, scenario, policy)
                    if self._twice and (first := known.setdefault(run.name, run)) is not run and first[1:] == run[1:]:
                        continue
                    self.total += 1
                    yield run
            self.unfit += unfit.count

    def drawn(self, size: int, seed: int) -> list[PlannedRun]:
        """Return a sample of `size` runs, spread over junctions, classes and configurations."""
        return draw(self, size, seed, lambda run: run.stratum, lambda run: run.name)
