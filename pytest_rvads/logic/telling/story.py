"""The judgement from which the texts of a verdict are made, sentences that several texts contain, and the explanation.

The explanation shows the rule, the vehicles and entrances concerned, the vehicles that have to act, the beginning of their
obligation, its violation, and a table with the last good and the first bad state. For an UNSURE verdict the explanation names the
uncertain event or measurement on which the verdict depends. Vehicles and places have the user's names (a0, entrance 1).
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pytest_rvads.logic.conduct.standing import wt
from pytest_rvads.logic.judging.attribution import Cycle, by_walkers, is_about, responsible
from pytest_rvads.logic.judging.instances import Template
from pytest_rvads.logic.judging.judge import Values, asked
from pytest_rvads.logic.judging.judgement import Judgement, Near
from pytest_rvads.logic.judging.verdicts import NearMiss, Status
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.ltl.ltl3 import evaluate
from pytest_rvads.logic.rules.rule import Kind, Rule, agents_of
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import (
    Naming,
    clock,
    colour_at,
    element_name,
    literal,
    origin,
    place,
    position,
    say,
    turns,
    why,
    zone,
)
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.support.wording import one_line

_ORDER = (Status.FAIL, Status.OPEN, Status.UNSURE, Status.PASS, Status.NA)
_WORDS = {Status.FAIL: "fail", Status.OPEN: "open", Status.UNSURE: "unsure", Status.PASS: "pass", Status.NA: "not triggered"}


@dataclass(slots=True)
class Story:
    """The judgement of a run by a rule, with all values from which the texts of the verdict are made."""

    rule: Rule
    run: Run
    status: Status
    judgements: tuple[Judgement, ...] = ()
    values: Values | None = None
    reason: str = ""
    collapsed: int = 0
    cycle: Cycle | None = None
    near: Near | None = None
    notes: list[str] = field(default_factory=list)
    asked: bool = True
    """Whether an instance bound the subject (the vehicle under test) to act."""
    unavoidable: bool = False
    """Whether no vehicle could have kept the rule."""
    provoked: bool = False
    """Whether the traffic alone caused the violation or the open obligation."""
    tolerance: str = ""
    """With how large an error of the measurements a violation in a recorded run stays definite."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of instances by outcome: fail, open, unsure, pass, "not triggered"."""
        numbers = Counter(_WORDS[j.status] for j in self.judgements)
        return {word: numbers[word] for word in _WORDS.values() if numbers[word]}

    def kept(self) -> tuple[int, int]:
        """Return the number of kept instances and of all instances; with a subject, of those that bind the subject to act."""
        judgements, run = self.judgements, self.run
        if self.run.subject is None or self.values is None:
            return sum(j.status is Status.PASS for j in judgements), len(judgements)
        me = next(column for column, agent in enumerate(run.agents) if agent.name == self.run.subject)
        binding = [j for j in judgements if any(e.index == me for m in j.template.members for e in m.bound)]
        return sum(j.status is Status.PASS and asked(j.template, self.values, me) for j in binding), len(binding)

    def ordered(self) -> list[Judgement]:
        """Return the judgements, sorted by severity and time; those that the subject is to blame for come before all others."""

        def key(j: Judgement) -> tuple[bool, int, int]:
            tick = j.failed if j.failed is not None else j.trigger
            if self.run.subject is not None:
                elsewhere = not is_about(j, self.run, self.run.subject)
            else:
                elsewhere = j.status is Status.FAIL and by_walkers(j, self.run)
            return elsewhere, _ORDER.index(j.status), self.run.steps if tick is None else tick

        return sorted(self.judgements, key=key)


def bound_names(template: Template) -> tuple[tuple[str, str], ...]:
    """Return the variables of a rule, and the names of the vehicles and places that the variables stand for in an instance."""
    return tuple((name, element_name(e)) for name, e in template.binding)


def happened(j: Judgement, name: Naming = element_name) -> str:
    """Return in words the events of the tick in which an instance of a rule failed."""
    shape, broken = j.template.shape, dict(j.broken)
    match shape.waits:
        case f.Atom("@", (f.Element() as agent, f.Element() as entrance)) if shape.goes and broken.get(shape.waits) is False:
            goes = say(shape.goes, name, "was")
            if j.together:
                return f"{name(agent)} left {name(entrance)} in the first step in which {goes}, not after it"
            return f"{name(agent)} left {name(entrance)} before {goes}"
        case f.Not(f.Atom("@", (f.Element() as agent, _)) as entered) if shape.goes and broken.get(entered) is True:
            goes = say(shape.goes, lambda e: "it" if e == agent else name(e), "was")
            return f"{name(agent)} entered the junction before {goes}"
    parts = j.template.atoms
    inside = [
        a.terms[0] for a in parts if a.name == "@" and isinstance(a.terms[1], f.Element) and a.terms[1].sort == Sort.JUNCTION
    ]
    if shape.kind is Kind.STATE and len(inside) == len(parts) == 2:
        return f"{', '.join(name(e) for e in inside if isinstance(e, f.Element))} both in junction"
    return ", ".join(literal(a, v, name) for a, v in j.broken)


