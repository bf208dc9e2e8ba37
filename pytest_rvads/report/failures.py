"""What pages and pictures of failures tell beside the verdict: facts, the instant that they show, the run of an earlier session.

The pages are made by the entry points ``failure`` and ``replay`` of the group ``rvads.pages``.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.report.folders import run_file
from pytest_rvads.report.record import Record, SimulatedItem, kept_run
from pytest_rvads.report.scene import picture
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.runs.states import Zone
from pytest_rvads.support.errors import RunError

TROUBLE = (Status.FAIL, Status.OPEN, Status.UNSURE)
"""The statuses of verdicts that have replay pages."""
_BEFORE = 1.0
"""A page without a violation opens this long before the first vehicle enters the junction [s]."""


@dataclass(frozen=True, slots=True)
class Beside:
    """Texts and pictures that a replay page shows beside the run."""

    facts: tuple[tuple[str, str], ...] = ()
    """Word and text of each line of the head: scenario, driver, rule, command for a repetition."""
    others: tuple[tuple[str, str, str], ...] = ()
    """Rule, status and message of the other verdicts of the run."""
    back: str = ""
    """Relative path of the page that links to this page; empty without such a page."""
    ghost: Run | None = None
    """An earlier run of the same scenario, drawn faintly below the run."""
    ghost_name: str = ""


class Page(NamedTuple):
    """A replay page about a failed verdict."""

    time: float
    """Time at which the page opens, on the clock of the recording [s]."""
    html: str


def summed(verdicts: Iterable[Verdict]) -> tuple[tuple[str, str, str], ...]:
    """Return rule, outcome and message of each verdict, the worst verdict first, as `Beside.others` holds them."""
    ordered = sorted(verdicts, key=lambda verdict: verdict.outcome.severity)
    return tuple((verdict.rule, verdict.outcome.value, verdict.message) for verdict in ordered)


def earlier_run(report: Report, beside: Path, here: Path, nodeid: str, run: Run) -> Run | None:
    """Return the run of a test item in an earlier session; None if it is the same run, was not kept, or lies elsewhere."""
    record = next((record for record in report.records if record.nodeid == nodeid), None)
    if record is None or not record.hash or record.hash == run.hash:
        return None
    paths = [kept_run(folder / report.kept, record) for folder in (here, beside)] if report.kept else []
    with suppress(RunError):  # the hash is malformed
        paths.append(run_file(beside, record.hash))
    for path in paths:
        with suppress(RunError):  # the file is missing or damaged
            earlier = load_run(path)
            if earlier.hash == record.hash and earlier.junction.digest == run.junction.digest:
                return earlier
    return None


def facts(record: Record, start: str, rerun: str) -> tuple[tuple[str, str], ...]:
    """Return the facts about the run of a test item as pairs of a word and a text; unknown facts are left out."""
    verdict = record.verdicts[-1] if record.verdicts else None
    rule = verdict.rule if verdict is not None else record.rule or ""
    rule += f": {verdict.title}" if verdict is not None and verdict.title else ""
    run: tuple[tuple[str, str], ...] = (("recorded", start),)
    if isinstance(record, SimulatedItem):
        driver = f"{record.driver} ({record.source})" if record.source else record.driver
        if record.traffic and verdict is not None and verdict.subject:
            driver = f"{driver}, {verdict.subject} alone; the others by {record.traffic}"
        run = ("scenario", start), ("driven by", driver), ("simulated by", record.simulator)
    known_facts = (*run, ("rule", rule), ("requirements", ", ".join(record.requirements)), ("rerun", rerun))
    return tuple((word, text) for word, text in known_facts if text)


def moment(run: Run, verdict: Verdict) -> float:
    """Return the time that shows best what a verdict is about, on the clock of the recording [s]."""
    if verdict.status not in TROUBLE:
        return opening(run)
    if verdict.time is not None:
        return verdict.time
    return next((time for time, *_ in troubles(verdict)), run.start + run.duration)


def failure_picture(run: Run, verdict: Verdict) -> str:
    """Return a picture (SVG) of the state in which the rule was violated."""
    tick = round((moment(run, verdict) - run.start) / run.dt)
    return picture(run, tick, verdict.message, verdict.responsible)


def opening(run: Run) -> float:
    """Return the time 1 s before the first vehicle enters the junction; the start of the run if no vehicle enters [s]."""
    driven = [agent.way.key in run.junction.movements for agent in run.agents]
    entered = (run.zone[:, driven] == Zone.JUNCTION).any(axis=1)
    return round(run.start + max(int(entered.argmax()) * run.dt - _BEFORE, 0.0), 9)


def usual_rules(run: Run) -> tuple[Rule, ...]:
    """Return the default rules for a run: ``road`` for a run with a subject or of recorded traffic, otherwise ``paper``."""
    return rules_for("paper" if run.subject is None and run.excerpt is None else "road", run.junction)


def troubles(verdict: Verdict) -> list[tuple[float, str, tuple[str, ...]]]:
    """Return a time [s], a line of text and the responsible vehicles for each violated, open or unsure instance of a rule."""
    found = []
    for instance in verdict.instances:
        time = when(verdict, instance)
        if instance.status in TROUBLE and time is not None:
            names = ", ".join(name for _, name in instance.binding)
            event = f"{verdict.rule} {instance.status}: {names}{instance.hangs and f', {instance.hangs}'}"
            found.append((time, event, instance.responsible))
    return found


def when(verdict: Verdict, instance: InstanceVerdict) -> float | None:
    """Return when an instance of a rule was violated, or since when an obligation is due [s]; None if no obligation was due."""
    tick = instance.trigger if instance.failed is None else instance.failed
    return None if tick is None else round(verdict.start + tick * verdict.dt, 9)
