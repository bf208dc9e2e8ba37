"""The summary of a session as text; the one module that imports rich."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Head, RollUp, Verdicts, outline
from pytest_rvads.report.rollup import WORST, Sums
from pytest_rvads.report.session_report import Report
from pytest_rvads.wording import printable

__all__ = ["summary"]

_MOST = 10
"""Causes and changes of a kind listed; the rest is counted."""
_ROWS = 20
"""Rows of a table shown; those with failures first."""
_LINES = 60
"""Lines of all tables of verdicts together; those with failures first."""
_LENGTH, _BRIEF = 20_000, 1_000
"""Characters of a line shown in full, and in short."""
_CHANGES = {"NEW": "bold red", "FIXED": "green", "ERODED": "yellow", "LOST": "yellow"}


def summary(report: Report, *, colour: bool, width: int, unicode: bool, full: bool = False) -> str:
    """Return the outline of a report but for its notes, which callers print where they belong.

    Args:
        report: of the session.
        colour: whether the terminal shows colours.
        width: of the terminal, in characters.
        unicode: whether its encoding has box characters.
        full: whether to show all; by default no table is longer than a screen and no list longer than ten.
    """
    screen = _Screen(colour, width, unicode, full, report.again)
    blocks = outline(report, short=not full, tables=full)
    tables = [block for block in blocks if isinstance(block, Verdicts)]
    shown = tables if full else _fitting(tables, width)
    for block in blocks:
        if block not in tables or block in shown:
            screen.show(block)
        if tables and block is tables[-1]:
            screen.left_out(len(tables) - len(shown))
    return screen.text()


def _fitting(tables: Sequence[Verdicts], width: int) -> list[Verdicts]:
    """Return as many tables as fit, one at least: those in which something is wrong, then the first ones."""
    right = [not any(entry.bad for _, entries in table.matrix.rows for entry in entries) for table in tables]
    kept: list[Verdicts] = []
    lines = 0
    for number in sorted(range(len(tables)), key=right.__getitem__):
        matrix = tables[number].matrix.shortened(_ROWS)
        short, pages = _layout(matrix, width)
        lines += sum(_height(matrix, page, short) for page in _telling(matrix, pages, short)) + 1
        if kept and lines > _LINES:
            break
        kept.append(tables[number])
    return kept


class _Screen:
    """Renders blocks; unless `full`, long lists and tables are cut."""

    def __init__(self, colour: bool, width: int, unicode: bool, full: bool, again: str) -> None:
        self._out = io.StringIO()
        self._console = Console(
            file=self._out, force_terminal=colour, no_color=not colour, width=width, highlight=False, legacy_windows=False
        )
        self._width, self._unicode = width, unicode
        self._most = None if full else _MOST
        self._rows = None if full else _ROWS
        self._sums = None if full else WORST
        self._all = "--rvads-summary=full shows them all" if again.startswith("pytest") else "reports in files hold them all"

    def text(self) -> str:
        """Return what was rendered."""
        return self._out.getvalue()

    def show(self, block: Block) -> None:
        """Render a block."""
        match block:
            case Changes(comparison):
                self._line(comparison.headline, "bold")
                for line in comparison.lines(self._most):
                    self._line(f"  {line}", _CHANGES.get(line.partition(" ")[0], ""))
                self._line("")
            case RollUp(sums):
                self._line(block.title, "bold")
                for table in sums:
                    self._rolled_up(table)
            case Verdicts(matrix):
                self._matrix(matrix)
            case Causes():
                self._causes(block)
            case Head(lines) | Figures(lines):
                for line in lines:
                    self._line(line)

    def left_out(self, tables: int) -> None:
        """Say how many tables were left out, where any were."""
        if tables:
            self._line(f"... and {tables} more table{'' if tables == 1 else 's'}: {self._all}\n")

    def _line(self, text: str, style: str = "") -> None:
        self._console.print(_text(text, style, _LENGTH if self._rows is None else _BRIEF), soft_wrap=True)

    def _causes(self, block: Causes) -> None:
        self._line(block.title)
        for cause in block.causes[: self._most]:
            self._line(f"  {cause.count:4d} x {cause.rule}: {cause.line}")
            self._line(f"         first: {block.first(cause)}")
        if self._most is not None and len(block.causes) > self._most:
            self._line(f"  ... and {len(block.causes) - self._most} more: {self._all}")

    def _rolled_up(self, sums: Sums) -> None:
        rows = [sums.cells(row) for row in sums.rows[: self._sums]]
        wide = [max(map(len, column)) for column in zip(sums.columns, *rows, strict=True)]
        name = min(wide[0], self._width // 3)
        for page in _packed([[(i, 3 + wide[i])] for i in range(1, len(wide))], self._width - 3 - name):
            table = self._new_table()
            table.add_column(_text(sums.columns[0]), max_width=name, overflow="fold")
            for i in page:
                table.add_column(_text(sums.columns[i]), no_wrap=True, overflow="fold", justify=sums.sides[i])
            for cells in rows:
                table.add_row(_text(cells[0]), *(_text(cells[i], sums.styles[i]) for i in page))
            self._console.print(table)
        if len(sums.rows) > len(rows):
            self._line(f" ... and {len(sums.rows) - len(rows)} more {sums.corner}s: {self._all}")
        self._line("")

    def _new_table(self) -> Table:
        return Table(box=box.SIMPLE_HEAD if self._unicode else box.ASCII2, show_edge=False)

    def _matrix(self, whole: Matrix) -> None:
        matrix = whole if self._rows is None else whole.shortened(self._rows)
        self._line(matrix.title, "bold")
        short, pages = _layout(matrix, self._width)
        shown = pages if self._rows is None else _telling(matrix, pages, short)
        for columns in shown:
            self._console.print(_filled(self._new_table(), matrix, columns, short, self._width))
        more = len(whole.rows) - len(matrix.rows), sum(map(len, pages)) - sum(map(len, shown))
        for count, what in zip(more, ("rows", "columns"), strict=True):
            if count:
                self._line(f" ... and {count} more {what}: {self._all}")
        for label in _numbered(matrix, [i for page in shown for i in page], short):
            self._line(f" {short[label]} = {label}")
        self._line("")


def _layout(matrix: Matrix, width: int) -> tuple[dict[str, str], list[list[int]]]:
    """Return the numbers that stand for long configurations, and the columns of each table that a matrix is split into."""
    short = matrix.numbers
    return short, _pages(matrix, short, width) if matrix.rows else []


def _telling(matrix: Matrix, pages: list[list[int]], short: dict[str, str]) -> list[list[int]]:
    """Return as many of the tables as fit, one at least: those in which something is wrong, then the first ones."""
    right = [not any(entries[i].bad for _, entries in matrix.rows for i in page) for page in pages]
    kept: list[int] = []
    lines = 0
    for number in sorted(range(len(pages)), key=right.__getitem__):
        lines += _height(matrix, pages[number], short)
        if kept and lines > _LINES:
            break
        kept.append(number)
    return [pages[k] for k in sorted(kept)]


def _height(matrix: Matrix, page: list[int], short: dict[str, str]) -> int:
    """Return how many lines a table takes: headings, rows, what stands above and below, and what numbers stand for."""
    return len(matrix.rows) + 4 + len(_numbered(matrix, page, short))


def _numbered(matrix: Matrix, columns: list[int], short: dict[str, str]) -> list[str]:
    """Return the configurations of some columns for which numbers stand."""
    return [label for label in dict.fromkeys(matrix.columns[i][0] for i in columns) if label in short]


def _pages(matrix: Matrix, short: dict[str, str], width: int) -> list[list[int]]:
    """Split the columns so that no table is wider than the terminal; a configuration stays together where it can."""
    room = width - 3 - min(max(map(len, [matrix.corner, *(label for label, _ in matrix.rows)])), width // 3)
    groups = groupby(range(len(matrix.columns)), lambda i: matrix.columns[i][0])
    return _packed([[(i, _wide(matrix, i, short)) for i in group] for _, group in groups], room)


def _packed(groups: Iterable[Sequence[tuple[int, int]]], room: int) -> list[list[int]]:
    """Pack groups of columns, each with its width, into tables that are no wider than the room for them, where they can be."""
    pages: list[list[int]] = [[]]
    used = 0
    for group in groups:
        together = sum(wide for _, wide in group)
        for k, (column, wide) in enumerate(group):
            if pages[-1] and used + (wide if k else together) > room:
                pages.append([])
                used = 0
            pages[-1].append(column)
            used += wide
    return pages


def _wide(matrix: Matrix, column: int, short: dict[str, str]) -> int:
    configuration, rule = matrix.columns[column]
    return 3 + max(
        len(short.get(configuration, configuration)), len(rule), *(len(cells[column].text) for _, cells in matrix.rows)
    )


def _filled(table: Table, matrix: Matrix, columns: list[int], short: dict[str, str], width: int) -> Table:
    # Where it is narrow the classes are broken, not the names of rules.
    room = width - 2 - sum(_wide(matrix, i, short) for i in columns)
    table.add_column(matrix.corner, max_width=max(room, len(matrix.corner)))
    previous = None
    for configuration, rule in (matrix.columns[i] for i in columns):
        head = short.get(configuration, configuration) if configuration != previous else ""
        table.add_column(_text(head) + Text("\n") + _text(rule), no_wrap=len(columns) > 1, overflow="fold")
        previous = configuration
    for label, cells in matrix.rows:
        table.add_row(_text(label), *(_text(cells[i].text, cells[i].style) for i in columns))
    return table


def _text(text: str, style: str = "", length: int = _LENGTH) -> Text:
    """Return a text on one line, which neither the terminal nor rich takes for a command."""
    return Text(printable(text.replace("\n", " "), length), style=style)
