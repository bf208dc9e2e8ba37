"""Failures as GitHub Actions shows them beside the lines of a change: one annotation per cause.

A workflow command is a line of its own, ``::error file=...,line=...,title=...::message``. Values are escaped so that no name and
no message ends its value, its line or its command, or begins another one. What a controller prints itself is not looked at here:
GitHub reads a log line by line, whoever wrote it.
"""

from __future__ import annotations

import os
from pathlib import Path

from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.triage import Cause, causes
from pytest_rvads.wording import one_line, plural, quoted

__all__ = ["annotate"]

_MOST = 10
"""GitHub shows so many annotations of a kind per step, and drops the rest."""
_LONGEST = 1000
"""Of a line of an annotation."""


def annotate(report: Report, root: Path, workspace: Path) -> list[str]:
    """Return at most ten workflow commands, one per cause of failures, the gravest first.

    They are errors, or warnings where the session lets the failures pass, as those that its baseline has.

    Args:
        report: of the session.
        root: folder that the ids of its items begin in.
        workspace: folder of the repository; what lies elsewhere is named without a file.
    """
    grouped = causes()
    firsts: dict[str, Record] = {}
    for record in report.records:
        grouped.add(record)
        if record.failed:
            firsts[record.nodeid] = record
    found = grouped.causes()
    kind = "error" if report.ended else "warning"
    shown = found if len(found) <= _MOST else found[: _MOST - 1]
    lines = [_annotation(kind, cause, _place(firsts[cause.example], root, workspace), report.again) for cause in shown]
    if rest := found[len(shown) :]:
        items = plural(sum(cause.count for cause in rest), "item")
        lines.append(_command(kind, {"title": "rvads"}, f"{len(rest)} more causes, of {items}: see the summary of the job"))
    return lines


def _annotation(kind: str, cause: Cause, place: dict[str, str], again: str) -> str:
    title = f"{cause.rule}, {plural(cause.count, 'item')}"
    told = (cause.line, f"rerun: {again} {quoted(cause.example)}")
    return _command(kind, {**place, "title": title}, *told)


def _place(record: Record, root: Path, workspace: Path) -> dict[str, str]:
    """Return file and line of the test of an item, or nothing where that is outside of the repository."""
    file = os.path.abspath(root / record.nodeid.partition("::")[0])
    inside = os.path.relpath(file, workspace)
    if inside.split(os.sep)[0] == os.pardir:
        return {}
    return {"file": inside.replace(os.sep, "/"), "line": str(record.line + 1)}  # pytest counts lines from 0


def _command(kind: str, properties: dict[str, str], *lines: str) -> str:
    """Return a workflow command with a message of several lines."""
    given = ",".join(f"{name}={_property(one_line(value, _LONGEST))}" for name, value in properties.items())
    return f"::{kind} {given}::{'%0A'.join(_data(one_line(line, _LONGEST)) for line in lines)}"


def _data(text: str) -> str:
    """Return a text as the message of a command holds it."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """Return a text as the value of a property of a command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
