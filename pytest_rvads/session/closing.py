"""The end of a session in the terminal: the verdicts, pytest's short summary, and the causes of failures.

Pytest's short summary has a line per failure. Here it gets a line per cause, because the causes list the other failures.

Two wrappers surround pytest's summary. The inner wrapper prints the verdicts and removes failures from pytest's list. The outer
wrapper puts these failures back and prints the causes. So the list is unchanged for other plugins before and after.
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

__all__ = ["Causes", "Verdicts"]

_FOLDED = {"failed": "f", "error": "E"}
"""Kinds of reports with lines in pytest's short summary, to the letter of ``-r`` that requests these lines."""


class Verdicts:
    """Prints the verdicts before pytest's short summary, and leaves one failure per cause in that summary.

    Args:
        session: the session whose report is printed.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.summary: Summary | None = None
        """The printed summary; None in a session without items of this plugin, or after an error while the summary was made."""
        self.whole: dict[str, list[Any]] = {}
        """The reports of pytest's terminal reporter before failures were removed, by kind."""
        self.lines = 0
        """Number of removed failures."""

    def _summarised(self, reporter: pytest.TerminalReporter) -> Summary | None:
        report = self._session.report
        if not report or not has_run(report):
            return None
        from pytest_rvads.report.terminal import summarise

        try:
            return summarise(
                report,
                colour=reporter.hasmarkup,
                width=shutil.get_terminal_size().columns,
                unicode=(sys.stdout.encoding or "").lower().startswith("utf"),
                full=self._session.options.summary == "full",
                more="--rvads-summary=full shows them all",
                head=False,
            )
        except Exception as error:
            self._session.troubles.append(f"the summary could not be shown: {named_error(error)}")
            return None

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Print the verdicts, and remove failures so that one per cause is left."""
        encode_all(sys.stdout)
        self.summary = self._summarised(terminalreporter)
        if self.summary:
            terminalreporter.section("rvads verdicts")
            terminalreporter.write(self.summary.verdicts)
        try:
            return (yield)
        finally:
            if self.summary and terminalreporter.verbosity < 2 and self._session.options.summary != "full":
                self._fold(terminalreporter, {*self.summary.examples})

    def _lines_of(self, reporter: pytest.TerminalReporter) -> set[str]:
        """Return the kinds of reports with lines in pytest's short summary."""
        if self._session.config.getoption("no_summary", False):
            return set()
        return {kind for kind, letter in _FOLDED.items() if letter in getattr(reporter, "reportchars", "")}

    def _fold(self, reporter: pytest.TerminalReporter, examples: set[str]) -> None:
        """Remove the reports of items that a cause counts, except its examples; `Causes` puts the reports back."""
        for kind in self._lines_of(reporter):
            reports = reporter.stats.get(kind, [])
            remaining = [report for report in reports if not self._counted(report) or report.nodeid in examples]
            if len(remaining) < len(reports):
                self.whole[kind] = reports
                reporter.stats[kind] = remaining
                self.lines += len(reports) - len(remaining)

    def _counted(self, report: Any) -> bool:
        """Return whether a cause counts the failure of a report; no cause counts an error at teardown."""
        record = self._session.records.get(report.nodeid)
        return record is not None and record.failed and hasattr(report, "rvads")


class Causes:
    """Prints the end of the summary: the causes, the path of the page, and the reasons why the session is not green.

    Args:
        verdicts: the wrapper that printed the verdicts.
        session: the session whose report is printed.
    """

    def __init__(self, verdicts: Verdicts, session: Session) -> None:
        self._verdicts, self._session = verdicts, session

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Put the removed failures back, and print after pytest's short summary."""
        try:
            return (yield)
        finally:
            terminalreporter.stats.update(self._verdicts.whole)
            self._print(terminalreporter)

    def _print(self, reporter: pytest.TerminalReporter) -> None:
        summary = self._verdicts.summary
        if summary and summary.causes:
            reporter.section("rvads causes")
            reporter.write(summary.causes)
        if self._verdicts.lines:
            folded = plural(self._verdicts.lines, "failure")
            reporter.write_line(f"{folded} left out above, where the short summary has one line per cause: -vv shows all")
        if self._session.outputs.index:
            reporter.write_line(f"look: {self._session.outputs.index}")
        for trouble in self._session.troubles:
            reporter.write_line(f"rvads: {printable(trouble)}", red=True)
        self._session.outputs.annotate(self._session.report, reporter)
