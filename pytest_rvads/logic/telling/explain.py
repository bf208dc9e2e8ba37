"""Turns the judgement of a rule on a run into a verdict with its texts: a message, an explanation, and a cause of failures.

The explanation shows the rule, the vehicles and entrances concerned, the vehicles that have to act, the beginning of their
obligation, its violation, and a table with the last good and the first bad state. For an UNSURE verdict the explanation names the
uncertain event or measurement on which the verdict depends. Vehicles and places have the user's names (a0, entrance 1).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.judging.judgement import ERRORS, Course, Cycle, Judgement, Reason, Scene
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, NearMiss, Status, Verdict
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.rule import Form, Rule, agents_of
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import (
    aside,
    bound_names,
    clock,
    colour_at,
    element_name,
    hangs,
    happened,
    literal,
    origin,
    place,
    position,
    say,
    since,
    turns,
    why,
    zone,
)
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.support.wording import one_line

_OWN: dict[str, str] = {Sort.ENTRANCE: "its entrance", Sort.LIGHT: "its light"}
"""Names of places in the cause of a violation; their numbers are left out, because they differ among rotations of a scenario."""
_WORDS = {Status.FAIL: "fail", Status.OPEN: "open", Status.UNSURE: "unsure", Status.PASS: "pass", Status.NA: "not triggered"}
_KINDS = {
    JunctionControl.STOP: "stop signs at all entrances",
    JunctionControl.LIGHTS: "lights at all entrances",
    JunctionControl.NONE: "no signs or lights",
    JunctionControl.YIELD: "yield or priority signs",
    JunctionControl.PARTIAL: "signs or lights at some entrances only",
}


def tell(judgement: Judgement, run: Run) -> Verdict:
    """Return the verdict on a run, with all its texts."""
    rule, status, scene = judgement.rule, judgement.status, judgement.scene
    worst = scene.instance if scene else None
    doubt = next((j for j in judgement.instances if j.status is status), None) if status is Status.UNSURE else None
    reason = _reason(judgement, run) if doubt is None else hangs(run, doubt)
    time = None
    if worst is not None:
        tick = worst.failed if worst.failed is not None else worst.trigger
        time = None if tick is None else round(run.start + tick * run.dt, 9)
    elif doubt is not None:
        time = since(run, doubt)
    near = None
    if nearest := judgement.nearest:
        near = NearMiss(bound_names(nearest.template), nearest.tick, tuple(map(say, nearest.missing)), nearest.steps)
    numbers = Counter(_WORDS[j.status] for j in judgement.instances)
    counts = {word: numbers[word] for word in _WORDS.values() if numbers[word]}
    instances = tuple(
        InstanceVerdict(
            bound_names(j.template),
            j.status,
            tuple(e.name for e in j.blame.agents),
            j.trigger,
            j.failed,
            tuple(literal(a, v) for a, v in j.broken),
            j.margin,
            hangs(run, j),
        )
        for j in judgement.instances
    )
    violated = [i for i in instances if i.status is status and i.status in (Status.FAIL, Status.OPEN)]
    notes = tuple(_notes(judgement, run))
    lines = _heading(rule)
    total = sum(counts.values())
    counted = f"{total} instance{'s' if total != 1 else ''}: {', '.join(f'{n} {word}' for word, n in counts.items())}"
    if told := worst or doubt:
        who = ", ".join(f"{k}={v}" for k, v in bound_names(told.template))
        lines.append(f"instance  {who}   ({counted})")
        lines += [*_roles(scene, run), *_table(scene, run)] if scene and not told.hinge else [f"unsure    {hangs(run, told)}"]
    else:
        lines += [f"{status.lower():<9} {reason}"] if reason else []
        lines += [f"instances {counted}"] if counts else []
        if near:
            who = ", ".join(f"{k}={v}" for k, v in near.binding)
            lines.append(f"nearest   at {clock(run, near.tick)} s for {who}; false: {', '.join(near.missing)}")
    return Verdict(
        rule.name,
        status,
        _message(judgement, run, reason),
        reason=reason,
        final=status is Status.FAIL,
        time=time,
        counts=counts,
        collapsed=judgement.collapsed,
        instances=instances,
        near=near,
        violated=_violated(judgement, reason),
        roles=_movements(judgement, run),
        asked=judgement.asked,
        unavoidable=judgement.unavoidable,
        notes=notes,
        explanation="\n".join((*lines, *(f"note      {note}" for note in notes))),
        requirement=rule.requirement,
        dt=run.dt,
        start=run.start,
        subject=run.subject,
        provoked=judgement.provoked,
        title=rule.title,
        responsible=tuple(dict.fromkeys(name for i in violated for name in i.responsible)),
    )


def _heading(rule: Rule) -> list[str]:
    lines = [f"rule      {rule.name}  {one_line(rule.title) + ':  ' if rule.title else ''}{rule.text}"]
    return [*lines, f"traces to {one_line(rule.requirement)}"] if rule.requirement else lines


def _reason(judgement: Judgement, run: Run) -> str:
    match judgement.reason:
        case Reason.DAMAGED:
            return judgement.detail
        case Reason.ELSEWHERE:
            return _elsewhere(judgement.rule, run.junction)
        case Reason.NOT_RECORDED:
            return f"not recorded: {judgement.detail}"
        case Reason.EXCLUDED:
            return "no vehicle is in a position that the rule is about: what is static already excludes every instance"
        case Reason.NEVER_TRIGGERED:
            return "never triggered: the premise of the rule never holds on the run"
        case Reason.NOBODY_MOVED:
            return "no vehicle moved, so no vehicle kept the rule by an action"
        case Reason.NOT_ASKED:
            return f"only traffic was asked: no instance that was triggered bound {run.subject}, the subject, to act"
        case Reason.STRAYED:
            who = " and ".join(run.facts.strayed)
            return f"{who} left the route, which ended the run: the rest of the way is not known"
        case Reason.CUT_OFF:
            return "cut off: the run reached its duration before the subject had left the junction"
    return ""


def _elsewhere(rule: Rule, junction: Junction) -> str:
    kind = _KINDS[junction.control]
    if junction.control not in rule.kinds:
        if len(rule.kinds) == 1:
            return f"{rule.name} is about junctions with {_KINDS[rule.kinds[0]]}, and this junction has {kind}"
        return f"{rule.name} is not about junctions with {kind}, such as this junction"
    if rule.crosswalks:
        return f"{rule.name} is about {rule.crosswalks}, and none walk at this junction"
    return f"{rule.name} is about junctions with several lanes on an arm, and this junction has one lane on each"


def _notes(judgement: Judgement, run: Run) -> Iterator[str]:
    """Yield further remarks, in the order in which a reader needs them."""
    scene, cycle = judgement.scene, judgement.cycle
    if cycle:
        yield f"{_cyclic(cycle)} ({' -> '.join((*cycle.agents, cycle.agents[0]))}), so no vehicle may go first"
    if judgement.undecided:
        yield f"the verdict does not depend on {judgement.undecided}"
    if judgement.untied:
        yield f"the tie window of {judgement.tie:g} s decides: without it the verdict would be {judgement.untied}"
    if scene and run.fault:
        yield f"later, at {run.fault.time:.2f} s, the run ended by a fault: {run.fault.reason}"
    if scene and (cause := scene.instance.blame.cause):
        yield f"to blame: {' and '.join(cause.agents)} {cause.reason}"
    for bend in scene.bends if scene else ():
        yield (
            f"no path keeps {bend.vehicle} in its lane through a bend with a radius of {bend.radius:.1f} m, as {bend.vehicle} "
            f"can't steer below {bend.steers:.1f} m: no driver could keep the lane there, but before and behind the bend"
        )
    if judgement.provoked:
        by_traffic = f"provoked by traffic: {run.subject}, the subject, is not to blame"
        yield by_traffic if run.subject else "provoked by pedestrians: no vehicle is to blame"
    if scene and judgement.tolerance is not None:
        margin = scene.instance.margin
        yield f"{f'{margin:.2f} s from PASS; ' if margin is not None and margin > 0.0 else ''}{_definite(judgement.tolerance)}"


def _definite(tolerance: tuple[int, ...]) -> str:
    """Return in words with how large an error of the measurements a violation stays definite."""
    parts = []
    for (noun, unit, errors), held in zip(ERRORS, tolerance, strict=True):
        if held < len(errors):
            limit = f"at {errors[held]:g} {unit} it is in doubt"
            parts.append(
                f"{noun} may be wrong by {errors[held - 1]:g} {unit}, {limit}" if held else f"if {noun} are wrong {limit}"
            )
    most = " and ".join(f"{noun} are wrong by {errors[-1]:g} {unit}" for noun, unit, errors in ERRORS)
    return "; ".join(parts) or f"a violation even if {most}"


def _cyclic(cycle: Cycle) -> str:
    if cycle.alone:
        return f"{len(cycle.agents)} vehicles arrived together and each must wait for the vehicle on its right"
    return f"{len(cycle.agents)} vehicles must each wait for another of the {len(cycle.agents)}"


def _message(judgement: Judgement, run: Run, reason: str) -> str:
    name, status, scene, cycle = judgement.rule.name, judgement.status, judgement.scene, judgement.cycle
    if status in (Status.NA, Status.ERROR):
        return f"{name} {status}: {reason}"
    alike = sum(j.status is status for j in judgement.instances)
    more = f" (the first of {alike} instances)" if alike > 1 else ""
    if status is Status.UNSURE:
        return f"{name} UNSURE: {reason}{more}"
    if scene is None:
        if reason:
            return f"{name} open: {reason}"
        binding = f" that bind {run.subject}" if run.subject else ""
        untriggered = ", the others were not triggered" if judgement.kept < judgement.binding else ""
        return f"{name} PASS: kept in {judgement.kept} of {judgement.binding} instances{binding}{untriggered}"
    worst = scene.instance
    hint = f"; {_cyclic(cycle)}, so no vehicle may go first" if cycle else ""
    hint += "; the bend is too tight for the vehicle" if judgement.unavoidable and not cycle else ""
    hint += f"; provoked by {'traffic' if run.subject else 'pedestrians'}" if judgement.provoked else ""
    if status is Status.FAIL:
        return f"{name} at t={clock(run, worst.failed or 0)} s: {happened(worst)}{more}{hint}"
    shape, began = worst.template.shape, clock(run, worst.trigger or 0)
    if shape.waits is not None and shape.goes is not None:
        wait = f"{say(shape.waits, be='is still')} and waits until {say(shape.goes)}"
    else:
        wait = f"still owed: {say(shape.obligation)}"
    if scene.vanished is not None:
        vehicle, tick = scene.vanished
        return f"{name} open: {wait}, since t={began} s when the recording of {vehicle} ended at {clock(run, tick)} s{more}{hint}"
    end = clock(run, run.steps - 1)
    return f"{name} open: {wait}, since t={began} s when the run ended at {end} s: deadlock, or too short a run{more}{hint}"


def _violated(judgement: Judgement, reason: str) -> str:
    """Return the violated obligation in words that are the same whichever vehicle violates the obligation."""
    if judgement.status is Status.UNSURE:
        return "unsure: another reading of the recording within its accuracy would change the verdict"
    if judgement.scene is None:
        return reason
    if judgement.cycle:
        return f"{_cyclic(judgement.cycle)}, so no vehicle may go first"
    worst = judgement.scene.instance
    variables = {e: name for name, e in worst.template.binding}

    def name(element: f.Element) -> str:
        if element.sort in _OWN:
            return _OWN[element.sort]
        return variables.get(element, "another vehicle" if element.sort == Sort.AGENT else element_name(element))

    shape = worst.template.shape
    if worst.status is Status.OPEN:
        if shape.waits and shape.goes:
            return f"open: {say(shape.waits, name)} until {say(shape.goes, name)}"
        return f"open: {judgement.rule.title or say(shape.obligation, name)}"
    caused_by = [name(e) for e in worst.blame.agents] if worst.blame.cause else []
    # Vehicles that act one step too early and vehicles that act many steps too early belong to the same group of failures.
    return happened(replace(worst, together=False), name) + (f", caused by {' and '.join(caused_by)}" if caused_by else "")


def _movements(judgement: Judgement, run: Run) -> str:
    """Return the movements of the vehicles of the violation, in words that are the same for all rotations of a scenario."""
    if judgement.scene is None or judgement.cycle:
        return ""
    junction, template = run.junction, judgement.scene.instance.template
    agents = [(name, run.agents[e.index]) for name, e in template.binding if e.sort == Sort.AGENT]
    first_arm = junction.starts[agents[0][1].entrance].arm if agents else 0

    def seat(entrance: int) -> str:
        arm, lane = junction.starts[entrance].arm, junction.starts[entrance].lane
        return f"+{(arm - first_arm) % junction.ways}" + (f".{lane}" if len(junction.arms[arm].entrances) > 1 else "")

    def role(agent: Agent) -> str:
        if agent.way.key in junction.movements:
            return f"{turns(junction, agent)} from entrance {seat(agent.entrance)}"
        return f"{aside(agent.way)} of arm {seat(agent.entrance)}"

    roles = ", ".join(f"{name} {role(agent)}" for name, agent in agents)
    return "; ".join(filter(None, (roles, why(run, judgement.scene.debt, seat))))


def _roles(scene: Scene, run: Run) -> list[str]:
    """Return lines of text with the waiting and the awaited vehicles, the beginning of the obligation, and its violation."""
    j, tick, lines = scene.instance, scene.tick, []
    shape = j.template.shape
    if shape.waits is None or shape.goes is None:
        for course in scene.courses:
            e = course.agent
            entered = "" if course.entered is None else f"   entered {clock(run, course.entered)} s"
            fast = f"   v = {run.speed[tick, e.index]:.1f} m/s" if run.speed is not None else ""
            acts = "   <- acts" if e in j.blame.agents else ""
            lines.append(f"vehicle   {e.name} {origin(run.junction, run.agents[e.index])}{entered}{fast}{acts}")
        if reason := why(run, scene.debt):
            lines.append(f"because   {reason}")
        if j.failed is None:
            lines.append(f"open      {say(shape.obligation)}, owed since {clock(run, j.trigger or 0)} s")
        else:
            lasted = f"; broken for {j.margin:.2f} s of the run" if j.margin and shape.premise is not None else ""
            lines.append(f"broken at {clock(run, tick)} s: {happened(j)}{lasted}")
        return lines
    waiting = agents_of(shape.waits)
    going = tuple(e for e in agents_of(shape.goes) if e not in waiting)
    courses = {course.agent: course for course in scene.courses}
    for word, agents in (("yields" if shape.form is Form.YIELD else "must wait", waiting), ("priority", going)):
        lines += [f"{word:<9} {_arrival(run, courses[e], waiting)}" for e in agents]
    stay = say(shape.waits, be="stays")
    lines.append(f"obligation since {clock(run, j.trigger or 0)} s: {stay} until {say(shape.goes)}")
    verb = "broken at" if j.failed is not None else "open at  "
    early = f"; {j.margin:.2f} s too early" if j.margin and j.margin > 0 and j.failed is not None else ""
    early = "; both in the same step" if j.together else early
    lines.append(f"{verb} {clock(run, tick)} s: {_places(run, waiting, going, shape.goes, tick)}{early}")
    return lines


def _arrival(run: Run, course: Course, waiting: tuple[f.Element, ...]) -> str:
    """Return an agent's name, entrance, turn, arrival and wait, and where its entrance lies for the agent that waits for it."""
    e, agent = course.agent, run.agents[course.agent.index]
    entrance = agent.entrance
    text = f"{e.name} @ entrance {entrance}, {turns(run.junction, agent)}"
    if course.arrived is not None:
        text += f"   arrived {clock(run, course.arrived)} s, waited {course.waited * run.dt:.2f} s"
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


def _places(run: Run, waiting: tuple[f.Element, ...], going: tuple[f.Element, ...], goes: f.Formula, tick: int) -> str:
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


def _table(scene: Scene, run: Run) -> list[str]:
    """Return a table of the states in which the obligation began, was last kept, and was broken."""
    j, agents = scene.instance, [course.agent for course in scene.courses]
    head = [" t [s]", *(e.name for e in agents), *map(str, j.template.atoms)]
    rows = [
        [f"{clock(run, t):>6}", *(position(run, e.index, t) for e in agents), *("x" if truth else "." for truth in truths)]
        for t, truths in scene.states
    ]
    widths = [max(len(r[k]) for r in (head, *rows)) for k in range(len(head))]
    centred = 1 + len(agents)

    def line(row: list[str]) -> str:
        cells = [c.ljust(w) if k < centred else c.center(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        return "  ".join(cells).rstrip()

    ends = "<- the run ends" if j.ended is None else "<- the last state with all of them"
    marks = {scene.tick: "<- violated, no continuation can repair it" if j.failed is not None else ends}
    lines = [f"{line(row)}   {marks[t]}" if t in marks else line(row) for (t, _), row in zip(scene.states, rows, strict=True)]
    return [line(head), *lines]
