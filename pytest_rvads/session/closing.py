"""Prints the end of a session in the terminal: the verdicts, pytest's short summary, and the causes of failures.

Pytest prints a block per failure, and in its short summary a line per failure. This module leaves one block and one line per
cause. The causes, which are printed at the end, count the other failures.

Two wrappers surround pytest's summary. The outer wrapper removes failures from pytest's list before pytest prints its blocks.
The inner wrapper puts these failures back, prints the verdicts, lets other plugins print, and removes the failures again
before pytest prints its short summary. The outer wrapper puts the failures back and prints the causes. So other plugins see
pytest's list of failures unchanged.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.session.main_process import Session, has_run
from pytest_rvads.support.wording import encode_all, named_error, plural, printable

if TYPE_CHECKING:
    from pytest_rvads.report.terminal import Summary

_FOLDED = {"failed": "f", "error": "E"}
"""By kind of reports that are folded, the letter of pytest's option ``-r`` that requests lines in pytest's short summary."""


class Verdicts:
    """Prints the verdicts before pytest's short summary, and leaves one failure per cause in pytest's list of failures."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.summary: Summary | None = None
        """The printed summary; None in a session without items of this plugin, or after an error while the summary was made."""
        self._whole: dict[str, list[Any]] = {}
        """The reports of pytest's terminal reporter before failures were removed, by kind of removed failures."""

    def begin(self, reporter: pytest.TerminalReporter) -> None:
        """Make the summary, and remove failures from pytest's list before pytest prints its blocks."""
        encode_all(sys.stdout)
        report = self._session.report
        if report and has_run(report):
            from pytest_rvads.report.terminal import summarise

            try:
                self.summary = summarise(
                    report,
                    colour=reporter.hasmarkup,
                    width=shutil.get_terminal_size().columns,
                    unicode=(sys.stdout.encoding or "").lower().startswith("utf"),
                    full=reporter.verbosity >= 2,
                    more="-vv shows them all",
                    head=False,
                )
            except Exception as error:
                self._session.troubles.append(f"the summary could not be shown: {named_error(error)}")
        self.fold(reporter)

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Print the verdicts, and let other plugins see all failures before pytest prints its short summary."""
        self.restore(terminalreporter)
        if self.summary:
            terminalreporter.section("rvads verdicts")
            terminalreporter.write(self.summary.verdicts)
        try:
            return (yield)
        finally:
            self.fold(terminalreporter)

    def fold(self, reporter: pytest.TerminalReporter) -> None:
        """Remove the reports of failures that a cause counts, except one example per cause; `restore` puts the reports back."""
        if not self.summary or reporter.verbosity >= 2:
            return
        examples = {*self.summary.examples}
        for kind in _FOLDED:
            reports = reporter.stats.get(kind, [])
            remaining = []
            for report in reports:
                record = self._session.records.get(report.nodeid)
                # No cause counts an error at teardown.
                is_counted = record is not None and record.failed and hasattr(report, "rvads")
                if not is_counted or report.nodeid in examples:
                    remaining.append(report)
            if len(remaining) < len(reports):
                self._whole[kind] = reports
                reporter.stats[kind] = remaining

    def restore(self, reporter: pytest.TerminalReporter) -> None:
        """Put the removed reports back into pytest's list."""
        reporter.stats.update(self._whole)

    def note(self, reporter: pytest.TerminalReporter) -> str:
        """Return a line which says that pytest's output has one failure per cause; empty if the output has all failures."""
        config = self._session.config
        letters = [_FOLDED[kind] for kind in self._whole]
        printed = {
            "one block": config.getoption("tbstyle", "auto") != "no",
            "one line": any(letter in getattr(reporter, "reportchars", "") for letter in letters),
        }
        if not letters or config.getoption("no_summary", False) or not any(printed.values()):
            return ""
        count = sum(len(reports) for reports in self._whole.values())
        return f"{' and '.join(filter(printed.get, printed))} per cause; -vv lists all {plural(count, 'failure')}"


class Causes:
    """Prints the end of the summary: the causes of failures, the path of the page, and the reasons why the session fails."""

    def __init__(self, verdicts: Verdicts, session: Session) -> None:
        self._verdicts, self._session = verdicts, session

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Fold the failures while pytest prints its summary, and print the causes below pytest's short summary."""
        self._verdicts.begin(terminalreporter)
        try:
            return (yield)
        finally:
            self._verdicts.restore(terminalreporter)
            summary = self._verdicts.summary
            if note := self._verdicts.note(terminalreporter):
                terminalreporter.write_line(note)
            if summary and summary.causes:
                terminalreporter.section("rvads causes")
                terminalreporter.write(summary.causes)
            if self._session.outputs.index:
                terminalreporter.write_line(f"look: {self._session.outputs.index}")
            if summary and summary.last:
                terminalreporter.write_line(f"rvads: {summary.last}", yellow=True)
            for trouble in self._session.troubles:
                terminalreporter.write_line(f"rvads: {printable(trouble)}", red=True)
            self._session.outputs.annotate(self._session.report, terminalreporter)
