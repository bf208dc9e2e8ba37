"""A run as a self-contained page: play, scrub, zoom, follow, keyboard, links to a time; what happens, and what is beside it."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.conduct.blocks import tick_of
from pytest_rvads.conduct.bodies import contacts
from pytest_rvads.draw.ghost import ghost_data, motion, outlines
from pytest_rvads.draw.picture import STYLE
from pytest_rvads.draw.scene import Scene, body, inks, label, size
from pytest_rvads.errors import RunError
from pytest_rvads.runs.run import Collision, Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.webpage import webpage
from pytest_rvads.wording import markup

__all__ = ["Beside", "Track", "events", "replay"]

_EVERY = 5
"""Positions are stored every so many states and drawn on straight lines between; zones and lights are exact."""
_TRAIL = 3.0
"""How long the trails of recorded traffic are [s]: among many vehicles, longer ones hide what happens."""
_LEAD = 1.5
"""How far back the first view reaches for those that the page is about [s]."""
_NEAR, _AROUND = 10.0, 3.0
"""Who is how far from the junction is in the first view, and how much is around it all [m]."""


@dataclass(frozen=True, slots=True)
class Beside:
    """What a page says and shows beside its run."""

    facts: tuple[tuple[str, str], ...] = ()
    """Word and text of each line of the head: scenario, what drove, rule, how to run it again."""
    others: tuple[tuple[str, str, str], ...] = ()
    """Rule, status and message of the other verdicts of the run."""
    back: str = ""
    """Relative path of the page that leads here; nothing without one."""
    ghost: Run | None = None
    """An earlier run of the same scenario, drawn faintly below this one."""
    ghost_name: str = ""
    """What that run is called."""


@dataclass(frozen=True, slots=True)
class Track:
    """A value that changes now and then, such as the state of a monitor."""

    label: str
    changes: tuple[tuple[int, str], ...]
    """Since which tick it has been what; the words ``watching``, ``due``, ``violated``, ``satisfied`` have colours."""


def replay(  # noqa: PLR0913 - a run, and what is to be said and shown beside it
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

    Args:
        run: a run with positions.
        title: heading of the page.
        notes: text shown beside the picture, such as an explanation.
        marked: further events (time [s], text), such as a violation; they stand out.
        tracks: further rows over time, such as the monitors of a rule.
        responsible: names of the vehicles to highlight.
        opened: time at which the page opens [s]; the rows are marked at the further event of this time. By default the page opens
            at the beginning, and the rows are marked at all further events.
        beside: further texts and pictures of the page.

    Times that are given and shown are on the clock of the recording that the run is an excerpt of, ticks count from its start.

    Raises:
        RunError: the run holds no positions, or no states.
        MapError: its junction has no geometry.
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
    told, beside = sorted(marked), beside or Beside()
    about = next((time for time, _ in told if opened in (None, time)), run.start)
    data = {
        "dt": run.dt,
        "start": run.start,
        "opened": run.start if opened is None else opened,
        "steps": run.steps,
        "every": _EVERY,
        "trail": None if run.excerpt is None else max(round(_TRAIL / run.dt / _EVERY), 1),
        "lengths": [size(run, i)[0] for i in range(len(run.agents))],
        "agents": [a.name for a in run.agents],
        "kinds": [a.kind for a in run.agents],
        "inks": colours,
        "motion": motion(run, _EVERY, run.zone != Zone.ABSENT, "pose", "station", "speed"),
        "zones": [_changes(run.zone[:, i]) for i in range(len(run.agents))],
        "entrances": [label(run.junction, e) for e in range(run.lights.shape[1])],
        "lights": [_changes(run.lights[:, e]) for e in range(run.lights.shape[1])],
        "tracks": [(track.label, track.changes) for track in tracks],
        "responsible": [a.name for a in run.agents if a.name in responsible],
        "marked": [time for time, _ in told if opened in (None, time)],
        "events": sorted([*((*event, False) for event in events(run)), *((*event, True) for event in told)]),
        "impacts": _impacts(run),
        "watched": run.collisions is not None,
        "home": _home(run, scene, about, responsible),
        "reach": max(wide, high),
        "facts": beside.facts,
        "others": beside.others,
        "back": beside.back,
        "ghost": ghost_data(run, beside.ghost, beside.ghost_name, _EVERY),
    }
    return webpage(
        [("pytest_rvads.draw", "replay")],
        title,
        data,
        style=STYLE,
        heading=markup(title),
        scene=f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.2f} {top:.2f} {wide:.2f} {high:.2f}">'
        f"{scene.road()}{scene.lights(run.lights[0])}{outlines(beside.ghost)}{trails}{bodies}</svg>",
        notes=markup(notes),
    )


def _home(run: Run, scene: Scene, about: float, responsible: Collection[str]) -> list[float]:
    """Return left, top, right and bottom of the part that the page shows at first, in SVG coordinates [m].

    The part holds the junction, the vehicles near the junction at the time `about`, and the starts of the responsible vehicles.
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


