"""The outline of a report: all that it says, in order, as blocks that every format renders in its own way.

Formats differ in how they show a block, never in which: what one of them says, all say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pytest_rvads.report.coverage import at_junctions, dropped, measure, traced
from pytest_rvads.report.figures import extremes, makers, slowest, timing
from pytest_rvads.report.matrix import Matrix, matrices
from pytest_rvads.report.refused import refused
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.triage import Cause, causes, idle, known, provoked, unavoidable, unsure

__all__ = ["Block", "Causes", "Changes", "Figures", "Notes", "Verdicts", "outline"]

_REASONS = 5
"""Reasons told in short why junctions are left out."""
_SLOWEST = 10
"""Runs named that took longest; in short three, and none where all were quicker than a second."""


@dataclass(frozen=True, slots=True)
class _Lines:
    lines: tuple[str, ...]

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        yield from self.lines


@dataclass(frozen=True, slots=True)
class Notes(_Lines):
    """What is missing or doubtful, before anything else is believed."""

    title: str = "notes"


@dataclass(frozen=True, slots=True)
class Changes:
    """What changed since the baseline."""

    comparison: Comparison
    title: str = "since the baseline"

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        yield self.comparison.headline
        yield from self.comparison.lines()


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts of one test at one junction."""

    matrix: Matrix

    @property
    def title(self) -> str:
        """Junction, traffic, and test."""
        return self.matrix.title

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        for rows, entries in self.matrix.rows:
            told = (f"{column} {e.text}" for column, e in zip(self.matrix.headings, entries, strict=True) if e.text)
            yield f"{self.matrix.corner} {rows}: {'; '.join(told)}"


@dataclass(frozen=True, slots=True)
class Causes:
    """What is behind failures, or behind what was no failure, the most frequent first."""

    title: str
    causes: tuple[Cause, ...]

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        for cause in self.causes:
            yield f"{cause.count} x {cause.rule}: {cause.line} (first: {cause.example})"


@dataclass(frozen=True, slots=True)
class Figures(_Lines):
    """Who drove, what simulated, the extremes, what was exercised, and how long it took."""

    title: str = "coverage"


Block = Notes | Changes | Verdicts | Causes | Figures


def outline(report: Report, short: bool = False) -> list[Block]:
    """Return what a report says; blocks that would be empty are left out.

    Args:
        report: of a session, or merged.
        short: name three slow runs at most, none where all were quick, and leave out what a glance does not need: why items are
            known failures or were not judged, requirements, versions.
    """
    records = report.records
    blocks: list[Block] = [Notes(report.notes)] if report.notes else []
    if report.comparison:
        blocks.append(Changes(report.comparison))
    blocks += map(Verdicts, matrices(records))
    grouped = [
        ("causes of failures", causes),
        ("provoked by traffic", provoked),
        ("unavoidable: nobody could have kept the rule", unavoidable),
        ("unsure: another reading of what was recorded changes the verdict", unsure),
    ]
    grouped += [] if short else [("known failures", known), ("not applicable, skipped or not run", idle)]
    for title, group in grouped:
        blocks += [Causes(title, tuple(found))] if (found := group(records)) else []
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    lines = (
        *makers(records),
        *extremes(records),
        *at_junctions(records, report.totals, report.extents),
        *timing(records),
        *(slowest(report.seconds, 3, 1.0) if short else slowest(report.seconds, _SLOWEST)),
        *([] if short else traced(records)),
        *([f"versions: {versions}"] if versions and not short else []),
        f"coverage: {measure(report)}",
        *dropped(report),
        *refused(report, _REASONS if short else None),
    )
    return [*blocks, Figures(lines)]
