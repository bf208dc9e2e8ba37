"""The outline of a report: its whole content in order, as blocks (parts such as tables or causes) that every format renders.

All formats show the same blocks, each format in its own way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from pytest_rvads.report.counting import Counts
from pytest_rvads.report.figures import LISTED, SIMULTANEOUS, Tried, figures, makers, pairs_tried, simultaneous, total
from pytest_rvads.report.matrix import Matrices, Matrix
from pytest_rvads.report.rollup import Sums, many, sums
from pytest_rvads.report.session_report import Comparison, Report
from pytest_rvads.report.triage import ByText, Cause, causes, idle, known, provoked, unavoidable, unsure
from pytest_rvads.support.wording import quoted

LONG = 40
"""Largest number of characters of a text that is not wrapped in a table."""
FAILURES = "causes of failures"
"""Title of the block with the causes of failures, which no format folds."""


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
class Head:
    """The time and command of the session, its driver, its totals, and its end."""

    facts: tuple[tuple[str, str], ...]
    """Pairs of a term and a text, which make a line together; the term of the line on all verdicts is empty."""
    shown: tuple[tuple[str, str], ...] = ()
    """The facts to print at the end of a pytest session: facts that are neither in pytest's own output nor in a later block."""
    title: str = "session"

    def plain(self, brief: bool = False) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text; only the facts of `shown` if `brief`."""
        yield from (f"{term} {text}".lstrip() for term, text in (self.shown if brief else self.facts))


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

    @property
    def first(self) -> str:
        """The command that runs the first item that fails now and did not before; empty if there is none."""
        new = next((change.nodeid for change in self.comparison.changes if change.kind == "NEW"), "")
        return f"{self.again} {quoted(new)}".lstrip() if new else ""


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
    """The cells of the table: texts with the mark ``good``, ``bad``, ``bars`` for a histogram in text, ``look`` for the path
    of a replay page, ``code`` for a command, or an empty mark."""
    side: bool = False
    """Whether the part is shown beside another part if the page is wide enough."""

    @property
    def long(self) -> bool:
        """Whether a row becomes a block on a narrow screen, because a cell beside its label has a long text."""
        return any(len(text) > LONG for _, *cells in self.rows for text, _ in cells)

    def plain(self) -> Iterator[str]:
        """Yield the content of this part of a report as lines of text."""
        yield from self.lines


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


@dataclass(frozen=True, slots=True)
class Picture(_Lines):
    """A picture on a page, between the head and the causes."""

    title: str = ""
    svg: str = ""


Block: TypeAlias = Notes | Head | Changes | RollUp | Matrix | Causes | Figures | Section | Picture

_GROUPED: tuple[tuple[str, Callable[[], ByText], bool], ...] = (
    (FAILURES, causes, False),
    ("provoked by traffic", provoked, False),
    ("unavoidable: nobody could have kept the rule", unavoidable, False),
    ("unsure: another reading of what was recorded changes the verdict", unsure, False),
    ("known failures", known, True),
    ("not applicable, skipped or not run", idle, True),
)
"""Per block of causes: its title, the function that makes its collector of records, and whether it is settled; the short form has
no last block."""


def outline(report: Report, short: bool = False, tables: bool = False) -> list[Block]:
    """Return the outline of a report, i.e. its content in blocks, in one pass over its records; empty blocks are left out."""
    counts, matrices = Counts(report), Matrices()
    groups = [(title, make(), settled) for title, make, settled in (_GROUPED[:-1] if short else _GROUPED)]
    adds = [counts.add, matrices.add, *(group.add for _, group, _ in groups)]
    for record in report.records:
        for add in adds:
            add(record)
    summed = many(counts) or matrices.too_many
    made, all_verdicts = list(makers(counts)), total(counts)
    if short and len(made) > LISTED:
        made[LISTED:] = [("", f"... and {len(made) - LISTED} more")]
    beginning = [("began", report.began), ("command:", report.command), ("", all_verdicts), ("exit status", str(report.ended))]
    # The block of a single junction shows the total, so the short head needs no total.
    shown = made if len(counts.first) == 1 else [("", all_verdicts), *made]
    blocks: list[Block] = [Notes(report.notes)] if report.notes else []
    blocks.append(Head((*(fact for fact in beginning if fact[1]), *made), tuple(shown)))
    blocks += [Changes(report.comparison, again=report.again)] if report.comparison else []
    blocks += [RollUp(sums(counts))] if summed else []
    blocks += matrices.matrices() if tables or not summed else []
    for title, group, settled in groups:
        group_causes = tuple(group.causes(summed))
        blocks += [Causes(title, group_causes, report.again, settled)] if group_causes else []
    last = SIMULTANEOUS if simultaneous(counts) else ""
    lines = (*figures(counts, short), *filter(None, [last]))
    return [*blocks, Figures(lines, arrivals=None if short else _arrivals(counts, summed), last=last)]


def _arrivals(counts: Counts, summed: bool) -> Section | None:
    """Return a table of the tried differences between arrivals: a row per pair of movements, or per junction for many pairs."""
    rows: list[tuple[tuple[str, ...], Tried, Tried]] = []
    heads: tuple[str, ...]
    if summed:
        heads = ("junction", "pairs met")
        for site, met in counts.met.items():
            worst = max(map(Tried, met.values()), key=lambda tried: tried.length)
            rows.append(((str(site), f"{len(met)} of {counts.pairs[site]}"), Tried(sum(met.values(), Counter())), worst))
    else:
        heads = ("junction", "under test", "other vehicle")
        rows = [((str(site), own, other), tried, tried) for site, own, other, tried in pairs_tried(counts)]
    if not rows:
        return None
    heads += ("other first", "together", "other later", "largest untested gap")
    lines, table = [], []
    for names, tried, worst in rows:
        texts = (*names, *map(str, tried.orders), str(worst))
        lines.append(f"{', '.join(map(' '.join, zip(heads, texts, strict=True)))}: {tried.bins()}")
        table.append((*((text, "") for text in texts), (tried.bars(), "bars")))
    return Section("arrivals", tuple(lines), (*heads, "6 s earlier to 6 s later"), tuple(table))
