"""The planned runs at many junctions: cases one after the other, never all at once, and their numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import cached_property, partial
from typing import NamedTuple

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.session_report import Extent
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.scenarios.selection import Selection, alone, extended
from pytest_rvads.support.errors import RvadsError, ScenarioError
from pytest_rvads.support.stratified import draw

__all__ = ["Asked", "LeftOut", "Plan", "Planned"]


@dataclass(frozen=True, slots=True)
class Asked:
    """The runs requested at every junction, in the terms of ``@rvads.scenario``."""

    driver: Factory
    rules: tuple[str | Rule, ...] = ("road",)
    cover: str = "conflicts"
    occupancy: str = "arms"
    grid: tuple[str, ...] | None = None
    """Configurations; None for the paper's, or with a subject those of `ARRIVALS`, one per scenario and seat."""
    subject: int | str | None = None
    traffic: Policy | None = None
    """Drives the other vehicles if there is a subject."""
    followers: tuple[int, ...] = (0,)


class Planned(NamedTuple):
    """A case with its name."""

    name: str
    """Name of the run in ids, without a rule."""
    case: Case


class LeftOut(NamedTuple):
    """Scenarios of a junction in which a vehicle has no room at its start."""

    scenarios: int
    reason: str
    """The reason for the first scenario."""


@dataclass(eq=False)
class Plan:
    """The cases of several junctions, junction by junction; the plan can be iterated any number of times."""

    junctions: Sequence[Junction]
    asked: Asked
    only: tuple[str, ...] = ()
    """Patterns for ids of runs or verdicts, with the wildcards of file names; empty for all runs."""
    sample: int | None = None
    """Number of cases drawn, spread evenly over junctions, classes and configurations; None for all cases."""
    seed: int = 0
    _counted: dict[str, tuple[int, LeftOut | None]] = field(default_factory=dict, init=False)

    @cached_property
    def refused(self) -> dict[str, str]:
        """Reasons, by name of the junction, why none of the requested runs is possible there."""
        reasons = {}
        for place in self.junctions:
            try:
                if not self.rules(place):
                    raise ScenarioError(f"none of the rules asked for is about {place.control} junctions")
                count, unfit = self._count(place)
                if unfit and not count:
                    raise ScenarioError(unfit.reason)
            except RvadsError as error:
                reasons[place.name] = str(error)
        return reasons

    @property
    def places(self) -> list[Junction]:
        """The junctions at which runs are possible."""
        return [place for place in self.junctions if place.name not in self.refused]

    def rules(self, place: Junction) -> tuple[Rule, ...]:
        """Return the rules that judge runs at a junction.

        Raises:
            FormulaError: a rule is unknown.
        """
        return rules_for(self.asked.rules, place)

    def left_out(self, place: Junction) -> LeftOut | None:
        """Return the requested scenarios of a junction that are left out; None if no scenario is, or the junction is refused."""
        return None if place.name in self.refused else self._count(place)[1]

    def extents(self) -> dict[str, Extent]:
        """Return the extents of coverage, by junction."""
        extents: dict[str, Extent] = {}
        for place in self.places:
            for selection in self.selections(place):
                extents = extended(extents, selection)
        return extents

    @property
    def total(self) -> int:
        """Number of cases without patterns and sample."""
        return sum(self._count(place)[0] for place in self.places)

    def counts(self) -> dict[str, int]:
        """Return the number of cases per junction, in order; 0 for a refused junction."""
        if self.sample is None and not self.only:
            return {place.name: 0 if place.name in self.refused else self._count(place)[0] for place in self.junctions}
        counts = dict.fromkeys((place.name for place in self.junctions), 0)
        for planned in self:
            counts[planned.case.scenario.place.name] += 1
        return counts

    def __iter__(self) -> Iterator[Planned]:
        """Yield the cases."""
        if self.sample is None:
            yield from self._every()
        else:
            yield from self._drawn

    @cached_property
    def _drawn(self) -> list[Planned]:
        return draw(_Again(self), self.sample or 0, self.seed, _stratum, _name)

    def _every(self) -> Iterator[Planned]:
        asked = self.asked
        traffic = None if asked.traffic is None or asked.subject is None else asked.traffic
        for place in self.places:
            rules = [rule.name for rule in self.rules(place)]
            for scenario in (
                fitting_scenario for selection in self.selections(place) for fitting_scenario in selection.fitting(_nobody)
            ):
                name = run_id(scenario, None if traffic is None else traffic.name)
                if not self.only or self._wanted(name, rules):
                    yield Planned(name, Case(scenario, asked.driver, traffic.factory if traffic else None))

    def _wanted(self, name: str, rules: Sequence[str]) -> bool:
        ids = (name, *(f"{name}-{rule}" for rule in rules))
        return any(fnmatchcase(id, pattern) for pattern in self.only for id in ids)

    def selections(self, place: Junction) -> tuple[Selection, ...]:
        """Return the selections of a junction, including scenarios that do not fit; raises ScenarioError if none is possible.

        With a subject, scenarios with the subject `alone` are added; the cover ``partial`` contains such scenarios itself.
        """
        asked, seat = self.asked, self.asked.subject
        names = asked.grid or ("paper" if seat is None else ARRIVALS,)
        points = grid(names, len(place.entrances), place.control)
        alternating = not asked.grid and seat is not None
        every = partial(Selection, place, occupancy=asked.occupancy, subject=seat, followers=asked.followers)
        most = every(configurations=points, cover=asked.cover, alternating=alternating)
        if seat is None or asked.cover == "partial":
            return (most,)
        single = [code for code in alone(place) if seat == "all" or code[int(seat)]]
        return most, every(configurations=points[:1], scenarios=tuple(single))

    def _count(self, place: Junction) -> tuple[int, LeftOut | None]:
        """Return the number of scenarios that fit at a junction, and those left out; scenarios are tried only if necessary."""
        if place.name not in self._counted:
            unfit, count = list[ScenarioError](), 0
            for selection in self.selections(place):
                total = selection.count() * selection.points
                count += total if selection.roomy else sum(1 for _ in selection.fitting(unfit.append))
            self._counted[place.name] = count, LeftOut(len(unfit), str(unfit[0])) if unfit else None
        return self._counted[place.name]


class _Again:
    """All cases of a plan, as an object that can be iterated twice."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan

    def __iter__(self) -> Iterator[Planned]:
        return self._plan._every()


def _nobody(_: ScenarioError) -> None:
    """Ignore the reason of a scenario that is left out, because the plan already knows these scenarios."""


def _stratum(planned: Planned) -> tuple[str, ...]:
    scenario = planned.case.scenario
    return scenario.place.name, f"{scenario.number} {scenario.orbit or scenario.label}", scenario.point


def _name(planned: Planned) -> str:
    return planned.name
