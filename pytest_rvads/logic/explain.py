"""From judgements to verdicts people can act on: one line, a block, and a cause that groups failures.

The block shows the rule, the instance, who has to act and since when, where it broke, and the last good and the first
bad state side by side. Names are the user's (a0, entrance 1), never generated ones.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pytest_rvads.logic import formula as f
from pytest_rvads.logic.boolean import evaluate
from pytest_rvads.logic.cycle import Cycle
from pytest_rvads.logic.evaluate import Values
from pytest_rvads.logic.judge import Judgement
from pytest_rvads.logic.phrase import Naming, clock, colour_at, element_name, literal, place, position, say, zone
from pytest_rvads.logic.prepare import Template
from pytest_rvads.logic.rules import Rule
from pytest_rvads.logic.shape import Kind, agents_of
from pytest_rvads.logic.sorts import Sort
from pytest_rvads.logic.verdicts import InstanceVerdict, NearMiss, Status, Verdict
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Zone

__all__ = ["Story", "tell"]

_ORDER = (Status.FAIL, Status.OPEN, Status.PASS, Status.NA)
_WORDS = {Status.FAIL: "fail", Status.OPEN: "open", Status.PASS: "pass", Status.NA: "not triggered"}


@dataclass(slots=True)
class Story:
    """Everything there is to tell about a rule on a run."""

    rule: Rule
    run: Run
    status: Status
    found: tuple[Judgement, ...] = ()
    values: Values | None = None
    reason: str = ""
    collapsed: int = 0
    tie: float = 0.0
    cycle: Cycle | None = None
    near: tuple[Template, int, tuple[f.Formula, ...], int] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def counts(self) -> dict[str, int]:
        """Instances by outcome."""
        found = Counter(_WORDS[j.status] for j in self.found)
        return {word: found[word] for word in _WORDS.values() if found[word]}

    def ordered(self) -> list[Judgement]:
        """Return the worst instances first, the earliest of them first."""

        def key(j: Judgement) -> tuple[int, int]:
            tick = j.failed if j.failed is not None else j.trigger
            return _ORDER.index(j.status), self.run.steps if tick is None else tick

        return sorted(self.found, key=key)


def tell(story: Story) -> Verdict:
    """Return the verdict of a story."""
    run, rule = story.run, story.rule
    ordered = story.ordered()
    worst = ordered[0] if ordered and story.status in (Status.FAIL, Status.OPEN) else None
    if story.cycle:
        around = " -> ".join((*story.cycle.agents, story.cycle.agents[0]))
        story.notes.insert(0, f"{_cyclic(story)} ({around}): each has to wait for the next, so no continuation could pass")
    near = story.near
    miss = None
    if near:
        missing = tuple(say(p) for p in near[2])
        miss = NearMiss(_names(near[0]), near[1], missing, near[3])
    time = None
    if worst is not None:
        tick = worst.failed if worst.failed is not None else worst.trigger
        time = None if tick is None else round(tick * run.dt, 9)
    return Verdict(
        rule.name,
        story.status,
        _message(story, worst),
        reason=story.reason,
        final=story.status is Status.FAIL,
        time=time,
        counts=story.counts,
        collapsed=story.collapsed,
        instances=tuple(_instance(j) for j in ordered),
        near=miss,
        cause=_cause(story, worst),
        notes=tuple(story.notes),
        explanation="\n".join(_block(story, worst, miss)),
        requirement=rule.requirement,
        dt=run.dt,
    )


def _cyclic(story: Story) -> str:
    what = "right-of relation" if story.cycle and story.cycle.alone else "order"
    return f"the {what} of the arrivals is a cycle"


def _names(template: Template) -> tuple[tuple[str, str], ...]:
    return tuple((name, element_name(e)) for name, e in template.binding)


def _instance(j: Judgement) -> InstanceVerdict:
    return InstanceVerdict(
        _names(j.template),
        j.status,
        tuple(e.name for e in _responsible(j)),
        j.trigger,
        j.failed,
        tuple(literal(a, v) for a, v in j.broken),
        j.margin,
    )


def _responsible(j: Judgement) -> tuple[f.Element, ...]:
    """Return the vehicles bound to act: those whose doing broke the instance, or that still have to wait."""
    if j.status is Status.FAIL:
        named = tuple(dict.fromkeys(e for a, _ in j.broken for e in agents_of(a)))
        return named or agents_of(j.template.formula)
    if j.status is Status.OPEN:
        waits = j.template.shape.waits
        return agents_of(waits if waits is not None else j.template.shape.obligation)
    return ()


def _message(story: Story, worst: Judgement | None) -> str:
    name, run, status = story.rule.name, story.run, story.status
    if status in (Status.NA, Status.ERROR):
        return f"{name} {status}: {story.reason}"
    if worst is None:
        asked = sum(n for word, n in story.counts.items() if word != "not triggered")
        total = sum(story.counts.values())
        rest = ", the others were not triggered" if asked < total else ""
        return f"{name} PASS: kept in {asked} of {total} instances{rest}"
    fails = sum(j.status is status for j in story.found)
    more = f" (the first of {fails} instances)" if fails > 1 else ""
    hint = f"; {_cyclic(story)}, no continuation could pass" if story.cycle else ""
    if status is Status.FAIL:
        return f"{name} at t={clock(run, worst.failed or 0)} s: {_what(worst)}{more}{hint}"
    shape = worst.template.shape
    since = clock(run, worst.trigger or 0)
    end = clock(run, run.steps - 1)
    if shape.waits is not None and shape.goes is not None:
        wait = f"{say(shape.waits, be='is still')} and waits until {say(shape.goes)}"
    else:
        wait = f"still owed: {say(shape.obligation)}"
    return f"{name} open: {wait}, since t={since} s when the run ended at {end} s: deadlock, or too short a run{more}{hint}"


def _what(j: Judgement, name: Naming = element_name) -> str:
    """Say what happened in the failing tick."""
    shape, broken = j.template.shape, dict(j.broken)
    match shape.waits:
        case f.Atom("@", (f.Element() as agent, f.Element() as entrance)) if shape.goes and broken.get(shape.waits) is False:
            goes = say(shape.goes, name, "was")
            if j.together:
                return f"{name(agent)} left {name(entrance)} in the first step in which {goes}, not after it"
            return f"{name(agent)} left {name(entrance)} before {goes}"
        case f.Not(f.Atom("@", (f.Element() as agent, _)) as entered) if shape.goes and broken.get(entered) is True:
            return f"{name(agent)} entered the junction before {say(shape.goes, name, 'was')}"
    parts = j.template.atoms
    inside = [
        a.terms[0] for a in parts if a.name == "@" and isinstance(a.terms[1], f.Element) and a.terms[1].sort is Sort.JUNCTION
    ]
    if shape.kind is Kind.STATE and len(inside) == len(parts) == 2:
        return f"{', '.join(name(e) for e in inside if isinstance(e, f.Element))} both in junction"
    return ", ".join(literal(a, v, name) for a, v in j.broken)


def _cause(story: Story, worst: Judgement | None) -> str:
    """Return what was violated in words that are the same for all rotations of a scenario."""
    if worst is None:
        return story.reason
    template, run = worst.template, story.run
    variables = {e: name for name, e in template.binding}
    agents = [(name, run.agents[e.index]) for name, e in template.binding if e.sort is Sort.AGENT]
    first = agents[0][1].entrance if agents else 0
    roles = ", ".join(f"{name} {a.turn} from entrance +{(a.entrance - first) % run.junction.ways}" for name, a in agents)

    def name(element: f.Element) -> str:
        return variables.get(element, element_name(element))

    shape = template.shape
    if worst.status is Status.OPEN:
        owed = f"{say(shape.waits, name)} until {say(shape.goes, name)}" if shape.waits and shape.goes else str(shape.obligation)
        return f"open: {owed} ({roles})"
    return f"{_what(worst, name)} ({roles})"


def _block(story: Story, worst: Judgement | None, miss: NearMiss | None) -> list[str]:
    """Return the lines of the explanation."""
    rule, run = story.rule, story.run
    lines = [f"rule      {rule.name}  {rule.title + ':  ' if rule.title else ''}{rule.text}"]
    if rule.requirement:
        lines.append(f"traces to {rule.requirement}")
    if worst is None:
        if story.reason:
            lines.append(f"{story.status.lower():<9} {story.reason}")
        if story.counts:
            lines.append(f"instances {_count(story)}")
        if miss:
            who = ", ".join(f"{k}={v}" for k, v in miss.binding)
            lines.append(f"nearest   at {clock(run, miss.tick)} s for {who}; false: {', '.join(miss.missing)}")
        return lines + [f"note      {note}" for note in story.notes]
    who = ", ".join(f"{k}={v}" for k, v in _names(worst.template))
    lines.append(f"instance  {who}   ({_count(story)})")
    lines += _roles(story, worst)
    lines += _table(run, worst, story.values)
    return lines + [f"note      {note}" for note in story.notes]


def _count(story: Story) -> str:
    total = sum(story.counts.values())
    return f"{total} instance{'s' if total != 1 else ''}: " + ", ".join(f"{n} {word}" for word, n in story.counts.items())


def _roles(story: Story, j: Judgement) -> list[str]:
    """Return who yields to whom, since when, and where it broke."""
    run, shape = story.run, j.template.shape
    tick = j.failed if j.failed is not None else run.steps - 1
    lines = []
    if shape.waits is None or shape.goes is None:
        for e in agents_of(j.template.formula):
            inside = np.flatnonzero(run.zone[: tick + 1, e.index] == Zone.JUNCTION)
            entered = f"   entered {clock(run, int(inside[0]))} s" if len(inside) else ""
            agent = run.agents[e.index]
            blame = "   <- acts" if e in _responsible(j) else ""
            lines.append(f"vehicle   {e.name} from entrance {agent.entrance}, {agent.turn}{entered}{blame}")
        if j.failed is None:
            lines.append(f"open      {say(shape.obligation)}, owed since {clock(run, j.trigger or 0)} s")
        else:
            lines.append(f"broken at {clock(run, tick)} s: {_what(j)}{_overlap(j)}")
        return lines
    waiting, going = agents_of(shape.waits), agents_of(shape.goes)
    for word, agents in (("yields" if shape.kind is Kind.YIELD else "holds", waiting), ("priority", going)):
        lines += [f"{word:<9} {_arrival(run, e, tick)}{_relation(run, e, waiting) if e in going else ''}" for e in agents]
    stay = say(shape.waits, be="stays")
    lines.append(f"obligation since {clock(run, j.trigger or 0)} s: {stay} until {say(shape.goes)}")
    verb = "broken at" if j.failed is not None else "open at  "
    lines.append(f"{verb} {clock(run, tick)} s: {_scene(run, waiting, going, shape.goes, tick)}{_early(j)}")
    return lines


def _overlap(j: Judgement) -> str:
    return f"; {j.margin:.2f} s in all" if j.margin else ""


def _early(j: Judgement) -> str:
    return f"; {j.margin:.2f} s too early" if j.margin and j.margin > 0 and j.failed is not None else ""


def _arrival(run: Run, e: f.Element, tick: int) -> str:
    """Return an agent with its entrance, turn, arrival and waiting time up to `tick`."""
    agent = run.agents[e.index]
    here = np.flatnonzero(run.zone[: tick + 1, e.index] == Zone.ENTRANCE)
    text = f"{e.name} @ entrance {agent.entrance}, {agent.turn}"
    if len(here):
        last = int(here[-1])
        away = np.flatnonzero(run.zone[:last, e.index] != Zone.ENTRANCE)
        arrived = int(away[-1]) + 1 if len(away) else 0
        text += f"   arrived {clock(run, arrived)} s, waited {int(run.wt[last, e.index]) * run.dt:.2f} s"
    return text


def _relation(run: Run, e: f.Element, others: tuple[f.Element, ...]) -> str:
    """Return how the entrance of an agent lies to that of the one that waits for it."""
    if len(others) != 1:
        return ""
    here, there = run.agents[e.index].entrance, run.agents[others[0].index].entrance
    for word, pairs in (("right of", run.junction.right_of), ("opposite", run.junction.opposite)):
        if (here, there) in pairs:
            return f"   entrance {here} is {word} {there}"
    return f"   entrance {there} is right of {here}" if (there, here) in run.junction.right_of else ""


def _scene(run: Run, waiting: tuple[f.Element, ...], going: tuple[f.Element, ...], goes: f.Formula, tick: int) -> str:
    """Return where everybody is in a tick."""

    def one(e: f.Element, still: bool) -> str:
        where = zone(run.agents[e.index], Zone(int(run.zone[tick, e.index])))
        at = "in the junction" if where == "junction" else f"on the {where}" if where == "approach" else f"at {where}"
        detail = [] if run.station is None else [f"{run.station[tick, e.index]:.2f} m"]
        if still and run.speed is not None:
            detail.append(f"v = {run.speed[tick, e.index]:.1f} m/s")
        return f"{e.name} {'is still ' if still and where.startswith('entrance') else 'is ' if still else ''}{at}" + (
            f" ({', '.join(detail)})" if detail else ""
        )

    left = ", ".join(one(e, False) for e in waiting)
    right = ", ".join(one(e, True) for e in going)
    lights = dict.fromkeys(
        t.of
        for a in f.atoms(goes)
        for t in a.terms
        if isinstance(t, f.Attr) and isinstance(t.of, f.Element) and t.of.sort is Sort.LIGHT
    )
    seen = [f"{place(e)} is {colour_at(run, e.index, tick)}" for e in lights if isinstance(e, f.Element)]
    return " while ".join(filter(None, (left, ", ".join(filter(None, (right, *seen))))))


def _table(run: Run, j: Judgement, values: Values | None) -> list[str]:
    """Return the states in which the obligation began, was last kept, and broke, side by side."""
    if values is None:
        return []
    last = j.failed if j.failed is not None else run.steps - 1
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

    marks = {last: "<- violated, no continuation can repair it" if j.failed is not None else "<- the run ends"}
    return [line(head), *(f"{line(row)}   {marks[t]}" if t in marks else line(row) for t, row in zip(ticks, rows, strict=True))]
