"""Sums of results, per junction of a town or per driver of a league; their memory grows with rules and causes, not with runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from pytest_rvads.logic.outcome import Mark, Outcome, counted
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.triage import causes, gravity, provoked, unavoidable, unsure
from pytest_rvads.satellites.campaigns.resultsfile import Judged

TownMark = Mark | Literal["error"]
"""The mark (colour) of runs on a map or in a table cell; ``error``: the runs have no verdict, so the driving is unknown."""

_GROUPS = (
    ("causes of failures", causes),
    ("provoked by traffic", provoked),
    ("unavoidable: nobody could have kept the rule", unavoidable),
    ("unsure", unsure),
)
_MOST = 100
"""Largest number of causes kept per tally, since the messages of foreign code may differ in every run."""
_MARKS: tuple[TownMark, ...] = ("bad", "error", "doubt", "good")


@dataclass(slots=True)
class CauseTally:
    """A cause of failures or doubts in a tally, with an example run."""

    title: str
    """Kind of the cause, such as ``provoked by traffic``."""
    text: str
    rules: tuple[str, ...]
    """Violated rules of the example run.

    The example is the run whose name comes first in the alphabet, so that the order of results does not matter.
    """
    run: str
    """Name of the example run."""
    rule: str
    """The rule whose verdict shows the cause in the example run."""
    hash: str | None
    """Hash of the example run; None without a run."""
    count: int = 0
    """Number of verdicts with this cause."""


@dataclass(slots=True)
class Tally:
    """Sums of the results of some runs: of all runs at a junction, or of all runs of a driver."""

    runs: int = 0
    table: Counter[tuple[str, str, Outcome]] = field(default_factory=Counter)
    """Number of verdicts by rule, configuration and outcome."""
    causes: dict[tuple[str, str], CauseTally] = field(default_factory=dict)
    """The causes by their title and text."""
    unlisted: int = 0
    """Number of verdicts whose causes were not kept, because the tally has too many causes."""

    def add(self, judged: Judged) -> None:
        """Add the result of a run."""
        self.runs += 1
        self.table.update((verdict.rule, judged.cfg, verdict.outcome) for verdict in judged.verdicts)
        if all(verdict.outcome in (Outcome.PASS, Outcome.NA) for verdict in judged.verdicts):
            return
        records = {record.nodeid: record for record in by_rule(judged)}
        for title, grouping in _GROUPS:
            groups = grouping()
            for record in records.values():
                groups.add(record)
            for cause in groups.causes():
                example = records[cause.example]
                # The replay page shows the names of the vehicles, so the text of the cause has none.
                text = cause.text.removesuffix(next((f" ({verdict.roles})" for verdict in example.verdicts if verdict.roles), ""))
                tally = self.causes.get((title, text))
                if tally is None and len(self.causes) >= _MOST:
                    self.unlisted += cause.count
                    continue
                count = cause.count + (tally.count if tally else 0)
                if tally is None or judged.nodeid < tally.run:
                    tally = CauseTally(title, text, cause.rules, judged.nodeid, example.asks, judged.hash)
                    self.causes[title, text] = tally
                tally.count = count

    @property
    def outcomes(self) -> Counter[Outcome]:
        """Number of verdicts by outcome."""
        counts: Counter[Outcome] = Counter()
        for (_, _, outcome), count in self.table.items():
            counts[outcome] += count
        return counts

    @property
    def mark(self) -> TownMark:
        """Mark of the junction on a map: the worst mark of its verdicts, or ``none`` if it has no verdicts."""
        marks = {_mark(outcome) for outcome in self.outcomes}
        return next((mark for mark in _MARKS if mark in marks), "none")

    @property
    def text(self) -> str:
        """The numbers of verdicts by outcome in one line."""
        counts = self.outcomes
        return counted({outcome: counts[outcome] for outcome in counts})

    def grouped(self) -> Iterator[tuple[str, list[CauseTally]]]:
        """Yield each kind of causes with its causes, which are sorted by gravity of the rules, then by frequency."""
        for title, _ in _GROUPS:
            tallies = [cause for cause in self.causes.values() if cause.title == title]
            if tallies:
                yield title, sorted(tallies, key=lambda cause: (gravity(cause.rules), -cause.count, cause.text))


def _mark(outcome: Outcome) -> TownMark:
    return "error" if outcome is Outcome.ERROR else outcome.mark


def cell(counts: Counter[Outcome]) -> tuple[str, TownMark]:
    """Return the text and the mark of a table cell: the worst of its outcomes, with the share of this outcome."""
    total = sum(counts.values())
    if not total:
        return "", "none"
    worst = min(counts, key=lambda outcome: outcome.severity)
    return (worst.cell if counts[worst] == total else f"{counts[worst]}/{total} {worst.small}"), _mark(worst)
