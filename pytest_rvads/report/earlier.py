"""The run of an item in an earlier session, where that has kept it."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from pytest_rvads.errors import RunError
from pytest_rvads.report.folders import run_file
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.storage import slug

__all__ = ["earlier_run"]


def earlier_run(report: Report, beside: Path, here: Path, nodeid: str, run: Run) -> Run | None:
    """Return what an item's run was in an earlier session; None where it was the same, was not kept, or was somewhere else.

    Args:
        report: of that session.
        beside: folder in which the report lies.
        here: folder that this session was started in, where that one may have been, too.
        nodeid: of the item.
        run: of the item in this session.
    """
    record = next((record for record in report.records if record.nodeid == nodeid), None)
    if record is None or not record.hash or record.hash == run.hash:
        return None
    names = _names(nodeid, record.rule)
    kept = [folder / report.kept / f"{name}.npz" for folder in (here, beside) for name in names] if report.kept else []
    with suppress(RunError):  # the hash is none
        kept.append(run_file(beside, record.hash))
    for path in kept:
        try:
            found = load_run(path)
        except RunError:  # it is not there, or is damaged
            continue
        if found.hash == record.hash and found.junction.digest == run.junction.digest:
            return found
    return None


def _names(nodeid: str, rule: str | None) -> list[str]:
    """Return how the file of an item's run may be called: by its id without the rule, wherever in it that stands."""
    if not rule:
        return [slug(nodeid)]
    return [slug(nodeid[: at.start()] + nodeid[at.end() :]) for at in re.finditer(re.escape(f"-{rule}"), nodeid)]
