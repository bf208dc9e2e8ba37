"""The summary of a session as text; the one module that imports rich."""

from __future__ import annotations

import io
from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pytest_rvads.report.matrix import Matrix, causes, coverage, matrices
from pytest_rvads.report.record import Record

__all__ = ["summary"]

_STYLES = {"pass": "green", "NA": "dim", "FAIL": "bold red", "fail": "red", "OPEN": "yellow", "ERROR": "bold magenta"}


def summary(records: Sequence[Record], totals: dict[int, tuple[int, int]], *, colour: bool, width: int, unicode: bool) -> str:
    """Return the verdict matrix, the cause groups and the coverage lines.

    Args:
        records: of the session.
        totals: per number of ways, how many classes and how many full scenarios exist.
        colour: whether the terminal shows colours.
        width: of the terminal, in characters.
        unicode: whether its encoding has box characters.
    """
    out = io.StringIO()
    console = Console(file=out, force_terminal=colour, no_color=not colour, width=width, highlight=False, legacy_windows=False)
    for matrix in matrices(records):
        console.print(Text(matrix.title, style="bold"), soft_wrap=True)
        console.print(_table(matrix, unicode), "")
    groups = causes(records)
    if groups:
        console.print("causes of failures")
        for cause in groups:
            console.print(Text(f"  {cause.count:4d} x {cause.rule}: {cause.text}"), soft_wrap=True)
            console.print(Text(f'         first: pytest "{cause.example}"'), soft_wrap=True)
    for line in coverage(records, totals):
        console.print(Text(line), soft_wrap=True)
    return out.getvalue()


def _table(matrix: Matrix, unicode: bool) -> Table:
    table = Table(box=box.SIMPLE_HEAD if unicode else box.ASCII2, show_edge=False)
    table.add_column("class")
    previous = None
    for configuration, rule in matrix.columns:
        table.add_column(f"{configuration if configuration != previous else ''}\n{rule}")
        previous = configuration
    for label, cells in matrix.rows:
        table.add_row(label, *(Text(cell, style=_style(cell)) for cell in cells))
    return table


def _style(cell: str) -> str:
    return next((style for word, style in _STYLES.items() if word in cell), "")
