"""The outline of a report: all that it says, in order, as blocks that every format renders in its own way.

Formats differ in how they show a block, never in which: what one of them says, all say.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from pytest_rvads.outcome import Tallied, counted
from pytest_rvads.report.at_junctions import FEW, AtJunction, AtJunctions
from pytest_rvads.report.coverage import Cells, Requirements, dropped
from pytest_rvads.report.figures import Extremes, Makers, Timing, Titles, slowest
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.report.record import Record
from pytest_rvads.report.refused import refused
from pytest_rvads.report.rollup import Sums, ranked, sums
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.triage import ByText, Cause, causes, idle, known, provoked, unavoidable, unsure
from pytest_rvads.wording import plural, quoted

__all__ = ["FAILURES", "Block", "Causes", "Changes", "Figures", "Head", "Notes", "RollUp", "Verdicts", "outline"]

FAILURES = "causes of failures"
"""Title of the block that groups failures; no format folds it."""
_REASONS = 5
"""Reasons told in short why junctions are left out."""
_LISTED = 10
"""Lines of a kind told in short: systems under test and simulators, stacks, samples."""
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
class Head(_Lines):
    """When the session was and by which command, what drove, what came of it in all, and how it ended."""

    title: str = "session"
    short: tuple[str, ...] = ()
    """What of it whoever sees pytest's own lines and those below does not know."""


@dataclass(frozen=True, slots=True)
class Changes:
    """What changed since the baseline."""

    comparison: Comparison
    title: str = "since the baseline"
    again: str = "pytest"
    """The command that runs an item once more."""

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        yield self.comparison.headline
        yield from self.comparison.lines()

    def first(self, nodeid: str) -> str:
        """Return the command that runs an item once more."""
        return _command(self.again, nodeid)


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
class RollUp:
    """The verdicts at many junctions in sums, in place of a table for each."""

    sums: tuple[Sums, ...]
    title: str = "verdicts in sums"

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        for table in self.sums:
            yield from table.plain()


@dataclass(frozen=True, slots=True)
class Causes:
    """What is behind failures, or behind what was no failure, the gravest first."""

    title: str
    causes: tuple[Cause, ...]
    again: str = "pytest"
    """The command that runs an item once more."""
    settled: bool = False
    """Whether nobody has to look into them: known failures, and what did not apply or did not run."""

    def plain(self) -> Iterator[str]:
        """Yield what the block says, a line each."""
        for cause in self.causes:
            yield f"{cause.count} x {cause.rule}: {cause.line} (first: {self.first(cause)})"

    def first(self, cause: Cause) -> str:
        """Return the command that runs the first item of a cause once more."""
        return _command(self.again, cause.example)


@dataclass(frozen=True, slots=True)
class Figures(_Lines):
    """The extremes, what was exercised, and how long it took."""

    title: str = "coverage"


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
"""Titles of blocks of causes, and what finds them; the last one is left out in short."""
_SETTLED = {"known failures", "not applicable, skipped or not run"}


def outline(report: Report, short: bool = False, tables: bool = False) -> list[Block]:
    """Return what a report says, in one pass over its records; blocks that would be empty are left out.

    Args:
        report: of a session, merged, or of a campaign.
        short: name three slow runs at most, none where all were quick, and leave out what a glance does not need: why items were
            not judged, requirements, versions.
        tables: give the table of every junction also where there are more of them than a few, beside the sums that stand for
            them otherwise; none where nobody could read them.
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
    # One junction says its verdicts itself.
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
    """Yield when a session was and by which command, where that is known."""
    if report.began:
        yield f"began {report.began}"
    if report.command:
        yield f"command: {report.command}"


def _total(found: Sequence[AtJunction]) -> str:
    """Return how many verdicts there are of what kind, on how many runs."""
    tally = sum((one.tally for one in found), Counter[Tallied]())
    runs = len(set[str]().union(*(some for one in found for some in (one.runs, one.wrong))))
    return f"{plural(tally.total(), 'verdict')} on {plural(runs, 'run')}: {counted(tally) or 'none'}"


def _fill(records: Iterable[Record], *tallies: _Tally) -> None:
    """Let all tallies take all records in, in one pass."""
    adds = [tally.add for tally in tallies]
    for record in records:
        for add in adds:
            add(record)


def _few(lines: Sequence[str], most: int | None) -> Iterator[str]:
    """Yield at most so many lines, and how many more there are."""
    yield from lines[:most]
    if most is not None and len(lines) > most:
        yield f"... and {len(lines) - most} more"


def _worst(found: Sequence[AtJunction]) -> Iterator[str]:
    """Yield a line for each of the worst few junctions."""
    yield from (line for one in ranked(found)[:FEW] for line in one.lines())
    if len(found) > FEW:
        yield f"... and {plural(len(found) - FEW, 'more junction')}, none worse"
