"""Writes the files of a session: its folder, its journal, its reports, its page, and the summary and annotations of a CI job.

All processes of a session share one folder, which is made when the first file is written to it. The reports are written at the
start of the session, when the plan is known, and at the end: so a report never shows an earlier session.

In GitHub Actions, failures are shown beside the lines of a change: one annotation per cause of failures. An annotation is a
workflow command on a separate line, ``::error file=...,line=...,title=...::message``. Values are escaped, so that no name and
no message can end a command or begin another command. The output of a controller is not escaped: GitHub reads
every line of a log, also the lines that a controller prints.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import pytest

from pytest_rvads.session.options import OPTIONS, Options
from pytest_rvads.support.wording import named_error, one_line, plural, quoted

if TYPE_CHECKING:
    from pytest_rvads.report.files import Journal
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Cell, Extent, Report
    from pytest_rvads.session.plan import Planner

_TOKEN = "rvads_session"
"""Key under which a worker gets the name of its session from the main process."""
_MOST_ANNOTATIONS = 10
"""Largest number of annotations of a kind per step that GitHub shows; GitHub drops further annotations."""
_LONGEST_LINE = 1000
"""Largest number of characters of a line of an annotation."""


class SessionFolder:
    """The folder for the pages, reports and runs of a session; the folder is made when a file is first written to it."""

    def __init__(self, config: pytest.Config, options: Options) -> None:
        self._token: str = getattr(config, "workerinput", {}).get(_TOKEN) or uuid4().hex
        self._name = options.artefacts or ""
        self._root = config.invocation_params.dir / self._name

    def make(self) -> Path:
        """Return the path of the folder, which is made if it does not exist."""
        from pytest_rvads.report.folders import claimed

        return claimed(self._root, self._token)

    def relative(self, path: Path) -> str:
        """Return a path in the folder, relative to the directory in which the session was started."""
        return (Path(self._name) / path.relative_to(self._root)).as_posix()

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """Send the name of the session to a worker."""
        node.workerinput[_TOKEN] = self._token


FOLDER: pytest.StashKey[SessionFolder] = pytest.StashKey()
_QUESTIONS = ("cacheshow", "collectonly", "help", "markers", "rvads_help", "show_fixtures_per_test", "showfixtures", "version")
"""Options with which pytest only prints and runs no test."""


def claim(early_config: pytest.Config) -> None:
    """Write an empty journal (file of records) before user code is loaded, so that an earlier report no longer counts."""
    arguments = early_config.known_args_namespace
    names = arguments.rvads_report or early_config.getini("rvads_report")
    report = _first_json([early_config.invocation_params.dir / name for name in names])
    if report and not _runs_nothing(arguments):
        from pytest_rvads.report.files import claim

        claim(report)


def totals(records: Iterable[Record]) -> dict[int, tuple[int, int]]:
    """Return the numbers of classes and scenarios at a junction, by number of arms, for all numbers of arms in the records."""
    from pytest_rvads.report.record import SimulatedItem
    from pytest_rvads.scenarios.classes import count_classes, count_scenarios

    sizes = sorted({record.ways for record in records if isinstance(record, SimulatedItem)})
    return {ways: (count_classes(ways), count_scenarios(ways)) for ways in sizes}


class Outputs:
    """Writes the files of a session; an error while writing one file does not keep other files from being written."""

    def __init__(self, config: pytest.Config) -> None:
        options, self._config = config.stash[OPTIONS], config
        self._artefacts = options.artefacts
        self._reports = () if _runs_nothing(config.option) else options.report
        self._announced = False
        """Whether the reports contain the plan."""
        self.index = ""
        """Path of the page of the session; empty until the page is written."""
        self._troubles: list[str] = []
        """Sentences on reports that could not be written before the end of the session."""

    @cached_property
    def journal(self) -> Journal:
        """The journal, a file to which the record of every test item is appended when the item ends."""
        from pytest_rvads.report.files import Journal

        journal = Journal(_first_json(self._reports))
        self._config.add_cleanup(journal.close)
        return journal

    def begin(self) -> None:
        """Replace the reports of an earlier session by reports which say that this session has not ended."""
        if self._reports:
            _ = self.journal  # replaced before the reports, because the journal of an earlier session has other items
            self._write_planned((), ())

    def announce(self, planner: Planner) -> None:
        """Write all selected test items into the reports before the items run, so that an item without a verdict is noticed."""
        if self._reports and not self._announced and (plan := planner.plan()).items:
            self._announced = True
            self._write_planned(plan.items.values(), plan.cells, plan.extents)

    def _write_planned(
        self, records: Collection[Record], cells: Iterable[Cell], extents: dict[str, Extent] | None = None
    ) -> None:
        from pytest_rvads.report.session_report import begun

        self._troubles = self._save(begun(list(records), totals(records), list(cells), extents), lambda _: True)

    def end(self, report: Report, ran: bool) -> tuple[list[str], bool]:
        """Write the page and the reports; the JSON reports come last, because they name the files that could not be written."""
        troubles = self._troubles
        if self._artefacts and ran:
            troubles = troubles + _attempt("the index of the session", partial(self._write_index, report))
        unwritten = self._save(report, lambda path: path.suffix != ".json")
        if (summary := os.environ.get("GITHUB_STEP_SUMMARY")) and report.records:
            from pytest_rvads.report.files import append_summary

            unwritten += _attempt("the report", partial(append_summary, Path(summary), report))
        if unwritten:
            report = replace(
                report, exitstatus=report.exitstatus or pytest.ExitCode.TESTS_FAILED, notes=(*report.notes, *unwritten)
            )
        unwritten_json = self._save(report, lambda path: path.suffix == ".json")
        if not unwritten_json:
            self.journal.remove()
        return list(dict.fromkeys([*troubles, *unwritten, *unwritten_json])), not (unwritten or unwritten_json)

    def annotate(self, report: Report | None, reporter: pytest.TerminalReporter) -> None:
        """Print the annotations that GitHub shows beside the lines of a change, if the session runs in GitHub Actions."""
        if report is None or os.environ.get("GITHUB_ACTIONS") != "true":
            return
        root = self._config.rootpath
        annotations: list[str] = []
        workspace = Path(os.environ.get("GITHUB_WORKSPACE") or root)
        troubles = _attempt("the annotations of the job", lambda: annotations.extend(annotate(report, root, workspace)))
        for line in (*(f"rvads: {trouble}" for trouble in troubles), *annotations):
            reporter.ensure_newline()
            reporter.write_line(line)

    def _save(self, report: Report, selected: Callable[[Path], bool]) -> list[str]:
        if not self._reports:
            return []
        from pytest_rvads.report.files import save

        jobs = [partial(save, path, report) for path in self._reports if selected(path)]
        return [trouble for job in jobs for trouble in _attempt("the report", job)]

    def _write_index(self, report: Report) -> None:
        """Write the page with links from verdicts to replays, and the report that `rvads replay` reads."""
        from pytest_rvads.report.files import save
        from pytest_rvads.report.folders import INDEX, REPORT

        folder = self._config.stash[FOLDER]
        path = folder.make() / INDEX
        save(path, report)
        self.index = folder.relative(path)
        save(path.with_name(REPORT), report)


def annotate(report: Report, root: Path, workspace: Path) -> list[str]:
    """Return at most ten workflow commands, one per cause, the gravest first; warnings if the session passes in spite of them."""
    from pytest_rvads.report.triage import causes

    collector = causes()
    failed_records: dict[str, Record] = {}
    for record in report.records:
        collector.add(record)
        if record.failed:
            failed_records[record.nodeid] = record
    failure_causes = collector.causes()
    kind = "error" if report.ended else "warning"
    shown = failure_causes if len(failure_causes) <= _MOST_ANNOTATIONS else failure_causes[: _MOST_ANNOTATIONS - 1]
    lines: list[str] = []
    for cause in shown:
        record = failed_records[cause.example]
        properties: dict[str, str] = {}
        inside = os.path.relpath(os.path.abspath(root / record.nodeid.partition("::")[0]), workspace)
        if inside.split(os.sep)[0] != os.pardir:  # a test outside of the repository has no file and line there
            properties = {"file": inside.replace(os.sep, "/"), "line": str(record.line + 1)}  # pytest counts lines from 0
        properties["title"] = f"{cause.rule}, {plural(cause.count, 'item')}"
        lines.append(_workflow_command(kind, properties, cause.line, f"rerun: {report.again} {quoted(cause.example)}"))
    if further_causes := failure_causes[len(shown) :]:
        items = plural(sum(cause.count for cause in further_causes), "item")
        lines.append(
            _workflow_command(
                kind, {"title": "rvads"}, f"{len(further_causes)} more causes, of {items}: see the summary of the job"
            )
        )
    return lines


def _workflow_command(kind: str, properties: dict[str, str], *lines: str) -> str:
    values = []
    for name, value in properties.items():
        escaped = _data(one_line(value, _LONGEST_LINE)).replace(":", "%3A").replace(",", "%2C")
        values.append(f"{name}={escaped}")
    return f"::{kind} {','.join(values)}::{'%0A'.join(_data(one_line(line, _LONGEST_LINE)) for line in lines)}"


def _data(text: str) -> str:
    """Return a text escaped as the message of a command."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _attempt(what: str, write: Callable[[], None]) -> list[str]:
    """Write a file; return a list with a sentence on the error, or an empty list."""
    try:
        write()
    except OSError as error:
        return [f"{what} could not be written: {error}"]
    except Exception as error:  # values that drivers or hooks put into a record can break a format
        return [f"{what} could not be written: {named_error(error)}"]
    return []


def _runs_nothing(options: argparse.Namespace) -> bool:
    return any(getattr(options, name, False) for name in _QUESTIONS)


def _first_json(reports: Sequence[Path]) -> Path | None:
    return next((path for path in reports if path.suffix == ".json"), None)
