"""Prints the summary of a session as text for terminals and logs of any width.

A table is laid out in blocks of columns that fit on the terminal; each block repeats the names of all rows. Wide texts are
wrapped at their spaces. If not even the longest words fit beside each other, each row becomes a list. Only a word that is longer
than a line is broken. The class rich.table.Table is not used, because it does not split a table into blocks.

This module imports rich, which is slow to import, so sessions import this module only at their end.
"""

from __future__ import annotations

import io
import re
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, zip_longest
from operator import itemgetter
from typing import NamedTuple

from rich.cells import cell_len, chop_cells
from rich.console import Console
from rich.text import Text

from pytest_rvads.logic.outcome import EXPLANATIONS
from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Head, RollUp, outline
from pytest_rvads.report.rollup import WORST, Sums
from pytest_rvads.report.session_report import Report
from pytest_rvads.support.wording import plural, printable

_BREAK = re.compile(r"(?<!\d) | (?!(?:m?s|m|m/s|m/s\^2|NA)(?:[ ,:;).]|$))")
"""The spaces at which a text can be broken into lines."""

_GAPS = 3, 2
"""Gap between columns if all columns fit in one block, and gap if the columns need several blocks [characters]."""
_PLEASANT = 20
"""Width above which the texts of a column are wrapped, as far as their words allow [characters]."""
_INDENT = 2
"""Indent of a line that continues the line above [characters]."""
_MOST = 10
"""Largest number of causes, and of changes of a kind, that are listed; further causes and changes are counted."""
_ROWS = 20
"""Largest number of rows of a table that are shown; rows with failures come first."""
_LINES = 50
"""Largest number of lines of all tables together; tables with failures come first."""
_LENGTH, _BRIEF = 20_000, 1_000
"""Largest number of characters of a line in the full form, and in the short form."""
_NARROWEST = 20
"""Least width of the output, even on a narrower terminal [characters]."""
_RELATIVE = re.compile(r"(entrance|arm)\s+\+\d")
"""Matches an arm that a cause counts from the arm of another vehicle, so that the cause is the same for rotated scenarios."""
_CHANGES = {"NEW": "bold red", "FIXED": "green", "ERODED": "yellow", "LOST": "yellow"}


class Cell(NamedTuple):
    """A cell of a table: a text with its style on a terminal."""

    text: str = ""
    style: str = ""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table: its headings from top to bottom, and a cell per row."""

    heads: tuple[str, ...]
    cells: tuple[Cell, ...]
    right: bool = False
    """Whether the texts are aligned at the right, as numbers are."""
    group: Hashable = None
    """Name of a group: neighbouring columns of a group stay in one block if the width allows."""


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a table with some of its columns, as lines of text."""

    columns: tuple[int, ...]
    """The numbers of the columns in the table."""
    lines: tuple[Text, ...]


def wrapped(text: str, width: int, indent: int = 0) -> list[str]:
    """Return a text as lines, broken at spaces, but not between a number and its unit; a word longer than a line is cut.

    All lines except the first are indented by `indent` characters.
    """
    lines = [""]
    for word in _BREAK.split(text):
        joined = f"{lines[-1]} {word}" if lines[-1].strip() else lines[-1] + word
        if cell_len(joined) <= width:
            lines[-1] = joined
            continue
        pieces = [word] if cell_len(word) <= width - indent else chop_cells(word, max(width - indent, 2))
        lines += [" " * indent + piece for piece in pieces]
    return lines[1:] if len(lines) > 1 and not lines[0] else lines


