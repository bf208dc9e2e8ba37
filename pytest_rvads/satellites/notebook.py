"""Displays junctions, scenarios, runs, verdicts, indicators and results in notebooks: self-contained pictures and tables as HTML.

A picture is a separate image within the HTML. So the styles and ids of the picture affect nothing else on the page, nothing in
the picture is executed, and viewers that remove scripts and style elements show the whole picture. An inlined picture would pass
its styles to the page, and viewers that remove styles would show black shapes. The text beside a picture has the colours of the
notebook.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from math import isinf

import numpy as np

from pytest_rvads.geometry.control import JunctionControl
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.precedence import Reason
from pytest_rvads.geometry.turns import turn_word
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.outcome import MARKS
from pytest_rvads.report.outline import Causes, Head, Notes, outline
from pytest_rvads.report.scene import Scene, body, course, draw_ways, inks, label, picture, still
from pytest_rvads.report.session_report import Report
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.measured import Kpis
from pytest_rvads.runs.run import ARRAYS, Run
from pytest_rvads.runs.states import Agent, Vehicle, Zone, crowd
from pytest_rvads.scenarios.pedestrians import Setting
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.support.errors import RunError, RvadsError
from pytest_rvads.support.wording import markup, one_line

_ROWS = 24
"""Largest number of rows of a table; a line below the table states the number of further rows."""
_WHEN = {JunctionControl.STOP: " in a tie", JunctionControl.LIGHTS: " on the same green"}
"""Condition of giving way, per control in which signs or lights come first."""
_ZONES = ((Zone.ENTRANCE, "arrives"), (Zone.JUNCTION, "enters"), (Zone.EXIT, "leaves"))


@dataclass(frozen=True, slots=True)
class Picture:
    """An SVG document as an image, which even untrusted notebooks show; the ``draw_...`` functions return pictures."""

    svg: str
    alt: str = "picture"
    """Text for viewers without pictures."""

    def _repr_html_(self) -> str:
        data = b64encode(self.svg.encode()).decode()
        style = "max-width:100%;height:auto;background:#fff"
        return f'<img width="500" style="{style}" alt="{markup(self.alt)}" src="data:image/svg+xml;base64,{data}">'


def html(value: object) -> str:
    """Return a junction, scenario, run, verdict, list of verdicts, `Kpis` or `Report` as HTML, or the text of the error."""
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
            case list():
                rows = [(v.rule, f"{MARKS[v.outcome.mark][0]} {v.outcome.value}", v.message) for v in value]
                return _html_table(("rule", "verdict", "message"), rows)
            case Kpis():
                return _kpis(value)
            case Report():
                blocks = outline(value)
                lines = [line for block in blocks if isinstance(block, Notes | Head) for line in block.plain()]
                groups = [block for block in blocks if isinstance(block, Causes)]
                causes = [(group.title, str(c.count), c.rule, c.line, group.first(c)) for group in groups for c in group.causes]
                return _block(*map(_paragraph, lines), _html_table(("", "items", "rule", "cause", "first"), causes))
    except Exception as error:  # a value that a user built by hand can be invalid
        return _paragraph(f"<{type(value).__name__}> can't be drawn: {type(error).__name__}: {error}")
    return _paragraph(repr(value))


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
            found = {prior for way, prior in decided if way[0] == entrance}
            priors = sorted({label(junction, prior[0]) for prior in found if prior in junction.movements})
            priors += ["pedestrians"] if any(prior not in junction.movements for prior in found) else []
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
        _paragraph(junction.name, f"{junction.ways}-way {junction.control}; {where}traffic keeps {side}; {use}"),
        _image(lambda: draw_ways(junction.walked), f"junction {junction.name}"),
        _html_table(head, rows),
    )


def _scenario(scenario: Scenario) -> str:
    place, agents = scenario.place, scenario.agents()
    walkers: tuple[Setting, ...] = ()
    try:
        starts, walkers = scenario.starts(), scenario.walkers()
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
    for agent, station, speed, delay, *_ in walkers:
        pace = f"{speed:g} m/s" if speed or isinf(delay) else f"from {delay:.2f} s on"
        rows.append((agent.name, _way(place, agent), f"{-station:.1f} m", pace))
    cls = f"class {scenario.number}" if scenario.number else "no class: not every arm has its vehicle"
    summary = f"{scenario.label} at {place.name}, {cls}; at most {scenario.duration:g} s"
    return _block(
        _paragraph(scenario.name, summary),
        _paragraph(fault) if fault else _image(lambda: _starts(scenario, starts, walkers), f"start of {scenario.name}"),
        _html_table(("agent" if walkers else "vehicle", "way", "to its line", "speed"), rows),
    )


def _starts(scenario: Scenario, starts: Sequence[tuple[float, float]], walkers: Sequence[Setting]) -> str:
    """Return a picture of the agents of a scenario at their starts, with the judged part of the way of each vehicle."""
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
    for setting, ink in zip(walkers, inks([*agents, *(setting.agent for setting in walkers)])[len(agents) :], strict=True):
        pose = np.array(itinerary(place, *setting.agent.way.key).pose(setting.station))
        bodies.append(body(pose, setting.agent, setting.agent.size or size, ink))
    return still(scene, [scene.lights(scenario.signals().colours(0.0, len(place.starts))), *ways, *bodies], corners)


def _run(run: Run) -> str:
    tick, reason = telling(run)
    summary = [crowd(run.agents), f"{run.duration:.2f} s"]
    summary += [f"{c.agents[0]} and {c.agents[1]} collide at {run.start + c.time:.2f} s" for c in run.collisions or ()]
    if not run.collisions:
        summary.append("collisions were not recorded" if run.collisions is None else "no collision")
    summary += [f"{name} left its route" for name in run.facts.strayed]
    if run.fault:
        summary.append(f"ended at {run.start + run.fault.time:.2f} s by a fault: {run.fault.reason}")
    origin = run.provenance
    names = {name: one_line(str(origin[name])) for name in ("autopilot", "traffic", "simulator") if origin.get(name)}
    if "autopilot" in names:
        summary.append(f"driven by {names['autopilot']}" + (f" among {names['traffic']}" if "traffic" in names else ""))
    if "simulator" in names:
        summary.append(f"simulated by {names['simulator']}")
    rows = []
    for column, agent in enumerate(run.agents):
        times = []
        for zone, _ in _ZONES:
            reached = np.flatnonzero(run.zone[:, column] >= zone)
            # ``by`` marks a zone in which the recording of the agent begins.
            before = "by " if len(reached) and reached[0] == run.spans[column, 0] else ""
            times.append(f"{before}{run.start + reached[0] * run.dt:.2f} s" if len(reached) else "never")
        rows.append((agent.name, _way(run.junction, agent), *times))
    title = f"{run.start + tick * run.dt:.2f} s: {reason}"
    hit = {name for collision in run.collisions or () for name in collision.agents}
    return _block(
        _paragraph(run.label, "; ".join(summary)),
        _image(lambda: _instant(run, tick, title, hit), f"{run.label} at {title}"),
        _html_table(("vehicle", "way", *(word for _, word in _ZONES)), rows),
    )


def _instant(run: Run, tick: int, title: str, hit: Collection[str]) -> str:
    """Return a picture of the state of a run at `tick`; recorded traffic has short trails, because long trails hide the state."""
    if not run.steps:
        raise RunError(f"run {run.label!r} has no states")
    if run.excerpt is None:
        return picture(run, tick, title, hit)
    span = slice(max(tick - round(3.0 / run.dt), 0), tick + 1)
    arrays = {name: getattr(run, name)[span] for name in (*ARRAYS, "spread") if getattr(run, name) is not None}
    excerpt = replace(run, **arrays)
    return picture(excerpt, excerpt.steps - 1, title, hit)


def telling(run: Run) -> tuple[int, str]:
    """Return the tick (number) of the state that best represents a run, and the reason for the choice in words.

    The tick is the tick of the first collision; without a collision, the tick of the fault that ended the run; without a fault,
    the middle of the first period with the most vehicles in the junction; and the last tick if no vehicle was in the junction.
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


