"""What an item knows of its cell and verdicts, and how it reaches the report.

A record is a dict of builtins: it crosses xdist on the report and lands in JUnit and report logs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from pytest_rvads.options import Options
from pytest_rvads.report.record import Record, conclude, flake, properties
from pytest_rvads.session.artefacts import look, show
from pytest_rvads.session.chosen_driver import stand_in, where_else
from pytest_rvads.session.plan import start

if TYPE_CHECKING:
    from pytest_rvads.logic.judging.verdicts import Verdict
    from pytest_rvads.runs.divergence import Divergence
    from pytest_rvads.runs.run import Run

__all__ = ["OPTIONS", "RECORD", "REPEAT", "RUN", "VERDICTS", "NoVerdict", "NotJudged", "attach", "letter", "prepare"]

OPTIONS: pytest.StashKey[Options] = pytest.StashKey()
RECORD: pytest.StashKey[Record] = pytest.StashKey()
VERDICTS: pytest.StashKey[list[Verdict]] = pytest.StashKey()


class NoVerdict(pytest.fail.Exception):  # type: ignore[name-defined,misc]
    """The run of an item can't be judged, or not by this item: an error, whatever the test expects."""


class NotJudged(NoVerdict):
    """A test that was to judge its run did not."""


for _shown in (NoVerdict, NotJudged):
    _shown.__module__ = "builtins"  # as pytest's own: it is shown, and nobody is to import it

RUN: pytest.StashKey[Run] = pytest.StashKey()
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
    """Return how to show NA, counted with the skips, and what a time budget had no room for, counted apart."""
    record = getattr(report, "rvads", None)
    if record and report.when == "call" and report.skipped and record["status"] == "NA":
        return "skipped", "n", "NA"
    if record and report.when == "setup" and record["message"].startswith("NOT RUN: "):
        return "not run", "-", "NOT RUN"
    return None


def attach(item: pytest.Item, call: pytest.CallInfo[None], report: pytest.TestReport) -> None:
    """Put the record, the explanation and the properties of an item on its report.

    The record goes out once per item: with the call, or with the phase that kept it from being called.
    """
    if report.when == "call" and _undriven(item):
        report.rvads_undriven = where_else(item.session)  # type: ignore[attr-defined]
    record = item.stash.get(RECORD, None)
    if record is None:
        return
    if report.when == "teardown":
        _release(item)
        return
    if report.when == "setup" and report.passed:
        return
    verdicts = item.stash[VERDICTS]
    raised = call.excinfo.value if call.excinfo else None
    known = None
    text = str(raised) if raised else report.longrepr if isinstance(report.longrepr, str) else ""
    expected = report.skipped and hasattr(report, "wasxfail")
    if expected and isinstance(raised, AssertionError):
        known = report.wasxfail or "xfail without a reason"
    elif expected and not isinstance(raised, pytest.xfail.Exception):
        _unmask(report, text)
    conclude(
        record,
        [v.record() for v in verdicts],
        report.when or "",
        report.outcome,
        known=known,
        text=text,
        asserted=raised is None or isinstance(raised, AssertionError),
        judged=not isinstance(raised, NotJudged),
    )
    if report.failed and item.config.stash[OPTIONS].repeat == "failed":
        _repeat(item, record, report)
    report.rvads = record  # type: ignore[attr-defined]
    # A repeated item replaces its properties.
    mine = properties(record)
    names = {name for name, _ in mine}
    item.user_properties[:] = [p for p in item.user_properties if p[0] not in names] + mine
    report.user_properties = list(item.user_properties)
    if report.skipped and record["status"] == "NA":
        path, line, _ = item.location
        report.longrepr = (str(path), (line or 0) + 1, text)
    if report.failed and verdicts and str(verdicts[-1].status) in ("FAIL", "OPEN"):
        try:
            told = _explanation(item, verdicts[-1], record, report)
        except Exception as error:  # no explanation is worth the verdict
            told = f"{verdicts[-1].explanation}\n(no more can be told: {type(error).__name__}: {error})"
        report.sections.append((f"rvads {verdicts[-1].rule}", told))


def _undriven(item: pytest.Item) -> bool:
    """Tell whether an item asked for an autopilot and nobody had named one."""
    options = item.config.stash[OPTIONS]
    found = getattr(item, "funcargs", {}).get("rvads_autopilot")
    return found is not None and found is stand_in() and not options.driver


def _unmask(report: pytest.TestReport, text: str) -> None:
    """Fail an item whose xfail was met by something else than a violation: an error is no known failure."""
    report.outcome = "failed"
    report.longrepr = f"{text}\n(an xfail stands for a violated rule, not for this)"
    del report.wasxfail


def _release(item: pytest.Item) -> None:
    """Let go of the run: a session of thousands of items can't hold on to all of them."""
    if RUN in item.stash:
        del item.stash[RUN]
    if REPEAT in item.stash:
        del item.stash[REPEAT]


def _repeat(item: pytest.Item, record: Record, report: pytest.TestReport) -> None:
    """Simulate the run of a failed item once more; where that gives another run, the item is FLAKY, and stays failed."""
    again = item.stash.get(REPEAT, None)
    divergence = again() if again else None
    if divergence is not None:
        flake(record, divergence.what, divergence.time, str(divergence))
        said = "The run was simulated once more from the same start and came out differently, so its verdict means little.\n"
        cure = "\nAn autopilot has to be deterministic: no clock, no unseeded random numbers, no state kept between runs."
        report.sections.append(("rvads not deterministic", f"{said}First difference: {divergence}.{cure}"))


def _explanation(item: pytest.Item, verdict: Verdict, record: Record, report: pytest.TestReport) -> str:
    """Return what to print of a failure, and put its page into the record and its picture on the report."""
    from pytest_rvads.scenarios.configurations import Configuration, probe
    from pytest_rvads.simulators.simulator import named

    cell = item.callspec.params["rvads_cell"]  # type: ignore[attr-defined]
    scenario = cell.scenario
    lines = [verdict.explanation, f"driven by {record['driver']}", f"start     {scenario.describe()}"]
    point = Configuration(scenario.configuration, scenario.distances, scenario.speeds)
    simulator = named(item.config.stash[OPTIONS].simulator)
    probed = probe(point, lambda distance: simulator.vmax(distance, scenario.aggression))
    if probed:
        lines.append(f"probe     {probed}")
    run, folder = item.stash.get(RUN, None), item.config.stash[OPTIONS].artefacts
    if folder and run is not None:
        rule = cell.rule if cell.rule and cell.rule.name == verdict.rule else verdict.rule
        notes = "\n".join((*lines, f'rerun     pytest "{item.nodeid}"'))
        page, image = look(item, folder, run, verdict, rule, notes)
        lines.append(f"look      {page}")
        if image:
            record["look"] = page
            show(item, report, image)
    return "\n".join((*lines, f'rerun     pytest "{item.nodeid}"'))
