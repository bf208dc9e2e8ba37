"""A town: all that is asked for at the junctions of some maps, judged as one campaign."""

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
from pytest_rvads.satellites.campaigns.judged import Judged
from pytest_rvads.satellites.campaigns.shapes import REACH, Member, Shape, shapes, twin
from pytest_rvads.satellites.campaigns.town_page import Site, TownMap
from pytest_rvads.satellites.campaigns.town_picture import spot, town_picture
from pytest_rvads.satellites.campaigns.town_plan import Asked, Plan, Planned
from pytest_rvads.satellites.campaigns.town_tally import JunctionTally
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.wording import first, plural

__all__ = ["Town", "tallied", "town_records"]
_AGENT = re.compile(r"\ba(\d+)(?=(\.\d+)?(\+\d+)?\b)")
_ENTRANCE = re.compile(r"\bentrance (\d+)\b")


@dataclass(eq=False)
class Town:
    """The junctions of some maps, and what is to run there."""

    maps: tuple[Path, ...]
    choice: Choice
    plan: Plan
    once_per_shape: bool = False
    """Whether junctions of one shape are simulated at the first one only."""

    @classmethod
    def of(  # noqa: PLR0913 - which junctions, what there, and how much of it
        cls,
        maps: Sequence[Path],
        wanted: Sequence[str],
        asked: Asked,
        *,
        kinds: Kinds | None = None,
        limit: int | None = None,
        only: Sequence[str] = (),
        sample: int | None = None,
        seed: int = 0,
        once_per_shape: bool = False,
    ) -> Town:
        """Return the town of some maps.

        Args:
            maps: OpenDRIVE files; no two may have the same name, since ids tell junctions by it.
            wanted: which junctions of each, see `choose`.
            asked: what is to run at each.
            kinds: take only these of them.
            limit: most junctions.
            only: patterns of ids, see `Plan`.
            sample: how many cases are drawn.
            seed: of both draws.
            once_per_shape: simulate junctions of one shape at the first one only.

        Raises:
            MapError: two maps of one name, an unreadable map, an unknown junction, or none that fits.
            FormulaError: no such rule.
        """
        stems = Counter(name_of(map, "") for map in maps)
        if twice := next((map for map in maps if stems[name_of(map, "")] > 1), None):
            raise MapError(f"ids tell junctions by the name of their map, and two are called {twice.stem!r}: rename one of them")
        choice = choose_among(((text, map) for map in maps for text in wanted), kinds=kinds, limit=limit, seed=seed)
        return cls(tuple(maps), choice, Plan(choice.junctions, asked, tuple(only), sample, seed), once_per_shape)

    def cases(self) -> Iterator[Case]:
        """Yield what is to be simulated: every case, or one of those that are the same up to a motion."""
        return self._twins.cases() if self.once_per_shape else (planned.case for planned in self.plan)

    @property
    def simulated(self) -> int:
        """How many cases are to be simulated."""
        return len(self._twins) if self.once_per_shape else sum(self.counts.values())

    @cached_property
    def counts(self) -> dict[str, int]:
        """Per junction how many cases are to be judged."""
        return self.plan.counts()

    @cached_property
    def _twins(self) -> Twins:
        return Twins(self.plan, self.shapes)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """The shapes of the junctions with planned runs, compared up to the distance that runs reach."""
        return shapes(self.plan.places, REACH)

    def judged(self, results: Iterable[Judged]) -> Iterable[Judged]:
        """Return results at every junction, from those of `cases`; can be gone through as often as `results`."""
        return self._twins.spread(results) if self.once_per_shape else results

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return the cases that runs of these names come from: those that were simulated."""
        if self.once_per_shape:
            return self._twins.case_of(names)
        return {planned.name: planned.case for planned in self.plan if planned.name in names}

    def pictures(self) -> list[TownMap]:
        """Return the maps as a page shows them."""
        return [TownMap(map.stem, town_picture(load(map))) for map in self.maps]

    def sites(self) -> list[Site]:
        """Return every junction that was asked for, map by map in the order of the files, those that are refused too."""
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
                why = refused.get(key) or self.plan.refused.get(name, "")
                notes = self._notes(usable[key]) if key in usable else ()
                sites.append(Site(name, report.id, number, spot(report), kind, self.counts.get(name, 0), why, notes))
        return sites

    def refused(self) -> dict[str, tuple[str, ...]]:
        """Return why junctions are left out, to their names."""
        names_of: dict[str, tuple[str, ...]] = {}
        for name, reason in [(refusal.name, refusal.reason) for refusal in self.choice.refused] + list(self.plan.refused.items()):
            same = reason.replace(f"junction {name!r}", "the junction")
            names_of[same] = (*names_of.get(same, ()), name)
        return names_of

    def drawn(self) -> tuple[Drawn, ...]:
        """Return what was drawn from more."""
        taken, over, seed = len(self.choice.junctions), self.choice.passed_over, self.plan.seed
        samples = [Drawn("rvads town", "junctions", taken, taken + over, seed)] if over else []
        if self.plan.sample is not None:
            samples.append(Drawn("rvads town", "runs", sum(self.counts.values()), self.plan.total, seed))
        return tuple(samples)

    def notes(self) -> list[str]:
        """Return what is to be said of the town as a whole, a sentence each."""
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
            return [*sentences, f"{shared}: with --once-per-shape each is simulated once"]
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
    """Return a record per case and rule, made anew in every pass.

    Args:
        judged: the results.
        looks: by name of a run and rule, where its replay page is.
        flaky: by name of a run, where it parts from its repetition.
    """

    def made() -> Iterator[Record]:
        for record in chain.from_iterable(map(by_rule, judged)):
            changes: dict[str, Any] = {}
            if look := looks.get((record.run or "", record.rule or "")):
                changes["look"] = look
            if record.failed and (difference := flaky.get(record.run or "")):
                changes |= {"status": Outcome.FLAKY, "flaky": difference}
            yield msgspec.structs.replace(record, **changes) if changes else record

    return Anew(made, cache(lambda: sum(len(result.verdicts) for result in judged)))


def tallied(judged: Iterable[Judged]) -> dict[str, JunctionTally]:
    """Return the tally of every junction, in one pass over the results."""
    tallies: dict[str, JunctionTally] = {}
    for result in judged:
        tallies.setdefault(result.junction, JunctionTally()).add(result)
    return tallies


@dataclass(frozen=True, slots=True)
class _At:
    """A planned case, with the equal case that is simulated instead."""

    planned: Planned
    case: Case
    member: Member


class Twins:
    """The cases of a plan by those that are simulated in their place; all are in memory, some hundred bytes each.

    Args:
        plan: all cases.
        shapes: of all junctions of the plan at which something runs.
    """

    def __init__(self, plan: Plan, shapes: Sequence[Shape]) -> None:
        members = {member.junction.name: (member, shape) for shape in shapes for member in shape.members}
        self._found: dict[str, list[_At]] = {}
        for planned in plan:
            asked = planned.case
            member, shape = members[asked.scenario.place.name]
            image = twin(asked.scenario, member, shape)
            case = asked if image is None else Case(image, asked.driver, asked.traffic, asked.fleet)
            name = planned.name.replace(asked.scenario.name, case.scenario.name)
            self._found.setdefault(name, []).append(_At(planned, case, member))

    def __len__(self) -> int:
        return len(self._found)

    def cases(self) -> Iterator[Case]:
        """Yield what is to be simulated."""
        return (twins[0].case for twins in self._found.values())

    def case_of(self, names: Collection[str]) -> dict[str, Case]:
        """Return what is simulated in place of the cases of these names."""
        return {at.planned.name: twins[0].case for twins in self._found.values() for at in twins if at.planned.name in names}

    def spread(self, results: Iterable[Judged]) -> Iterable[Judged]:
        """Return the results of all cases; the iterable can be repeated as often as `results`."""
        return _Spread(self._found, results)


class _Spread:
    def __init__(self, twins: dict[str, list[_At]], results: Iterable[Judged]) -> None:
        self._found, self._results = twins, results

    def __iter__(self) -> Iterator[Judged]:
        for judged in self._results:
            for at in self._found.get(judged.nodeid, ()):
                yield judged if at.member.junction.name == judged.junction else _moved(judged, at)


def _moved(judged: Judged, at: _At) -> Judged:
    """Return a result as one at another junction of the same shape: agents and entrances may have other numbers there."""
    scenario, place, member = at.planned.case.scenario, at.member.junction, at.member
    fields: dict[str, Any] = msgspec.to_builtins(judged)
    if member.rotation:
        entrances = {image: entrance for entrance, image in enumerate(member.entrances)}

        def arm(number: int) -> int:
            return (number - member.rotation) % place.ways

        def renamed(text: str) -> str:
            text = _AGENT.sub(lambda match: f"a{arm(int(match[1]))}", text)
            return _ENTRANCE.sub(lambda match: f"entrance {entrances.get(int(match[1]), match[1])}", text)

        fields |= {part: _deeply(fields[part], renamed) for part in ("verdicts", "kpis", "timing", "agents") if fields.get(part)}
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


def _deeply(value: Any, change: Callable[[str], str]) -> Any:
    """Return builtins with every text in them changed."""
    if isinstance(value, str):
        return change(value)
    if isinstance(value, dict):
        return {change(key): _deeply(inner, change) for key, inner in value.items()}
    return [_deeply(inner, change) for inner in value] if isinstance(value, list | tuple) else value
