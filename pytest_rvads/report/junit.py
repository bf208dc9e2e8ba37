"""A report as JUnit XML, which servers of continuous integration read: an item per test case."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.report.outline import outline
from pytest_rvads.report.record import Record, properties
from pytest_rvads.report.session_report import Report
from pytest_rvads.support.wording import printable

__all__ = ["junit"]

_ERRORS = (Outcome.ERROR, Outcome.FLAKY, Outcome.NOT_JUDGED)
"""What says nothing about the rule of an item."""


def junit(report: Report) -> Iterator[str]:
    """Yield a report as a test suite: each item with its properties, and as output of the suite what the report says."""
    kinds = Counter(_kind(record) for record in report.records)
    counts = {"tests": kinds.total(), "failures": kinds["failure"], "errors": kinds["error"], "skipped": kinds["skipped"]}
    told = " ".join(f'{name}="{count}"' for name, count in counts.items())
    yield f'<?xml version="1.0" encoding="utf-8"?>\n<testsuites>\n<testsuite name="rvads" {told}>\n'
    yield from map(_case, report.records)
    lines = (line for block in outline(report) for line in (block.title, *block.plain(), ""))
    yield f"<system-out>{escape(_clean(chr(10).join(lines)))}</system-out>\n</testsuite>\n</testsuites>\n"


def _kind(record: Record) -> str:
    """Return the element that says how an item ended; nothing for an item that passed."""
    if record.failed:
        return "error" if record.status in _ERRORS else "failure"
    return "" if record.outcome == "passed" else "skipped"


def _case(record: Record) -> str:
    file, _, name = record.nodeid.partition("::")
    place = (file.removesuffix(".py").replace("/", "."), name) if name else (record.junction, record.nodeid)
    told = "".join(f"<property name={_quoted(key)} value={_quoted(value)}/>" for key, value in properties(record))
    ended = f"<{kind} message={_quoted(record.known or record.message or record.status)}/>" if (kind := _kind(record)) else ""
    head = f"<testcase classname={_quoted(place[0])} name={_quoted(place[1])}>"
    return f"{head}<properties>{told}</properties>{ended}</testcase>\n"


def _quoted(value: object) -> str:
    return quoteattr(_clean("" if value is None else str(value)))


def _clean(text: str) -> str:
    """Return a text without the characters that XML can't hold."""
    return "\n".join(printable(line, len(line)) for line in text.split("\n"))
