"""The records of a whole session: gathered where its reports arrive, summed up and written at the end."""

from __future__ import annotations

import os
import shlex
from collections.abc import Generator
from dataclasses import replace
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pytest_rvads.errors import RvadsError
from pytest_rvads.options import OPTIONS
from pytest_rvads.outcome import Outcome
from pytest_rvads.session.interrupts import leave_in_time, put_off
from pytest_rvads.session.outputs import Outputs, told, totals
from pytest_rvads.session.plan import Planner
from pytest_rvads.session.reasons import Ending, reasons
from pytest_rvads.session.time_budget import BUDGET
from pytest_rvads.wording import plural, printable

if TYPE_CHECKING:
    from pytest_rvads.report.record import Record
    from pytest_rvads.report.session_report import Report

__all__ = ["Session", "ran"]


class Session:
    """Lives in the main process, also under xdist, where the reports come from the workers."""

    def __init__(self, config: pytest.Config, planner: Planner) -> None:
        self.config = config
        self.options = config.stash[OPTIONS]
        self.planner = planner
        self.baseline = _load(self.options.baseline)
        self.outputs = Outputs(config)
        self.records: dict[str, Record] = {}
        """By node id, once the session is over; until then they are in the journal. Of a repeated item the last one counts."""
        self.seconds: dict[str, float] = {}
        """Node id to how long its phases took [s]."""
        self.lost: dict[str, str] = {}
        """Node ids of items that ran and left no record, and why."""
        self.turned: set[str] = set()
        """Node ids of items that failed until somebody changed their reports."""
        self.others: set[str] = set()
        """Failures that no verdict accounts for: of other tests, of collection, of clearing up."""
        self.undriven: dict[str, str] = {}
        """Node ids of items that nothing was named to drive in, and where what was meant may be."""
        self.troubles: list[str] = []
        self.report: Report | None = None
        """Of the whole session, once it is over."""
        self.began = datetime.now().astimezone().isoformat(timespec="seconds")
        self.collected = False
        """Whether collecting came to its end; under xdist this process collects nothing."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionstart(self) -> None:
        """Take the place of an earlier session, before anything of this one runs."""
        self.outputs.begin()

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """Announce what is to run."""
        found = yield
        self.collected = True
        self.outputs.announce(self.planner)
        return found

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the record of an item."""
        self.outputs.announce(self.planner)  # under xdist what is to run comes with the first report
        content = getattr(report, "rvads", None)
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if content is not None:
            self._keep(content, report)
        elif report.when not in ("setup", "call", "teardown"):
            self.lost[report.nodeid] = "the worker process crashed while it ran this item"
        if hasattr(report, "rvads_undriven"):
            self.undriven[report.nodeid] = report.rvads_undriven
        if report.failed and (content is None or report.when == "teardown"):
            self.others.add(report.nodeid)

    def _keep(self, content: dict[str, Any], report: pytest.TestReport) -> None:
        """Keep a record and tell users' hooks of it; one that fails costs no other verdict."""
        from pytest_rvads.report.record import received

        try:
            record = received(content)
            self.outputs.journal.add(record)
        except Exception as error:
            self.lost[report.nodeid] = f"the record of this item can't be read: {told(error)}"
            self.others.add(report.nodeid)
            return
        if record.outcome == "failed" and not report.failed:
            self.turned.add(report.nodeid)
        try:
            self.config.hook.pytest_rvads_verdict(record=content, config=self.config)
        except (Exception, SystemExit, pytest.skip.Exception, pytest.fail.Exception) as error:
            said = f"a hook pytest_rvads_verdict raised {told(error)}"
            self.troubles += [] if said in self.troubles else [said]
            self.others.add("pytest_rvads_verdict")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Remember what could not be collected."""
        if report.failed:
            self.others.add(report.nodeid)

    @pytest.hookimpl(wrapper=True, trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> Generator[None, None, None]:
        """Write the reports and set the exit status, even after an interruption or when another plugin's hook raises an error."""
        if self.config.option.collectonly or not self._concerned():
            return (yield)
        put_off(self.config)
        ended = int(exitstatus)
        try:
            return (yield)
        except KeyboardInterrupt:
            ended = ended or pytest.ExitCode.INTERRUPTED
            raise
        except BaseException:
            ended = ended or pytest.ExitCode.TESTS_FAILED
            raise
        finally:
            try:
                self._finish(session, ended)
            except Exception as error:
                self.troubles.append(f"the session could not be summed up: {told(error)}")
                session.exitstatus = exitstatus or pytest.ExitCode.INTERNAL_ERROR
            leave_in_time(int(session.exitstatus))

    def _finish(self, session: pytest.Session, exitstatus: int) -> None:
        """Write what was asked for, and keep the exit status honest."""
        from pytest_rvads.report.steady import steady

        self.records = self.outputs.journal.records()
        budget = self.config.stash[BUDGET]
        missing = self._complete()
        self.records = {record.nodeid: record for record in steady(self.records.values())}
        found = reasons(
            Ending(
                exitstatus,
                self.collected,
                self.records,
                missing,
                self.planner.unsaid(),
                len(self.planner.plan().vanished),
                self.undriven,
                self.turned,
                budget.reason if budget else "",
                self.options.open != "fail",
            )
        )
        self.troubles += [reason.text for reason in found]
        ended = next(filter(None, (exitstatus % 256, *(reason.exitstatus for reason in found))), 0)
        if budget:
            budget.remember(self.records.values())
        if self.lost or "pytest_rvads_verdict" in self.others:
            ended = ended or pytest.ExitCode.TESTS_FAILED
        self.report = self._report(ended, cut=bool(session.shouldfail) or any(reason.cut for reason in found))
        ended = self.report.exitstatus
        wrong, whole = self.outputs.end(self.report, ran(self.report))
        self.troubles += wrong
        if not whole:
            ended = ended or pytest.ExitCode.TESTS_FAILED
        if session.exitstatus in (0, exitstatus):  # somebody else's is worse
            session.exitstatus = ended

    def _concerned(self) -> bool:
        """Return whether anything of ours was planned, or asked for; most sessions of an environment are none of our business."""
        asked = self.baseline, self.options.report, self.options.cov_fail_under is not None
        return bool(self.planner.plan().cells or any(asked))

    def _complete(self) -> int:
        """Add a record for every item that was selected and gave none; return how many never ran."""
        from msgspec import structs

        from pytest_rvads.report.record import conclude

        missing = 0
        plan = self.planner.plan()
        for nodeid, record in plan.vanished.items():
            self.records[nodeid] = structs.replace(record, message="dropped after collection")
        for nodeid, record in plan.items.items():
            if nodeid in self.lost:
                self.records[nodeid] = conclude(record, (), "", "failed", text=self.lost[nodeid])
            elif nodeid not in self.records:
                self.records[nodeid] = structs.replace(record, message="the session ended before")
                missing += 1
        return missing

    def _report(self, ended: int, cut: bool) -> Report:
        """Return the report of the session, with the exit status that its gates make of it."""
        from pytest_rvads.report.coverage import shortfall
        from pytest_rvads.report.session_report import Report, in_order
        from pytest_rvads.versions import ENGINES, versions

        plan = self.planner.plan()
        records = in_order(list(self.records.values()))
        report = Report(
            records,
            totals(records),
            tuple(plan.cells),
            versions(*ENGINES),
            left_out=plan.left_out,
            unfit=plan.unfit,
            extents=plan.extents,
            again=self.options.again,
            refused=plan.refused,
            drawn=tuple(plan.drawn),
            seconds=self._by_run(),
            began=self.began,
            command=printable(shlex.join(["pytest", *map(os.fspath, self.config.invocation_params.args)])),
            project=self._project(),
            kept=self._kept(),
        )
        if self.baseline:
            report = self._compare(report, self.baseline)
            if ended in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
                ended = self._judge_changes(report, ended, cut)
        least = self.options.cov_fail_under
        short = "" if least is None else shortfall(report, least)
        if short:
            self.troubles.append(short)
            ended = ended or pytest.ExitCode.TESTS_FAILED
        return replace(report, notes=tuple(self.troubles), exitstatus=ended)

    def _project(self) -> str:
        """Return what tells the project from others, see `Report.project`."""
        file = self.config.inipath
        return sha256(file.read_bytes()).hexdigest()[:12] if file and file.is_file() else self.config.rootpath.name

    def _kept(self) -> str:
        """Return the folder in which all runs are kept, from where the session was started."""
        if not self.options.keep:
            return ""
        try:
            return os.path.relpath(self.options.keep, self.config.invocation_params.dir)
        except ValueError:  # on another drive no path leads there from here
            return str(self.options.keep)

    def _by_run(self) -> dict[str, float]:
        """Return how long the items of every run took together [s]."""
        found: dict[str, float] = {}
        for nodeid, record in self.records.items():
            if record.run:
                found[record.where] = found.get(record.where, 0.0) + self.seconds.get(nodeid, 0.0)
        return {name: round(taken, 3) for name, taken in found.items()}

    def _compare(self, report: Report, baseline: Report) -> Report:
        from pytest_rvads.report.baseline import compare, with_baseline

        name = self.options.baseline.name if self.options.baseline else ""
        same = self.options.baseline_of == "same"
        return with_baseline(report, compare(report, baseline, name, self.options.erosion, self.planner.gone, same=same))

    def _judge_changes(self, report: Report, ended: int, cut: bool) -> int:
        """Return the exit status where only some changes since the baseline are failures; what is `cut` is no success."""
        kinds = {"any": (), "new": ("NEW", "LOST"), "eroded": ("NEW", "LOST", "ERODED")}[self.options.fail_on]
        if not kinds or not report.comparison:
            return ended
        errors = any(record.status.meaning == "error" for record in report.records)
        if report.comparison.count(*kinds) or errors:
            return pytest.ExitCode.TESTS_FAILED
        old = sum(record.failed for record in report.records)
        if ended and old and not self.others and not cut:
            self.troubles.append(
                f"{plural(old, 'item')} failed as in the baseline, which --rvads-fail-on={self.options.fail_on} lets pass"
            )
            return pytest.ExitCode.OK
        return ended


def ran(report: Report) -> bool:
    """Return whether any item of a session ran."""
    return any(record.status is not Outcome.NOT_RUN for record in report.records)


def _load(path: Path | None) -> Report | None:
    """Return the baseline, before anything runs.

    Raises:
        pytest.UsageError: it is no report.
    """
    if path is None:
        return None
    from pytest_rvads.report.files import load

    try:
        return load(path)
    except RvadsError as error:
        raise pytest.UsageError(f"rvads_baseline: {error}") from error
