"""The end of a session in the terminal: verdicts before pytest's own short summary, and last of all the causes.

Pytest prints a line per failure in between. Those of one cause are folded into the first of them, where the cause tells the rest.

Two wrappers around pytest's own summary fold the failures. The inner wrapper prints the verdicts and takes the folded failures
out of pytest's list; the outer wrapper puts the failures back and prints the causes. So other plugins find the list unchanged
before and after.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.session.main_process import Session, ran
from pytest_rvads.session.outputs import told
from pytest_rvads.wording import encode_all, plural, printable

if TYPE_CHECKING:
    from pytest_rvads.report.terminal import Summary

__all__ = ["Causes", "Verdicts"]

_FOLDED = {"failed": "f", "error": "E"}
"""Kinds of reports of pytest that have a line each in its short summary, and the letter of ``-r`` that asks for them."""


class Verdicts:
    """Prints the verdicts before pytest's short summary, which it folds: as a wrapper within that of pytest.

    Args:
        session: whose report is told.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.summary: Summary | None = None
        """The printed summary; None in a session without items of this plugin, and where the terminal can't show the summary."""
        self.whole: dict[str, list[Any]] = {}
        """The terminal's reports before folding, by kind."""
        self.lines = 0
        """How many lines of pytest were folded."""

    def _made(self, reporter: pytest.TerminalReporter) -> Summary | None:
        report = self._session.report
        if not report or not ran(report):
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
            self._session.troubles.append(f"the summary could not be shown: {told(error)}")
            return None

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Print the verdicts, and leave pytest a failure per cause."""
        encode_all(sys.stdout)
        self.summary = self._made(terminalreporter)
        if self.summary:
            terminalreporter.section("rvads verdicts")
            terminalreporter.write(self.summary.verdicts)
        try:
            return (yield)
        finally:
            if self.summary and terminalreporter.verbosity < 2 and self._session.options.summary != "full":
                self._fold(terminalreporter, {*self.summary.examples})

    def _lines_of(self, reporter: pytest.TerminalReporter) -> set[str]:
        """Return which kinds of reports have lines in pytest's short summary."""
        if self._session.config.getoption("no_summary", False):
            return set()
        return {kind for kind, letter in _FOLDED.items() if letter in getattr(reporter, "reportchars", "")}

    def _fold(self, reporter: pytest.TerminalReporter, kept: set[str]) -> None:
        """Leave out, until `Causes` puts them back, reports of items that a cause counts and that are not its first."""
        for kind in self._lines_of(reporter):
            reports = reporter.stats.get(kind, [])
            left = [report for report in reports if not self._counted(report) or report.nodeid in kept]
            if len(left) < len(reports):
                self.whole[kind] = reports
                reporter.stats[kind] = left
                self.lines += len(reports) - len(left)

    def _counted(self, report: Any) -> bool:
        """Tell whether a report is that of a failure that a cause counts; what breaks while clearing up is none."""
        record = self._session.records.get(report.nodeid)
        return record is not None and record.failed and hasattr(report, "rvads")


class Causes:
    """Prints what comes last: the causes, where the page is, and what else keeps the session from being green.

    Args:
        verdicts: what was printed before.
        session: whose report is told.
    """

    def __init__(self, verdicts: Verdicts, session: Session) -> None:
        self._verdicts, self._session = verdicts, session

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Print after pytest's own short summary, as the outermost wrapper."""
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
            reporter.write_line(f"{folded} left out above, where the first item of every cause stands: -vv shows all")
        if self._session.outputs.index:
            reporter.write_line(f"look: {self._session.outputs.index}")
        for trouble in self._session.troubles:
            reporter.write_line(f"rvads: {printable(trouble)}", red=True)
        self._session.outputs.annotate(self._session.report, reporter)
