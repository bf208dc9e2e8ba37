"""The main process of a session: it collects the records of all items, makes report and exit status, and adds to pytest's output.

A session is green only if a verdict was given, a driver was named, and everything planned is accounted for. Verdicts are printed
before pytest's short summary, and the causes of failures after it. Pytest's list of failures stays as it is; the text of a
failure becomes one line if an earlier failure explains it.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass, replace
from datetime import datetime
from hashlib import sha256
from traceback import format_tb
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.session.interrupts import BUDGET, leave_in_time, put_off
from pytest_rvads.session.options import OPTIONS
from pytest_rvads.session.outputs import Outputs, totals
from pytest_rvads.session.plan import Planner
from pytest_rvads.support.errors import RvadsError, in_own_code, located
from pytest_rvads.support.wording import encode_all, named_error, plural, printable

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Report
    from pytest_rvads.report.terminal import Summary

_FAILED = int(pytest.ExitCode.TESTS_FAILED)
_NOTHING = int(pytest.ExitCode.NO_TESTS_COLLECTED)


@dataclass(frozen=True, slots=True)
class Reason:
    """A reason why a session is not green, or a note on the session."""

    text: str
    exitstatus: int = _FAILED
    """Exit status of the session if nothing else gives the session another status than 0; 0 for a note."""
    cut: bool = True
    """Whether so many items are missing that ``--rvads-fail-on`` excuses no failure."""


class Session:
    """A session in the main process, which collects the records of all test items; under xdist the workers send the records."""

    def __init__(self, config: pytest.Config, planner: Planner) -> None:
        self.config = config
        self.options = config.stash[OPTIONS]
        self.planner = planner
        self.baseline: Report | None = None
        if self.options.baseline is not None:
            from pytest_rvads.report.files import load

            try:
                self.baseline = load(self.options.baseline)
            except RvadsError as error:
                raise pytest.UsageError(f"rvads_baseline: {error}") from error
        self.outputs = Outputs(config)
        self.records: dict[str, Record] = {}
        """Records by node id, read from the journal at the end of the session; the last record of a repeated item."""
        self.seconds: dict[str, float] = {}
        """By node id, the time that setup, call and teardown of the item took together [s]."""
        self.lost: dict[str, str] = {}
        """By node id of an item that ran without leaving a record, the reason."""
        self.turned: set[str] = set()
        """Node ids of items that failed and whose reports a plugin or conftest.py turned into reports of passed items."""
        self.failures_without_verdict: set[str] = set()
        """Node ids of failures without a verdict: other tests, collection, teardown, hooks of users."""
        self.undriven: dict[str, str] = {}
        """By node id of an item without a named driver, the sentence of `where_else` on a misplaced definition of the driver."""
        self.troubles: list[str] = []
        self.report: Report | None = None
        """The report of the session; None before the end."""
        self.began = datetime.now().astimezone().isoformat(timespec="seconds")
        self.collected = False
        """Whether the collection was completed; also True under xdist, where workers collect."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionstart(self) -> None:
        """Replace the reports of an earlier session before any test item runs."""
        self.outputs.begin()

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """Write the plan, i.e. all selected test items, into the reports after the collection."""
        collection = yield
        self.collected = True
        self.outputs.announce(self.planner)
        return collection

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Store the record, the duration and the failure of a test item from pytest's report."""
        self.outputs.announce(self.planner)  # under xdist the plan comes with the first report
        content = getattr(report, "rvads", None)
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if content is not None:
            self._store(content, report)
        elif report.when not in ("setup", "call", "teardown"):
            self.lost[report.nodeid] = "the worker process crashed while it ran this item"
        if hasattr(report, "rvads_undriven"):
            self.undriven[report.nodeid] = report.rvads_undriven
        if report.failed and (content is None or report.when == "teardown"):
            self.failures_without_verdict.add(report.nodeid)

    def _store(self, content: dict[str, Any], report: pytest.TestReport) -> None:
        """Add a record to the journal on disk and call the hooks of users; an error in a hook loses no verdict."""
        from pytest_rvads.report.record import received

        try:
            record = received(content)
            self.outputs.journal.add(record)
        except Exception as error:
            self.lost[report.nodeid] = f"the record of this item can't be read: {named_error(error)}"
            self.failures_without_verdict.add(report.nodeid)
            return
        if record.outcome == "failed" and not report.failed:
            self.turned.add(report.nodeid)
        try:
            self.config.hook.pytest_rvads_verdict(record=content, config=self.config)
        except (Exception, SystemExit, pytest.skip.Exception, pytest.fail.Exception) as error:
            traces = in_own_code(error)
            told = "".join(format_tb(traces[0] if traces else None)).rstrip()
            trouble = f"a hook pytest_rvads_verdict raised {located(error)}\n{told}"
            self.troubles += [] if trouble in self.troubles else [trouble]
            self.failures_without_verdict.add("pytest_rvads_verdict")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note that the collection of a test file failed."""
        if report.failed:
            self.failures_without_verdict.add(report.nodeid)

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> Generator[None, None, None]:
        """Write the reports and set the exit status, even after an interruption or when another plugin's hook raises an error."""
        gates = self.options.cov_fail_under, self.options.cov_arrivals
        wanted = any((self.baseline, self.options.report, gates != (None, None)))  # even without items of this plugin
        if self.config.option.collectonly or not (self.planner.plan().cells or wanted):
            return (yield)
        put_off(self.config)
        status = int(exitstatus)
        try:
            return (yield)
        except KeyboardInterrupt:
            status = status or pytest.ExitCode.INTERRUPTED
            raise
        except BaseException:
            status = status or pytest.ExitCode.TESTS_FAILED
            raise
        finally:
            try:
                self._finish(session, status)
            except Exception as error:
                self.troubles.append(f"the session could not be summed up: {named_error(error)}")
                session.exitstatus = exitstatus or pytest.ExitCode.INTERNAL_ERROR
            leave_in_time(int(session.exitstatus))

    def _finish(self, session: pytest.Session, exitstatus: int) -> None:
        """Make the report of the session, write the files and set the exit status."""
        from msgspec import structs

        from pytest_rvads.report.record import conclude
        from pytest_rvads.report.session_report import steady

        self.records = self.outputs.journal.records()
        plan, budget, missing = self.planner.plan(), self.config.stash[BUDGET], 0
        for nodeid, record in plan.vanished.items():
            self.records[nodeid] = structs.replace(record, message="dropped after collection")
        for nodeid, record in plan.items.items():
            if nodeid in self.lost:
                self.records[nodeid] = conclude(record, (), "", "failed", text=self.lost[nodeid])
            elif nodeid not in self.records:
                self.records[nodeid] = structs.replace(record, message="the session ended before")
                missing += 1
        self.records = {record.nodeid: record for record in steady(self.records.values())}
        causes = self._reasons(exitstatus, missing)
        self.troubles += [reason.text for reason in causes]
        status = next(filter(None, (exitstatus % 256, *(reason.exitstatus for reason in causes))), 0)
        if budget:
            budget.remember(self.records.values())
        if self.lost or "pytest_rvads_verdict" in self.failures_without_verdict:
            status = status or pytest.ExitCode.TESTS_FAILED
        self.report = self._report(status, cut=bool(session.shouldfail) or any(reason.cut for reason in causes))
        status = self.report.exitstatus
        troubles, complete = self.outputs.end(self.report, has_run(self.report))
        self.troubles += troubles
        if not complete:
            status = status or pytest.ExitCode.TESTS_FAILED
        if session.exitstatus in (0, exitstatus):  # unchanged if another plugin has set a worse status
            session.exitstatus = status

    def _reasons(self, exitstatus: int, missing: int) -> list[Reason]:
        """Return the reasons why the session is not green; the first reason with an exit status other than 0 decides the status.

        `missing` is the number of selected items that never ran. A violation fails its item even if the test, a plugin or a
        conftest.py catches the exception.
        """
        records, plan, unplanned = self.records.values(), self.planner.plan(), self.planner.unplanned()
        found: list[Reason] = []
        incomplete = bool(missing or unplanned) or not self.collected
        absent = f"{plural(missing, 'item')} did not run"
        if not self.collected:
            absent = "the items to run were not yet known"
        elif unplanned:
            absent = f"none of {plural(unplanned, 'item')} ended, and no worker reported which of them belong to pytest-rvads"
        if exitstatus not in (pytest.ExitCode.OK, _FAILED, _NOTHING):
            text = f"the session did not end by itself (exit status {exitstatus}): {absent}"
            found.append(Reason(text, cut=incomplete))
        elif incomplete:
            found.append(Reason(f"the session stopped early: {absent}"))
        if plan.vanished:
            vanished = f"{plural(len(plan.vanished), 'item')} vanished"
            found.append(Reason(f"{vanished}: a plugin or conftest.py dropped them without deselecting them"))
        if self.undriven:
            where = next(filter(None, self.undriven.values()), "")
            text = (
                f"nothing says what drives in {plural(len(self.undriven), 'item')}, so the bundled reference autopilot did, and "
                "nothing of yours was tested: override the fixture rvads_autopilot, or name what drives by "
                "--rvads-autopilot=module:name or --rvads-sut (--rvads-autopilot=reference if you mean the reference)"
            )
            found.append(Reason(f"{text}{'; ' if where else ''}{where}"))
        flaky = [record for record in records if record.status is Outcome.FLAKY and record.outcome != "failed"]
        if flaky:
            example = f", first {flaky[0].nodeid}: {flaky[0].flaky}" if flaky[0].flaky else ""
            found.append(Reason(f"FLAKY, though nothing failed: {plural(len(flaky), 'item')}{example}", cut=False))
        if records and not any(record.status.judges or record.status is Outcome.FLAKY for record in records):
            text = "nothing was judged: no rule required an action of the system under test, or no item ran"
            found.append(Reason(text, _NOTHING, cut=False))
        fails = {outcome for outcome in Outcome if outcome.bad} - (set() if "open" in self.options.strict else {Outcome.OPEN})
        hidden = {name for name, r in self.records.items() if r.status in fails and not r.failed and not r.known}
        hushed = sorted(hidden | {name for name in self.turned if self.records[name].status is not Outcome.FLAKY})
        if hushed:
            passed = f"{plural(len(hushed), 'item')} passed in spite of a failure"
            found.append(Reason(f"{passed}: a plugin catches failures, first {hushed[0]}"))
        unkept = [record.unkept for record in records if record.unkept]
        if unkept:
            found.append(Reason(f"the runs of {plural(len(unkept), 'item')} could not be kept: {unkept[0]}"))
        budget, late = self.config.stash[BUDGET], sum(record.late for record in records)
        if budget and late:
            text = f"{budget.reason.partition(': ')[2]}: {plural(late, 'item')} did not run"
            found.append(Reason(text, exitstatus=0, cut=False))
        return found

    def _report(self, exitstatus: int, cut: bool) -> Report:
        """Return the report of the session; its exit status includes the baseline and the required coverage."""
        from pytest_rvads.report.figures import shortfall, untested
        from pytest_rvads.report.session_report import Report, in_order
        from pytest_rvads.support.installed import entries, libraries, versions

        plan, ini = self.planner.plan(), self.config.inipath
        records = in_order(list(self.records.values()))
        seconds: defaultdict[str, float] = defaultdict(float)  # that all test items of each run took
        for record in self.records.values():
            if record.run:
                seconds[record.where] += self.seconds.get(record.nodeid, 0.0)
        report = Report(
            records,
            totals(records),
            tuple(plan.cells),
            versions(*(library for name in entries("simulators") for library in libraries(name))),
            left_out=plan.left_out,
            unfit=plan.unfit,
            extents=plan.extents,
            again=self.options.again,
            refused={reason: tuple(names) for reason, names in plan.refused.items()},
            drawn=tuple(plan.drawn),
            seconds={name: round(total, 3) for name, total in seconds.items()},
            began=self.began,
            command=printable(shlex.join(["pytest", *map(os.fspath, self.config.invocation_params.args)])),
            project=sha256(ini.read_bytes()).hexdigest()[:12] if ini and ini.is_file() else self.config.rootpath.name,
            kept=self._kept_folder(),
        )
        if self.baseline:
            from pytest_rvads.report.session_report import compare, with_baseline

            name = self.options.baseline.name if self.options.baseline else ""
            report = with_baseline(report, compare(report, self.baseline, name, self.planner.no_longer_exists))
            if exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
                exitstatus = self._judge_changes(report, exitstatus, cut)
        least_coverage, most_untested = self.options.cov_fail_under, self.options.cov_arrivals
        for text in (
            "" if least_coverage is None else shortfall(report, least_coverage),
            "" if most_untested is None else untested(report, most_untested),
        ):
            if text:
                self.troubles.append(text)
                exitstatus = exitstatus or pytest.ExitCode.TESTS_FAILED
        return replace(report, notes=tuple(self.troubles), exitstatus=exitstatus)

    def _kept_folder(self) -> str:
        """Return the path of the folder ``--rvads-keep``, written relative to the directory in which the session was started."""
        if not self.options.keep:
            return ""
        try:
            return os.path.relpath(self.options.keep, self.config.invocation_params.dir)
        except ValueError:  # no relative path leads to another drive of Windows
            return str(self.options.keep)

    def _judge_changes(self, report: Report, exitstatus: int, cut: bool) -> int:
        """Return the exit status; ``--rvads-fail-on`` excuses failures that the baseline has as well, but not if `cut` is set."""
        kinds = {"any": (), "new": ("NEW", "LOST"), "eroded": ("NEW", "LOST", "ERODED")}[self.options.fail_on]
        if not kinds or not report.comparison:
            return exitstatus
        errors = any(record.status.meaning == "error" for record in report.records)
        if report.comparison.count(*kinds) or errors:
            return pytest.ExitCode.TESTS_FAILED
        failed = sum(record.failed for record in report.records)
        if exitstatus and failed and not self.failures_without_verdict and not cut:
            self.troubles.append(
                f"{plural(failed, 'item')} failed as in the baseline, which --rvads-fail-on={self.options.fail_on} lets pass"
            )
            return pytest.ExitCode.OK
        return exitstatus


def has_run(report: Report) -> bool:
    """Return whether at least one test item of the session ran."""
    return any(record.status is not Outcome.NOT_RUN for record in report.records)


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
