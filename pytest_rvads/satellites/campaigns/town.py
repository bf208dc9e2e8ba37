"""A town: the junctions of some maps, with the runs requested at every junction, which are judged as one campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from pytest_rvads.geometry.finder import Choice, choose_among, load, name_of
from pytest_rvads.logic.outcome import Outcome, Tallied
from pytest_rvads.report.outline import Picture
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Drawn, Report, exit_status
from pytest_rvads.satellites.campaigns.replays import INTERRUPTED, Replays
from pytest_rvads.satellites.campaigns.resultsfile import Results
from pytest_rvads.satellites.campaigns.town_map import MarkedJunction, town_picture
from pytest_rvads.satellites.campaigns.town_plan import Plan, Request
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
