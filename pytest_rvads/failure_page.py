"""The replay page of a run with a failed verdict, which tests and ``rvads check`` write."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from pytest_rvads.draw.picture import picture
from pytest_rvads.draw.replay import Beside, Track, replay
from pytest_rvads.errors import FormulaError
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Status, Verdict
from pytest_rvads.logic.rules.book import get_rule, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.timeline import timelines
from pytest_rvads.report.run_record import summed, verdict_by
from pytest_rvads.runs.run import ARRAYS, Run

__all__ = ["Page", "failure_pages", "failure_picture", "moment", "other_verdicts", "usual_rules", "when"]

_BEFORE, _AFTER = 30.0, 10.0
"""How much of recorded traffic a page shows before and after what it is about [s]: minutes of dense traffic fill megabytes."""
_WORST = ("FAIL", "OPEN", "ERROR", "UNSURE", "PROVOKED", "UNAVOIDABLE", "PASS", "NA")
"""What a verdict of a run is, the worst first."""
_TROUBLE = (Status.FAIL, Status.OPEN, Status.UNSURE)


@dataclass(frozen=True, slots=True)
class Page:
    """One page about a verdict."""

    time: float
    """At which it opens, on the clock of the recording [s]."""
    html: str


def moment(run: Run, verdict: Verdict) -> float:
    """Return when there is most to see of a verdict, on the clock of the recording [s].

    That is its time, or when its first instance became violated, open or unsure; else the end of the run.
    """
    if verdict.time is not None:
        return verdict.time
    return next((time for time, _ in _troubled(verdict)), run.start + run.duration)


def failure_picture(run: Run, verdict: Verdict) -> str:
    """Return the state in which the rule was broken as SVG; raises as `failure_pages` does."""
    tick = round((moment(run, verdict) - run.start) / run.dt)
    return picture(run, tick, verdict.message, verdict.responsible)


def failure_pages(run: Run, verdict: Verdict, rule: str | Rule, notes: str, beside: Beside | None = None) -> Iterator[Page]:
    """Yield pages that show what is violated, open or unsure, with the monitors of the rule; `moment` is on the first.

    Of a run that is complete in itself there is one. Of recorded traffic there is one for each instance that no earlier page
    shows, of the seconds around it and the vehicles that were there then.

    Args:
        run: what to show.
        verdict: what went wrong.
        rule: that was broken.
        notes: what the pages say beside the picture.
        beside: what else they say and show. Recorded traffic has no ghost: it is what it is, whoever judges it.

    Raises:
        RunError: the run holds no positions, or no states.
        MapError: its junction has no geometry.
    """
    beside = _known(run, rule, notes, beside or Beside())
    if run.excerpt is None:
        time, message = moment(run, verdict), verdict.message
        marked = [(time, message)]
        yield Page(time, replay(run, message, notes, marked, _tracks(run, rule), verdict.responsible, beside=beside))
        return
    beside = replace(beside, ghost=None, ghost_name="")
    tracks = sorted(_tracks(run, rule), key=lambda track: track.changes[-1][1] != "violated")
    found = _troubled(verdict)
    shown: list[tuple[int, int]] = []
    for time in dict.fromkeys([moment(run, verdict), *(time for time, _ in found)]):
        tick = round((time - run.start) / run.dt)
        if any(begin <= tick < end for begin, end in shown):
            continue
        begin, end = max(tick - round(_BEFORE / run.dt), 0), min(tick + round(_AFTER / run.dt) + 1, run.steps)
        title = verdict.message if not shown else next(_line(verdict, i) for t, i in found if t == time)
        shown.append((begin, end))
        part = _part(run, begin, end)
        marked = [(t, _line(verdict, i)) for t, i in found if part.start <= t <= part.start + part.duration]
        lines = [cut for track in tracks if (cut := _within(track, begin, end))]
        who = {name for t, i in found if t == time for name in i.responsible}
        yield Page(time, replay(part, title, notes, marked or [(time, title)], lines, who, time, beside))


def _known(run: Run, rule: str | Rule, notes: str, beside: Beside) -> Beside:
    """Return what is beside a run, with what run and rule tell of themselves where that was not given."""
    told, asked = run.provenance, None
    with suppress(FormulaError):  # of a rule that is known by no name
        asked = get_rule(rule)
    again = re.findall(r"^rerun +(.+)$", notes, re.MULTILINE)[-1:]  # ours is the last: texts of others come before it
    traffic = told.get("traffic")
    driver = str(told.get("autopilot") or "")
    found = {
        "scenario": run.label,
        "driven by": f"{driver}, {run.subject} alone; the others by {traffic}" if traffic and run.subject else driver,
        "simulated by": str(told.get("simulator") or ""),
        "rule": f"{asked.name}: {asked.title}".removesuffix(": ") if asked else str(rule),
        "formula": asked.text if asked else "",
        "rerun": "".join(again),
    }
    given = dict(beside.facts)
    own = tuple((word, given.pop(word, text)) for word, text in found.items())
    return replace(beside, facts=tuple((word, text) for word, text in (*own, *given.items()) if text))


def usual_rules(run: Run) -> tuple[Rule, ...]:
    """Return the rules that a run is judged by where nobody names any: the paper's where all drive alike, else the road's."""
    return rules_for("paper" if run.subject is None and run.excerpt is None else "road", run.junction)


def other_verdicts(run: Run, rules: Iterable[str | Rule], but: str = "") -> tuple[tuple[str, str, str], ...]:
    """Return rule, status and message of a run's verdicts by some rules, the worst first; for `Beside.others`.

    The status is PROVOKED or UNAVOIDABLE where the verdict is, and ERROR with the reason where a rule can't judge the run.

    Args:
        run: what to judge.
        rules: by what.
        but: name of the rule that is left out, because the page is about it.
    """
    names = {rule if isinstance(rule, str) else rule.name: rule for rule in rules}
    return summed(verdict_by(run, rule) for name, rule in names.items() if name != but)


def _troubled(verdict: Verdict) -> list[tuple[float, InstanceVerdict]]:
    """Return the instances that are violated, open or unsure, and when they became so [s]; not those of which nobody knows."""
    timed = [(when(verdict, instance), instance) for instance in verdict.instances if instance.status in _TROUBLE]
    return [(time, instance) for time, instance in timed if time is not None]


def _line(verdict: Verdict, instance: InstanceVerdict) -> str:
    """Return what is said of an instance among the events of a page."""
    who = ", ".join(name for _, name in instance.binding)
    return f"{verdict.rule} {instance.status}: {who}{instance.hangs and f', {instance.hangs}'}"


def when(verdict: Verdict, instance: InstanceVerdict) -> float | None:
    """Return when an instance of a verdict was violated, else since when there is an obligation; None where there was none.

    The time is on the clock of the recording [s].
    """
    tick = instance.trigger if instance.failed is None else instance.failed
    return None if tick is None else round(verdict.start + tick * verdict.dt, 9)


def _tracks(run: Run, rule: str | Rule) -> list[Track]:
    """Return the monitors of a rule, without those to which nothing ever happened; none of a rule that is known by no name."""
    try:
        found = [line for line in timelines(run, rule) if line.moved]
    except FormulaError:
        return []
    vehicles = {agent.name for agent in run.agents}
    bound = [[value for _, value in line.binding if value in vehicles] for line in found]
    name = rule if isinstance(rule, str) else rule.name
    return [Track(f"{name} {', '.join(who)}", line.changes) for who, line in zip(bound, found, strict=True)]


def _part(run: Run, begin: int, end: int) -> Run:
    """Return some ticks of recorded traffic as a run, with the vehicles that were there meanwhile."""
    span = slice(begin, end)
    there = np.flatnonzero(run.here[span].any(axis=0)).tolist()
    names = {run.agents[column].name for column in there}
    columns = [name for name in (*ARRAYS, "spread") if name != "lights" and getattr(run, name) is not None]
    shift = begin * run.dt
    within = [c for c in run.collisions or () if begin <= round(c.time / run.dt) < end and names.issuperset(c.agents)]
    touched = tuple(replace(collision, time=collision.time - shift) for collision in within)
    return replace(
        run,
        lights=run.lights[span],
        **{name: getattr(run, name)[span][:, there] for name in columns},
        agents=tuple(run.agents[column] for column in there),
        collisions=None if run.collisions is None else touched,
        fault=None if run.fault is None else replace(run.fault, time=run.fault.time - shift),
        excerpt=None if run.excerpt is None else replace(run.excerpt, start=run.start + shift),
    )


def _within(track: Track, begin: int, end: int) -> Track | None:
    """Return the part of a track between the ticks `begin` and `end`; None if the track does not change between the two."""
    before = [word for tick, word in track.changes if tick <= begin]
    inside = [(tick - begin, word) for tick, word in track.changes if begin < tick < end]
    return replace(track, changes=((0, before[-1]), *inside)) if inside else None
