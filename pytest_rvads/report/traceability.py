"""Traceability: which requirement was judged by what, with which verdict, on which run."""

from __future__ import annotations

import csv
import io

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
    "run": "hash",
    "item": "nodeid",
}
"""Heading to key of the record."""


def table(report: Report) -> str:
    """Return a report as comma-separated values: a row per requirement and item.

    Items that trace to no requirement come last, with the first column empty, so that nothing is missing.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["requirement", *_COLUMNS, "versions"])
    versions = "; ".join(f"{name} {version}" for name, version in report.versions.items())
    rows = [(requirement, record) for record in report.records for requirement in record.get("requirements") or [""]]
    for requirement, record in sorted(rows, key=lambda row: (row[0] == "", row[0])):
        writer.writerow([requirement, *(record.get(key) for key in _COLUMNS.values()), versions])
    return out.getvalue()
