"""Makes replay pages: a self-contained HTML page to play, scrub and zoom a run, follow a vehicle, and jump to events.

The page of a failure also shows timelines (the states of the monitors of the rule along the run). A page can show an earlier run
of the same scenario, drawn faintly below the run, and the first difference of the two runs.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing, Parking, Side
from pytest_rvads.logic.conduct.blocks import tick_of
from pytest_rvads.logic.conduct.bodies import contacts
from pytest_rvads.logic.conduct.static_model import extract, without_jumps
from pytest_rvads.logic.judging.instances import prepare
from pytest_rvads.logic.judging.judge import Values, walk
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.outcome import MARKS, Outcome
from pytest_rvads.logic.rules.book import get_rule
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.logic.telling.phrase import bound_names
from pytest_rvads.report.failures import TROUBLE, Beside, Page, moment, opening, troubles
from pytest_rvads.report.scene import STYLE, Scene, body, inks, label, placed, size
from pytest_rvads.report.svg import Points
from pytest_rvads.runs.run import ARRAYS, Collision, Run, diverge
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.pages.page import webpage
from pytest_rvads.support.errors import FormulaError, RunError
from pytest_rvads.support.wording import markup

_SEEN = 0.1
"""Two runs differ visibly if the positions of a vehicle in the two runs are this far apart [m]."""
_EVERY = 5
"""Number of states per stored position; the page interpolates positions in straight lines, and zones and lights are exact."""
_TRAIL = 3.0
"""Length of the trails of recorded traffic [s]; longer trails of many vehicles hide the events."""
_LEAD = 1.5
"""The first view shows the way of responsible vehicles during this time before the instant of the view [s]."""
_BEFORE, _AFTER = 30.0, 10.0
"""A page shows this much recorded traffic before and after an instant [s]; minutes of dense traffic would fill megabytes."""
_NEAR, _AROUND = 10.0, 3.0
"""Distance from the junction within which vehicles are in the first view, and margin of the first view [m]."""


@dataclass(frozen=True, slots=True)
class Track:
    """The states of a rule's monitor along a run; the monitor watches the rule for certain vehicles and entrances."""

    label: str
    changes: tuple[tuple[int, str], ...]
    """Pairs of tick and new state of the monitor.

    The states are ``watching`` (no obligation is due, every verdict is possible), ``due`` (an obligation is due), ``violated``
    and ``satisfied`` (both final, whatever happens later). The LTL3 verdicts of the four states are ?, ?, F and T.
    """
    binding: tuple[tuple[str, str], ...] = ()
    """Variables of the rule, and the names of the elements that the variables stand for."""

    @property
    def moved(self) -> bool:
        """Whether the monitor was in a state other than ``watching`` at any tick of the run."""
        return len(self.changes) > 1 or self.changes[0][1] != "watching"


