"""The summary of a session as text; the one module that imports rich."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import groupby

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pytest_rvads.report.coverage import dropped, measure
from pytest_rvads.report.driven import drivers
from pytest_rvads.report.indicators import extremes
from pytest_rvads.report.matrix import Matrix, coverage, matrices
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.timing import timing
from pytest_rvads.report.triage import Cause, causes, provoked, unavoidable

__all__ = ["summary"]

_LONG = 8
"""A configuration with a longer label is numbered in the table and spelled out below it."""
_MOST = 10
"""Causes and changes of a kind listed; the rest is counted."""
_ROWS = 20
"""Rows of a table shown; those with failures first."""
_SLOW = 1.0
"""A run that takes longer is told, and the next slowest with it [s]."""
_STYLES = {
    "pass": "green",
    "provoked": "cyan",
    "unavoidable": "cyan",
    "NA": "dim",
    "FAIL": "bold red",
    "fail": "red",
    "OPEN": "yellow",
    "ERROR": "bold magenta",
    "NOT JUDGED": "bold magenta",
    "FLAKY": "bold magenta",
}
_CHANGES = {"NEW": "bold red", "FIXED": "green", "ERODED": "yellow", "LOST": "yellow"}


def summary(report: Report, *, colour: bool, width: int, unicode: bool, full: bool = False) -> str:
    """Return what changed, the verdict matrix, the cause groups, the extreme indicators and the coverage lines.

    Args:
        report: of the session.
        colour: whether the terminal shows colours.
        width: of the terminal, in characters.
        unicode: whether its encoding has box characters.
        full: whether to show all; by default no table is longer than a screen and no list longer than ten.
    """
    most = None if full else _MOST
    out = io.StringIO()
    console = Console(file=out, force_terminal=colour, no_color=not colour, width=width, highlight=False, legacy_windows=False)
    if report.comparison:
        console.print(Text(report.comparison.headline, style="bold"), soft_wrap=True)
        for line in report.comparison.lines(most):
            console.print(Text(f"  {line}", style=_CHANGES.get(line.partition(" ")[0], "")), soft_wrap=True)
        console.print()
    for whole in matrices(report.records):
        matrix = whole if full else whole.shortened(_ROWS)
        console.print(Text(matrix.title, style="bold"), soft_wrap=True)
        long = [c for c in dict.fromkeys(cfg for cfg, _ in matrix.columns) if len(c) > _LONG]
        short = {c: f"#{n}" for n, c in enumerate(long, start=1)}
        for columns in _pages(matrix, short, width):
            console.print(_table(matrix, columns, short, unicode))
        if len(matrix.rows) < len(whole.rows):
            console.print(f" ... and {len(whole.rows) - len(matrix.rows)} more rows: --rvads-summary=full shows them all")
        for label in long:
            console.print(Text(f" {short[label]} = {label}"), soft_wrap=True)
        console.print()
    records = report.records
    for title, groups in (
        ("causes of failures", causes(records)),
        ("provoked by traffic", provoked(records)),
        ("unavoidable: nobody could have kept the rule", unavoidable(records)),
    ):
        _list(console, title, groups, most)
    for line in (
        *drivers(records),
        *extremes(records),
        *coverage(records, report.totals),
        *timing(records),
        *_slowest(report, full),
        f"coverage: {measure(report)}",
        *dropped(report),
    ):
        console.print(Text(line), soft_wrap=True)
    return out.getvalue()


def _slowest(report: Report, full: bool) -> list[str]:
    """Return a line on the runs that took longest, where that is worth one."""
    slowest = sorted(report.seconds.items(), key=lambda entry: -entry[1])[: _MOST if full else 3]
    if not slowest or (slowest[0][1] < _SLOW and not full):
        return []
    return ["slowest: " + ", ".join(f"{seconds:.1f} s {run}" for run, seconds in slowest)]


def _list(console: Console, title: str, groups: Sequence[Cause], most: int | None) -> None:
    if groups:
        console.print(title)
    for cause in groups[:most]:
        console.print(Text(f"  {cause.count:4d} x {cause.rule}: {cause.line}"), soft_wrap=True)
        console.print(Text(f'         first: pytest "{cause.example}"'), soft_wrap=True)
    if most is not None and len(groups) > most:
        console.print(f"  ... and {len(groups) - most} more: --rvads-summary=full shows them all")


def _pages(matrix: Matrix, short: dict[str, str], width: int) -> list[list[int]]:
    """Split the columns so that no table is wider than the terminal; a configuration stays together where it can."""
    room = width - 3 - max(len("class"), *(len(label) for label, _ in matrix.rows))
    pages: list[list[int]] = [[]]
    used = 0
    for _, group in groupby(range(len(matrix.columns)), lambda i: matrix.columns[i][0]):
        columns = list(group)
        need = sum(_wide(matrix, i, short) for i in columns)
        if pages[-1] and used + need > room:
            pages.append([])
            used = 0
        pages[-1] += columns
        used += need
    return pages


def _wide(matrix: Matrix, column: int, short: dict[str, str]) -> int:
    configuration, rule = matrix.columns[column]
    return 3 + max(len(short.get(configuration, configuration)), len(rule), *(len(cells[column]) for _, cells in matrix.rows))


def _table(matrix: Matrix, columns: list[int], short: dict[str, str], unicode: bool) -> Table:
    table = Table(box=box.SIMPLE_HEAD if unicode else box.ASCII2, show_edge=False)
    table.add_column("class")
    previous = None
    for configuration, rule in (matrix.columns[i] for i in columns):
        head = short.get(configuration, configuration) if configuration != previous else ""
        table.add_column(f"{head}\n{rule}", no_wrap=True)
        previous = configuration
    for label, cells in matrix.rows:
        table.add_row(label, *(Text(cells[i], style=_style(cells[i])) for i in columns))
    return table


def _style(cell: str) -> str:
    return next((style for word, style in _STYLES.items() if word in cell), "")
