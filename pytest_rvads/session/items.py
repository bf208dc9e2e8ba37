"""Makes the record of a test item: begun before the fixtures, completed after the test, and put on pytest's report of the item.

The record is an attribute of the report, in the form of JSON values. Pytest serialises all attributes of a report and makes
a `TestReport` of them by keyword, so the record reaches the main process under xdist, and report logs. The record is not put
into ``user_properties``, because JUnit files show all ``user_properties``.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast

import pytest

from pytest_rvads.drivers.naming import called, stand_in
from pytest_rvads.logic.outcome import Outcome
from pytest_rvads.session.artefacts import beside, look, show
from pytest_rvads.session.collection.cells import RecordedCell
from pytest_rvads.session.interrupts import OutOfTime
from pytest_rvads.session.options import LIMITS, OPTIONS
from pytest_rvads.session.plan import start
from pytest_rvads.support.errors import RvadsError, in_own_code, located
from pytest_rvads.support.wording import named_error, printable, quoted

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.report.record import Record, SimulatedItem
    from pytest_rvads.runs.measured import Divergence
    from pytest_rvads.runs.run import Run
    from pytest_rvads.session.collection.cells import Cell
    from pytest_rvads.simulators.simulator import Choice

RECORD: pytest.StashKey[Record] = pytest.StashKey()
VERDICTS: pytest.StashKey[list[Verdict]] = pytest.StashKey()


_NAME = "rvads_autopilot"
"""Name of the fixture that returns the driver."""
_ALIKE = 0.8
"""Least similarity of a misspelt name to the name of the fixture, see `difflib`."""
_ELSEWHERE: pytest.StashKey[str] = pytest.StashKey()
_LONGEST = 20_000
"""Longest message of a record [characters]."""
_SKIPPED = (Outcome.NA, Outcome.UNSURE)
"""Statuses that skip a test; the reason of the skip names the line of the test."""


class NoVerdict(pytest.fail.Exception):  # type: ignore[name-defined,misc]
    """The run of a test item can't be judged, or a rule is not the rule of the item; an error even in a test with an xfail."""


class NotJudged(NoVerdict):
    """A test took ``rule`` or ``monitor`` and judged nothing."""


class Unsure(NoVerdict):
    """The verdict is UNSURE, and the option ``--rvads-strict=unsure`` lets such a verdict fail the test."""


for _exception in (NoVerdict, NotJudged, Unsure):
    _exception.__module__ = "builtins"  # as for pytest's own exceptions, so that tracebacks show no module

RUN: pytest.StashKey[Run] = pytest.StashKey()
SIMULATOR: pytest.StashKey[Choice] = pytest.StashKey()
ERROR: pytest.StashKey[BaseException | None] = pytest.StashKey()
"""The exception of the driver that ended the run of an item; None if the run ended otherwise."""
PRINTED: pytest.StashKey[list[tuple[str, str]]] = pytest.StashKey()
"""What the simulation of the run of an item printed and logged, by pytest's names (stdout, stderr, log)."""
EARLIER: pytest.StashKey[tuple[Outcome, str | None]] = pytest.StashKey()
"""Status of a test item and hash of its run at the last execution, to compare with if a plugin repeats the item."""
CELL: pytest.StashKey[Cell] = pytest.StashKey()
"""The cell (run and rule) of the start that a searching test reports; in all other tests, items have a cell as parameter."""
REPEAT: pytest.StashKey[Callable[[], Divergence | None]] = pytest.StashKey()
"""A function that simulates the run of an item once more and returns the first difference of the two runs, or None."""


def checked_name(driver: Any, config: pytest.Config) -> str:
    """Return the name of a driver, read within the time limit of a decision, because reading can run code of the driver."""
    from pytest_rvads.simulators.patience import TooLate, Watch

    with suppress(TooLate), Watch(config.stash[LIMITS]) as watch:
        watch.asked = driver
        name = called(driver)
    if watch.late:
        raise NoVerdict(f"ERROR: what drives does not say what it is called: {watch.late}", pytrace=False)
    return name


def prepare(item: pytest.Item) -> bool:
    """Begin the record of an item before any fixture runs; return whether the item belongs to this plugin."""
    record = start(item)
    if record is not None:
        item.stash[RECORD] = record
        item.stash[VERDICTS] = []
    return record is not None