def _verdict(verdict: Verdict) -> str:
    outcome = verdict.outcome
    sign, colour, _ = MARKS[outcome.mark]
    badge = f'<b style="background:{colour};color:#fff;padding:1px 7px;border-radius:4px">{sign} {outcome.value}</b> '
    head = ("about", "verdict", "since", "broken", "margin", "because")

    def clock(tick: int | None) -> str:
        return "" if tick is None else f"{verdict.start + tick * verdict.dt:.2f} s"

    rows = [
        (
            ", ".join(f"{variable} = {name}" for variable, name in instance.binding),
            instance.status.value,
            clock(instance.trigger),
            clock(instance.failed),
            "" if instance.margin is None else f"{instance.margin:.2f} s",
            instance.hangs or ", ".join(instance.broken),
        )
        for instance in verdict.instances
    ]
    unfolded = " open" if outcome.mark in ("bad", "doubt") else ""
    text = (
        f'<pre style="overflow-x:auto;white-space:pre;font-family:monospace;line-height:1.35">{markup(verdict.explanation)}</pre>'
    )
    requirement = [f"requirement {verdict.requirement}"] if verdict.requirement else []
    return _block(
        _paragraph(verdict.rule, "; ".join(filter(None, [verdict.title, *requirement])), before=badge),
        _paragraph(verdict.message),
        *(_paragraph(f"note: {note}") for note in verdict.notes),
        _html_table(head, rows),
        f"<details{unfolded}><summary>explanation</summary>{text}</details>" if verdict.explanation else "",
    )


