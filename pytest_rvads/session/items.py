"""What an item knows of its cell and verdicts, and how it reaches the report.

It crosses xdist on the report as builtins, and lands in JUnit and report logs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import pytest

from pytest_rvads.collection.cells import RecordedCell, run_name
from pytest_rvads.drivers.naming import stand_in
from pytest_rvads.options import OPTIONS
from pytest_rvads.outcome import Outcome
from pytest_rvads.session.artefacts import look, show
from pytest_rvads.session.beside import beside
from pytest_rvads.session.chosen_driver import where_else
from pytest_rvads.session.exports import export
from pytest_rvads.session.plan import start
from pytest_rvads.session.time_budget import OutOfTime
from pytest_rvads.wording import one_line, printable, quoted

if TYPE_CHECKING:
    from pytest_rvads.collection import Cell
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.report.record import Record, SimulatedItem
    from pytest_rvads.runs.measured import Divergence
    from pytest_rvads.runs.run import Run
    from pytest_rvads.scenarios.scenario import Scenario
    from pytest_rvads.simulators.simulator import Simulator

__all__ = [
    "RECORD",
    "REPEAT",
    "RUN",
    "SIMULATOR",
    "VERDICTS",
    "NoVerdict",
    "NotJudged",
    "Unsure",
    "attach",
    "letter",
    "prepare",
]

RECORD: pytest.StashKey[Record] = pytest.StashKey()
VERDICTS: pytest.StashKey[list[Verdict]] = pytest.StashKey()


_LONGEST = 20_000
"""Of a message [characters]."""
_SKIPPED = (Outcome.NA, Outcome.UNSURE)
"""What skips a test by itself: its reason is told at the test."""


class NoVerdict(pytest.fail.Exception):  # type: ignore[name-defined,misc]
    """The run of an item can't be judged, or not by this item: an error, whatever the test expects."""


class NotJudged(NoVerdict):
    """A test that was to judge its run did not."""


class Unsure(NoVerdict):
    """A verdict that another reading of the recording would change, where that is to fail."""


for _shown in (NoVerdict, NotJudged, Unsure):
    _shown.__module__ = "builtins"  # as pytest's own: it is shown, and nobody is to import it

RUN: pytest.StashKey[Run] = pytest.StashKey()
SIMULATOR: pytest.StashKey[Simulator] = pytest.StashKey()
"""What made the run of an item."""
EARLIER: pytest.StashKey[tuple[Outcome, str | None]] = pytest.StashKey()
"""Status and hash of the run of an item when it ran before, which stays for as long as the item may be repeated."""
REPEAT: pytest.StashKey[Callable[[], Divergence | None]] = pytest.StashKey()
"""Simulates the run of an item once more and tells where the two part."""


def prepare(item: pytest.Item) -> bool:
    """Give an item of ours its record, before any fixture runs; tell whether it is one."""
    record = start(item)
    if record is not None:
        item.stash[RECORD] = record
        item.stash[VERDICTS] = []
    return record is not None


