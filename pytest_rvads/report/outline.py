"""The outline of a report: its whole content in order, as blocks (parts such as tables or causes) that every format renders.

All formats show the same blocks, each format in its own way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from pytest_rvads.logic.outcome import Tallied, counted
from pytest_rvads.report.coverage import SIMULTANEOUS, ArrivalCoverage, Cells, Requirements, Tried, dropped
from pytest_rvads.report.figures import Excesses, Extremes, Makers, Timing, Titles, slowest
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import FEW, AtJunction, AtJunctions, Sums, ranked, sums
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.triage import ByText, Cause, causes, idle, known, provoked, unavoidable, unsure
from pytest_rvads.support.wording import first, plural, quoted

FAILURES = "causes of failures"
"""Title of the block with the causes of failures, which no format folds."""
_REASONS = 5
"""Largest number of reasons for left-out junctions in the short form."""
_LISTED = 10
"""Largest number of lines of a kind in the short form: systems under test and simulators, stacks, samples."""
_SLOWEST = 10
"""Largest number of slowest runs that are named; three in the short form, and none if all runs took less than a second."""
_NAMED = 5
"""Largest number of junctions named per reason."""


@dataclass(frozen=True, slots=True)
class _Lines:
    lines: tuple[str, ...]

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        yield from self.lines


@dataclass(frozen=True, slots=True)
class Notes(_Lines):
    """Notes on missing or doubtful parts of the report, which formats show before all other blocks."""

    title: str = "notes"


@dataclass(frozen=True, slots=True)
class Head(_Lines):
    """The time and command of the session, its driver, its totals, and its end."""

    title: str = "session"
    short: tuple[str, ...] = ()
    """The lines to print at the end of a pytest session: lines that are neither in pytest's own output nor in a later block."""


@dataclass(frozen=True, slots=True)
class Changes:
    """The changes since the baseline."""

    comparison: Comparison
    title: str = "since the baseline"
    again: str = "pytest"
    """The command that runs an item again if the quoted id of the item follows."""

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        yield self.comparison.headline
        yield from self.comparison.lines()

    def first(self, nodeid: str) -> str:
        """Return the command that runs the test item with this id again."""
        return f"{self.again} {quoted(nodeid)}".lstrip()


@dataclass(frozen=True, slots=True)
class Verdicts:
    """The verdicts of one test at one junction."""

    matrix: Matrix

    @property
    def title(self) -> str:
        """Title of the block: junction, traffic, and test."""
        return self.matrix.title

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        for rows, entries in self.matrix.rows:
            texts = (f"{column} {e.text}" for column, e in zip(self.matrix.headings, entries, strict=True) if e.text)
            yield f"{self.matrix.corner} {rows}: {'; '.join(texts)}"


@dataclass(frozen=True, slots=True)
class RollUp:
    """Sums of the verdicts at many junctions, in place of a table per junction."""

    sums: tuple[Sums, ...]
    title: str = "verdicts in sums"

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        for table in self.sums:
            yield from table.plain()