def replay(
    run: Run,
    title: str,
    notes: str = "",
    marked: Iterable[tuple[float, str]] = (),
    tracks: Iterable[Track] = (),
    responsible: Collection[str] = (),
    opened: float | None = None,
    beside: Beside | None = None,
) -> str:
    """Return an HTML page that replays `run`, state by state.

    `marked` are highlighted further events (time [s], text), such as a violation. The page opens at the time `opened` [s], and
    all rows over time have a mark at the event of `marked` with this time. By default the page opens at the first event of
    `marked`, or at `opening` if nothing is marked, and the rows have a mark at every event of `marked`. Times are on the clock of
    the recording of which the run is an excerpt. Ticks count from the start of the run.
    """
    if run.pose is None or run.station is None or run.speed is None:
        raise RunError(f"run {run.label!r} holds no positions, so there is nothing to replay")
    if not run.steps:
        raise RunError(f"run {run.label!r} has no states, so there is nothing to replay")
    scene = Scene(run.junction)
    left, top, wide, high = scene.view
    colours = inks(run.agents)
    trails = "".join(f'<polyline class="trail" stroke="{colour}"/>' for colour in colours)
    bodies = "".join(
        body(np.nan_to_num(run.pose[run.spans[i, 0], i]), agent, size(run, i), colours[i], agent.name in responsible)
        for i, agent in enumerate(run.agents)
    )
    highlights, beside = sorted(marked), beside or Beside()
    times = [time for time, _ in highlights if opened in (None, time)]
    if opened is None:
        opened = times[0] if times else opening(run)
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    impacts = sorted((tick_of(run, c), [columns[name] for name in c.agents if name in columns]) for c in _collisions(run))
    data = {
        "dt": run.dt,
        "start": run.start,
        "opened": opened,
        "steps": run.steps,
        "every": _EVERY,
        "trail": None if run.excerpt is None else max(round(_TRAIL / run.dt / _EVERY), 1),
        "lengths": [size(run, i)[0] for i in range(len(run.agents))],
        "agents": [a.name for a in run.agents],
        "kinds": [a.kind for a in run.agents],
        "inks": colours,
        "motion": _motion(run, run.zone != Zone.ABSENT, run.pose, run.station, run.speed),
        "zones": [changes(run.zone[:, i]) for i in range(len(run.agents))],
        "entrances": _light_names(run),
        "lights": [changes(run.lights[:, e]) for e in range(run.lights.shape[1])],
        "tracks": [(track.label, track.changes) for track in tracks],
        "responsible": [a.name for a in run.agents if a.name in responsible],
        "marked": times,
        "events": sorted([*((*event, False) for event in events(run)), *((*event, True) for event in highlights)]),
        "impacts": impacts,
        "watched": run.collisions is not None,
        "home": _home(run, scene, opened, responsible),
        "reach": max(wide, high),
        "facts": beside.facts,
        "others": beside.others,
        "marks": {outcome: (outcome.mark, MARKS[outcome.mark][0]) for outcome in Outcome},
        "back": beside.back,
        "ghost": None if beside.ghost is None else _ghost_data(run, beside.ghost, beside.ghost_name or "the earlier run"),
    }
    parts = []
    for table, lines in groupby(notes.split("\n"), key=lambda line: line.startswith(" ")):
        text = markup("\n".join(lines))
        # The lines of a table scroll together, so that columns stay columns.
        parts.append(f'<span class="table" tabindex="0">{text}</span>' if table else text)
    return webpage(
        "replay.html",
        title,
        data,
        ("replay.css", "replay.js"),
        style=STYLE,
        scene=f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.2f} {top:.2f} {wide:.2f} {high:.2f}">'
        f"{scene.road()}{scene.lights(run.lights[0])}{_outlines(beside.ghost)}{trails}{bodies}</svg>",
        notes="\n".join(parts),
    )


def _home(run: Run, scene: Scene, about: float, responsible: Collection[str]) -> list[float]:
    """Return left, top, right and bottom of the part of the road that the page shows at first, in SVG coordinates [m].

    The part holds the junction, the vehicles near it at the time `about`, and the last metres of the responsible vehicles.
    """
    tick = min(max(round((about - run.start) / run.dt), 0), run.steps - 1)
    low, high = scene.core
    points = [low, high]
    for column, agent in enumerate(run.agents):
        begin = max(tick - round(_LEAD / run.dt), 0) if agent.name in responsible else tick
        way = run.need("pose")[begin : tick + 1, column, :2][run.here[begin : tick + 1, column]]
        near = ((way > low - _NEAR) & (way < high + _NEAR)).all(axis=1)
        points += list(way[near])
        if run.here[tick, column] and near.any():
            heading = run.need("pose")[tick, column, 2]
            points.append(way[-1] - size(run, column)[0] * np.array([np.cos(heading), np.sin(heading)]))
    (left, bottom), (right, top) = np.min(points, axis=0) - _AROUND, np.max(points, axis=0) + _AROUND
    return [round(float(v), 2) for v in (left, -top, right, -bottom)]


