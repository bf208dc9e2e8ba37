"""A town: the junctions of some maps, with the runs requested at every junction, judged as one campaign; pictures of the maps.

The picture of a map shows its lanes, and a mark per junction in the form and colour of the worst verdict of the junction.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property, partial
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.drivers.interface import Factory
from pytest_rvads.drivers.traffic import Policy
from pytest_rvads.geometry.analysis import JunctionReport
from pytest_rvads.geometry.finder import Choice, choose_among, load, name_of
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.road_map import RoadMap
from pytest_rvads.logic.outcome import MARKS, Mark, Outcome, Tallied, counted
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.outline import Picture
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Drawn, Extent, Report, exit_status
from pytest_rvads.satellites.campaigns.replays import INTERRUPTED, Replays
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import ARRIVALS, grid
from pytest_rvads.scenarios.ids import run_id
from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT, Selection, alone, extended
from pytest_rvads.support.errors import MapError, RvadsError, ScenarioError
from pytest_rvads.support.stratified import draw
from pytest_rvads.support.wording import first, markup, plural

_MARGIN = 15.0
"""Empty margin of a picture around the lanes [m]."""
_WIDTHS = (0.5, 6.0)
"""Least and greatest width with which a lane is drawn [m]."""
_MEANINGS: dict[Mark, str] = {
    "bad": "failed",
    "error": "no verdict (ERROR)",
    "doubt": "open, provoked, unavoidable, unsure or incomplete",
    "good": "passed",
    "none": "refused or not judged",
}
_FORMS: dict[Mark, tuple[str, str]] = {
    "bad": ("M-8.5 -8.5h17v17h-17z", "M-3.8 -3.8L3.8 3.8M3.8 -3.8L-3.8 3.8"),
    "error": ("M-10 -6L0 -11L10 -6V6L0 11L-10 6z", "M3.6 -4.6H-3V4.6H3.6M-3 0H2.6"),
    "doubt": ("M0 -11.5L11.5 0L0 11.5L-11.5 0z", "M0 -5.5V1.5M0 5V5.2"),
    "good": ("M-9 0a9 9 0 1 0 18 0a9 9 0 1 0 -18 0", "M-4 0L-1 3.2L4.2 -3.6"),
    "none": ("M-8 0a8 8 0 1 0 16 0a8 8 0 1 0 -16 0", "M-3.2 0H3.2"),
}
"""Paths of the body and of the sign of each mark [px]."""


class MarkedJunction(NamedTuple):
    """A junction on the map."""

    name: str
    """Name of the junction in ids."""
    report: JunctionReport
    verdicts: Counter[Tallied]
    incomplete: bool
    """Whether results of the junction are missing."""
    note: str
    """The reason why no run is possible, or further facts; empty without one."""

    @property
    def mark(self) -> Mark:
        """The worst mark of the verdicts; a junction of which results are missing is never ``good`` or ``none``."""
        marks = {outcome.mark for outcome in self.verdicts if outcome}
        worst: Mark = next((mark for mark in MARKS if mark in marks), "none")
        return "doubt" if worst in ("good", "none") and self.incomplete else worst


def town_picture(title: str, road_map: RoadMap, sites: Iterable[MarkedJunction]) -> Picture:
    """Return the picture of a map, with the numbers of its junctions by mark."""
    worst_last = sorted(sites, key=lambda site: list(MARKS).index(site.mark), reverse=True)  # their marks lie on top
    numbers = Counter(site.mark for site in worst_last)
    told = "; ".join(f"{numbers[mark]} {MARKS[mark][0]} {what}" for mark, what in _MEANINGS.items() if numbers[mark])
    groups: defaultdict[float, str] = defaultdict(str)
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for id in sorted(road_map.graph.edges):
        edge = road_map.graph.edges[id]
        points = simplified(edge.points * (1.0, -1.0), 0.2)  # [m] beside the centre line at most
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
        width = round(min(max(edge.width, _WIDTHS[0]), _WIDTHS[1]) * 2) / 2
        tenths = np.rint(points * 10.0).astype(int)  # decimetres
        (x, y), steps = tenths[0].tolist(), np.diff(tenths, axis=0)
        path = f"M{_tenth(x)} {_tenth(y)}" + "".join(f"l{_tenth(dx)} {_tenth(dy)}" for dx, dy in steps.tolist() if dx or dy)
        groups[width] += path
    if not groups:
        low = high = np.zeros(2)
    (west, north), (wide, tall) = (low - _MARGIN).tolist(), (high - low + 2 * _MARGIN).tolist()
    lanes = "".join(
        f'<path data-width="{width:g}" stroke-width="{width:g}" d="{path}"/>' for width, path in sorted(groups.items())
    )
    areas, marks = [], []
    for site in worst_last:
        if site.report.arms:
            x, y, radius = spot(site.report)
            areas += [f'<circle class="area {site.mark}" cx="{x}" cy="{y}" r="{radius}"/>'] if site.mark != "none" else []
            marks.append(_mark(site, x, y, max(wide, tall) / 1000))
    svg = (
        f'<svg class="map" viewBox="{west:.1f} {north:.1f} {wide:.1f} {tall:.1f}" tabindex="0" role="group" '
        'aria-label="map: arrows move the view, plus and minus zoom, 0 shows the whole map">'
        f'<g class="lanes">{lanes}</g>{"".join(areas)}{"".join(marks)}</svg>'
    )
    return Picture((f"{plural(len(worst_last), 'junction')}: {told}" if told else "no junctions",), title, svg)


def _mark(site: MarkedJunction, x: float, y: float, scale: float) -> str:
    """Return the mark of a junction as SVG, a link to its items on the page."""
    facts = filter(None, (counted(site.verdicts), "results are missing" if site.incomplete else "", site.note))
    label = markup(f"{site.name}: {'; '.join(facts) or 'nothing judged'}")
    id = site.report.id
    short = id if len(id) <= 12 else f"{id[:4]}…{id[-5:]}"  # some converters join ids to long ids, which would cover the map
    body, sign = _FORMS[site.mark]
    return (
        f'<a href="#{quote(site.name)}" class="mark {site.mark}" data-x="{x}" data-y="{y}" data-name="{markup(site.name)}" '
        f'aria-label="{label}" transform="translate({x} {y}) scale({scale:.3g})"><title>{label}</title>'
        f'<path class="body" d="{body}"/><path class="sign" d="{sign}"/><text y="25">{markup(short)}</text></a>'
    )


def spot(report: JunctionReport) -> tuple[float, float, float]:
    """Return the mean position of the arms of a junction, y to the south, and a radius that reaches all arms [m]."""
    arms = report.arms
    x, y = math.fsum(arm.x for arm in arms) / len(arms), math.fsum(arm.y for arm in arms) / len(arms)
    # The disc shows how far the junction reaches, 8 m at least.
    radius = max(8.0, *(math.dist((x, y), (arm.x, arm.y)) for arm in arms))
    return round(x, 1), round(-y, 1), round(radius, 1)


def simplified(points: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Return a line with fewer points, by the algorithm of Ramer, Douglas and Peucker.

    Args:
        points: points of the line, shape ``(k, 2)``, k >= 2.

    Returns:
        Some of the points in order, including both ends, shape ``(n, 2)``.
    """
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    parts = [(0, len(points) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        start, along = points[first], points[last] - points[first]
        inner = points[first + 1 : last] - start
        length = float(along @ along)
        share = np.clip(inner @ along / length, 0.0, 1.0) if length else np.zeros(len(inner))
        off = np.hypot(*(inner - share[:, None] * along).T)
        farthest = int(off.argmax())
        if off[farthest] > tolerance:
            middle = first + 1 + farthest
            keep[middle] = True
            parts += [(first, middle), (middle, last)]
    return points[keep]


def _tenth(number: int) -> str:
    return f"{number / 10:.1f}".removesuffix(".0")


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


@dataclass(eq=False)
class Town:
    """The junctions of some maps, with the planned runs."""

    maps: tuple[Path, ...]
    choice: Choice
    plan: Plan

    @classmethod
    def of(
        cls,
        maps: Sequence[Path],
        junctions_wanted: Sequence[str],
        request: Request,
        *,
        limit: int | None = None,
        only: Sequence[str] = (),
        sample: int | None = None,
        seed: int = 0,
    ) -> Town:
        """Return the town of some maps, with the chosen junctions and the planned runs."""
        stems = Counter(name_of(map, "") for map in maps)
        if duplicate := next((map for map in maps if stems[name_of(map, "")] > 1), None):
            raise MapError(
                f"ids tell junctions by the name of their map, and two are called {duplicate.stem!r}: rename one of them"
            )
        choice = choose_among(((text, map) for map in maps for text in junctions_wanted), limit=limit, seed=seed)
        return cls(tuple(maps), choice, Plan(choice.junctions, request, tuple(only), sample, seed))

    def cases(self) -> Iterator[Case]:
        """Yield the planned cases."""
        return (planned.case for planned in self.plan)

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of planned cases, by junction."""
        return self.plan.counts()

    @property
    def runs(self) -> int:
        """Number of planned cases."""
        return sum(self.counts.values())

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return, by name of the run, the case of each of the named runs."""
        return {planned.name: planned.case for planned in self.plan if planned.name in names}

    def pictures(self, results: Results, records: Iterable[Record]) -> list[Picture]:
        """Return the pictures of the maps with the requested junctions, also the refused ones."""
        verdicts: dict[str, Counter[Tallied]] = {}
        runs: Counter[str] = Counter()
        for result in results:
            runs[result.junction] += 1
        for record in records:
            verdicts.setdefault(record.junction, Counter())[record.counts_as] += 1
        usable = {(str(place.map), place.id): place for place in self.choice.junctions}
        refused = {(str(refusal.map), refusal.junction): refusal.reason for refusal in self.choice.refused}
        pictures = []
        for map in self.maps:
            sites = []
            for report in load(map).junctions:
                key, name = (str(map), report.id), name_of(map, report.id)
                if key in refused or key in usable:
                    left_out = self.plan.left_out(usable[key]) if key in usable else None
                    note = f"{left_out.scenarios} scenarios are left out, the first: {left_out.reason}" if left_out else ""
                    reason = refused.get(key) or self.plan.refused.get(name, "")
                    note = f"refused: {reason}" if reason else note
                    incomplete = runs[name] < self.counts.get(name, 0)
                    sites.append(MarkedJunction(name, report, verdicts.get(name, Counter()), incomplete, note))
            pictures.append(town_picture(map.stem, load(map), sites))
        return pictures

    def refused(self) -> dict[str, tuple[str, ...]]:
        """Return the names of the left-out junctions, by reason."""
        names_of: dict[str, tuple[str, ...]] = {}
        for name, reason in [(refusal.name, refusal.reason) for refusal in self.choice.refused] + list(self.plan.refused.items()):
            reason_text = reason.replace(f"junction {name!r}", "the junction")
            names_of[reason_text] = (*names_of.get(reason_text, ()), name)
        return names_of

    def drawn(self) -> tuple[Drawn, ...]:
        """Return the numbers of drawn junctions and of drawn runs, for the report; empty if all were taken."""
        chosen_count, passed_over, seed = len(self.choice.junctions), self.choice.passed_over, self.plan.seed
        samples = [Drawn("rvads town", "junctions", chosen_count, chosen_count + passed_over, seed)] if passed_over else []
        if self.plan.sample is not None:
            samples.append(Drawn("rvads town", "runs", self.runs, self.plan.total, seed))
        return tuple(samples)

    def notes(self) -> list[str]:
        """Return sentences on the whole town: left-out movements and short roads."""
        bends = [name for place in self.plan.places for name in self.plan.selections(place)[0].too_tight]
        sentences = [f"{plural(len(bends), 'movement')} left out: {TOO_TIGHT}: {first(bends, 5)}"] if bends else []
        short = [place.name for place in self.plan.places if self.plan.selections(place)[0].too_short]
        return sentences + ([f"{plural(len(short), 'junction')} {TOO_SHORT}: {first(short, 5)}"] if short else [])

    def report(self, results: Results, replays: Replays, again: str, cut: str) -> Report:
        """Return the report of the results, given the reason why the campaign was cut short, if any."""
        missing = self.runs - len(results)
        notes = [*self.notes(), *replays.notes]
        if missing:
            why = cut or "results are missing"
            notes.insert(0, f"INCOMPLETE: {why}, {missing} runs have no result: run it again to continue")
        complete = not missing and INTERRUPTED not in notes
        places = self.plan.places
        return replace(
            results.report(again=again),
            records=results.records(replays.looks, replays.flaky),
            notes=tuple(notes),
            exitstatus=exit_status(results.outcomes | ({Outcome.FLAKY} if replays.flaky else set()), complete=complete),
            complete=complete,
            extents=self.plan.extents(),
            refused=self.refused(),
            drawn=self.drawn(),
            unfit={place.name: left_out.scenarios for place in places if (left_out := self.plan.left_out(place))},
        )