@dataclass(frozen=True, slots=True)
class Causes:
    """Groups of failures by their cause, or groups of items that did not fail by their reason, sorted by severity."""

    title: str
    causes: tuple[Cause, ...]
    again: str = "pytest"
    """The command that runs an item again if the quoted id of the item follows."""
    settled: bool = False
    """Whether the causes need no attention: known failures, and items that did not apply or did not run."""

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        for cause in self.causes:
            yield f"{cause.count} x {cause.rule}: {cause.line} (first: {self.first(cause)})"

    def first(self, cause: Cause) -> str:
        """Return the command that runs the first test item of a cause again."""
        return f"{self.again} {quoted(cause.example)}".lstrip()


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a comparison of two reports: lines, and possibly a table with the same content, for formats with tables."""

    title: str
    lines: tuple[str, ...]
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[tuple[str, str], ...], ...] = ()
    """The cells of the table: texts with the mark ``good``, ``bad``, ``bars`` for a histogram in text, ``look`` for the path of a
    replay page, or an empty mark."""
    side: bool = False
    """Whether the part is shown beside another part if the page is wide enough."""


@dataclass(frozen=True, slots=True)
class Figures(_Lines):
    """Extreme values, coverage and durations."""

    title: str = "coverage"
    arrivals: Section | None = None
    """The differences between arrivals that were tried; None in the short form and if no two vehicles met."""
    last: str = ""
    """The line of `lines` that terminals print below all other output; empty if there is no such line."""

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        yield from self.lines
        yield from self.arrivals.lines if self.arrivals else ()


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
"""Title of each block of causes, with the function that makes its collector of records; the short form has no last block."""
_SETTLED = {"known failures", "not applicable, skipped or not run"}


def outline(report: Report, short: bool = False, tables: bool = False) -> list[Block]:
    """Return the outline of a report, i.e. its content in blocks, in one pass over its records; empty blocks are left out."""
    at_junctions = AtJunctions(report.totals, report.extents)
    matrices, cells, arrivals, requirements = Matrices(), Cells(report.planned), ArrivalCoverage(), Requirements()
    makers, titles, extremes, timing, excesses = Makers(), Titles(), Extremes(), Timing(), Excesses()
    groups = [(title, make()) for title, make in (_GROUPED[:-1] if short else _GROUPED)]
    tallies: list[_Tally] = [matrices, at_junctions, cells, arrivals, requirements, makers, titles, extremes, timing, excesses]
    tallies += [group for _, group in groups]
    adds = [tally.add for tally in tallies]
    for record in report.records:
        for add in adds:
            add(record)
    many = at_junctions.many or matrices.too_many
    brief = _LISTED if short else None
    blocks: list[Block] = [Notes(report.notes)] if report.notes else []
    total, maker_lines = _verdict_total(at_junctions.junctions), tuple(_few(makers.lines(report.versions), brief))
    beginning = [f"began {report.began}"] if report.began else []
    beginning += [f"command: {report.command}"] if report.command else []
    # The block of a single junction shows the total, so the head needs no total.
    blocks.append(
        Head(
            (*beginning, total, f"exit status {report.ended}", *maker_lines),
            short=maker_lines if len(at_junctions.junctions) == 1 else (total, *maker_lines),
        )
    )
    if report.comparison:
        blocks.append(Changes(report.comparison, again=report.again))
    blocks += [RollUp(sums(at_junctions.junctions))] if many else []
    blocks += map(Verdicts, matrices.matrices()) if tables or not many else []
    for title, group in groups:
        blocks += (
            [Causes(title, tuple(group_causes), report.again, title in _SETTLED)] if (group_causes := group.causes(many)) else []
        )
    worst = ranked(at_junctions.junctions)[:FEW] if many else at_junctions.junctions
    junction_lines = [line for junction in worst for line in junction.lines()]
    if further := len(at_junctions.junctions) - len(worst):
        junction_lines.append(f"... and {plural(further, 'more junction')}, with no worse verdicts")
    versions = ", ".join(f"{name} {version}" for name, version in report.versions.items())
    lines = (
        *titles.lines(brief),
        *extremes.lines(),
        *junction_lines,
        *_few(timing.lines(), brief),
        *excesses.lines(),
        *(slowest(report.seconds, 3, 1.0) if short else slowest(report.seconds, _SLOWEST)),
        *([] if short else requirements.lines()),
        *([f"versions: {versions}"] if versions and not short else []),
        f"coverage: {cells.coverage()}",
        *([arrivals.line()] if arrivals.pairs else []),
        *dropped(report, brief),
        *_few(refused(report, _REASONS if short else None), brief),
    )
    last = SIMULTANEOUS if arrivals.simultaneous else ""
    return [*blocks, Figures((*lines, *filter(None, [last])), arrivals=None if short else _arrivals(arrivals, many), last=last)]


def _arrivals(coverage: ArrivalCoverage, many: bool) -> Section | None:
    """Return a table of the tried differences between arrivals: a row per pair of movements, or per junction for many pairs."""
    rows: list[tuple[tuple[str, ...], Tried, Tried]]
    if many:
        heads: tuple[str, ...] = ("junction", "pairs met")
        rows = [((name, f"{met} of {pairs}"), tried, worst) for name, met, pairs, tried, worst in coverage.at_junctions()]
    else:
        heads = ("junction", "under test", "other vehicle")
        rows = [(tuple(names), tried, tried) for *names, tried in coverage.rows()]
    if not rows:
        return None
    heads += ("other first", "together", "other later", "largest untested gap")
    lines, table = [], []
    for names, tried, worst in rows:
        texts = (*names, *map(str, tried.orders), str(worst))
        lines.append(f"{', '.join(map(' '.join, zip(heads, texts, strict=True)))}: {tried.bins()}")
        table.append((*((text, "") for text in texts), (tried.bars(), "bars")))
    return Section("arrivals", tuple(lines), (*heads, "6 s earlier to 6 s later"), tuple(table))


def _verdict_total(junctions: Sequence[AtJunction]) -> str:
    tally = sum((junction.tally for junction in junctions), Counter[Tallied]())
    runs = len(set[str]().union(*(ids for junction in junctions for ids in (junction.runs, junction.wrong))))
    return f"{plural(tally.total(), 'verdict')} on {plural(runs, 'run')}: {counted(tally) or 'none'}"


def _few(lines: Sequence[str], most: int | None) -> Iterator[str]:
    """Yield at most `most` lines, then a line with the number of further lines."""
    yield from lines[:most]
    if most is not None and len(lines) > most:
        yield f"... and {len(lines) - most} more"


def refused(report: Report, most: int | None = None) -> list[str]:
    """Return a line per reason why junctions, movements or scenarios are left out, and a line per sampled test."""
    reasons = sorted(report.refused.items(), key=lambda entry: -len(entry[1]))
    lines = []
    for reason, names in reasons[:most]:
        what = plural(len(names), "movement" if " from entrance " in names[0] else "test" if "::" in names[0] else "junction")
        lines.append(f"{what}{'' if reason.startswith('with ') else ' left out:'} {reason}: {first(names, _NAMED)}")
    further_names = {name for _, names in reasons[len(lines) :] for name in names}
    if further_names:
        lines.append(f"{plural(len(further_names), 'junction')} left out for other reasons: reports in files say which")
    return lines + [f"{sample}: {sample.test}" for sample in report.drawn]
