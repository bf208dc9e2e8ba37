"""Sums of the results of a junction of a town: memory grows with junctions, rules and causes, not with runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from pytest_rvads.logic.outcome import Mark, Outcome, counted
from pytest_rvads.report.record import Record
from pytest_rvads.report.run_record import by_rule
from pytest_rvads.report.triage import Cause, causes, gravity, provoked, unavoidable, unsure
from pytest_rvads.satellites.campaigns.judged import Judged

__all__ = ["CauseTally", "JunctionTally", "TownMark", "cell"]

TownMark = Mark | Literal["error"]
"""How a map or a cell shows what came of runs; ``error``: the runs have no verdict, which says nothing about the driving."""

_GROUPS = (
    ("causes of failures", causes),
    ("provoked by traffic", provoked),
    ("unavoidable: nobody could have kept the rule", unavoidable),
    ("unsure", unsure),
)
_MOST = 100
"""Most causes kept per junction, since the messages of foreign code may differ in every run."""
_MARKS: tuple[TownMark, ...] = ("bad", "error", "doubt", "good")


@dataclass(slots=True)
class CauseTally:
    """A cause of verdicts at a junction, with an example."""

    title: str
    """Kind of the cause."""
    text: str
    rules: tuple[str, ...]
    """Violated rules of the example. The example is the first run by name, so that no order of results matters."""
    run: str
    """Name of the example."""
    rule: str
    """The rule whose verdict shows the cause in the example."""
    hash: str | None
    """Hash of the example."""
    count: int = 0
    """Number of verdicts with this cause."""


@dataclass(slots=True)
class JunctionTally:
    """Sums of the results of a junction."""

    runs: int = 0
    table: Counter[tuple[str, str, Outcome]] = field(default_factory=Counter)
    """Number of verdicts by rule, configuration and outcome."""
    causes: dict[tuple[str, str], CauseTally] = field(default_factory=dict)
    """The causes, by title and text."""
    untold: int = 0
    """Number of verdicts whose causes exceed the most causes kept."""
    shapes: Counter[str] = field(default_factory=Counter)
    """Number of runs simulated at other junctions of the same shape, by name of the junction."""

    def add(self, judged: Judged) -> None:
        """Add a result."""
        self.runs += 1
        if judged.shape:
            self.shapes[judged.shape] += 1
        self.table.update((verdict.rule, judged.cfg, verdict.outcome) for verdict in judged.verdicts)
        if all(verdict.outcome in (Outcome.PASS, Outcome.NA) for verdict in judged.verdicts):
            return
        records = {record.nodeid: record for record in by_rule(judged)}
        for title, grouping in _GROUPS:
            groups = grouping()
            for record in records.values():
                groups.add(record)
            for cause in groups.causes():
                self._explain(title, cause, judged, records[cause.example])

    def _explain(self, title: str, cause: Cause, judged: Judged, example: Record) -> None:
        """Add a cause of verdicts of a run, without the vehicles: the replay shows the vehicles."""
        roles = next((f" ({verdict.roles})" for verdict in example.verdicts if verdict.roles), "")
        text = cause.text.removesuffix(roles)
        tally = self.causes.get((title, text))
        if tally is None and len(self.causes) >= _MOST:
            self.untold += cause.count
            return
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
        """Mark of the junction on a map: bad, error, doubt or good; none without verdicts."""
        marks = {_mark(outcome) for outcome in self.outcomes}
        return next((mark for mark in _MARKS if mark in marks), "none")

    @property
    def told(self) -> str:
        """The outcomes in one line."""
        counts = self.outcomes
        return counted({outcome: counts[outcome] for outcome in counts})

    def grouped(self) -> Iterator[tuple[str, list[CauseTally]]]:
        """Yield the causes of each kind, the gravest first, then the most frequent."""
        for title, _ in _GROUPS:
            tallies = [cause for cause in self.causes.values() if cause.title == title]
            if tallies:
                yield title, sorted(tallies, key=lambda cause: (gravity(cause.rules), -cause.count, cause.text))


def _mark(outcome: Outcome) -> TownMark:
    return "error" if outcome is Outcome.ERROR else outcome.mark


def cell(counts: Counter[Outcome]) -> tuple[str, TownMark]:
    """Return the text and the mark of a table cell, given its outcomes: the worst outcome with its share."""
    total = sum(counts.values())
    if not total:
        return "", "none"
    worst = min(counts, key=lambda outcome: outcome.severity)
    return (worst.cell if counts[worst] == total else f"{counts[worst]}/{total} {worst.small}"), _mark(worst)