def blocks(corner: str, labels: Sequence[str], columns: Sequence[Column], width: int, rule: str = "-") -> list[Part]:
    """Return a table as blocks of at most `width` characters."""
    if not columns:
        return []
    label_width = max(map(cell_len, (corner, *labels)))
    widths, longest_word = [], 0
    for column in columns:  # as wide as the longest text, or as the longest word if the texts are long
        texts = [*column.heads, *(cell.text for cell in column.cells)]
        word = max(map(_longest, texts))
        longest_word = max(longest_word, word)
        widths.append(max(cell_len(line) for text in texts for line in wrapped(text, max(_PLEASANT, word))))
    gap = _GAPS[1 + label_width + sum(_GAPS[0] + column_width for column_width in widths) > width]
    if 1 + label_width + sum(gap + column_width for column_width in widths) > width:
        word = max(_longest(text) for text in (corner, *labels))
        most = max(min(label_width, width // 3), min(label_width, word + _INDENT))
        label_width = max(cell_len(line) for text in (corner, *labels) for line in wrapped(text, most, _INDENT))
        if 1 + label_width + gap + longest_word > width:
            # As a list: the name of each row, followed by its cells with their headings.
            lines: list[Text] = []
            for number, label in enumerate(labels):
                lines += [Text(f" {line}") for line in wrapped(f"{corner} {label}", width - 1, _INDENT)]
                cells = [f"{' '.join(filter(None, c.heads))}: {c.cells[number].text}" for c in columns if c.cells[number].text]
                parts = wrapped("; ".join(cells), width - 1 - _INDENT, _INDENT)
                lines += [Text(f"{' ' * (1 + _INDENT)}{line}") for line in parts]
            return [Part(tuple(range(len(columns))), tuple(lines))]
    room = width - 1 - label_width
    widths = [min(column_width, room - gap) for column_width in widths]
    result = []
    for page in _packed(columns, [gap + column_width for column_width in widths], room):
        shown = [(columns[i], widths[i]) for i in page]
        result.append(Part(page, _block_lines(corner, labels, label_width, shown, gap, rule)))
    return result


def _longest(text: str) -> int:
    return max(map(cell_len, text.split(" ")))


def _packed(columns: Sequence[Column], widths: Sequence[int], room: int) -> list[tuple[int, ...]]:
    """Return the numbers of the columns in each block of a table."""
    pages: list[list[int]] = [[]]
    used = 0
    for _, members in groupby(range(len(columns)), lambda i: columns[i].group or i):
        group = list(members)
        together = sum(widths[i] for i in group)
        for k, i in enumerate(group):
            if pages[-1] and used + (widths[i] if k else together) > room:
                pages.append([])
                used = 0
            pages[-1].append(i)
            used += widths[i]
    return [tuple(page) for page in pages]


def _block_lines(
    corner: str, labels: Sequence[str], label_width: int, shown: Sequence[tuple[Column, int]], gap: int, rule: str
) -> tuple[Text, ...]:
    """Return the lines of one block of a table, whose columns are `shown` with their widths; a cell can take several lines."""
    lines: list[Text] = []

    def add_row(label: str, cells: Sequence[Cell]) -> None:
        texts = [wrapped(cell.text, width) for cell, (_, width) in zip(cells, shown, strict=True)]
        for name, *parts in zip_longest(wrapped(label, label_width, _INDENT), *texts, fillvalue=""):
            line = Text(f" {name}{' ' * (label_width - cell_len(name))}")
            for part, cell, (column, width) in zip(parts, cells, shown, strict=True):
                pad = " " * (width - cell_len(part))
                line.append(" " * gap + (pad if column.right else ""))
                line.append(part, style=cell.style)
                line.append("" if column.right else pad)
            line.rstrip()
            lines.append(line)

    *upper, lowest = zip(*(column.heads for column, _ in shown), strict=True)
    for heads in upper:  # neighbouring columns with the same heading show the heading once
        once = [head if not k or heads[k - 1] != head else "" for k, head in enumerate(heads)]
        if any(once):
            add_row("", [Cell(head) for head in once])
    add_row(corner, [Cell(head) for head in lowest])
    lines.append(Text(rule * (1 + label_width + sum(gap + width for _, width in shown))))
    for number, label in enumerate(labels):
        add_row(label, [column.cells[number] for column, _ in shown])
    return tuple(lines)


@dataclass(frozen=True, slots=True)
class Summary:
    """The text of a report's summary in two parts; the second part has the causes of failures."""

    verdicts: str
    """The first part: totals, changes, tables and figures."""
    causes: str
    """The second part: causes of failures, and causes of items that did not fail."""
    last: str
    """The last line on the terminal; empty without such a line."""


def summary(
    report: Report, *, colour: bool, width: int, unicode: bool, full: bool = False, more: str = "reports in files hold all"
) -> str:
    """Return the summary of a report as text of a width [characters]; causes come last, and callers print the notes."""
    parts = summarise(report, colour=colour, width=width, unicode=unicode, full=full, more=more)
    return "\n".join([parts.verdicts + parts.causes, parts.last, ""]) if parts.last else parts.verdicts + parts.causes


def summarise(report: Report, *, colour: bool, width: int, unicode: bool, full: bool, more: str, head: bool = True) -> Summary:
    """Return the summary of a report as text of a width [characters] in two parts: verdicts and causes."""
    verdicts, causes = (_Screen(colour, max(width, _NARROWEST), unicode, full, more) for _ in range(2))
    tables: list[RollUp | Matrix] = []
    later_blocks: list[Block] = []
    for block in outline(report, short=not full, tables=full):
        match block:
            case Head():
                verdicts.lines(block.plain(brief=not head))
            case Changes():
                verdicts.changes(block)
            case RollUp() | Matrix():
                tables.append(block)
            case Causes(settled=False):
                causes.lines([""] if causes.text() else [])
                causes.causes(block)
            case _:
                later_blocks.append(block)
    if _RELATIVE.search(causes.text()):
        causes.lines(["", " entrance +1: one arm counter-clockwise from +0, the arm of the vehicle that is named first"])
    verdicts.tables(tables)
    for block in later_blocks:
        match block:
            case Causes():
                verdicts.causes(block)
                verdicts.lines([""])
            case Figures(last=last):
                verdicts.lines(line for line in block.plain() if line != last)
    return Summary(verdicts.text(), causes.text(), last)


class _Table(NamedTuple):
    """A table, divided into blocks of columns that fit on a terminal; rows are left out unless everything is to be shown."""

    title: str
    parts: Sequence[Part]
    hidden: str
    """The rows left out, in words; empty if none are."""
    wrong: Sequence[bool]
    """Per block, whether the block contains failures."""
    below: Sequence[list[str]]
    """Per block, the lines below its table; each line is printed once."""

    def height(self, k: int) -> int:
        """Return the number of lines of a block of columns, including its title and the lines below its table."""
        return len(self.parts[k].lines) + len(self.below[k]) + 2


class _Screen:
    """Renders the parts of a report as text; unless `full`, long lists and tables are cut."""

    def __init__(self, colour: bool, width: int, unicode: bool, full: bool, more: str) -> None:
        self._out = io.StringIO()
        self._console = Console(
            file=self._out, force_terminal=colour, no_color=not colour, width=width, highlight=False, legacy_windows=False
        )
        self._width, self._rule = width, "─" if unicode else "-"
        self.most = None if full else _MOST
        self._full, self._more = full, more
        self._length = _LENGTH if full else _BRIEF

    def text(self) -> str:
        """Return the text that was rendered so far."""
        return self._out.getvalue()

    def lines(self, texts: Iterable[str]) -> None:
        """Print lines, each broken at spaces if it is too long."""
        for text in texts:
            for line in wrapped(_fit(text, self._length), self._width, 4):
                self._print_line(line)

    def tables(self, table_blocks: Sequence[RollUp | Matrix]) -> None:
        """Render as many blocks of tables as fit on a screen, but at least one; blocks with failures come first."""
        tables: list[_Table] = []
        for block in table_blocks:
            tables += self._sums_tables(block.sums) if isinstance(block, RollUp) else [self._matrix_table(block)]
        # First blocks of all tables precede second blocks.
        ranked = sorted(
            (not wrong, table.wrong[:k].count(wrong), number, k)
            for number, table in enumerate(tables)
            for k, wrong in enumerate(table.wrong)
        )
        shown: set[tuple[int, int]] = set()
        lines = 0
        for *_, number, k in ranked:
            lines += tables[number].height(k)
            if shown and lines > _LINES and not self._full:
                break
            shown.add((number, k))
        hidden_tables = 0
        for number, table in enumerate(tables):
            parts = [k for k in range(len(table.parts)) if (number, k) in shown]
            if table.parts and not parts:
                hidden_tables += 1
                continue
            if table.title:
                self._print_line(table.title, "bold")
            for k in parts:
                for line in table.parts[k].lines:
                    self._console.print(line, soft_wrap=True)
            columns = sum(len(part.columns) for k, part in enumerate(table.parts) if k not in parts)
            for left_out in filter(None, (table.hidden, plural(columns, "more column") if columns else "")):
                self._print_paragraph(f"... and {left_out}: {self._more}")
            for text in (*dict.fromkeys(text for k in parts for text in table.below[k]), ""):
                self._print_line(text)
        if hidden_tables:
            self._print_line(f"... and {plural(hidden_tables, 'more table')}: {self._more}\n")
        if explanations := "; ".join(legend(table_blocks)):
            self._print_paragraph(explanations)
            self._print_line("")

    def _matrix_table(self, full_matrix: Matrix) -> _Table:
        matrix = full_matrix if self._full else full_matrix.shortened(_ROWS)
        short = matrix.numbers
        columns = [
            Column(
                (_fit(short.get(label, label)), _fit(rule)),
                tuple(Cell(_fit(entries[i].text), entries[i].style) for _, entries in matrix.rows),
                group=(label,),
            )
            for i, (label, rule) in enumerate(matrix.columns)
        ]
        rows = [_fit(label) for label, _ in matrix.rows]
        more = len(full_matrix.rows) - len(rows)
        parts = blocks(matrix.corner, rows, columns, self._width, self._rule) if rows else []
        wrong = [any(entries[i].bad for _, entries in matrix.rows for i in part.columns) for part in parts]
        labels = [dict.fromkeys(matrix.columns[i][0] for i in part.columns) for part in parts]
        below = [[f" {short[name]} = {name}" for name in names if name in short] for names in labels]
        return _Table(matrix.title, parts, plural(more, "more row") if more else "", wrong, below)

    def _sums_tables(self, sums: Sequence[Sums]) -> list[_Table]:
        """Return the tables of sums, cut to the largest number of rows per table with which all tables fit on one screen."""
        for most in (None,) if self._full else (WORST, 15, 12, 10, 8, 6, 5, 4, 3):
            tables: list[_Table] = []
            for table in sums:
                rows = [table.cells(row) for row in table.rows[:most]]
                columns = [
                    Column((_fit(head),), tuple(Cell(_fit(row[i]), table.styles[i]) for row in rows), table.sides[i] == "right")
                    for i, head in enumerate(table.columns)
                ]
                parts = blocks(table.corner, [_fit(row[0]) for row in rows], columns[1:], self._width, self._rule)
                more = len(table.rows) - len(rows)
                hidden = plural(more, f"more {table.corner}") if more else ""
                # No table of sums is left out before a matrix: sums are cut by rows.
                wrong, below = [True] * len(parts), [list[str]() for _ in parts]
                tables.append(_Table("" if tables else "verdicts in sums", parts, hidden, wrong, below))
            if sum(table.height(k) for table in tables for k in range(len(table.parts))) <= _LINES:
                break
        return tables

    def _print_paragraph(self, text: str) -> None:
        for line in wrapped(text, self._width - 1, 2):
            self._print_line(f" {line}")

    def changes(self, block: Changes) -> None:
        """Print the changes since the baseline."""
        self._print_line(block.comparison.headline, "bold")
        for kind, listed in groupby(block.comparison.listed(self.most), itemgetter(0)):
            for _, text in listed:
                self._print_line(f"  {kind:<7} {text}" if kind else f"  {text}", _CHANGES.get(kind, ""))
            if kind == "NEW":
                self._print_line(f"          first: {block.first}")
        self._print_line("")

    def causes(self, block: Causes) -> None:
        """Print causes of failures; for causes that need attention, also the command that runs the first test item."""
        self._print_line(block.title, "bold")
        for cause in block.causes[: self.most]:
            count = f"  {cause.count:4d} x "
            lines = wrapped(f"{_fit(cause.rule)}: {_fit(cause.line, self._length)}", self._width - len(count))
            for number, line in enumerate(lines):
                self._print_line((" " * len(count) if number else count) + line)
            if self._full or not block.settled:
                self._print_line(f"         first: {block.first(cause)}")
        if self.most is not None and len(block.causes) > self.most:
            self._print_line(f"  ... and {len(block.causes) - self.most} more: {self._more}")

    def _print_line(self, text: str, style: str = "") -> None:
        """Print a line without line breaks, so that a command in the line can be copied."""
        end = "\n" if text.endswith("\n") else ""
        self._console.print(Text(_fit(text.removesuffix("\n"), self._length) + end, style=style), soft_wrap=True)


def _fit(text: str, length: int = _LENGTH) -> str:
    """Return a text on one line, without control characters that would act on a terminal."""
    return printable(text.replace("\n", " "), length)


def legend(tables: Sequence[RollUp | Matrix]) -> Iterator[str]:
    """Yield explanations of the outcomes in the tables, such as NA, for readers who do not know the outcomes."""
    entries = [entry for block in tables if isinstance(block, Matrix) for _, row in block.rows for entry in row]
    summed = [table for block in tables if isinstance(block, RollUp) for table in block.sums]
    kinds = {entry.outcome for entry in entries if not entry.known}.union(*(table.kinds for table in summed))
    if summed:
        yield "wrong: runs with a failure that is not known, wrong at: junctions with such runs"
    if any("/" in entry.text for entry in entries):
        yield "1/4: one of four items"
    yield from (f"{kind.small}: {explanation}" for kind, explanation in EXPLANATIONS.items() if kind in kinds)
    if any(None in table.kinds for table in summed) or any("xfail" in entry.text for entry in entries):
        yield "known, xfail: a failure that the tests expect, by the reason that they give"
