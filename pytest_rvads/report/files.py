"""A session's records on disk: JSON for programs, Markdown for people and for GitHub's job summary."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from pytest_rvads.errors import RvadsError
from pytest_rvads.report.indicators import extremes
from pytest_rvads.report.matrix import causes, coverage, matrices
from pytest_rvads.report.record import Record

__all__ = ["FORMATS", "SUMMARY_LIMIT", "load", "markdown", "save"]

VERSION = 1
FORMATS = (".json", ".md")
SUMMARY_LIMIT = 900 * 1024
"""GitHub drops a job summary above 1 MiB as a whole [bytes]."""


def save(path: Path, records: Sequence[Record], totals: dict[int, tuple[int, int]], exitstatus: int = 0) -> None:
    """Write a report in the format that the ending of `path` names.

    Raises:
        RvadsError: another ending.
        OSError: the file can't be written.
    """
    if path.suffix not in FORMATS:
        raise RvadsError(f"a report is a {' or '.join(FORMATS)} file, got {str(path)!r}")
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".md":
        path.write_text(markdown(records, totals, exitstatus), encoding="utf-8")
        return
    content = {
        "format": "rvads-report",
        "version": VERSION,
        "exitstatus": exitstatus,
        "totals": {str(k): v for k, v in totals.items()},
        "records": records,
    }
    path.write_text(json.dumps(content, indent=1), encoding="utf-8")


def load(path: Path) -> list[Record]:
    """Read the records of a JSON report.

    Raises:
        RvadsError: not a report, or one of another version.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RvadsError(f"{path} can't be read as a report of --rvads-report: {error}") from error
    if not isinstance(content, dict) or content.get("format") != "rvads-report" or content.get("version") != VERSION:
        raise RvadsError(f"{path} is not a report of version {VERSION} written by --rvads-report=FILE.json")
    records: list[Record] = content["records"]
    return records


def markdown(records: Sequence[Record], totals: dict[int, tuple[int, int]], exitstatus: int = 0) -> str:
    """Return the causes first, then coverage and verdict matrices.

    Args:
        records: of the session.
        totals: per number of ways, how many classes and how many full scenarios exist.
        exitstatus: of pytest; above 1 the session did not end by itself.
    """
    lines = ["# rvads verdicts", ""]
    if exitstatus > 1:
        lines += [f"**The session did not end by itself (exit status {exitstatus}): verdicts are missing.**", ""]
    groups = causes(records)
    if groups:
        lines += ["## Causes of failures", "", "| items | rule | cause | first |", "|---:|---|---|---|"]
        lines += [f"| {c.count} | {_cell(c.rule)} | {_cell(c.text)} | `{_cell(c.example)}` |" for c in groups]
        lines.append("")
    lines += [f"- {_cell(line)}" for line in (*coverage(records, totals), *extremes(records))]
    for matrix in matrices(records):
        lines += ["", f"## {matrix.title}", ""]
        lines.append("| class | " + " | ".join(f"{cfg} {rule}" for cfg, rule in matrix.columns) + " |")
        lines.append("|---|" + "---|" * len(matrix.columns))
        lines += [f"| {label} | " + " | ".join(_cell(c) for c in cells) + " |" for label, cells in matrix.rows]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