def block(story: Story, worst: Judgement | None, miss: NearMiss | None) -> list[str]:
    """Return the lines of the explanation of a verdict; `worst` is the violated, open or UNSURE instance to explain."""
    rule, run, total = story.rule, story.run, sum(story.counts.values())
    counted = f"{total} instance{'s' if total != 1 else ''}: {', '.join(f'{n} {word}' for word, n in story.counts.items())}"
    lines = [f"rule      {rule.name}  {one_line(rule.title) + ':  ' if rule.title else ''}{rule.text}"]
    if rule.requirement:
        lines.append(f"traces to {one_line(rule.requirement)}")
    if worst is None:
        if story.reason:
            lines.append(f"{story.status.lower():<9} {story.reason}")
        if story.counts:
            lines.append(f"instances {counted}")
        if miss:
            who = ", ".join(f"{k}={v}" for k, v in miss.binding)
            lines.append(f"nearest   at {clock(run, miss.tick)} s for {who}; false: {', '.join(miss.missing)}")
        return lines + [f"note      {note}" for note in story.notes]
    who = ", ".join(f"{k}={v}" for k, v in bound_names(worst.template))
    lines.append(f"instance  {who}   ({counted})")
    if worst.hinge is not None:
        return [*lines, f"unsure    {hangs(run, worst)}", *(f"note      {note}" for note in story.notes)]
    lines += _roles(story, worst)
    lines += _table(run, worst, story.values)
    return lines + [f"note      {note}" for note in story.notes]


def _roles(story: Story, j: Judgement) -> list[str]:
    """Return lines of text with the waiting and the awaited vehicles, the beginning of the obligation, and its violation."""
    run, shape = story.run, j.template.shape
    tick = next(t for t in (j.failed, j.ended, run.steps - 1) if t is not None)
    lines = []
    if shape.waits is None or shape.goes is None:
        for e in agents_of(j.template.formula):
            inside = np.flatnonzero(run.zone[: tick + 1, e.index] == Zone.JUNCTION)
            entered = f"   entered {clock(run, int(inside[0]))} s" if len(inside) else ""
            agent = run.agents[e.index]
            fast = f"   v = {run.speed[tick, e.index]:.1f} m/s" if run.speed is not None else ""
            blame = "   <- acts" if e in responsible(j, run) else ""
            lines.append(f"vehicle   {e.name} {origin(run.junction, agent)}{entered}{fast}{blame}")
        if reason := why(run, j.template.atoms):
            lines.append(f"because   {reason}")
        if j.failed is None:
            lines.append(f"open      {say(shape.obligation)}, owed since {clock(run, j.trigger or 0)} s")
        else:
            lasted = f"; broken for {j.margin:.2f} s of the run" if j.margin and shape.premise is not None else ""
            lines.append(f"broken at {clock(run, tick)} s: {happened(j)}{lasted}")
        return lines
    waiting = agents_of(shape.waits)
    going = tuple(e for e in agents_of(shape.goes) if e not in waiting)
    for word, agents in (("yields" if shape.kind is Kind.YIELD else "must wait", waiting), ("priority", going)):
        lines += [f"{word:<9} {_arrival(run, e, tick, waiting)}" for e in agents]
    stay = say(shape.waits, be="stays")
    lines.append(f"obligation since {clock(run, j.trigger or 0)} s: {stay} until {say(shape.goes)}")
    verb = "broken at" if j.failed is not None else "open at  "
    early = f"; {j.margin:.2f} s too early" if j.margin and j.margin > 0 and j.failed is not None else ""
    early = "; both in the same step" if j.together else early
    lines.append(f"{verb} {clock(run, tick)} s: {_scene(run, waiting, going, shape.goes, tick)}{early}")
    return lines


def _arrival(run: Run, e: f.Element, tick: int, waiting: tuple[f.Element, ...]) -> str:
    """Return an agent's name, entrance, turn, arrival and wait up to `tick`, and where its entrance lies for who waits for it."""
    entrance = run.agents[e.index].entrance
    ticks = np.flatnonzero(run.zone[: tick + 1, e.index] == Zone.ENTRANCE)
    text = f"{e.name} @ entrance {entrance}, {turns(run.junction, run.agents[e.index])}"
    if len(ticks):
        last = int(ticks[-1])
        away = np.flatnonzero(run.zone[:last, e.index] != Zone.ENTRANCE)
        arrived = int(away[-1]) + 1 if len(away) else 0
        text += f"   arrived {clock(run, arrived)} s, waited {int(wt(run, e.index)[last]) * run.dt:.2f} s"
    if e in waiting or len(waiting) != 1:
        return text
    waiting_entrance = run.agents[waiting[0].index].entrance
    # Where traffic keeps left, the relation right-of means left-of.
    side = "left of" if run.junction.left_hand else "right of"
    for word, pairs in ((side, run.junction.right_of), ("opposite", run.junction.opposite)):
        if (entrance, waiting_entrance) in pairs:
            return f"{text}   entrance {entrance} is {word} {waiting_entrance}"
    if (waiting_entrance, entrance) in run.junction.right_of:
        text += f"   entrance {waiting_entrance} is {side} {entrance}"
    return text


