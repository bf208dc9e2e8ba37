"""Makes the replay page of a run with a failed verdict, for tests and ``rvads check``.

The page also shows facts about the run, timelines (the states of the monitors of the rule along the run), and the run of the same
test item in an earlier session.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pytest_rvads.logic.conduct.static_model import extract, without_jumps
from pytest_rvads.logic.judging.instances import prepare
from pytest_rvads.logic.judging.judge import Values, walk
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.telling.story import bound_names
from pytest_rvads.report.draw.scene import picture
from pytest_rvads.report.folders import run_file
from pytest_rvads.report.record import Record, SimulatedItem
from pytest_rvads.report.run_record import kept_run
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.run import ARRAYS, Run
from pytest_rvads.runs.runfile import load_run
from pytest_rvads.satellites.pages.replay import Beside, Track, changes, opening, replay
from pytest_rvads.support.errors import FormulaError, RunError


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


_BEFORE, _AFTER = 30.0, 10.0
"""A page shows this much recorded traffic before and after an instant [s]; minutes of dense traffic would fill megabytes."""
_TROUBLE = (Status.FAIL, Status.OPEN, Status.UNSURE)


class Page(NamedTuple):
    """A replay page about a failed verdict."""

    time: float
    """Time at which the page opens, on the clock of the recording [s]."""
    html: str


def moment(run: Run, verdict: Verdict) -> float:
    """Return the time that shows best what a verdict is about, on the clock of the recording [s]."""
    if verdict.status not in _TROUBLE:
        return opening(run)
    if verdict.time is not None:
        return verdict.time
    return next((time for time, *_ in _troubles(verdict)), run.start + run.duration)


def failure_picture(run: Run, verdict: Verdict) -> str:
    """Return a picture (SVG) of the state in which the rule was violated."""
    tick = round((moment(run, verdict) - run.start) / run.dt)
    return picture(run, tick, verdict.message, verdict.responsible)


def failure_pages(run: Run, verdict: Verdict, rule: str | Rule, notes: str, beside: Beside | None = None) -> Iterator[Page]:
    """Yield replay pages of the instances (rule for certain vehicles) that are violated, open or unsure, with their monitors.

    The first page opens at the time that `moment` returns. A simulated run gives one page. Recorded traffic gives a page for each
    instance that no earlier page shows.
    """
    beside, tracks = beside or Beside(), list[Track]()
    traffic, driver = run.provenance.get("traffic"), str(run.provenance.get("autopilot") or "")
    texts = {
        "scenario": run.label,
        "driven by": f"{driver}, {run.subject} alone; the others by {traffic}" if traffic and run.subject else driver,
        "simulated by": str(run.provenance.get("simulator") or ""),
        "rule": str(rule),
        "formula": "",
        "rerun": "",
    }
    with suppress(FormulaError):  # no rule has this name
        known_rule = get_rule(rule)
        texts |= {"rule": f"{known_rule.name}: {known_rule.title}".removesuffix(": "), "formula": known_rule.text}
        tracks = [track for track in timelines(run, known_rule) if track.moved]
    texts |= dict(beside.facts)
    beside = replace(beside, facts=tuple((word, text) for word, text in texts.items() if text))
    if run.excerpt is None:
        time, message = moment(run, verdict), verdict.message
        marked = [(time, message)] if verdict.status in _TROUBLE else []
        yield Page(time, replay(run, message, notes, marked, tracks, verdict.responsible, beside=beside))
        return
    beside = replace(beside, ghost=None, ghost_name="")
    tracks.sort(key=lambda track: track.changes[-1][1] != "violated")
    troubles = _troubles(verdict)
    shown: list[tuple[int, int]] = []
    for time in dict.fromkeys([moment(run, verdict), *(time for time, *_ in troubles)]):
        tick = round((time - run.start) / run.dt)
        if any(begin <= tick < end for begin, end in shown):
            continue
        begin, end = max(tick - round(_BEFORE / run.dt), 0), min(tick + round(_AFTER / run.dt) + 1, run.steps)
        title = verdict.message if not shown else next(event for t, event, _ in troubles if t == time)
        shown.append((begin, end))
        part = _part(run, begin, end)
        marked = [(t, event) for t, event, _ in troubles if part.start <= t <= part.start + part.duration]
        lines = []
        for track in tracks:
            before = [word for tick, word in track.changes if tick <= begin]
            inside = [(tick - begin, word) for tick, word in track.changes if begin < tick < end]
            if inside:
                lines.append(replace(track, changes=((0, before[-1]), *inside)))
        responsible = {name for t, _, names in troubles if t == time for name in names}
        yield Page(time, replay(part, title, notes, marked or [(time, title)], lines, responsible, time, beside))


def usual_rules(run: Run) -> tuple[Rule, ...]:
    """Return the default rules for a run: ``road`` for a run with a subject or of recorded traffic, otherwise ``paper``."""
    return rules_for("paper" if run.subject is None and run.excerpt is None else "road", run.junction)


def _troubles(verdict: Verdict) -> list[tuple[float, str, tuple[str, ...]]]:
    """Return a time [s], a line of text and the responsible vehicles for each violated, open or unsure instance of a rule."""
    troubles = []
    for instance in verdict.instances:
        time = when(verdict, instance)
        if instance.status in _TROUBLE and time is not None:
            names = ", ".join(name for _, name in instance.binding)
            event = f"{verdict.rule} {instance.status}: {names}{instance.hangs and f', {instance.hangs}'}"
            troubles.append((time, event, instance.responsible))
    return troubles


def when(verdict: Verdict, instance: InstanceVerdict) -> float | None:
    """Return when an instance of a rule was violated, or since when an obligation is due [s]; None if no obligation was due."""
    tick = instance.trigger if instance.failed is None else instance.failed
    return None if tick is None else round(verdict.start + tick * verdict.dt, 9)


def timelines(run: Run, rule: str | Rule) -> tuple[Track, ...]:
    """Return the states of a rule's monitor per choice of vehicles and entrances; none if the run lacks a needed quantity."""
    vehicles = {agent.name for agent in run.agents}
    rule, run = get_rule(rule), without_jumps(run)
    templates = prepare(rule.formula, extract(run), rule.bound).templates
    try:
        walked = walk(templates, Values(run, rule.tie))
    except RunError:
        return ()
    tracks, final = [], {Truth.FALSE: "violated", Truth.TRUE: "satisfied"}
    for template, states in zip(templates, walked, strict=True):
        outputs = enumerate(map(Truth, template.machine.output.tolist()))
        words = [final.get(output, "due" if state else "watching") for state, output in outputs]
        binding = bound_names(template)
        label = f"{rule.name} {', '.join(name for _, name in binding if name in vehicles)}"
        tracks.append(Track(label, tuple(changes(np.array(words)[states])), binding))
    return tuple(tracks)


def _part(run: Run, begin: int, end: int) -> Run:
    """Return the states between two ticks as a run of the vehicles that are present in these states."""
    span, shift = slice(begin, end), begin * run.dt
    present = np.flatnonzero(run.here[span].any(axis=0)).tolist()
    agents = tuple(run.agents[column] for column in present)
    names = {agent.name for agent in agents}
    columns = [name for name in (*ARRAYS, "spread") if name != "lights" and getattr(run, name) is not None]
    within = [c for c in run.collisions or () if begin <= round(c.time / run.dt) < end and names.issuperset(c.agents)]
    return replace(
        run,
        lights=run.lights[span],
        **{name: getattr(run, name)[span][:, present] for name in columns},
        agents=agents,
        collisions=None if run.collisions is None else tuple(replace(c, time=c.time - shift) for c in within),
        fault=None if run.fault is None else replace(run.fault, time=run.fault.time - shift),
        excerpt=None if run.excerpt is None else replace(run.excerpt, start=run.start + shift),
    )
