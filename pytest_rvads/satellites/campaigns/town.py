"""A town: the junctions of some maps, with the runs requested at every junction, which are judged as one campaign."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.geometry.choosing import Choice, Kinds, choose_among
from pytest_rvads.geometry.finder import load, name_of
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.session_report import Anew, Drawn
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.satellites.campaigns.shapes import REACH, Member, Shape, shapes, twin
from pytest_rvads.satellites.campaigns.town_page import Site, TownMap, spot, town_picture
from pytest_rvads.satellites.campaigns.town_plan import Plan, Planned, Request
from pytest_rvads.satellites.campaigns.town_tally import Tally
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.wording import first, plural

__all__ = ["Town", "tallied", "town_records"]
_AGENT = re.compile(r"\ba(\d+)(?=(\.\d+)?(\+\d+)?\b)")
_ENTRANCE = re.compile(r"\bentrance (\d+)\b")


@dataclass(eq=False)
class Town:
    """The junctions of some maps, with the planned runs."""

    maps: tuple[Path, ...]
    choice: Choice
    plan: Plan
    once_per_shape: bool = False
    """Whether equal cases at congruent junctions (junctions of a shape) are simulated only at the first of these junctions."""

    @classmethod
    def of(  # noqa: PLR0913 - the choices of junctions and of runs
        cls,
        maps: Sequence[Path],
        junctions_wanted: Sequence[str],
        request: Request,
        *,
        kinds: Kinds | None = None,
        limit: int | None = None,
        only: Sequence[str] = (),
        sample: int | None = None,
        seed: int = 0,
        once_per_shape: bool = False,
    ) -> Town:
        """Return the town of some maps, with the chosen junctions and the planned runs.

        Args:
            maps: map files with different names, because ids contain the names of maps.
            junctions_wanted: the junctions of each map, see `choose`.
            request: the runs at each junction.
            kinds: the kinds of junctions to take; None for all kinds.
            limit: the largest number of junctions; of more junctions, a sample is drawn.
            only: patterns of ids, see `Plan`.
            sample: number of cases to draw.
            seed: seed of the draws of junctions and of cases.
            once_per_shape: whether equal cases at congruent junctions are simulated only at the first of these junctions.

        Raises:
            MapError: two maps have the same name, a map can't be read, a junction is unknown, or no junction fits.
            FormulaError: a rule is unknown.
        """
        stems = Counter(name_of(map, "") for map in maps)
        if duplicate := next((map for map in maps if stems[name_of(map, "")] > 1), None):
            raise MapError(
                f"ids tell junctions by the name of their map, and two are called {duplicate.stem!r}: rename one of them"
            )
        choice = choose_among(((text, map) for map in maps for text in junctions_wanted), kinds=kinds, limit=limit, seed=seed)
        return cls(tuple(maps), choice, Plan(choice.junctions, request, tuple(only), sample, seed), once_per_shape)

    def cases(self) -> Iterator[Case]:
        """Yield the cases to simulate: all cases, or with `once_per_shape` one case of each group of congruent cases."""
        return self._twins.cases() if self.once_per_shape else (planned.case for planned in self.plan)

    @property
    def simulated(self) -> int:
        """Number of cases to simulate."""
        return len(self._twins) if self.once_per_shape else sum(self.counts.values())

    @cached_property
    def counts(self) -> dict[str, int]:
        """Number of cases to judge, by junction."""
        return self.plan.counts()

    @cached_property
    def _twins(self) -> Twins:
        return Twins(self.plan, self.shapes)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The classes of congruent junctions among the junctions with planned runs."""
        return shapes(self.plan.places, REACH)

    def judged(self, results: Iterable[Judged]) -> Iterable[Judged]:
        """Return the results of all planned cases, given the results of the simulated cases.

        The returned iterable reads `results` again in every iteration.
        """
        return self._twins.spread(results) if self.once_per_shape else results

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return, by name of the run, the case that is simulated for each of the named runs."""
        if self.once_per_shape:
            return self._twins.case_of(names)
        return {planned.name: planned.case for planned in self.plan if planned.name in names}

    def pictures(self) -> list[TownMap]:
        """Return the pictures of the maps for the page."""
        return [TownMap(map.stem, town_picture(load(map))) for map in self.maps]

    def sites(self) -> list[Site]:
        """Return the requested junctions, including refused junctions, map by map in the order of the files."""
        usable = {(str(place.map), place.id): place for place in self.choice.junctions}
        refused = {(str(refusal.map), refusal.junction): refusal.reason for refusal in self.choice.refused}
        sites = []
        for number, map in enumerate(self.maps):
            for report in load(map).junctions:
                key = str(map), report.id
                if key not in refused and key not in usable:
                    continue
                name = name_of(map, report.id)
                kind = f"{report.ways}-way {report.control.value}" if report.entrances else f"{report.ways}-way"
                refusal_reason = refused.get(key) or self.plan.refused.get(name, "")
                notes = self._notes(usable[key]) if key in usable else ()
                sites.append(Site(name, report.id, number, spot(report), kind, self.counts.get(name, 0), refusal_reason, notes))
        return sites

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
            samples.append(Drawn("rvads town", "runs", sum(self.counts.values()), self.plan.total, seed))
        return tuple(samples)

    def notes(self) -> list[str]:
        """Return sentences on the whole town: left-out movements, short roads, and junctions of equal shape."""
        bends = [name for place in self.plan.places for name in self.plan.selections(place)[0].too_tight]
        sentences = [f"{plural(len(bends), 'movement')} left out: {TOO_TIGHT}: {first(bends, 5)}"] if bends else []
        short = [place.name for place in self.plan.places if self.plan.selections(place)[0].too_short]
        sentences += [f"{plural(len(short), 'junction')} {TOO_SHORT}: {first(short, 5)}"] if short else []
        several = [len(shape.members) for shape in self.shapes if len(shape.members) > 1]
        total = sum(self.counts.values())
        if not several and self.once_per_shape:
            sentences.append("no two junctions have the same shape, so every run was simulated")
        if not several:
            return sentences
        shared = f"{sum(several)} junctions have {len(several)} shape{'s' if len(several) > 1 else ''} in common"
        if not self.once_per_shape:
            return [*sentences, f"{shared}: with --once-per-shape each shape is simulated once"]
        return [
            *sentences,
            f"{shared}: {total - self.simulated} of {total} runs were not simulated but taken from a junction of the same shape",
        ]

    def _notes(self, place: Junction) -> tuple[str, ...]:
        left_out = self.plan.left_out(place)
        sentences = [f"{left_out.scenarios} scenarios are left out, the first: {left_out.reason}"] if left_out else []
        if place.name not in self.plan.refused:
            shape = next((s for s in self.shapes if len(s.members) > 1 and any(m.junction is place for m in s.members)), None)
            if shape is not None:
                names = [f"{m.junction.name}" for m in shape.members if m.junction is not place]
                apart = max(member.deviation for member in shape.members)
                sentences.append(f"of the same shape, to within {apart:.3f} m: {', '.join(names)}")
        return tuple(sentences)


def town_records(
    judged: Iterable[Judged], looks: Mapping[tuple[str, str], str], flaky: Mapping[str, Divergence]
) -> Collection[Record]:
    """Return a record per case and rule; every iteration makes the records again, because memory may not hold all records.

    Args:
        judged: the results of cases.
        looks: by name of a run and rule, the path of its replay page.
        flaky: by name of a run, the difference between the run and its repetition; failures of such a run become FLAKY.
    """

    def records() -> Iterator[Record]:
        for record in chain.from_iterable(map(by_rule, judged)):
            changes: dict[str, Any] = {}
            if look := looks.get((record.run or "", record.rule or "")):
                changes["look"] = look
            if record.failed and (difference := flaky.get(record.run or "")):
                changes |= {"status": Outcome.FLAKY, "flaky": difference}
            yield msgspec.structs.replace(record, **changes) if changes else record

    return Anew(records, cache(lambda: sum(len(result.verdicts) for result in judged)))


def tallied(judged: Iterable[Judged]) -> dict[str, Tally]:
    """Return the sums of the results at each junction, by name of the junction."""
    tallies: dict[str, Tally] = {}
    for result in judged:
        tallies.setdefault(result.junction, Tally()).add(result)
    return tallies


@dataclass(frozen=True, slots=True)
class _At:
    """A planned case, with the case at a congruent junction that is simulated instead of the planned case."""

    planned: Planned
    case: Case
    member: Member


class Twins:
    """The cases of a plan in groups of congruent cases, of which one case is simulated for the group.

    Memory holds all cases, with some hundred bytes per case.

    Args:
        plan: all cases.
        shapes: the classes of congruent junctions among the junctions with planned runs.
    """

    def __init__(self, plan: Plan, shapes: Sequence[Shape]) -> None:
        members = {member.junction.name: (member, shape) for shape in shapes for member in shape.members}
        self._groups: dict[str, list[_At]] = {}
        for planned in plan:
            planned_case = planned.case
            member, shape = members[planned_case.scenario.place.name]
            image = twin(planned_case.scenario, member, shape)
            case = planned_case if image is None else Case(image, planned_case.driver, planned_case.traffic, planned_case.fleet)
            name = planned.name.replace(planned_case.scenario.name, case.scenario.name)
            self._groups.setdefault(name, []).append(_At(planned, case, member))

    def __len__(self) -> int:
        return len(self._groups)

    def cases(self) -> Iterator[Case]:
        """Yield the cases to simulate, one per group."""
        return (twins[0].case for twins in self._groups.values())

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return, by name of the run, the case that is simulated for each of the named planned cases."""
        return {at.planned.name: twins[0].case for twins in self._groups.values() for at in twins if at.planned.name in names}

    def spread(self, results: Iterable[Judged]) -> Iterable[Judged]:
        """Return the results of all planned cases, given the results of the simulated cases.

        The returned iterable reads `results` again in every iteration.
        """
        return _Spread(self._groups, results)


