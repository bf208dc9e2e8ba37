"""A session's report as a self-contained page: causes, coverage, verdict matrices, and every item with its replay."""

from __future__ import annotations

import json
import os
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from pytest_rvads.report.coverage import measure
from pytest_rvads.report.driven import drivers
from pytest_rvads.report.indicators import extremes
from pytest_rvads.report.matrix import coverage, group_of, matrices
from pytest_rvads.report.record import SEVERITY, Record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.timing import timing
from pytest_rvads.report.triage import Cause, causes, provoked, unavoidable

__all__ = ["page"]


def page(report: Report, folder: Path) -> str:
    """Return a report as an HTML page.

    Args:
        report: of a session, or merged.
        folder: where the page will lie, relative to the folder the session was started in; replay pages are linked from there.
    """
    records = report.records
    template = Template(files("pytest_rvads.report").joinpath("page.html").read_text(encoding="utf-8"))
    notes = list(report.notes)
    if report.exitstatus > 1:
        notes.insert(0, f"The session did not end by itself (exit status {report.exitstatus}): verdicts are missing.")
    said = (
        *drivers(records),
        *coverage(records, report.totals),
        *extremes(records),
        *timing(records),
        f"coverage: {measure(report)}",
    )
    groups = (("", causes), ("provoked by traffic: ", provoked), ("unavoidable: ", unavoidable))
    content = {
        "items": [_item(record, folder) for record in records],
        "causes": [_cause(kind, cause) for kind, group in groups for cause in group(records)],
        "matrices": [{"title": m.title, "columns": m.columns, "rows": m.rows} for m in matrices(records)],
        "statuses": [s for s in SEVERITY if any(r["status"] == s for r in records)],
    }
    return template.substitute(
        notes="".join(f"<p class=note>{escape(note)}</p>" for note in notes),
        changes=_changes(report),
        said="".join(f"<li>{escape(line)}" for line in said),
        # "<" could end the script element from inside a string.
        data=json.dumps(content, separators=(",", ":")).replace("<", "\\u003c"),
    )


def _changes(report: Report) -> str:
    if not report.comparison:
        return ""
    lines = "".join(f"<li>{escape(line)}" for line in report.comparison.lines())
    return f"<h2>since the baseline</h2><p>{escape(report.comparison.headline)}</p><ul>{lines}</ul>"


def _item(record: Record, folder: Path) -> dict[str, Any]:
    look = record.get("look", "")
    return {
        "id": record["nodeid"],
        "group": group_of(record),
        "status": record["status"],
        "known": bool(record["known"]),
        "cls": record["cls"],
        "cfg": record["cfg"],
        "rule": record["rule"] or "run",
        "text": record.get("message") or "",
        "driver": record["driver"],
        "look": look and os.path.relpath(look, folder).replace(os.sep, "/"),
    }


def _cause(kind: str, cause: Cause) -> dict[str, Any]:
    return {"kind": kind, "count": cause.count, "rule": cause.rule, "text": cause.line, "ids": cause.nodeids}
