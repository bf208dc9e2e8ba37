"""A town: the junctions of some maps, with the runs requested at every junction, which are judged as one campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import msgspec

from pytest_rvads.geometry.choosing import Choice, choose_among
from pytest_rvads.geometry.finder import Kinds, load, name_of
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.record import Record
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.session_report import Anew, Drawn
from pytest_rvads.runs.measured import Divergence
from pytest_rvads.satellites.campaigns.resultsfile import Judged
from pytest_rvads.satellites.campaigns.town_page import Site, TownMap, spot, town_picture
from pytest_rvads.satellites.campaigns.town_plan import Plan, Request
from pytest_rvads.satellites.campaigns.town_tally import Tally
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.selection import TOO_SHORT, TOO_TIGHT
from pytest_rvads.support.errors import MapError
from pytest_rvads.support.wording import first, plural


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
        kinds: Kinds | None = None,
        limit: int | None = None,
        only: Sequence[str] = (),
        sample: int | None = None,
        seed: int = 0,
    ) -> Town:
        """Return the town of some maps, with the chosen junctions and the planned runs.

        Args:
            kinds: the kinds of junctions to take; None for all kinds.
        """
        stems = Counter(name_of(map, "") for map in maps)
        if duplicate := next((map for map in maps if stems[name_of(map, "")] > 1), None):
            raise MapError(
                f"ids tell junctions by the name of their map, and two are called {duplicate.stem!r}: rename one of them"
            )
        choice = choose_among(((text, map) for map in maps for text in junctions_wanted), kinds=kinds, limit=limit, seed=seed)
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
                left_out = self.plan.left_out(usable[key]) if key in usable else None
                notes = (f"{left_out.scenarios} scenarios are left out, the first: {left_out.reason}",) if left_out else ()
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
            samples.append(Drawn("rvads town", "runs", self.runs, self.plan.total, seed))
        return tuple(samples)

    def notes(self) -> list[str]:
        """Return sentences on the whole town: left-out movements and short roads."""
        bends = [name for place in self.plan.places for name in self.plan.selections(place)[0].too_tight]
        sentences = [f"{plural(len(bends), 'movement')} left out: {TOO_TIGHT}: {first(bends, 5)}"] if bends else []
        short = [place.name for place in self.plan.places if self.plan.selections(place)[0].too_short]
        return sentences + ([f"{plural(len(short), 'junction')} {TOO_SHORT}: {first(short, 5)}"] if short else [])


def town_records(
    judged: Iterable[Judged], looks: Mapping[tuple[str, str], str], flaky: Mapping[str, Divergence]
) -> Collection[Record]:
    """Return a record per case and rule; every iteration makes the records again, because memory may not hold all records."""

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