class _Spread:
    def __init__(self, twins: dict[str, list[_At]], results: Iterable[Judged]) -> None:
        self._groups, self._results = twins, results

    def __iter__(self) -> Iterator[Judged]:
        for judged in self._results:
            for at in self._groups.get(judged.nodeid, ()):
                yield judged if at.member.junction.name == judged.junction else _moved_result(judged, at)


def _moved_result(judged: Judged, at: _At) -> Judged:
    """Return the result of a simulated case as the result of a planned case at a congruent junction.

    The numbers of agents and entrances are replaced by the numbers at the junction of the planned case.
    """
    scenario, place, member = at.planned.case.scenario, at.member.junction, at.member
    fields: dict[str, Any] = msgspec.to_builtins(judged)
    if member.rotation:
        entrances = {image: entrance for entrance, image in enumerate(member.entrances)}

        def arm(number: int) -> int:
            return (number - member.rotation) % place.ways

        def renamed(text: str) -> str:
            text = _AGENT.sub(lambda match: f"a{arm(int(match[1]))}", text)
            return _ENTRANCE.sub(lambda match: f"entrance {entrances.get(int(match[1]), match[1])}", text)

        fields |= {
            part: _with_texts_changed(fields[part], renamed)
            for part in ("verdicts", "kpis", "timing", "excess", "agents")
            if fields.get(part)
        }
        for agent in fields.get("agents", ()):
            for end in ("entrance", "exit"):
                agent[end] = arm(agent[end][0]), agent[end][1]
    fields |= {
        "nodeid": at.planned.name,
        "run": at.planned.name,
        "junction": place.name,
        "cls": scenario.number,
        "scenario": scenario.label,
        "cfg": scenario.point,
        "rotation": scenario.rotation,
        "seat": scenario.subject,
        "orbit": scenario.orbit,
        "place": place.digest[: len(judged.place or "")],
        "shape": judged.junction,
    }
    return msgspec.convert(fields, Judged)


def _with_texts_changed(value: Any, change: Callable[[str], str]) -> Any:
    """Return a copy of nested dicts and lists in which `change` has been applied to every text."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {change(key): _with_texts_changed(inner, change) for key, inner in value.items()}
    return [_with_texts_changed(inner, change) for inner in value] if isinstance(value, list | tuple) else value
