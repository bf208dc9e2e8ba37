"""Traceability: which requirement was judged by what, with which verdict, on which run."""

from __future__ import annotations

import csv
import io

from pytest_rvads.report.outline import outline
from pytest_rvads.report.session_report import Report

__all__ = ["table"]

_COLUMNS = {
    "junction": "junction",
    "class": "cls",
    "scenario": "scenario",
    "configuration": "cfg",
    "rotation": "rotation",
    "seat": "seat",
    "traffic": "traffic",
    "rule": "rule",
    "verdict": "status",
    "known": "known",
    "driver": "driver",
    "simulator": "simulator",
    "agents": "took_part",
    "run": "hash",
    "item": "nodeid",
}
"""Heading to attribute of the record."""


def table(report: Report) -> str:
    """Return a report as comma-separated values: a row per requirement and item, then a row per line of its outline.

    Items that trace to no requirement come last, with the first column empty, so that nothing is missing.

    Who reads such a file with a program expects one heading and one width, so what is said of the whole session has rows of
    that width too: with nothing but ``section`` and ``text``, which rows of items leave empty but for the item's message.
    Whoever sorts, filters or counts by any other column meets items alone.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["requirement", *_COLUMNS, "versions", "section", "text"])
    versions = "; ".join(f"{name} {version}" for name, version in report.versions.items())
    rows = [(requirement, record) for record in report.records for requirement in record.requirements or ("",)]
    for requirement, record in sorted(rows, key=lambda row: (row[0] == "", row[0])):
        writer.writerow([requirement, *(getattr(record, key) for key in _COLUMNS.values()), versions, "", record.message])
    empty = [""] * (2 + len(_COLUMNS))
    writer.writerows([*empty, block.title, line] for block in outline(report) for line in block.plain())
    return out.getvalue()
