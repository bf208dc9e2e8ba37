"""The outline of a report: its whole content, in order, as blocks that every format renders.

Formats differ in how they show a block. All formats show the same blocks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from pytest_rvads.logic.outcome import Tallied, counted
from pytest_rvads.report.at_junctions import FEW, AtJunction, AtJunctions
from pytest_rvads.report.coverage import Cells, Requirements, dropped
from pytest_rvads.report.figures import Extremes, Makers, Timing, Titles, slowest
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import Sums, ranked, sums
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.triage import ByText, Cause, causes, idle, known, provoked, unavoidable, unsure
from pytest_rvads.support.wording import first, plural, quoted

__all__ = ["FAILURES", "Block", "Causes", "Changes", "Figures", "Head", "Notes", "RollUp", "Section", "Verdicts", "outline"]

FAILURES = "causes of failures"
"""Title of the block that groups failures, which no format folds."""
_REASONS = 5
"""Most reasons for left-out junctions in the short form."""
_LISTED = 10
"""Most lines of a kind in the short form: systems under test and simulators, stacks, samples."""
_SLOWEST = 10
"""Most slowest runs that are named; three in the short form, and none if all runs took less than a second."""
_NAMED = 5
"""Most junctions named per reason."""


@dataclass(frozen=True, slots=True)
class _Lines:
    lines: tuple[str, ...]

    def plain(self) -> Iterator[str]:
        """Yield the content of the block as lines of text."""
        yield from self.lines


@dataclass(frozen=True, slots=True)
class Notes(_Lines):
    """Missing or doubtful parts of the report, shown before everything else."""

    title: str = "notes"


@dataclass(frozen=True, slots=True)
class Head(_Lines):
    """The time and command of the session, its driver, its totals, and its end."""

    title: str = "session"
    short: tuple[str, ...] = ()
    """The lines that neither pytest's own output nor the blocks below contain."""


@dataclass(frozen=True, slots=True)
class Changes:
    """The changes since the baseline."""

    comparison: Comparison
    title: str = "since the baseline"
    again: str = "pytest"
    """The command that runs an item again."""

    def plain(self) -> Iterator[str]:
        """Yield the content of the block as lines of text."""
        yield self.comparison.headline
        yield from self.comparison.lines()

    def first(self, nodeid: str) -> str:
        """Return the command that runs an item again."""
        return _command(self.again, nodeid)


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts of one test at one junction."""

    matrix: Matrix

    @property
    def title(self) -> str:
        """The title: junction, traffic, and test."""
        return self.matrix.title

    def plain(self) -> Iterator[str]:
        """Yield the content of the block as lines of text."""
        for rows, entries in self.matrix.rows:
            told = (f"{column} {e.text}" for column, e in zip(self.matrix.headings, entries, strict=True) if e.text)
            yield f"{self.matrix.corner} {rows}: {'; '.join(told)}"


@dataclass(frozen=True, slots=True)
class RollUp:
    """Sums of the verdicts at many junctions, instead of a table per junction."""

    sums: tuple[Sums, ...]
    title: str = "verdicts in sums"

    def plain(self) -> Iterator[str]:
        """Yield the content of the block as lines of text."""
        for table in self.sums:
            yield from table.plain()


@dataclass(frozen=True, slots=True)
class Causes:
    """The causes of failures, or of items that did not fail, sorted by severity."""

    title: str
    causes: tuple[Cause, ...]
    again: str = "pytest"
    """The command that runs an item again."""
    settled: bool = False
    """Whether the causes need no attention: known failures, and items that did not apply or did not run."""

    def plain(self) -> Iterator[str]:
        """Yield the content of the block as lines of text."""
        for cause in self.causes:
            yield f"{cause.count} x {cause.rule}: {cause.line} (first: {self.first(cause)})"

    def first(self, cause: Cause) -> str:
        """Return the command that runs the first item of a cause again."""
        return _command(self.again, cause.example)


@dataclass(frozen=True, slots=True)
class Figures(_Lines):
    """Extreme values, coverage and durations."""

    title: str = "coverage"


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a comparison of two reports: lines, or a table that says the same."""

    title: str
    lines: tuple[str, ...]
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[tuple[str, str], ...], ...] = ()
    """The cells of the table: texts with the mark ``good``, ``bad`` or an empty mark."""
    side: bool = False
    """Whether the part stands beside another one where there is room."""


Block = Notes | Head | Changes | RollUp | Verdicts | Causes | Figures


class _Tally(Protocol):
    def add(self, record: Record) -> None: ...


_GROUPED: tuple[tuple[str, Callable[[], ByText]], ...] = (
    (FAILURES, causes),
    ("provoked by traffic", provoked),
    ("unavoidable: nobody could have kept the rule", unavoidable),
    ("unsure: another reading of what was recorded changes the verdict", unsure),
    ("known failures", known),
    ("not applicable, skipped or not run", idle),
)
"""Titles of blocks of causes, with the makers of their groups; the short form leaves out the last block."""
_SETTLED = {"known failures", "not applicable, skipped or not run"}