def events(run: Run) -> list[tuple[float, str]]:
    """Return the events of a run, each with time [s] and text: zones entered, changes of lights, collisions, a fault."""
    rows: list[tuple[float, str]] = []
    junction = run.junction

    def add(tick: int, text: str) -> None:
        rows.append((round(run.start + tick * run.dt, 6), text))

    out = [f"{lane.arm}.{lane.lane}" if len(junction.arms[lane.arm].exits) > 1 else f"{lane.arm}" for lane in junction.ends]
    for column, agent in enumerate(run.agents):
        if isinstance(agent.way, Parking):
            continue
        words = {Zone.ENTRANCE: "at entrance {0}", Zone.JUNCTION: "enters the junction", Zone.EXIT: "leaves by exit {1}"}
        if agent.way.key not in junction.movements:
            words = {Zone.ENTRANCE: "comes to the {2}", Zone.JUNCTION: "enters the {2}", Zone.EXIT: "leaves the {2}"}
        what, zones, back = agent.way.kind, changes(run.zone[:, column]), list[tuple[int, int]]()
        if isinstance(agent.way, Crossing):
            back = [row for before, row in pairwise(zones) if row[1] == Zone.ENTRANCE and before[1] == Zone.JUNCTION]
            for tick, _ in back:
                add(tick, f"{agent.name} goes back to the sidewalk")
            words[Zone.JUNCTION], what = "steps onto the {2}", f"crosswalk of arm {junction.crossings[agent.way.crosswalk].arm}"
        for tick, zone in zones:
            # A vehicle whose recording begins inside a zone has no recorded entry into the zone.
            unrecorded = run.excerpt and (tick == 0 or run.zone[tick - 1, column] == Zone.ABSENT)
            if zone in words and (tick, zone) not in back and not unrecorded:
                add(tick, f"{agent.name} {words[Zone(zone)].format(label(junction, agent.entrance), out[agent.exit], what)}")
    for entrance, name in enumerate(_light_names(run)):
        for tick, colour in changes(run.lights[:, entrance])[1:] if name else []:
            add(tick, f"light {name} turns {Colour(colour).name.lower()}")
    touch = "touch, by their places and sizes," if run.collisions is None else "collide"
    rows += [(run.start + c.time, f"{c.agents[0]} and {c.agents[1]} {touch} at {c.speed:.1f} m/s") for c in _collisions(run)]
    if run.fault:
        rows.append((run.start + run.fault.time, run.fault.reason))
    return sorted(rows)


def _light_names(run: Run) -> list[str]:
    """Return the names of the lights; empty for the second light of a crosswalk, which shows what the first shows."""
    names = [label(run.junction, entrance) for entrance in range(len(run.junction.entrances))]
    for way, start, _ in run.junction.further:
        names.append(f"for pedestrians {start.arm}" if isinstance(way, Crossing) and way.side is Side.NEAR else "")
    return names


def _collisions(run: Run) -> tuple[Collision, ...]:
    """Return the collisions of a run; none if the run holds no bodies."""
    with suppress(RunError):
        return contacts(run)
    return ()


def changes(values: NDArray[Any]) -> list[tuple[int, Any]]:
    """Return tick and value of the first element of a series, and of every element that differs from the element before."""
    ticks = [0, *(np.flatnonzero(values[1:] != values[:-1]) + 1).tolist()]
    return list(zip(ticks, values[ticks].tolist(), strict=True))


def _motion(run: Run, there: NDArray[np.bool_], pose: Points, *further: Points) -> list[list[list[float] | None]]:
    """Return every `_EVERY`-th state of every vehicle, with headings without jumps by 2 pi; None for an absent vehicle.

    `there` says whether each vehicle is present, shape ``(steps, agents)``.
    """
    together = np.concatenate([pose, *(values[..., None] for values in further)], axis=2)
    for column, (begin, end) in enumerate(run.spans.tolist()):
        together[begin:end, column, 2] = np.unwrap(together[begin:end, column, 2])
    # The position of a vehicle that is gone can be NaN.
    stored: list[list[list[float] | None]] = np.nan_to_num(together[::_EVERY].round(3)).tolist()
    for row, column in np.argwhere(~there[::_EVERY]).tolist():
        stored[row][column] = None
    return stored


