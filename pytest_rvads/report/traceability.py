"""Traceability: a table with requirement, test, rule, verdict and run of every item."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from functools import lru_cache, partial
from tempfile import SpooledTemporaryFile
from typing import IO

from pytest_rvads.report.outline import outline
from pytest_rvads.report.session_report import Report
from pytest_rvads.support.wording import printable

__all__ = ["table"]

_COLUMNS = {
    "junction": "junction",
    "control": "control",
    "class": "cls",
    "scenario": "scenario",
    "configuration": "cfg",
    "rotation": "rotation",
    "seat": "seat",
    "traffic": "traffic",
    "recording": "recording",
    "variant": "variant",
    "rule": "rule",
    "verdict": "status",
    "known": "known",
    "driver": "driver",
    "simulator": "simulator",
    "agents": "took_part",
    "run": "hash",
    "item": "nodeid",
}
"""Heading to attribute of the record; the cell is empty where the record has no such attribute."""
_WAITING = 2**20
"""Characters of rows of a requirement that wait in memory; more of them wait on disk."""
_FORMULA = re.compile(r"[\s'\"\u200b\ufeff]*[=+\-@＝＋－＠\t\r]")
"""What spreadsheets compute (OWASP, CSV Injection)."""
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


def table(report: Report) -> Iterator[str]:
    """Yield a report as comma-separated values: a row per requirement and item, then a row per line of its outline.

    Items that trace to no requirement come last, with the first column empty, so that nothing is missing. Rows wait on disk for
    those of requirements that come before theirs.

    Who reads such a file with a program expects one heading and one width, so what is said of the whole session has rows of
    that width too: with nothing but ``section`` and ``text``, which rows of items leave empty but for the item's message.
    Whoever sorts, filters or counts by any other column meets items alone. Texts that spreadsheets would take for formulas begin
    with an apostrophe.

    Raises:
        OSError: there is no room for temporary files.
    """
    yield _row(["requirement", *_COLUMNS, "versions", "section", "text"])
    versions = "; ".join(f"{name} {version}" for name, version in report.versions.items())
    with ExitStack() as files:
        waiting: dict[str, IO[str]] = {}
        for record in report.records:
            told = [getattr(record, name, "") for name in _COLUMNS.values()]
            for requirement in record.requirements or ("",):
                if requirement not in waiting:
                    waiting[requirement] = files.enter_context(SpooledTemporaryFile(_WAITING, "w+", encoding="utf-8", newline=""))
                waiting[requirement].write(_row([requirement, *told, versions, "", record.message]))
        for requirement in sorted(waiting, key=lambda name: (name == "", name)):
            waiting[requirement].seek(0)
            yield from iter(partial(waiting[requirement].read, _WAITING), "")
    empty = [""] * (2 + len(_COLUMNS))
    yield from (_row([*empty, block.title, line]) for block in outline(report) for line in block.plain())


def _row(cells: Iterable[object]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(map(_cell, cells))
    return out.getvalue()


def _cell(value: object) -> object:
    """Return a value for a spreadsheet: an apostrophe before a text keeps a spreadsheet from computing the text as a formula."""
    return _shown(value) if isinstance(value, str) else value


@lru_cache(256)  # the rows of a run have most cells in common
def _shown(text: str) -> str:
    shown = printable(text, len(text))
    return f"'{shown}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else shown
