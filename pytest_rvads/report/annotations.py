"""Failures as annotations of GitHub Actions beside the lines of a change: one annotation per cause.

A workflow command is a separate line, ``::error file=...,line=...,title=...::message``. Values are escaped, so that no name and
no message ends its value, its line or its command, or begins another. The output of a controller is not escaped: GitHub reads
every line of a log, also the lines that a controller prints.
"""

from __future__ import annotations

import os
from pathlib import Path

from pytest_rvads.report.record import Record
from pytest_rvads.report.session_report import Report
from pytest_rvads.report.triage import Cause, causes
from pytest_rvads.support.wording import one_line, plural, quoted

__all__ = ["annotate"]

_MOST = 10
"""Most annotations of a kind per step that GitHub shows; GitHub drops further annotations."""
_LONGEST = 1000
"""Most characters of a line of an annotation."""


def annotate(report: Report, root: Path, workspace: Path) -> list[str]:
    """Return at most ten workflow commands, one per cause of failures, sorted by severity.

    The commands are errors, or warnings if the session passes in spite of the failures, for example because its baseline has
    them.

    Args:
        report: the report of the session.
        root: the folder that the ids of its items are relative to.
        workspace: the folder of the repository; tests outside are annotated without a file.
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
    """Return file and line of the test of an item; empty for a test outside of the repository."""
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
    """Return a text escaped as the message of a command."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """Return a text escaped as the value of a property of a command."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