def letter(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Return category, letter and word for pytest, for an item that is NA, UNSURE or beyond the time budget; None for others."""
    record = getattr(report, "rvads", None)
    if not record:
        return None
    outcome = Outcome(record["status"])
    if report.when == "call" and report.skipped and outcome in _SKIPPED:
        return "skipped", outcome.letter, outcome.value
    if report.when == "setup" and record.get("late"):
        return "not run", outcome.letter, outcome.value
    return None


def attach(item: pytest.Item, call: pytest.CallInfo[None], report: pytest.TestReport) -> None:
    """Put the record, the explanation and the properties of a test item on pytest's report of the item.

    One report per item has the record: the report of the call, or of a setup that did not pass.
    """
    if report.failed:
        printed = [(f"Captured {name} of the run", text) for name, text in item.stash.get(PRINTED, ())]
        report.sections[:0] = [section for section in printed if section not in report.sections]
    driver = getattr(item, "funcargs", {}).get("rvads_autopilot") if report.when == "call" else None
    if driver is not None and driver is stand_in() and not item.config.stash[OPTIONS].driver:
        report.rvads_undriven = where_else(item.session)  # type: ignore[attr-defined]
    if RECORD not in item.stash:
        return
    from msgspec.structs import replace

    if report.when == "teardown":  # memory does not hold the runs of thousands of items
        keys: tuple[pytest.StashKey[Any], ...] = (RECORD, VERDICTS, RUN, SIMULATOR, REPEAT, CELL, ERROR, PRINTED)
        for key in keys:
            if key in item.stash:
                del item.stash[key]
    elif report.when == "call" or not report.passed:
        try:
            record = _completed_record(item, call.excinfo.value if call.excinfo else None, report)
        except Exception as error:
            report.outcome = "failed"
            report.longrepr = f"this item can't be recorded: {named_error(error)}"
            record = replace(item.stash[RECORD], status=Outcome.ERROR, outcome="failed", message=report.longrepr)
        for step in (_with_repetition, _with_explanation):
            try:
                record = step(item, record, report)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # an error in a diagnosis costs no verdict
                report.sections.append(("rvads", f"the explanation is incomplete, because of {named_error(error)}"))
        _publish(item, record, report)


@contextmanager
def unwound(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    """Let pytest report the error of an item with the frames of the code of a user that raised it, without this package's.

    After the report, the traceback ends in the innermost line of that code, where ``--pdb`` then stops.
    """
    raised = call.excinfo.value if call.excinfo and RECORD in item.stash else None
    source, fault = raised, item.stash[RUN].fault if RUN in item.stash else None
    if isinstance(raised, NoVerdict):
        source = item.stash.get(ERROR, None) if fault and fault.reason in str(raised) else None
    traces = in_own_code(source) if source else None
    if not (raised and source and traces):
        yield
        return
    if isinstance(raised, NoVerdict):
        raised.pytrace = True
        for name in ("__cause__", "__context__", "__suppress_context__"):
            setattr(raised, name, getattr(source, name))
    call.excinfo = pytest.ExceptionInfo.from_exception(raised.with_traceback(traces[0]))
    yield
    call.excinfo = pytest.ExceptionInfo.from_exception(raised.with_traceback(traces[1]))


def _completed_record(item: pytest.Item, raised: BaseException | None, report: pytest.TestReport) -> Record:
    from pytest_rvads.report.record import conclude

    text = str(raised) if raised else report.longrepr if isinstance(report.longrepr, str) else ""
    if isinstance(raised, Exception) and not isinstance(raised, AssertionError | RvadsError):
        text = located(raised)
    elif raised and not any(map(str.isalnum, text)):
        text = named_error(raised)
    known = None
    if report.skipped and hasattr(report, "wasxfail"):
        if isinstance(raised, AssertionError):
            known = report.wasxfail or "xfail without a reason"
        elif not isinstance(raised, pytest.xfail.Exception):  # an xfail expects a violation of a rule, nothing else
            report.outcome = "failed"
            report.longrepr = f"{text}\n(an xfail stands for a violated rule, not for this)"
            del report.wasxfail
    verdicts: list[Verdict] = item.stash[VERDICTS]
    error = None if raised is None or isinstance(raised, AssertionError) else Outcome.ERROR
    if isinstance(raised, NotJudged | Unsure):
        error = Outcome.NOT_JUDGED if isinstance(raised, NotJudged) else Outcome.UNSURE
    return conclude(
        item.stash[RECORD],
        verdicts,
        report.when or "",
        report.outcome,
        known=known,
        text=printable(text, _LONGEST),
        error=error,
        late=isinstance(raised, OutOfTime),
    )


def _publish(item: pytest.Item, record: Record, report: pytest.TestReport) -> None:
    """Put a record and its properties on pytest's report; if the verdict skips the test, the report gets the test's line.

    The record becomes FLAKY if a plugin repeated the item, and status or run differ from the last execution.
    """
    from msgspec.structs import replace

    from pytest_rvads.report.record import properties, sent
    from pytest_rvads.runs.measured import Divergence

    status, run = item.stash.get(EARLIER, (record.status, record.hash))
    if (status, run) != (record.status, record.hash):
        field = "status" if run == record.hash else "hash"
        which_run = "the same run" if field == "status" else "another run"
        text = f"the item was repeated: {status} at first, {record.status} afterwards, of {which_run}"
        record = replace(record, status=Outcome.FLAKY, flaky=Divergence(field, text=text), known=None)
    item.stash[EARLIER] = record.status, record.hash
    item.stash[RECORD] = record
    report.rvads = sent(record)  # type: ignore[attr-defined]
    if report.failed:
        from pytest_rvads.report.triage import first_line, signature

        report.rvads_short = repr(signature(record)), first_line(record)  # type: ignore[attr-defined]
    # A repeated item replaces its properties.
    of_record = properties(record)
    names = {name for name, _ in of_record}
    item.user_properties[:] = [p for p in item.user_properties if p[0] not in names] + of_record
    report.user_properties = list(item.user_properties)
    if report.skipped and record.status in _SKIPPED:
        path, line, _ = item.location
        report.longrepr = (str(path), (line or 0) + 1, record.message)


def _with_repetition(item: pytest.Item, record: Record, report: pytest.TestReport) -> Record:
    """Simulate the run of a failed item once more; return the record as FLAKY if the second run differs."""
    simulate_again = item.stash.get(REPEAT, None) if report.failed else None
    divergence = simulate_again() if simulate_again else None
    if divergence is None:
        return record
    from msgspec.structs import replace

    finding = "The run was simulated once more from the same start and came out differently, so its verdict means little.\n"
    cure = "\nAn autopilot has to be deterministic: no clock, no unseeded random numbers, no state kept between runs."
    report.sections.append(("rvads not deterministic", f"{finding}First difference: {divergence}.{cure}"))
    return replace(record, status=Outcome.FLAKY, flaky=divergence)


def _with_explanation(item: pytest.Item, record: Record, report: pytest.TestReport) -> Record:
    """Add the explanation of a verdict FAIL, OPEN or UNSURE to the report, and return the record with the address of its page."""
    verdicts = item.stash[VERDICTS]
    if not (report.failed and verdicts and verdicts[-1].status in ("FAIL", "OPEN", "UNSURE")):
        return record
    from msgspec.structs import replace

    verdict, page = verdicts[-1], ""
    try:
        text, page = _explanation(item, verdict, record, report)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        text = f"{verdict.explanation}\n(the explanation is incomplete, because of {named_error(error)})"
    report.sections.append((f"rvads {verdict.rule}", text))
    return replace(record, look=page)


def _explanation(item: pytest.Item, verdict: Verdict, record: Record, report: pytest.TestReport) -> tuple[str, str]:
    """Return the text that pytest prints on a failure, and the address of its page or an empty text; attach the picture."""
    cell: Cell | RecordedCell = item.stash.get(CELL, None) or item.callspec.params["rvads_cell"]  # type: ignore[attr-defined]
    if isinstance(cell, RecordedCell):
        origin = [f"recorded  {cell.path}"]
    else:
        from pytest_rvads.scenarios.configurations import Configuration, probe
        from pytest_rvads.simulators.simulator import vmax

        scenario, simulated = cell.scenario, cast("SimulatedItem", record)
        origin = [f"driven by {simulated.driver}", f"simulated by {simulated.simulator}", f"start     {scenario.describe()}"]
        point = Configuration(scenario.configuration, scenario.distances, scenario.speeds)
        vehicle = item.funcargs.get("rvads_vehicle")  # type: ignore[attr-defined]
        limit = scenario.place.top_limit
        probed = probe(point, lambda d: vmax(d, scenario.aggression, vehicle, item.stash[SIMULATOR], limit))
        origin += [f"probe     {probed}"] if probed else []
    lines = [verdict.explanation, *origin]
    options, run = item.config.stash[OPTIONS], item.stash.get(RUN, None)
    command, page = f"{options.again} {quoted(item.nodeid)}", ""
    rerun = f"rerun     {command}"
    if options.artefacts and run is not None:
        rule = cell.rule if cell.rule and cell.rule.name == verdict.rule else verdict.rule
        start = cell.path if isinstance(cell, RecordedCell) else cell.scenario.describe()
        around = partial(beside, item, options, record, run, start, command)
        shown, image = look(item, run, verdict, rule, "\n".join((*lines, rerun)), around)
        lines.append(f"look      {shown}")
        if image:
            page = shown
            show(item, report, image)
    return "\n".join((*lines, rerun)), page


def where_else(session: pytest.Session) -> str:
    """Return a sentence on a definition in the tests that was probably meant as the fixture of the driver; empty without one.

    The modules of the tests and of the plugins are searched once per session.
    """
    stash = session.config.stash
    if _ELSEWHERE in stash:
        return stash[_ELSEWHERE]
    plugins = session.config.pluginmanager.get_plugins()
    candidates = (*(getattr(item, "module", None) for item in session.items), *plugins)
    modules = {str(m.__file__): m for m in candidates if isinstance(m, ModuleType) and getattr(m, "__file__", None) is not None}
    package, text = __name__.partition(".")[0], ""
    for file, module in sorted(modules.items()):
        if module.__name__.partition(".")[0] != package and not text:
            for name in difflib.get_close_matches(_NAME, vars(module), 1, _ALIKE):
                text = f"{file} defines {name!r}: is it misspelt?"
                if name == _NAME:
                    text = f"{file} has one that is not visible there: move it into a conftest.py of a folder that holds both"
    return stash.setdefault(_ELSEWHERE, text)
