"""The display of junctions, scenarios, runs and verdicts in notebooks: self-contained pictures and tables as HTML.

A picture is a separate image within the HTML. So the styles and ids of the picture reach nothing else on the page, nothing in the
picture is executed, and viewers that remove scripts and style elements show the whole picture. An inlined picture would pass its
styles to the page, and viewers that remove styles would show black shapes. The text beside a picture has the colours of the
notebook.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turn_words import turn_word
from pytest_rvads.geometry.yielding import Reason
from pytest_rvads.logic.judging.verdicts import InstanceVerdict, Verdict
from pytest_rvads.report.draw.picture import course, draw_ways, picture, still
from pytest_rvads.report.draw.scene import Scene, body, inks, label
from pytest_rvads.runs.run import ARRAYS, Run
from pytest_rvads.runs.states import Agent, Zone
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import RunError, RvadsError
from pytest_rvads.support.wording import first, markup, one_line, plural

__all__ = ["Picture", "html", "telling"]

_WIDE = 500
"""Width of a picture on a page with enough room [px]."""
_ROWS = 24
"""Most rows of a table; a line below the table states the number of further rows."""
_SHORT = 24
"""Most letters of a cell that is not broken into lines."""
_TRAIL = 3.0
"""Length of the trails of recorded traffic [s]."""
_HITS = 3
"""Most collisions in a line; recorded traffic may have more."""
_MARKS = {"good": ("✓", "#00694d"), "bad": ("✗", "#b3261e"), "doubt": ("!", "#8a5a00"), "none": ("–", "#5f6368")}
"""Sign and colour by mark of an outcome; white letters have a contrast above 5 on every colour."""
_WHEN = {JunctionControl.STOP: " in a tie", JunctionControl.LIGHTS: " on the same green"}
"""Condition of giving way, per control in which signs or lights come first."""
_ZONES = ((Zone.ENTRANCE, "arrives"), (Zone.JUNCTION, "enters"), (Zone.EXIT, "leaves"))


@dataclass(frozen=True, slots=True)
class Picture:
    """An SVG document as an image, which untrusted notebooks show, too; the ``draw_...`` functions return pictures."""

    svg: str
    alt: str = "picture"
    """Text for viewers without pictures."""

    def _repr_html_(self) -> str:
        data = b64encode(self.svg.encode()).decode()
        style = "max-width:100%;height:auto;background:#fff"
        return f'<img width="{_WIDE}" style="{style}" alt="{markup(self.alt)}" src="data:image/svg+xml;base64,{data}">'


def html(value: object) -> str:
    """Return a junction, scenario, run or verdict as HTML; the text of the error if drawing fails, as the notebook goes on."""
    try:
        match value:
            case Junction():
                return _junction(value)
            case Scenario():
                return _scenario(value)
            case Run():
                return _run(value)
            case Verdict():
                return _verdict(value)
    except Exception as error:  # a value that a user built by hand may be invalid
        return _line(f"<{type(value).__name__}> can't be drawn: {type(error).__name__}: {error}")
    return _line(repr(value))


def _junction(junction: Junction) -> str:
    use = "usable" if junction.drivable else "only for judging zones of recorded runs, because its lanes have no geometry"
    where = f"junction {junction.id} of {junction.map}; " if junction.map else ""
    side = "left" if junction.left_hand else "right"
    rows = []
    for entrance, lane in enumerate(junction.entrances):
        ways = sorted((m.exit, turn_word(junction, m)) for m in junction.movements.values() if m.entrance == entrance)
        priors = None
        if junction.yields is not None:
            decided = (pair for pair, reason in junction.yields.items() if reason is not Reason.UNDECIDED)
            priors = sorted({label(junction, prior[0]) for way, prior in decided if way[0] == entrance})
        rows.append(
            (
                label(junction, entrance),
                lane.sign.value,
                f"{junction.approach(entrance):.0f} m" if lane.approach else "not known",
                ", ".join(f"{turn} to {junction.exits[exit].arm}" for exit, turn in ways),
                "not known" if priors is None else ", ".join(priors) or "nobody",
            )
        )
    head = ("entrance", "sign", "approach", "ways to arms", f"gives way{_WHEN.get(junction.control, '')} to")
    return _block(
        _line(junction.name, f"{junction.ways}-way {junction.control}; {where}traffic keeps {side}; {use}"),
        _image(lambda: draw_ways(junction), f"junction {junction.name}"),
        _table(head, rows),
    )


def _scenario(scenario: Scenario) -> str:
    place, agents = scenario.place, scenario.agents()
    try:
        starts = scenario.starts()
    except RvadsError as error:
        starts, fault = tuple(scenario.start(agent.entrance) for agent in agents), str(error)
    else:
        fault = ""
    rows = [
        (
            f"{agent.name} (under test)" if agent.name == scenario.under_test else agent.name,
            _way(place, agent),
            f"{distance:g} m",
            f"{speed:g} m/s",
        )
        for agent, (distance, speed) in zip(agents, starts, strict=True)
    ]
    cls = f"class {scenario.number}" if scenario.number else "no class: not every arm has its vehicle"
    summary = f"{scenario.label} at {place.name}, {cls}; at most {scenario.duration:g} s"
    return _block(
        _line(scenario.name, summary),
        _line(fault) if fault else _image(lambda: _starts(scenario, starts), f"start of {scenario.name}"),
        _table(("vehicle", "way", "to its line", "speed"), rows),
    )


def _starts(scenario: Scenario, starts: Sequence[tuple[float, float]]) -> str:
    """Return a picture of the vehicles at their starts, with the judged part of the way of each vehicle."""
    place, agents = scenario.place, scenario.agents()
    scene = Scene(place)
    size = (Vehicle().length, Vehicle().width)
    ways, bodies, corners = [], [], list[list[float]]()
    for agent, (distance, _), way, ink in zip(agents, starts, scenario.itineraries(), inks(agents), strict=True):
        start = way.start(distance)
        points = np.array([way.pose(float(s)) for s in np.linspace(start, way.leave, 60)])
        ways.append(course(points, ink))
        bodies.append(body(points[0], agent, size, ink))
        corners += points[(0, -1), :2].tolist()
    return still(scene, [scene.lights(scenario.signals().colours(0.0, len(place.entrances))), *ways, *bodies], corners)


def _run(run: Run) -> str:
    tick, reason = telling(run)
    summary = [plural(len(run.agents), "vehicle"), f"{run.duration:.2f} s", *_events(run), *_origin(run)]
    rows = [(agent.name, _way(run.junction, agent), *_passage(run, column)) for column, agent in enumerate(run.agents)]
    title = f"{run.start + tick * run.dt:.2f} s: {reason}"
    hit = {name for collision in run.collisions or () for name in collision.agents}
    return _block(
        _line(run.label, "; ".join(summary)),
        _image(lambda: _instant(run, tick, title, hit), f"{run.label} at {title}"),
        _table(("vehicle", "way", *(word for _, word in _ZONES)), rows),
    )


def _instant(run: Run, tick: int, title: str, hit: Collection[str]) -> str:
    """Return a picture of the state at `tick`; recorded traffic has short trails, because long trails would hide the state."""
    if not run.steps:
        raise RunError(f"run {run.label!r} has no states")
    if run.excerpt is None:
        return picture(run, tick, title, hit)
    span = slice(max(tick - round(_TRAIL / run.dt), 0), tick + 1)
    arrays = {name: getattr(run, name)[span] for name in (*ARRAYS, "spread") if getattr(run, name) is not None}
    excerpt = replace(run, **arrays)
    return picture(excerpt, excerpt.steps - 1, title, hit)


def telling(run: Run) -> tuple[int, str]:
    """Return the tick of the most telling state of a run, and the reason in words.

    The tick is the tick of the first collision or of a fault, else the middle of the first time in which most vehicles are in the
    junction, else the last tick.
    """
    last = max(run.steps - 1, 0)
    if run.collisions:
        hit = run.collisions[0]
        return min(round(hit.time / run.dt), last), f"{hit.agents[0]} and {hit.agents[1]} collide"
    if run.fault:
        return min(round(run.fault.time / run.dt), last), "the run ends by a fault"
    inside = (run.zone == Zone.JUNCTION).sum(axis=1)
    if not inside.any():
        return last, "the last state, nobody was in the junction"
    most = inside == inside.max()
    begin = int(most.argmax())
    end = begin + int((~np.append(most[begin:], False)).argmax())
    return (begin + end - 1) // 2, f"{inside.max()} in the junction"


def _events(run: Run) -> list[str]:
    """Return the collisions of a run, the vehicles that left their routes, and the fault, in words."""
    hits = [f"{c.agents[0]} and {c.agents[1]} collide at {run.start + c.time:.2f} s" for c in run.collisions or ()]
    texts = [first(hits, _HITS)] if hits else ["collisions were not recorded" if run.collisions is None else "no collision"]
    texts += [f"{name} left its route" for name in run.facts.strayed]
    if run.fault:
        texts.append(f"ended at {run.start + run.fault.time:.2f} s by a fault: {run.fault.reason}")
    return texts


def _origin(run: Run) -> list[str]:
    """Return the drivers and the simulator of a run in words, as far as its provenance names them."""
    origin = run.provenance
    names = {name: one_line(str(origin[name])) for name in ("autopilot", "traffic", "simulator") if origin.get(name)}
    among = f" among {names['traffic']}" if "traffic" in names else ""
    driven = [f"driven by {names['autopilot']}{among}"] if "autopilot" in names else []
    return [*driven, f"simulated by {names['simulator']}"] if "simulator" in names else driven


def _passage(run: Run, column: int) -> list[str]:
    """Return the times at which an agent enters its zones; ``by`` marks a zone in which the recording of the agent begins."""
    times = []
    for zone, _ in _ZONES:
        reached = np.flatnonzero(run.zone[:, column] >= zone)
        before = "by " if len(reached) and reached[0] == run.spans[column, 0] else ""
        times.append(f"{before}{run.start + reached[0] * run.dt:.2f} s" if len(reached) else "never")
    return times


def _verdict(verdict: Verdict) -> str:
    outcome = verdict.outcome
    sign, colour = _MARKS[outcome.mark]
    badge = f'<b style="background:{colour};color:#fff;padding:1px 7px;border-radius:4px">{sign} {outcome.value}</b> '
    head = ("about", "verdict", "since", "broken", "margin", "because")
    unfolded = " open" if outcome.mark in ("bad", "doubt") else ""
    text = (
        f'<pre style="overflow-x:auto;white-space:pre;font-family:monospace;line-height:1.35">{markup(verdict.explanation)}</pre>'
    )
    requirement = [f"requirement {verdict.requirement}"] if verdict.requirement else []
    return _block(
        _line(verdict.rule, "; ".join(filter(None, [verdict.title, *requirement])), before=badge),
        _line(verdict.message),
        *(_line(f"note: {note}") for note in verdict.notes),
        _table(head, [_instance(verdict, instance) for instance in verdict.instances]),
        f"<details{unfolded}><summary>explanation</summary>{text}</details>" if verdict.explanation else "",
    )


def _instance(verdict: Verdict, instance: InstanceVerdict) -> tuple[str, ...]:
    def clock(tick: int | None) -> str:
        return "" if tick is None else f"{verdict.start + tick * verdict.dt:.2f} s"

    return (
        ", ".join(f"{variable} = {name}" for variable, name in instance.binding),
        instance.status.value,
        clock(instance.trigger),
        clock(instance.failed),
        "" if instance.margin is None else f"{instance.margin:.2f} s",
        instance.hangs or ", ".join(instance.broken),
    )


def _way(junction: Junction, agent: Agent) -> str:
    return f"{label(junction, agent.entrance)} to {junction.exits[agent.exit].arm}, {turn_word(junction, agent.way)}"


def _block(*parts: str) -> str:
    return f"<div>{''.join(parts)}</div>"


def _line(head: str, body: str = "", before: str = "") -> str:
    """Return a paragraph; its head is bold if a body follows."""
    text = f"<b>{markup(head)}</b>: {markup(body)}" if body else markup(head)
    return f'<p style="margin:4px 0;overflow-wrap:anywhere">{before}{text}</p>'


def _image(draw: Callable[[], str], alt: str) -> str:
    """Return a picture as an image within the page; if the picture can't be drawn, a paragraph with the reason."""
    try:
        return Picture(draw(), alt)._repr_html_()
    except RvadsError as error:
        return _line(f"no picture: {error}")


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts without empty columns; an empty text without rows."""
    if not rows:
        return ""
    shown = [k for k in range(len(head)) if any(row[k] for row in rows)]
    titles = "".join(_cell("th", head[k]) for k in shown)
    lines = ["".join(_cell("td", row[k]) for k in shown) for row in rows[:_ROWS]]
    lower = "".join(f"<tr>{line}</tr>" for line in lines)
    more = _line(f"and {len(rows) - _ROWS} more") if len(rows) > _ROWS else ""
    table = f'<table style="margin:4px 0"><thead><tr>{titles}</tr></thead><tbody>{lower}</tbody></table>'
    return f'<div style="overflow-x:auto">{table}</div>{more}'


def _cell(tag: str, text: str) -> str:
    """Return a cell; a short text is not broken into lines, because a narrow page can be scrolled."""
    wrap = ";white-space:nowrap" if len(text) <= _SHORT else ""
    return f'<{tag} style="text-align:left;vertical-align:top;padding:2px 10px 2px 0{wrap}">{markup(text)}</{tag}>'
