"""The summary of a session as text; the one module that imports rich."""

from __future__ import annotations

import io
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pytest_rvads.report.matrix import Matrix
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Verdicts, outline
from pytest_rvads.report.session_report import Report
from pytest_rvads.wording import printable

__all__ = ["summary"]

_LONG = 8
"""A configuration with a longer label is numbered in the table and spelled out below it."""
_MOST = 10
"""Causes and changes of a kind listed; the rest is counted."""
_ROWS = 20
"""Rows of a table shown; those with failures first."""
_LENGTH = 20_000
"""Characters of a line shown."""
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
    screen = _Screen(colour, width, unicode, None if full else _MOST, None if full else _ROWS)
    for block in outline(report, short=not full):
        screen.show(block)
    return screen.text()


class _Screen:
    """Renders blocks; lists longer than `most` and tables longer than `rows` are cut, None: they are not."""

    def __init__(self, colour: bool, width: int, unicode: bool, most: int | None, rows: int | None) -> None:
        self._out = io.StringIO()
        self._console = Console(
            file=self._out, force_terminal=colour, no_color=not colour, width=width, highlight=False, legacy_windows=False
        )
        self._width, self._unicode, self._most, self._rows = width, unicode, most, rows

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
            case Verdicts(matrix):
                self._matrix(matrix)
            case Causes():
                self._causes(block)
            case Figures(lines):
                for line in lines:
                    self._line(line)

    def _line(self, text: str, style: str = "") -> None:
        self._console.print(_text(text, style), soft_wrap=True)

    def _causes(self, block: Causes) -> None:
        self._line(block.title)
        for cause in block.causes[: self._most]:
            self._line(f"  {cause.count:4d} x {cause.rule}: {cause.line}")
            self._line(f'         first: pytest "{cause.example}"')
        if self._most is not None and len(block.causes) > self._most:
            self._line(f"  ... and {len(block.causes) - self._most} more: --rvads-summary=full shows them all")

    def _matrix(self, whole: Matrix) -> None:
        matrix = whole if self._rows is None else whole.shortened(self._rows)
        self._line(matrix.title, "bold")
        long = [label for label in dict.fromkeys(cfg for cfg, _ in matrix.columns) if len(label) > _LONG]
        short = {label: f"#{n}" for n, label in enumerate(long, start=1)}
        for columns in _pages(matrix, short, self._width) if matrix.rows else ():
            self._console.print(_table(matrix, columns, short, self._width, self._unicode))
        if len(matrix.rows) < len(whole.rows):
            self._line(f" ... and {len(whole.rows) - len(matrix.rows)} more rows: --rvads-summary=full shows them all")
        for label in long:
            self._line(f" {short[label]} = {label}")
        self._line("")


def _pages(matrix: Matrix, short: dict[str, str], width: int) -> list[list[int]]:
    """Split the columns so that no table is wider than the terminal; a configuration stays together where it can."""
    room = width - 3 - min(max(map(len, [matrix.corner, *(label for label, _ in matrix.rows)])), width // 3)
    pages: list[list[int]] = [[]]
    used = 0
    for _, group in groupby(range(len(matrix.columns)), lambda i: matrix.columns[i][0]):
        columns = list(group)
        wide = [_wide(matrix, i, short) for i in columns]
        for k, column in enumerate(columns):
            if pages[-1] and used + (wide[k] if k else sum(wide)) > room:
                pages.append([])
                used = 0
            pages[-1].append(column)
            used += wide[k]
    return pages


def _wide(matrix: Matrix, column: int, short: dict[str, str]) -> int:
    configuration, rule = matrix.columns[column]
    return 3 + max(
        len(short.get(configuration, configuration)), len(rule), *(len(cells[column].text) for _, cells in matrix.rows)
    )


def _table(matrix: Matrix, columns: list[int], short: dict[str, str], width: int, unicode: bool) -> Table:
    table = Table(box=box.SIMPLE_HEAD if unicode else box.ASCII2, show_edge=False)
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


def _text(text: str, style: str = "") -> Text:
    """Return a text on one line, which neither the terminal nor rich takes for a command."""
    return Text(printable(text.replace("\n", " "), _LENGTH), style=style)
