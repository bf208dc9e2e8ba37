"""Adds to pytest's output: the verdicts before pytest's short summary, and the causes of failures after it.

Pytest's list of failures stays as it is. The text of a failure becomes one line if an earlier failure explains it.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Generator
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.session.main_process import Session, has_run
from pytest_rvads.support.wording import encode_all, named_error, printable

if TYPE_CHECKING:
    from pytest_rvads.report.terminal import Summary

_OWN_SECTION = re.compile(r"rvads( |$)|Captured \w+ of the run$")


class Closing:
    """Adds sections around those of pytest and of other plugins, and explains one failure of a kind in the main process."""

    def __init__(self, session: Session) -> None:
        self._session = session
        config = session.config
        self._abridges = config.getoption("verbose", 0) < 2 and not config.getoption("usepdb", False)
        self._explained: dict[str, str] = {}
        """By signature of a failure, the node id of the first failure with this signature, whose text stays whole."""
        self._summary: Summary | None = None
        """The printed summary; None in a session without items of this plugin, or after an error while the summary was made."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Leave one line of the text of a failure that an earlier failure explains; captured output of the test stays."""
        signature, text = report.__dict__.pop("rvads_short", (None, ""))
        if signature is None or not self._abridges or not report.failed:  # pytest-rerunfailures shows no text of a repeated item
            return
        first = self._explained.setdefault(signature, report.nodeid)
        if first != report.nodeid and not isinstance(report.longrepr, str):  # pytest's text of a strict xfail is one line
            report.longrepr = f"{text}; see {first}"
            report.sections = [part for part in report.sections if not _OWN_SECTION.match(part[0])]

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> Generator[None, object, object]:
        """Make the summary; print the causes, the path of the page, and the reasons why the session fails, below all sections."""
        encode_all(sys.stdout)
        report = self._session.report
        if report and has_run(report):
            from pytest_rvads.report.terminal import summarise

            try:
                self._summary = summarise(
                    report,
                    colour=terminalreporter.hasmarkup,
                    width=shutil.get_terminal_size().columns,
                    unicode=(sys.stdout.encoding or "").lower().startswith("utf"),
                    full=terminalreporter.verbosity >= 2,
                    more="-vv shows them all",
                    head=False,
                )
            except Exception as error:
                self._session.troubles.append(f"the summary could not be shown: {named_error(error)}")
        summary = self._summary
        try:
            return (yield)
        finally:
            if summary and summary.causes:
                terminalreporter.section("rvads causes")
                terminalreporter.write(summary.causes)
            if self._session.outputs.index:
                terminalreporter.write_line(f"look: {self._session.outputs.index}")
            if summary and summary.last:
                terminalreporter.write_line(f"rvads: {summary.last}", yellow=True)
            for trouble in self._session.troubles:
                terminalreporter.write_line(f"rvads: {printable(trouble)}", red=True)
            self._session.outputs.annotate(report, terminalreporter)

    @pytest.hookimpl(specname="pytest_terminal_summary", tryfirst=True)
    def pytest_print_verdicts(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Print the verdicts between pytest's blocks of failures and its short summary, which is a wrapper, too."""
        if self._summary:
            terminalreporter.section("rvads verdicts")
            terminalreporter.write(self._summary.verdicts)