def _kpis(kpis: Kpis) -> str:
    def number(value: float | None, unit: str) -> str:
        return "" if value is None else f"{value:.2f} {unit}"

    vehicles = [
        (
            v.agent,
            *(number(time, "s") for time in (v.arrival, v.waiting, v.delay)),
            number(v.deceleration, "m/s²"),
            number(v.jerk, "m/s³"),
        )
        for v in kpis.vehicles
    ]
    pairs = [(", ".join(pair.agents), number(pair.ttc, "s"), number(pair.pet, "s")) for pair in kpis.pairs]
    return _block(
        _html_table(("vehicle", "arrives", "waits", "delay", "braking", "jerk"), vehicles),
        _html_table(("vehicles", "time to collision", "post-encroachment time"), pairs),
        _paragraph("not recorded", ", ".join(kpis.unavailable)) if kpis.unavailable else "",
    )


def _way(junction: Junction, agent: Agent) -> str:
    if agent.way.key not in junction.movements:
        return f"{agent.way.kind} of arm {junction.starts[agent.entrance].arm}"
    return f"{label(junction, agent.entrance)} to {junction.exits[agent.exit].arm}, {turn_word(junction, agent.way)}"


def _block(*parts: str) -> str:
    return f"<div>{''.join(parts)}</div>"


def _paragraph(head: str, body: str = "", before: str = "") -> str:
    """Return an HTML paragraph with a head and a body; the head is bold if the paragraph has a body."""
    text = f"<b>{markup(head)}</b>: {markup(body)}" if body else markup(head)
    return f'<p style="margin:4px 0;overflow-wrap:anywhere">{before}{text}</p>'


def _image(draw: Callable[[], str], alt: str) -> str:
    """Return a picture as an image within the page; if the picture can't be drawn, a paragraph with the reason."""
    try:
        return Picture(draw(), alt)._repr_html_()
    except RvadsError as error:
        return _paragraph(f"no picture: {error}")


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table of texts without empty columns; an empty text without rows."""

    def cell(tag: str, text: str) -> str:
        # A short text is not broken into lines, because a narrow page can be scrolled.
        wrap = ";white-space:nowrap" if len(text) <= 24 else ""
        return f'<{tag} style="text-align:left;vertical-align:top;padding:2px 10px 2px 0{wrap}">{markup(text)}</{tag}>'

    if not rows:
        return ""
    shown = [k for k in range(len(head)) if any(row[k] for row in rows)]
    titles = "".join(cell("th", head[k]) for k in shown)
    lines = ["".join(cell("td", row[k]) for k in shown) for row in rows[:_ROWS]]
    lower = "".join(f"<tr>{line}</tr>" for line in lines)
    more = _paragraph(f"and {len(rows) - _ROWS} more") if len(rows) > _ROWS else ""
    table = f'<table style="margin:4px 0"><thead><tr>{titles}</tr></thead><tbody>{lower}</tbody></table>'
    return f'<div style="overflow-x:auto">{table}</div>{more}'