def _touched(run: Run) -> tuple[Collision, ...]:
    """Return the collisions of a run; none if the run holds no bodies."""
    try:
        return contacts(run)
    except RunError:
        return ()


def _impacts(run: Run) -> list[tuple[int, list[int]]]:
    """Return tick and columns of every collision, by time."""
    columns = {agent.name: column for column, agent in enumerate(run.agents)}
    found = [(tick_of(run, c), [columns[name] for name in c.agents if name in columns]) for c in _touched(run)]
    return sorted(found)


def events(run: Run) -> list[tuple[float, str]]:
    """Return what happens in a run: zones entered, lights that change, collisions, a fault; time [s] and text."""
    found: list[tuple[float, str]] = []
    first = run.start
    junction = run.junction
    out = [f"{lane.arm}.{lane.lane}" if len(junction.arms[lane.arm].exits) > 1 else f"{lane.arm}" for lane in junction.ends]
    for column, agent in enumerate(run.agents):
        words = {Zone.ENTRANCE: "at entrance {0}", Zone.JUNCTION: "enters the junction", Zone.EXIT: "leaves by exit {1}"}
        if agent.way.key not in junction.movements:
            words = {Zone.ENTRANCE: "comes to the {2}", Zone.JUNCTION: "enters the {2}", Zone.EXIT: "leaves the {2}"}
        found += [
            (
                round(first + tick * run.dt, 6),
                f"{agent.name} {words[Zone(zone)].format(label(junction, agent.entrance), out[agent.exit], agent.way.kind)}",
            )
            for tick, zone in _changes(run.zone[:, column])
            if zone in words and not (run.excerpt and _found_there(run, tick, column))
        ]
    for entrance in range(run.lights.shape[1]):
        found += [
            (round(first + tick * run.dt, 6), f"light {label(junction, entrance)} turns {Colour(colour).name.lower()}")
            for tick, colour in _changes(run.lights[:, entrance])[1:]
        ]
    touch = "touch, by their places and sizes," if run.collisions is None else "collide"
    found += [(first + c.time, f"{c.agents[0]} and {c.agents[1]} {touch} at {c.speed:.1f} m/s") for c in _touched(run)]
    if run.fault:
        found.append((first + run.fault.time, run.fault.reason))
    return sorted(found)


def _found_there(run: Run, tick: int, column: int) -> bool:
    """Return whether the recording of a vehicle begins in its zone, so that no border crossing was recorded."""
    return tick == 0 or bool(run.zone[tick - 1, column] == Zone.ABSENT)


def _changes(values: NDArray[np.int8]) -> list[tuple[int, int]]:
    """Return (tick, value) wherever a series takes a new value, its first state included."""
    ticks = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
    return [(int(tick), int(values[tick])) for tick in ticks]
