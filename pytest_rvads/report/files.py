"""A session's report on disk: JSON for programs, Markdown for GitHub's job summary, HTML for people."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pytest_rvads.errors import RvadsError
from pytest_rvads.report.coverage import dropped, measure
from pytest_rvads.report.driven import drivers
from pytest_rvads.report.indicators import extremes
from pytest_rvads.report.matrix import coverage, matrices
from pytest_rvads.report.page import page
from pytest_rvads.report.session_report import Report, cell_from
from pytest_rvads.report.timing import timing
from pytest_rvads.report.traceability import table
from pytest_rvads.report.triage import causes, provoked, unavoidable

__all__ = ["FORMATS", "append_summary", "load", "markdown", "save"]

VERSION = 3
SUMMARY_LIMIT = 900 * 1024
"""GitHub drops a job summary above 1 MiB as a whole [bytes]."""
_REQUIRED = {
    *("nodeid", "line", "test", "ways", "junction", "cls", "scenario", "cfg", "rule", "seat", "traffic", "driver"),
    *("status", "verdicts", "outcome"),
}


def save(path: Path, report: Report) -> None:
    """Write a report in the format that the ending of `path` names.

    Raises:
        RvadsError: another ending.
        OSError: the file can't be written.
    """
    if path.suffix not in FORMATS:
        raise RvadsError(f"a report is a {', '.join(FORMATS)} file, got {str(path)!r}")
    text = FORMATS[path.suffix](report, path.parent)
    path.parent.mkdir(parents=True, exist_ok=True)
    # An earlier report, perhaps the baseline, outlives a disk that is full.
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def append_summary(path: Path, report: Report) -> None:
    """Append a report to the job summary of GitHub Actions, or say that it is too long for one.

    Raises:
        OSError: the file can't be written.
    """
    text = markdown(report).encode()
    with path.open("ab") as out:
        out.write(text if len(text) <= SUMMARY_LIMIT else b"rvads: too many verdicts for a job summary, see the log\n")


def load(path: Path) -> Report:
    """Read a JSON report.

    Raises:
        RvadsError: not a report, or one of another version.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RvadsError(f"{path} can't be read as a report of --rvads-report: {error}") from error
    if not isinstance(content, dict) or content.get("format") != "rvads-report" or content.get("version") != VERSION:
        raise RvadsError(f"{path} is not a report of version {VERSION} written by --rvads-report=FILE.json")
    try:
        return _report(content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RvadsError(f"{path} is a damaged report ({type(error).__name__}: {error}): write it again") from error


def _report(content: dict[str, Any]) -> Report:
    for record in content["records"]:
        if missing := sorted(_REQUIRED - record.keys()):
            raise ValueError(f"a record has no {', '.join(missing)}")
    return Report(
        tuple(content["records"]),
        {int(ways): (classes, scenarios) for ways, (classes, scenarios) in content["totals"].items()},
        tuple(map(cell_from, content["planned"])),
        dict(content["versions"]),
        int(content["exitstatus"]),
        tuple(content["notes"]),
        {str(test): int(count) for test, count in content["left_out"].items()},
    )


def _json(report: Report) -> str:
    content = {
        "format": "rvads-report",
        "version": VERSION,
        "versions": report.versions,
        "exitstatus": report.exitstatus,
        "notes": report.notes,
        "left_out": report.left_out,
        "totals": {str(ways): total for ways, total in report.totals.items()},
        "planned": report.planned,
        "records": report.records,
    }
    return json.dumps(content, indent=1)


def markdown(report: Report) -> str:
    """Return a report as Markdown: the causes first, then coverage and verdict matrices."""
    records = report.records
    lines = ["# rvads verdicts", ""]
    if report.exitstatus > 1:
        lines += [f"**The session did not end by itself (exit status {report.exitstatus}): verdicts are missing.**", ""]
    lines += [line for note in report.notes for line in (f"**{_cell(note)}**", "")]
    if report.comparison:
        lines += ["## Since the baseline", "", _cell(report.comparison.headline), ""]
        lines += [f"- {_cell(line)}" for line in report.comparison.lines()]
        lines.append("")
    for title, groups in (
        ("Causes of failures", causes(records)),
        ("Provoked by traffic", provoked(records)),
        ("Unavoidable: nobody could have kept the rule", unavoidable(records)),
    ):
        if groups:
            lines += [f"## {title}", "", "| items | rule | cause | first |", "|---:|---|---|---|"]
            lines += [f"| {c.count} | {_cell(c.rule)} | {_cell(c.line)} | `{_cell(c.example)}` |" for c in groups]
            lines.append("")
    said = (
        *drivers(records),
        *coverage(records, report.totals),
        *extremes(records),
        *timing(records),
        f"coverage: {measure(report)}",
        *dropped(report),
    )
    lines += [f"- {_cell(line)}" for line in said]
    for matrix in matrices(records):
        lines += ["", f"## {matrix.title}", ""]
        lines.append("| class | " + " | ".join(f"{cfg} {rule}" for cfg, rule in matrix.columns) + " |")
        lines.append("|---|" + "---|" * len(matrix.columns))
        lines += [f"| {label} | " + " | ".join(_cell(c) for c in cells) + " |" for label, cells in matrix.rows]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


FORMATS: dict[str, Callable[[Report, Path], str]] = {
    ".json": lambda report, _: _json(report),
    ".html": page,
    ".md": lambda report, _: markdown(report),
    ".csv": lambda report, _: table(report),
}
"""How a report is written, by the ending of its file; what it links to is linked from the folder it is written to."""
