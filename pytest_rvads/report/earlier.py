"""The run of an item in an earlier session that kept its runs."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from pytest_rvads.report.folders import run_file
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import slug

__all__ = ["earlier_run"]


def earlier_run(report: Report, beside: Path, here: Path, nodeid: str, run: Run) -> Run | None:
    """Return the run of an item in an earlier session; None if it is the same run, was not kept, or has another junction.

    Args:
        report: the report of the earlier session.
        beside: the folder of that report.
        here: the working directory of this session, which may have been that of the earlier session.
        nodeid: the id of the item.
        run: the run of the item in this session.
    """
    record = next((record for record in report.records if record.nodeid == nodeid), None)
    if record is None or not record.hash or record.hash == run.hash:
        return None
    names = _names(nodeid, record.rule)
    kept = [folder / report.kept / f"{name}.npz" for folder in (here, beside) for name in names] if report.kept else []
    with suppress(RunError):  # the hash is malformed
        kept.append(run_file(beside, record.hash))
    for path in kept:
        try:
            found = load_run(path)
        except RunError:  # the file is missing or damaged
            continue
        if found.hash == record.hash and found.junction.digest == run.junction.digest:
            return found
    return None


def _names(nodeid: str, rule: str | None) -> list[str]:
    """Return the possible names of an item's run file: the id without the rule, at each place where the rule occurs in the id."""
    if not rule:
        return [slug(nodeid)]
    return [slug(nodeid[: at.start()] + nodeid[at.end() :]) for at in re.finditer(re.escape(f"-{rule}"), nodeid)]
