"""The page that lists what ``rvads check`` found and leads to the replay of every failure."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from shutil import copyfileobj
from urllib.parse import quote
from uuid import uuid4

from pytest_rvads.cli.check_output import line, unsure
from pytest_rvads.cli.check_totals import Totals
from pytest_rvads.cli.run_answers import NOTABLE, RunAnswer
from pytest_rvads.report.record import Record
from pytest_rvads.webpage import webpage
from pytest_rvads.wording import markup

__all__ = ["Index"]

_ROWS = f"<!-- {uuid4().hex} -->"
"""Where the rows go; they lie on disk meanwhile, as there may be any number of them."""


class Index:
    """Rows are added as verdicts come, and written at the end."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115 - closed when it is written

    def add(self, label: str, answer: RunAnswer) -> None:
        """Add a row per verdict that is not as it should be."""
        for record in answer.records:
            if record.verdicts[0].status in NOTABLE:
                self._rows.write(_row(label, answer.file, record))

    def write(self, totals: Totals) -> None:
        """Write the page."""
        page = webpage(
            "pytest_rvads.cli", "check_index", "rvads check", None, totals=markup("\n".join(totals.lines())), rows=_ROWS
        )
        head, tail = page.split(_ROWS)
        self._rows.seek(0)
        target = self._folder / "index.html"
        part = target.with_name(f".{uuid4().hex}.part")
        try:
            with self._rows, part.open("w", encoding="utf-8") as file:
                file.write(head)
                copyfileobj(self._rows, file)
                file.write(tail)
            os.replace(part, target)
        finally:
            part.unlink(missing_ok=True)


def _row(label: str, file: str, record: Record) -> str:
    verdict = record.verdicts[0]
    status = verdict.status.value
    links = [_link(look) for look in (record.look, *record.looks) if look]
    told = [f"<p>{markup(what)}</p>" for what in (line(verdict).removeprefix(f"{status:5} "), *unsure(verdict))]
    cells = (
        f'<td class="s {status}">{status}',
        f'<td title="{markup(file)}">{markup(label)}',
        f"<td>{markup(verdict.rule)}",
        f"<td>{''.join(told)}",
        f"<td>{' '.join(links)}",
    )
    return f"<tr>{''.join(cells)}</tr>\n"


def _link(look: str) -> str:
    name, _, time = look.rpartition("#t=")
    explained = f"<details><summary>explained</summary><pre>{markup(look)}</pre></details>"
    return f'<a href="{quote(name)}#t={time}">{time} s</a>' if name else explained