def letter(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Return how to show NA and UNSURE, counted with the skips, and what a time budget had no room for, counted apart."""
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
    """Put the record, the explanation and the properties of an item on its report.

    The record goes out once per item: with the call, or with the phase that kept it from being called.
    """
    if report.when == "call" and _undriven(item):
        report.rvads_undriven = where_else(item.session)  # type: ignore[attr-defined]
    if RECORD not in item.stash:
        return
    if report.when == "teardown":
        _release(item)
    elif report.when == "call" or not report.passed:
        try:
            record = _concluded(item, call.excinfo.value if call.excinfo else None, report)
        except Exception as error:
            record = _unrecorded(item, error, report)
        for step in (_repeated, _explained):
            try:
                record = step(item, record, report)
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # no diagnosis is worth a verdict
                report.sections.append(("rvads", f"no more can be told: {_named(error)}"))
        _publish(item, _steadied(item, record), report)


def _unrecorded(item: pytest.Item, error: Exception, report: pytest.TestReport) -> Record:
    """Return the record of an item of which nothing else can be recorded."""
    from msgspec.structs import replace

    report.outcome = "failed"
    report.longrepr = f"this item can't be recorded: {_named(error)}"
    return replace(item.stash[RECORD], status=Outcome.ERROR, outcome="failed", message=report.longrepr)


def _named(error: BaseException) -> str:
    try:
        return f"{type(error).__name__}: {one_line(str(error))}"
    except Exception:  # of somebody else's making
        return type(error).__name__


def _concluded(item: pytest.Item, raised: BaseException | None, report: pytest.TestReport) -> Record:
    """Return the record of an item that is over."""
    from pytest_rvads.report.record import conclude

    text = str(raised) if raised else report.longrepr if isinstance(report.longrepr, str) else ""
    known = _known(report, raised, text)
    error = None if raised is None or isinstance(raised, AssertionError) else Outcome.ERROR
    given: list[Verdict] = item.stash[VERDICTS]
    told = Outcome.NOT_JUDGED if isinstance(raised, NotJudged) else Outcome.UNSURE if isinstance(raised, Unsure) else error
    return conclude(
        item.stash[RECORD],
        given,
        report.when or "",
        report.outcome,
        known=known,
        text=printable(text, _LONGEST),
        error=told,
        late=isinstance(raised, OutOfTime),
    )


def _known(report: pytest.TestReport, raised: BaseException | None, text: str) -> str | None:
    """Return the reason of the xfail that a violation met; what meets one otherwise fails: an error is no known failure."""
    if not (report.skipped and hasattr(report, "wasxfail")):
        return None
    if isinstance(raised, AssertionError):
        return report.wasxfail or "xfail without a reason"
    if not isinstance(raised, pytest.xfail.Exception):
        report.outcome = "failed"
        report.longrepr = f"{text}\n(an xfail stands for a violated rule, not for this)"
        del report.wasxfail
    return None


def _publish(item: pytest.Item, record: Record, report: pytest.TestReport) -> None:
    """Put a record on a report, with its properties and, of what skipped its test, the place."""
    from pytest_rvads.report.record import properties, sent

    item.stash[RECORD] = record
    report.rvads = sent(record)  # type: ignore[attr-defined]
    # A repeated item replaces its properties.
    mine = properties(record)
    names = {name for name, _ in mine}
    item.user_properties[:] = [p for p in item.user_properties if p[0] not in names] + mine
    report.user_properties = list(item.user_properties)
    if report.skipped and record.status in _SKIPPED:
        path, line, _ = item.location
        report.longrepr = (str(path), (line or 0) + 1, record.message)


def _undriven(item: pytest.Item) -> bool:
    """Tell whether an item asked for an autopilot and nobody had named one."""
    options = item.config.stash[OPTIONS]
    found = getattr(item, "funcargs", {}).get("rvads_autopilot")
    return found is not None and found is stand_in() and not options.driver


def _release(item: pytest.Item) -> None:
    """Let go of run and verdicts: a session of thousands of items can't hold on to all of them."""
    kept: tuple[pytest.StashKey[Any], ...] = (RECORD, VERDICTS, RUN, SIMULATOR, REPEAT)
    for key in kept:
        if key in item.stash:
            del item.stash[key]


def _repeated(item: pytest.Item, record: Record, report: pytest.TestReport) -> Record:
    """Simulate the run of a failed item once more; where that gives another run, the item is FLAKY, and stays failed."""
    asked = report.failed and item.config.stash[OPTIONS].repeat == "failed"
    again = item.stash.get(REPEAT, None) if asked else None
    divergence = again() if again else None
    if divergence is None:
        return record
    from msgspec.structs import replace

    said = "The run was simulated once more from the same start and came out differently, so its verdict means little.\n"
    cure = "\nAn autopilot has to be deterministic: no clock, no unseeded random numbers, no state kept between runs."
    report.sections.append(("rvads not deterministic", f"{said}First difference: {divergence}.{cure}"))
    return replace(record, status=Outcome.FLAKY, flaky=divergence)


def _steadied(item: pytest.Item, record: Record) -> Record:
    """Return the record as FLAKY where a plugin repeats the item and its verdict or its run is another one than before."""
    from msgspec.structs import replace

    from pytest_rvads.runs.measured import Divergence

    status, run = item.stash.get(EARLIER, (record.status, record.hash))
    if (status, run) != (record.status, record.hash):
        what = "status" if run == record.hash else "hash"
        told = "the same run" if what == "status" else "another run"
        text = f"the item was repeated: {status} at first, {record.status} afterwards, of {told}"
        record = replace(record, status=Outcome.FLAKY, flaky=Divergence(what, text=text), known=None)
    item.stash[EARLIER] = record.status, record.hash
    return record


def _explained(item: pytest.Item, record: Record, report: pytest.TestReport) -> Record:
    """Print what there is to say of a violation, or of one that may be, and return the record with the page that shows it."""
    verdicts = item.stash[VERDICTS]
    if not (report.failed and verdicts and verdicts[-1].status in ("FAIL", "OPEN", "UNSURE")):
        return record
    from msgspec.structs import replace

    verdict, page = verdicts[-1], ""
    try:
        told, page = _explanation(item, verdict, record, report)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        told = f"{verdict.explanation}\n(no more can be told: {_named(error)})"
    report.sections.append((f"rvads {verdict.rule}", told))
    return replace(record, look=page)


def _made(item: pytest.Item, scenario: Scenario, record: SimulatedItem) -> list[str]:
    """Return who drove, what simulated, from which start, and whether that was beyond the braking envelope, a line each."""
    from pytest_rvads.scenarios.configurations import Configuration, probe
    from pytest_rvads.simulators.simulator import vmax

    made = [f"driven by {record.driver}", f"simulated by {record.simulator}", f"start     {scenario.describe()}"]
    point = Configuration(scenario.configuration, scenario.distances, scenario.speeds)
    vehicle = item.funcargs.get("rvads_vehicle")  # type: ignore[attr-defined]
    probed = probe(point, lambda d: vmax(d, scenario.aggression, vehicle, item.stash[SIMULATOR], scenario.place.top_limit))
    return [*made, f"probe     {probed}"] if probed else made


def _explanation(item: pytest.Item, verdict: Verdict, record: Record, report: pytest.TestReport) -> tuple[str, str]:
    """Return what to print of a failure, and its page or nothing; its picture is put on the report."""
    cell: Cell | RecordedCell = item.callspec.params["rvads_cell"]  # type: ignore[attr-defined]
    if isinstance(cell, RecordedCell):
        made = [f"recorded  {cell.path}"]
    else:
        made = _made(item, cell.scenario, cast("SimulatedItem", record))
    lines = [verdict.explanation, *made]
    options, run = item.config.stash[OPTIONS], item.stash.get(RUN, None)
    again, page = f"{options.again} {quoted(item.nodeid)}", ""
    rerun = f"rerun     {again}"
    if options.artefacts and run is not None:
        rule = cell.rule if cell.rule and cell.rule.name == verdict.rule else verdict.rule
        start = cell.path if isinstance(cell, RecordedCell) else cell.scenario.describe()
        around = partial(beside, item, options, record, run, start, again)
        shown = look(item, run, verdict, rule, "\n".join((*lines, rerun)), around)
        lines.append(f"look      {shown.told}")
        page = shown.page
        if shown.image:
            show(item, report, shown.image)
    if (exports := options.export) and run is not None:
        name = run_name(item.nodeid, cell)
        lines.append(f"export    {export(item, exports, name, run, verdict, options.map)}")
    return "\n".join((*lines, rerun)), page
