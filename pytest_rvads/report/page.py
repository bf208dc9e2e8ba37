"""A report as a self-contained page: sums, causes, coverage, verdict matrices, and the items with their replays."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator
from heapq import nsmallest
from pathlib import Path
from typing import Any

from pytest_rvads.report.matrix import group_of, member_of
from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Head, Notes, RollUp, Verdicts, outline
from pytest_rvads.report.record import Record
from pytest_rvads.report.rollup import Sums
from pytest_rvads.report.session_report import Report
from pytest_rvads.webpage import webpage
from pytest_rvads.wording import markup, printable

__all__ = ["page"]

_ITEMS = 5000
"""Items in a page; of more of them those that went wrong first, from all junctions and rules alike."""
_WEB = re.compile(r"https://[^\\\s]+")
_NO_PATH = re.compile(r"[^/?#]*:| *//|.*[\\\t\n]", re.DOTALL)
"""An address with a scheme, of another host, or what browsers would make one of."""


def page(report: Report, folder: Path) -> str:
    """Return a report as an HTML page.

    Args:
        report: of a session, or merged.
        folder: where the page will lie, relative to the folder the session was started in; replay pages are linked from there.
    """
    blocks = outline(report, tables=True)
    chosen = _chosen(report)
    seen = {record.status for record in chosen}
    content = {
        "items": [_item(record, folder) for record in chosen],
        "all": len(report.records),
        "sums": [_sums(table) for block in blocks if isinstance(block, RollUp) for table in block.sums],
        "causes": [_causes(block) for block in blocks if isinstance(block, Causes)],
        "matrices": [_matrix(block) for block in blocks if isinstance(block, Verdicts)],
        "statuses": {outcome: outcome.mark for outcome in Outcome.worst_first() if outcome in seen},
    }
    return webpage("pytest_rvads.report", "page", "rvads verdicts", content, said="".join(map(_said, blocks)))


def _chosen(report: Report) -> list[Record]:
    """Return the records that the page has, in their order."""
    if len(report.records) <= _ITEMS:
        return list(report.records)
    seen: Counter[tuple[int, str, str]] = Counter()

    def ranked() -> Iterator[tuple[int, int, int, Record]]:
        for number, record in enumerate(report.records):
            wrong = record.failed or (record.status.bad and not record.known)
            key = 0 if wrong else 1 if record.known or record.status.mark == "doubt" else 2, record.junction, record.asks
            seen[key] += 1
            yield key[0], seen[key], number, record

    kept = nsmallest(_ITEMS, ranked(), key=lambda found: found[:3])
    return [record for *_, record in sorted(kept, key=lambda found: found[2])]


def _said(block: Block) -> str:
    """Return a block of plain sentences as HTML; what can be clicked is made on the page."""
    match block:
        case Notes(lines):
            return "".join(f"<p class=note>{markup(note)}</p>" for note in lines)
        case Head(lines):
            return f"<ul>{''.join(f'<li>{markup(line)}' for line in lines)}</ul>"
        case Changes(comparison):
            changes = "".join(f"<li>{markup(line)}" for line in comparison.lines())
            return f"<h2>{block.title}</h2><p>{markup(comparison.headline)}</p><ul>{changes}</ul>"
        case RollUp():
            return f"<h2>{block.title}</h2><div id=sums></div>"
        case Figures(lines):
            figures = "".join(f"<li>{markup(line)}" for line in lines)
            return f"<div id=causes></div><h2>{block.title}</h2><ul>{figures}</ul>"
    return ""


def _causes(block: Causes) -> dict[str, Any]:
    causes = [{"count": c.count, "rule": c.rule, "text": c.line, "ids": c.nodeids, "first": c.example} for c in block.causes]
    return {"title": block.title, "again": block.again, "causes": causes}


def _sums(table: Sums) -> dict[str, Any]:
    marks = [""] * (1 + len(table.headings)) + ["" if kind is None else kind.mark for kind in table.kinds]
    rows = [table.cells(row) for row in table.rows]
    return {"corner": table.corner, "columns": table.columns, "sides": table.sides, "marks": marks, "rows": rows}


def _matrix(block: Verdicts) -> dict[str, Any]:
    matrix = block.matrix
    rows = [
        (label, [(entry.text, entry.bad) for entry in entries], members)
        for (label, entries), members in zip(matrix.rows, matrix.members, strict=True)
    ]
    return {"title": block.title, "junction": matrix.junction, "corner": matrix.corner, "columns": matrix.columns, "rows": rows}


def _item(record: Record, folder: Path) -> dict[str, Any]:
    return {
        "id": record.nodeid,
        "group": group_of(record),
        "junction": record.junction,
        "kind": record.kind,
        "status": record.status,
        "known": bool(record.known),
        "member": member_of(record),
        "cfg": record.cfg,
        "rule": record.asks,
        "text": record.message,
        "driver": record.driver,
        "simulator": record.simulator,
        "look": _link(record.look, folder),
    }


def _link(look: str, folder: Path) -> str:
    """Return a link to a page, for a file in a folder; nothing where that would be neither a relative path nor https."""
    look = printable(look, len(look))  # control characters become backslashes, which are refused
    if _WEB.fullmatch(look):
        return look
    if not look or _NO_PATH.match(look):
        return ""
    path = os.path.relpath(look, folder).replace(os.sep, "/")
    return "" if _NO_PATH.match(path) else path
