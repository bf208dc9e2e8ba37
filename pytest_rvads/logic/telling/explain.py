"""Turns the judgement of a run into a verdict with its texts: a message, an explanation, and a cause that groups failures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pytest_rvads.logic.conduct.lane import too_tight
from pytest_rvads.logic.conduct.static_model import last_seen
from pytest_rvads.logic.judging.attribution import Cycle, cause_between, responsible
from pytest_rvads.logic.judging.instances import columns
from pytest_rvads.logic.judging.judgement import Judgement
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, NearMiss, Status, Verdict
from pytest_rvads.logic.ltl import formula as f
from pytest_rvads.logic.rules.lexicon import word_of
from pytest_rvads.logic.rules.vocabulary import Sort
from pytest_rvads.logic.telling.phrase import aside, clock, element_name, literal, say, turns, why
from pytest_rvads.logic.telling.story import Story, block, bound_names, hangs, happened, since
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent

_OWN: dict[str, str] = {Sort.ENTRANCE: "its entrance", Sort.LIGHT: "its light"}
"""Names of places in the cause of a violation; their numbers are left out, because they differ among rotations of a scenario."""


def tell(story: Story) -> Verdict:
    """Return the verdict on a run, with all its texts, made of a story, which holds the judgement of the run."""
    run, rule = story.run, story.rule
    ordered = story.ordered()
    worst = ordered[0] if ordered and story.status in (Status.FAIL, Status.OPEN) and not story.reason else None
    doubt = next((j for j in ordered if j.status is Status.UNSURE), None) if story.status is Status.UNSURE else None
    if doubt is not None:
        story.reason = hangs(run, doubt)
    if story.cycle:
        around = " -> ".join((*story.cycle.agents, story.cycle.agents[0]))
        story.notes.insert(0, f"{_cyclic(story.cycle)} ({around}), so no vehicle may go first")
    cause = worst and cause_between(worst, run)
    if cause:
        story.notes.append(f"to blame: {' and '.join(cause.agents)} {cause.reason}")
    story.notes += _bends(worst, run)
    if story.provoked:
        by_traffic = f"provoked by traffic: {run.subject}, the subject, is not to blame"
        story.notes.append(by_traffic if run.subject else "provoked by pedestrians: no vehicle is to blame")
    if story.tolerance and worst is not None:
        seconds = f"{worst.margin:.2f} s from PASS; " if worst.margin is not None and worst.margin > 0.0 else ""
        story.notes.append(f"{seconds}{story.tolerance}")
    miss = None
    if near := story.near:
        missing = tuple(say(p) for p in near[2])
        miss = NearMiss(bound_names(near[0]), near[1], missing, near[3])
    time = None
    if worst is not None:
        tick = worst.failed if worst.failed is not None else worst.trigger
        time = None if tick is None else round(run.start + tick * run.dt, 9)
    elif doubt is not None:
        time = since(run, doubt)
    instances = tuple(
        InstanceVerdict(
            bound_names(j.template),
            j.status,
            tuple(e.name for e in responsible(j, run)),
            j.trigger,
            j.failed,
            tuple(literal(a, v) for a, v in j.broken),
            j.margin,
            hangs(run, j),
        )
        for j in ordered
    )
    violated = [i for i in instances if i.status is story.status and i.status in (Status.FAIL, Status.OPEN)]
    return Verdict(
        rule.name,
        story.status,
        _message(story, worst),
        reason=story.reason,
        final=story.status is Status.FAIL,
        time=time,
        counts=story.counts,
        collapsed=story.collapsed,
        instances=instances,
        near=miss,
        violated=_violated(story, worst),
        roles=_roles(story, worst),
        asked=story.asked,
        unavoidable=story.unavoidable,
        notes=tuple(story.notes),
        explanation="\n".join(block(story, worst or doubt, miss)),
        requirement=rule.requirement,
        dt=run.dt,
        start=run.start,
        subject=run.subject,
        provoked=story.provoked,
        title=rule.title,
        responsible=tuple(dict.fromkeys(name for i in violated for name in i.responsible)),
    )


def _bends(worst: Judgement | None, run: Run) -> Iterator[str]:
    """Yield a sentence per vehicle to blame that left its lane or hit another vehicle in a bend too tight for the vehicle."""
    words = [word_of(atom) for atom, _ in worst.broken] if worst is not None else []
    if worst is None or not any(word is not None and word.bend for word in words):
        return
    for name, bend in ((e.name, too_tight(run, e.index)) for e in responsible(worst, run)):
        if bend is not None:
            yield (
                f"no path keeps {name} in its lane through a bend with a radius of {bend[0].radius:.1f} m, as {name} can't steer "
                f"below {bend[1]:.1f} m: no driver could keep the lane there, but before and behind the bend"
            )


def _cyclic(cycle: Cycle) -> str:
    if cycle.alone:
        return f"{len(cycle.agents)} vehicles arrived together and each must wait for the vehicle on its right"
    return f"{len(cycle.agents)} vehicles must each wait for another of the {len(cycle.agents)}"


def _message(story: Story, worst: Judgement | None) -> str:
    name, run, status = story.rule.name, story.run, story.status
    if status in (Status.NA, Status.ERROR):
        return f"{name} {status}: {story.reason}"
    if status is Status.UNSURE:
        doubts = sum(j.status is status for j in story.judgements)
        return f"{name} UNSURE: {story.reason}" + (f" (the first of {doubts} instances)" if doubts > 1 else "")
    if status is Status.OPEN and story.reason:
        return f"{name} open: {story.reason}"
    if worst is None:
        kept_count, total = story.kept()
        binding = f" that bind {run.subject}" if run.subject else ""
        untriggered = ", the others were not triggered" if kept_count < total else ""
        return f"{name} PASS: kept in {kept_count} of {total} instances{binding}{untriggered}"
    fails = sum(j.status is status for j in story.judgements)
    more = f" (the first of {fails} instances)" if fails > 1 else ""
    hint = f"; {_cyclic(story.cycle)}, so no vehicle may go first" if story.cycle else ""
    hint += "; the bend is too tight for the vehicle" if story.unavoidable and not story.cycle else ""
    hint += f"; provoked by {'traffic' if run.subject else 'pedestrians'}" if story.provoked else ""
    if status is Status.FAIL:
        return f"{name} at t={clock(run, worst.failed or 0)} s: {happened(worst)}{more}{hint}"
    shape = worst.template.shape
    since = clock(run, worst.trigger or 0)
    end = clock(run, run.steps - 1)
    if shape.waits is not None and shape.goes is not None:
        wait = f"{say(shape.waits, be='is still')} and waits until {say(shape.goes)}"
    else:
        wait = f"still owed: {say(shape.obligation)}"
    if (absent := last_seen(run, columns(worst.template))) is not None:
        vehicle, tick = absent
        return f"{name} open: {wait}, since t={since} s when the recording of {vehicle} ended at {clock(run, tick)} s{more}{hint}"
    return f"{name} open: {wait}, since t={since} s when the run ended at {end} s: deadlock, or too short a run{more}{hint}"


def _violated(story: Story, worst: Judgement | None) -> str:
    """Return the violated obligation in words that are the same whichever vehicle violates the obligation."""
    if story.status is Status.UNSURE:
        return "unsure: another reading of the recording within its accuracy would change the verdict"
    if worst is None:
        return story.reason
    if story.cycle:
        return f"{_cyclic(story.cycle)}, so no vehicle may go first"
    variables = {e: name for name, e in worst.template.binding}

    def name(element: f.Element) -> str:
        if element.sort in _OWN:
            return _OWN[element.sort]
        return variables.get(element, "another vehicle" if element.sort == Sort.AGENT else element_name(element))

    shape, run = worst.template.shape, story.run
    if worst.status is Status.OPEN:
        if shape.waits and shape.goes:
            return f"open: {say(shape.waits, name)} until {say(shape.goes, name)}"
        return f"open: {story.rule.title or say(shape.obligation, name)}"
    by = cause_between(worst, run)
    blame = [name(e) for e in responsible(worst, run)] if by else []
    # Vehicles that act one step too early and vehicles that act many steps too early belong to the same group of failures.
    return happened(replace(worst, together=False), name) + (f", caused by {' and '.join(blame)}" if blame else "")


def _roles(story: Story, worst: Judgement | None) -> str:
    """Return the movements of the vehicles of the violation, in words that are the same for all rotations of a scenario."""
    if worst is None or story.cycle:
        return ""
    run, junction = story.run, story.run.junction
    agents = [(name, run.agents[e.index]) for name, e in worst.template.binding if e.sort == Sort.AGENT]
    first_arm = junction.starts[agents[0][1].entrance].arm if agents else 0

    def seat(entrance: int) -> str:
        arm, lane = junction.starts[entrance].arm, junction.starts[entrance].lane
        return f"+{(arm - first_arm) % junction.ways}" + (f".{lane}" if len(junction.arms[arm].entrances) > 1 else "")

    def role(agent: Agent) -> str:
        if agent.way.key in junction.movements:
            return f"{turns(junction, agent)} from entrance {seat(agent.entrance)}"
        return f"{aside(agent.way)} of arm {seat(agent.entrance)}"

    roles = ", ".join(f"{name} {role(agent)}" for name, agent in agents)
    return "; ".join(filter(None, (roles, why(run, worst.template.atoms, seat))))