def _outlines(ghost: Run | None) -> str:
    """Return SVG outlines of the vehicles of an earlier run; an empty text if the run has no positions."""
    if ghost is None or ghost.pose is None or not ghost.steps:
        return ""
    parts = []
    for column, colour in enumerate(inks(ghost.agents)):
        length, width = size(ghost, column)
        parts.append(
            f'<g class="ghost" stroke="{colour}" transform="{placed(np.nan_to_num(ghost.pose[ghost.spans[column, 0], column]))}">'
            f'<rect x="{-length:g}" y="{-width / 2:g}" width="{length:g}" height="{width:g}" rx="0.4"/>'
            f'<path d="M-1.3 {-width / 2 + 0.25:g}L-0.3 0L-1.3 {width / 2 - 0.25:g}"/></g>'
        )
    return "".join(parts)


def _ghost_data(run: Run, ghost: Run, name: str) -> dict[str, Any]:
    """Return the data of an earlier run for the replay page."""
    sentence = f"This run and {name} are the same, state for state."
    times: list[tuple[float, str]] = []
    if divergence := diverge(run, ghost):
        value, ghost_value = divergence.one, divergence.other
        sentence = f"This run and {name} differ in {divergence.what}: {value} here, {ghost_value} there."
        if divergence.time is not None:
            at = divergence.time + run.start
            with suppress(ValueError):  # the values are words
                one, other = float(value), float(ghost_value)
                pairs = ((f"{one:.{digits}g}", f"{other:.{digits}g}") for digits in range(3, 17))
                value, ghost_value = next((pair for pair in pairs if pair[0] != pair[1]), (value, ghost_value))
            sentence = f"This run and {name} part at t = {at:.2f} s: {divergence.what} is {value} here, {ghost_value} there."
            times.append((at, f"where they part: {at:.2f} s"))
        if run.pose is not None and ghost.pose is not None and run.dt == ghost.dt:
            first = steps = min(run.steps, ghost.steps)
            columns = {agent.name: column for column, agent in enumerate(ghost.agents)}
            for column, agent in enumerate(run.agents):
                if (other_column := columns.get(agent.name)) is not None:
                    both = run.here[:steps, column] & ghost.here[:steps, other_column]
                    gap = np.hypot(*(run.pose[:steps, column, :2] - ghost.pose[:steps, other_column, :2]).T)
                    first = min([first, *np.flatnonzero(both & (gap > _SEEN)).tolist()[:1]])
            if first < steps:
                apart = round(run.start + first * run.dt, 9)
                times.append((apart, f"{_SEEN:g} m apart: {apart:.2f} s"))
    motion = [] if ghost.pose is None else _motion(ghost, ghost.here, ghost.pose)
    if not motion:
        sentence += f" Positions of {name} are not recorded, so it is not shown."
    return {
        "name": name,
        "agents": [agent.name for agent in ghost.agents],
        "said": sentence,
        "times": times,
        "start": ghost.start,
        "dt": ghost.dt,
        "every": _EVERY,
        "motion": motion,
    }


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
        marked = [(time, message)] if verdict.status in TROUBLE else []
        yield Page(time, replay(run, message, notes, marked, tracks, verdict.responsible, beside=beside))
        return
    beside = replace(beside, ghost=None, ghost_name="")
    tracks.sort(key=lambda track: track.changes[-1][1] != "violated")
    found = troubles(verdict)
    shown: list[tuple[int, int]] = []
    for time in dict.fromkeys([moment(run, verdict), *(time for time, *_ in found)]):
        tick = round((time - run.start) / run.dt)
        if any(begin <= tick < end for begin, end in shown):
            continue
        begin, end = max(tick - round(_BEFORE / run.dt), 0), min(tick + round(_AFTER / run.dt) + 1, run.steps)
        title = verdict.message if not shown else next(event for t, event, _ in found if t == time)
        shown.append((begin, end))
        part = _part(run, begin, end)
        marked = [(t, event) for t, event, _ in found if part.start <= t <= part.start + part.duration]
        lines = []
        for track in tracks:
            before = [word for tick, word in track.changes if tick <= begin]
            inside = [(tick - begin, word) for tick, word in track.changes if begin < tick < end]
            if inside:
                lines.append(replace(track, changes=((0, before[-1]), *inside)))
        responsible = {name for t, _, names in found if t == time for name in names}
        yield Page(time, replay(part, title, notes, marked or [(time, title)], lines, responsible, time, beside))


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
