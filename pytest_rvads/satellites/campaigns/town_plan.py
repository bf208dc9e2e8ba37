"""The planned runs at many junctions: cases, made one by one while the plan is iterated, and counts of cases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
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


@dataclass(frozen=True, slots=True)
class Request:
    """The runs requested at every junction; the fields have the meanings of the arguments of ``@rvads.scenario``."""

    driver: Factory
    rules: tuple[str | Rule, ...] = ("road",)
    cover: str = "conflicts"
    occupancy: str = "arms"
    grid: tuple[str, ...] | None = None
    """Configurations; None for those of the paper, or, with a subject, for those of `ARRIVALS` in turn, one per seat."""
    subject: int | str | None = None
    traffic: Policy | None = None
    """Driver of the other vehicles if there is a subject (vehicle under test)."""
    followers: tuple[int, ...] = (0,)


class Planned(NamedTuple):
    """A planned case with its name."""

    name: str
    """Id of the run: the id of a test item without the name of the rule."""
    case: Case


class LeftOut(NamedTuple):
    """Number of scenarios of a junction that are left out because a vehicle has no room at its start, and the reason."""

    scenarios: int
    reason: str
    """The reason why the first of the left-out scenarios is left out."""


@dataclass(eq=False)
class Plan:
    """The planned cases at several junctions, junction by junction; a plan can be iterated any number of times."""

    junctions: Sequence[Junction]
    request: Request
    only: tuple[str, ...] = ()
    """Patterns for ids of runs or of verdicts (run and rule), with the wildcards of file names; empty for all runs."""
    sample: int | None = None
    """Number of cases drawn, spread evenly over junctions, classes and configurations; None for all cases."""
    seed: int = 0
    _counts: dict[str, tuple[int, LeftOut | None]] = field(default_factory=dict, init=False)

    @cached_property
    def refused(self) -> dict[str, str]:
        """By name of a junction, the reason why none of the requested runs is possible at the junction."""
        reasons = {}
        for place in self.junctions:
            try:
                if not self.rules(place):
                    raise ScenarioError(f"none of the requested rules is about {place.control} junctions")
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
        """Return the rules that judge runs at a junction."""
        return rules_for(self.request.rules, place)

    def left_out(self, place: Junction) -> LeftOut | None:
        """Return the number of left-out scenarios of a junction; None if no scenario is left out or the junction is refused."""
        return None if place.name in self.refused else self._count(place)[1]

    def extents(self) -> dict[str, Extent]:
        """Return the numbers of classes and scenarios at each junction, as the total for the coverage in reports."""
        extents: dict[str, Extent] = {}
        for place in self.places:
            for selection in self.selections(place):
                extents = extended(extents, selection)
        return extents

    @property
    def total(self) -> int:
        """Number of cases without the restrictions by `only` and `sample`."""
        return sum(self._count(place)[0] for place in self.places)

    def counts(self) -> dict[str, int]:
        """Return the number of cases by name of the junction, in the order of `junctions`; 0 for a refused junction."""
        if self.sample is None and not self.only:
            return {place.name: 0 if place.name in self.refused else self._count(place)[0] for place in self.junctions}
        counts = dict.fromkeys((place.name for place in self.junctions), 0)
        for planned in self:
            counts[planned.case.scenario.place.name] += 1
        return counts

    def __iter__(self) -> Iterator[Planned]:
        if self.sample is not None:
            yield from self._sampled_cases
            return
        request = self.request
        traffic = None if request.traffic is None or request.subject is None else request.traffic
        for place in self.places:
            rules = [rule.name for rule in self.rules(place)]
            for selection in self.selections(place):
                for scenario in selection.fitting(lambda _: None):  # `_count` counts the left-out scenarios
                    name = run_id(scenario, None if traffic is None else traffic.name)
                    ids = (name, *(f"{name}-{rule}" for rule in rules)) if self.only else ()
                    if not self.only or any(fnmatchcase(id, pattern) for pattern in self.only for id in ids):
                        yield Planned(name, Case(scenario, request.driver, traffic.factory if traffic else None))

    @cached_property
    def _sampled_cases(self) -> list[Planned]:
        def stratum(planned: Planned) -> tuple[str, ...]:
            scenario = planned.case.scenario
            return scenario.place.name, f"{scenario.number} {scenario.orbit or scenario.label}", scenario.point

        return draw(replace(self, sample=None), self.sample or 0, self.seed, stratum, lambda planned: planned.name)

    def selections(self, place: Junction) -> tuple[Selection, ...]:
        """Return the selected scenarios of a junction, also without room, and for a subject those without other vehicles."""
        request, seat = self.request, self.request.subject
        names = request.grid or ("paper" if seat is None else ARRIVALS,)
        points = grid(names, len(place.entrances), place.control)
        alternating = not request.grid and seat is not None
        select = partial(Selection, place, occupancy=request.occupancy, subject=seat, followers=request.followers)
        covering = select(configurations=points, cover=request.cover, alternating=alternating)
        if seat is None or request.cover == "partial":
            return (covering,)
        alone_scenarios = [code for code in alone(place) if seat == "all" or code[int(seat)]]
        return covering, select(configurations=points[:1], scenarios=tuple(alone_scenarios))

    def _count(self, place: Junction) -> tuple[int, LeftOut | None]:
        """Return the number of scenarios at a junction in which all vehicles have room, and the number of left-out scenarios."""
        if place.name not in self._counts:
            unfit, count = list[ScenarioError](), 0
            for selection in self.selections(place):
                total = selection.count() * selection.points
                count += total if selection.roomy else sum(1 for _ in selection.fitting(unfit.append))
            self._counts[place.name] = count, LeftOut(len(unfit), str(unfit[0])) if unfit else None
        return self._counts[place.name]
