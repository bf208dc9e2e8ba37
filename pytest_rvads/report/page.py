"""A session's report as a self-contained page: causes, coverage, verdict matrices, and every item with its replay."""

from __future__ import annotations

import json
import os
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from pytest_rvads.report.matrix import group_of
from pytest_rvads.report.outcome import Outcome
from pytest_rvads.report.outline import Block, Causes, Changes, Figures, Notes, Verdicts, outline
from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Report

__all__ = ["page"]


def page(report: Report, folder: Path) -> str:
    """Return a report as an HTML page.

    Args:
        report: of a session, or merged.
        folder: where the page will lie, relative to the folder the session was started in; replay pages are linked from there.
    """
    blocks = outline(report)
    template = Template(files("pytest_rvads.report").joinpath("page.html").read_text(encoding="utf-8"))
    seen = {record.status for record in report.records}
    content = {
        "items": [_item(record, folder) for record in report.records],
        "causes": [_causes(block) for block in blocks if isinstance(block, Causes)],
        "matrices": [_matrix(block) for block in blocks if isinstance(block, Verdicts)],
        "statuses": {outcome: outcome.mark for outcome in Outcome.worst_first() if outcome in seen},
    }
    return template.substitute(
        said="".join(map(_said, blocks)),
        # "<" could end the script element from inside a string.
        data=json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
    )


def _said(block: Block) -> str:
    """Return a block of plain sentences as HTML; what can be clicked is made on the page."""
    match block:
        case Notes(lines):
            return "".join(f"<p class=note>{escape(note)}</p>" for note in lines)
        case Changes(comparison):
            changes = "".join(f"<li>{escape(line)}" for line in comparison.lines())
            return f"<h2>{block.title}</h2><p>{escape(comparison.headline)}</p><ul>{changes}</ul>"
        case Figures(lines):
            figures = "".join(f"<li>{escape(line)}" for line in lines)
            return f"<div id=causes></div><h2>{block.title}</h2><ul>{figures}</ul>"
    return ""


def _causes(block: Causes) -> dict[str, Any]:
    causes = [{"count": c.count, "rule": c.rule, "text": c.line, "ids": c.nodeids, "first": c.example} for c in block.causes]
    return {"title": block.title, "causes": causes}


def _matrix(block: Verdicts) -> dict[str, Any]:
    rows = [(label, [(entry.text, entry.bad) for entry in entries]) for label, entries in block.matrix.rows]
    return {"title": block.title, "columns": block.matrix.columns, "rows": rows}


def _item(record: Record, folder: Path) -> dict[str, Any]:
    return {
        "id": record.nodeid,
        "group": group_of(record),
        "status": record.status,
        "known": bool(record.known),
        "cls": record.cls,
        "cfg": record.cfg,
        "rule": record.asks,
        "text": record.message,
        "driver": record.driver,
        "simulator": record.simulator,
        "look": record.look and os.path.relpath(record.look, folder).replace(os.sep, "/"),
    }