def _scene(run: Run, waiting: tuple[f.Element, ...], going: tuple[f.Element, ...], goes: f.Formula, tick: int) -> str:

    def placed(e: f.Element, still: bool) -> str:
        where = zone(run.agents[e.index], Zone(int(run.zone[tick, e.index])))
        at = "in the junction" if where == "junction" else f"on the {where}" if where == "approach" else f"at {where}"
        detail = [] if run.station is None else [f"{run.station[tick, e.index]:.2f} m"]
        if still and run.speed is not None:
            detail.append(f"v = {run.speed[tick, e.index]:.1f} m/s")
        waits = still and going and where.startswith("entrance")
        return f"{e.name} {'is still ' if waits else 'is ' if still else ''}{at}" + (f" ({', '.join(detail)})" if detail else "")

    waiting_text = ", ".join(placed(e, not going) for e in waiting)
    going_text = ", ".join(placed(e, True) for e in going)
    lights = dict.fromkeys(
        t.of
        for a in f.atoms(goes)
        for t in a.terms
        if isinstance(t, f.Attr) and isinstance(t.of, f.Element) and t.of.sort == Sort.LIGHT
    )
    colours = [f"{place(e)} is {colour_at(run, e.index, tick)}" for e in lights if isinstance(e, f.Element)]
    return " while ".join(filter(None, (waiting_text, ", ".join(filter(None, (going_text, *colours))))))


def _table(run: Run, j: Judgement, values: Values | None) -> list[str]:
    """Return a table of the states in which the obligation began, was last kept, and was broken."""
    if values is None:
        return []
    last = next(t for t in (j.failed, j.ended, run.steps - 1) if t is not None)
    ticks = sorted({t for t in (j.trigger, last - 1, last) if t is not None and t >= 0})
    agents = agents_of(j.template.formula)
    atoms = j.template.atoms
    head = [" t [s]", *(e.name for e in agents), *map(str, atoms)]
    rows = [
        [
            f"{clock(run, t):>6}",
            *(position(run, e.index, t) for e in agents),
            *("x" if evaluate(a, values, (run.steps,))[t] else "." for a in atoms),
        ]
        for t in ticks
    ]
    widths = [max(len(r[k]) for r in (head, *rows)) for k in range(len(head))]
    centred = 1 + len(agents)

    def line(row: list[str]) -> str:
        cells = [c.ljust(w) if k < centred else c.center(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        return "  ".join(cells).rstrip()

    ends = "<- the run ends" if j.ended is None else "<- the last state with all of them"
    marks = {last: "<- violated, no continuation can repair it" if j.failed is not None else ends}
    return [line(head), *(f"{line(row)}   {marks[t]}" if t in marks else line(row) for t, row in zip(ticks, rows, strict=True))]


_CAME = {
    Zone.ENTRANCE: ("arrived", "had arrived"),
    Zone.JUNCTION: ("entered", "had entered"),
    Zone.EXIT: ("was through", "was through"),
    Zone.GONE: ("was gone", "was gone"),
}
"""Per zone, the verb for a vehicle that came to the zone, and the verb for a vehicle that possibly never came to the zone."""


def hangs(run: Run, j: Judgement) -> str:
    """Return in words the uncertain events or measurement on which an UNSURE instance depends, with the accuracy.

    An example is ``a4 arrived at 12.31 s, a7 arrived at 12.34 s: 0.03 s apart, known to 0.05 s``.
    """
    hinge = j.hinge
    if hinge is None:
        return ""
    if hinge.reading:
        who = " and ".join(dict.fromkeys(element.name for _, element in j.template.binding if element.sort == Sort.AGENT))
        return f"it depends on {hinge.reading}" + (f" ({who})" if who else "")
    told = []
    for happening in hinge.what:
        if happening.agent is None:
            what, ended = f"light {happening.light} turned {Colour(happening.code).name.lower()}", ""
        else:
            did, had = _CAME[Zone(happening.code)]
            name = run.agents[happening.agent].name
            what, ended = f"{name} {did}", f"nothing tells whether {name} {had} when its recording ends"
        told.append(ended if happening.time is None else f"{what} at {run.start + happening.time:.2f} s")
    events = ", ".join(told)
    if math.isinf(hinge.known):
        return f"{events}; how long before is not known"
    if hinge.apart is None:
        return f"{events}, known to {hinge.known:.2f} s"
    tie = f", where up to {hinge.tie:.2f} s count as at the same time" if hinge.tie else ""
    return f"{events}: {abs(hinge.apart):.2f} s apart, known to {hinge.known:.2f} s{tie}"


def since(run: Run, j: Judgement) -> float | None:
    """Return the time of the uncertain events, or of the beginning of the obligation, on the clock of the recording [s]."""
    times = [h.time for h in j.hinge.what if h.time is not None] if j.hinge else []
    tick = None if j.trigger is None else j.trigger * run.dt
    time = max(times) if times else tick
    return None if time is None else round(run.start + time, 9)
