"""Writes the files on the failures of a session: runs, replay pages and pictures.

The run of a failure is saved under its hash, so several failures of one run share a file. Drawing thousands of pages would take
minutes, so a process draws the first failures only; ``rvads replay`` draws any other failure from the folder of the session.
"""

from __future__ import annotations

from base64 import b64encode
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.session.options import Options
from pytest_rvads.session.outputs import FOLDER
from pytest_rvads.support.errors import RvadsError
from pytest_rvads.support.storage import slug, write_file
from pytest_rvads.support.wording import named_error, one_line, quoted

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.logic.rules.rule import Rule
    from pytest_rvads.report.failures import Beside
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Report
    from pytest_rvads.runs.run import Run

_MOST_PAGES = 20
"""Number of failures after which a process draws only the first failure of every further rule."""
_MOST_BYTES = 200 * 2**20
"""Disk space for the runs of a session; a run of four vehicles and 30 s takes 0.25 MB [bytes]."""
_DRAWN: pytest.StashKey[Counter[str]] = pytest.StashKey()
"""Number of failures that this process has drawn, by rule."""
_BASELINE: pytest.StashKey[Report | None] = pytest.StashKey()
"""The report of the earlier session (baseline), which a process reads when the first failure is shown."""


def look(
    item: pytest.Item, run: Run, verdict: Verdict, rule: str | Rule, notes: str, around: Callable[[], Beside]
) -> tuple[str, str]:
    """Save the run of a failure, and draw its replay page and picture if the failure is among the first of the process.

    Return the path of the page with the time of the violation, and the picture (SVG). Without a page, return the command that
    draws the page or the reason for neither, and an empty text.

    An error while saving or drawing becomes the text of the result, because a picture never costs a verdict.
    """
    from pytest_rvads.report.folders import option

    drawn = item.config.stash.setdefault(_DRAWN, Counter())
    session = item.config.stash[FOLDER]
    try:
        folder = session.make()
        unsaved = _save(folder, run)
        if drawn.total() >= _MOST_PAGES and drawn[verdict.rule]:
            folder_option = option(Path(session.relative(folder)))
            return f"not drawn, and {unsaved}" if unsaved else f"rvads replay {folder_option} {quoted(item.nodeid)}", ""
        from pytest_rvads.report.failures import failure_picture, moment
        from pytest_rvads.support.installed import load

        path = folder / f"{slug(item.nodeid)}.html"
        page = next(load("pages", "failure")(run, verdict, rule, notes, around()))
        write_file(path, page.html.encode())
        image = failure_picture(run, verdict)
        write_file(path.with_suffix(".svg"), image.encode())
    except Exception as error:
        return f"not drawn: {named_error(error)}", ""
    drawn[verdict.rule] += 1
    return f"{session.relative(path)}#t={moment(run, verdict):.2f}", image


def show(item: pytest.Item, report: pytest.TestReport, image: str) -> None:
    """Attach a picture (SVG) to pytest's report of a test item for pytest-html, if pytest-html is installed.

    The picture is encoded in base64, the only form of pictures in the self-contained mode of pytest-html.
    """
    if item.config.pluginmanager.hasplugin("html"):
        content = b64encode(image.encode()).decode()
        extra = {"name": "scene", "format_type": "image", "content": content, "mime_type": "image/svg+xml", "extension": "svg"}
        report.extras = [*getattr(report, "extras", []), extra]  # type: ignore[attr-defined]


def _save(folder: Path, run: Run) -> str:
    """Write a run to its file unless the file exists; return the reason why the run can't be written, or an empty text."""
    from pytest_rvads.report.folders import run_file, used
    from pytest_rvads.runs.runfile import save_run

    path = run_file(folder, run.hash)
    if path.exists():
        return ""
    if used(folder) >= _MOST_BYTES:
        return f"its run is not kept, those of this session take {_MOST_BYTES // 2**20} MB already: run it again alone"
    try:
        save_run(run, path)
    except RvadsError as error:  # the disk is full, or the provenance can't be written as JSON
        return f"its run is not kept: {one_line(str(error))}"
    return ""


def beside(item: pytest.Item, options: Options, record: Record, run: Run, start: str, rerun: str) -> Beside:
    """Return the texts that a page shows beside the replay of a failure: facts, other verdicts, the run of an earlier session.

    A rule that can't judge the run has the status ERROR among the other verdicts.
    """
    from pytest_rvads.logic.check import other_verdicts
    from pytest_rvads.logic.rules.book import rules_for
    from pytest_rvads.report import files
    from pytest_rvads.report.failures import Beside, earlier_run, facts, summed, usual_rules
    from pytest_rvads.report.folders import INDEX

    marks = [pair for name in ("scenario", "recorded") for pair in item.iter_markers_with_node(f"rvads_{name}")]
    # All rules that the nearest marks name, not only the selected rules.
    named = [rule for node, mark in marks if node is marks[0][0] for rule in mark.args[0].rules or ()]
    rules = rules_for(named, run.junction) if named else usual_rules(run)
    verdicts = summed(other_verdicts(run, rules, record.verdicts[-1].rule))
    ghost = None
    if options.baseline is not None and run.excerpt is None:
        stash = item.config.stash
        if _BASELINE not in stash:
            stash[_BASELINE] = None
            with suppress(RvadsError):  # the file was replaced after the main process had read it
                stash[_BASELINE] = files.load(options.baseline)
        if report := stash[_BASELINE]:
            here = item.config.invocation_params.dir
            ghost = earlier_run(report, options.baseline.parent, here, item.nodeid, run)
    name = options.baseline.name if ghost is not None and options.baseline else ""
    return Beside(facts(record, start, rerun), verdicts, INDEX, ghost, name)