def outline(report: Report, short: bool = False, tables: bool = False) -> list[Block]:
    """Return the outline of a report, in one pass over its records; empty blocks are left out.

    Args:
        report: the report of a session, of several sessions merged, or of a campaign.
        short: whether to name at most three slow runs, none if all were quick, and to leave out requirements, versions and the
            reasons why items were not judged.
        tables: whether to include the table of every junction beside the sums that replace the tables of many junctions; never if
            there are too many verdicts for tables.
    """
    at_junctions = AtJunctions(report.totals, report.extents)
    matrices, cells, requirements = Matrices(), Cells(report.planned), Requirements()
    makers, titles, extremes, timing = Makers(), Titles(), Extremes(), Timing()
    groups = [(title, make()) for title, make in (_GROUPED[:-1] if short else _GROUPED)]
    _fill(
        report.records,
        matrices,
        at_junctions,
        cells,
        requirements,
        makers,
        titles,
        extremes,
        timing,
        *(group for _, group in groups),
    )
    many = at_junctions.many or matrices.too_many
    brief = _LISTED if short else None
    blocks: list[Block] = [Notes(report.notes)] if report.notes else []
    total, made = _total(at_junctions.found), tuple(_few(makers.lines(report.versions), brief))
    ended = f"exit status {report.ended}"
    # The block of a single junction shows its verdicts itself.
    blocks.append(Head((*_began(report), total, ended, *made), short=made if len(at_junctions.found) == 1 else (total, *made)))
    if report.comparison:
        blocks.append(Changes(report.comparison, again=report.again))
    blocks += [RollUp(sums(at_junctions.found))] if many else []
    blocks += map(Verdicts, matrices.matrices()) if tables or not many else []
    for title, group in groups:
        blocks += [Causes(title, tuple(found), report.again, title in _SETTLED)] if (found := group.causes(many)) else []
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    lines = (
        *titles.lines(brief),
        *extremes.lines(),
        *(_worst(at_junctions.found) if many else (line for one in at_junctions.found for line in one.lines())),
        *_few(timing.lines(), brief),
        *(slowest(report.seconds, 3, 1.0) if short else slowest(report.seconds, _SLOWEST)),
        *([] if short else requirements.lines()),
        *([f"versions: {versions}"] if versions and not short else []),
        f"coverage: {cells.coverage()}",
        *dropped(report, brief),
        *_few(refused(report, _REASONS if short else None), brief),
    )
    return [*blocks, Figures(lines)]


def _command(again: str, nodeid: str) -> str:
    return f"{again} {quoted(nodeid)}".lstrip()


def _began(report: Report) -> Iterator[str]:
    """Yield the beginning and the command of a session, if they are known."""
    if report.began:
        yield f"began {report.began}"
    if report.command:
        yield f"command: {report.command}"


def _total(junctions: Sequence[AtJunction]) -> str:
    """Return the number of verdicts by kind, and the number of runs."""
    tally = sum((junction.tally for junction in junctions), Counter[Tallied]())
    runs = len(set[str]().union(*(ids for junction in junctions for ids in (junction.runs, junction.wrong))))
    return f"{plural(tally.total(), 'verdict')} on {plural(runs, 'run')}: {counted(tally) or 'none'}"


def _fill(records: Iterable[Record], *tallies: _Tally) -> None:
    """Add all records to all tallies, in one pass."""
    adds = [tally.add for tally in tallies]
    for record in records:
        for add in adds:
            add(record)


def _few(lines: Sequence[str], most: int | None) -> Iterator[str]:
    """Yield at most `most` lines, and the number of further lines."""
    yield from lines[:most]
    if most is not None and len(lines) > most:
        yield f"... and {len(lines) - most} more"


def _worst(junctions: Sequence[AtJunction]) -> Iterator[str]:
    """Yield the lines of the worst few junctions."""
    yield from (line for junction in ranked(junctions)[:FEW] for line in junction.lines())
    if len(junctions) > FEW:
        yield f"... and {plural(len(junctions) - FEW, 'more junction')}, none worse"


def refused(report: Report, most: int | None = None) -> list[str]:
    """Return a line per reason for left-out junctions or movements, the most frequent first, and a line per drawn sample.

    Args:
        report: the report of a session, or of several sessions merged.
        most: most reasons that have a line; the junctions of further reasons are counted.
    """
    reasons = sorted(report.refused.items(), key=lambda entry: -len(entry[1]))
    lines = []
    for reason, names in reasons[:most]:
        what = plural(len(names), "movement" if " from entrance " in names[0] else "junction")
        lines.append(f"{what}{'' if reason.startswith('with ') else ' left out:'} {reason}: {first(names, _NAMED)}")
    further_names = {name for _, names in reasons[len(lines) :] for name in names}
    if further_names:
        lines.append(f"{plural(len(further_names), 'junction')} left out for other reasons: reports in files say which")
    return lines + [
        f"{sample.taken:,} of {sample.total:,} {sample.what} drawn, seed {sample.seed}: {sample.test}" for sample in report.drawn
    ]
