"""A run as a self-contained page: play, scrub, speed, keyboard, a link to a time; events, zones, lights, monitors over time."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.draw.picture import STYLE, size
from pytest_rvads.draw.scene import Scene, body, inks, label
from pytest_rvads.errors import RunError
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.webpage import webpage
from pytest_rvads.wording import markup

__all__ = ["Beside", "Track", "events", "replay"]

_EVERY = 5
"""Positions are stored every so many states and drawn on straight lines between; zones and lights are exact."""
_TRAIL = 3.0
"""How long the trails of recorded traffic are [s]: among many vehicles, longer ones hide what happens."""


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
        tracks: what else to show over time, such as the monitors of a rule.
        responsible: names of the vehicles to point out.
        opened: time at which the page opens [s], the one of the further events that all rows are marked at; by default the
            beginning, and all of them.
        beside: what else the page says and shows.

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
    told = sorted(marked)
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
        "motion": _motion(run),
        "zones": [_changes(run.zone[:, i]) for i in range(len(run.agents))],
        "entrances": [label(run.junction, e) for e in range(run.lights.shape[1])],
        "lights": [_changes(run.lights[:, e]) for e in range(run.lights.shape[1])],
        "tracks": [(track.label, track.changes) for track in tracks],
        "responsible": [a.name for a in run.agents if a.name in responsible],
        "marked": [time for time, _ in told if opened in (None, time)],
        "events": sorted([*((*event, False) for event in events(run)), *((*event, True) for event in told)]),
    }
    return webpage(
        "pytest_rvads.draw",
        "replay",
        title,
        data,
        style=STYLE,
        heading=markup(title),
        scene=f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{left:.2f} {top:.2f} {wide:.2f} {high:.2f}">'
        f"{scene.road()}{scene.lights(run.lights[0])}{trails}{bodies}</svg>",
        notes=markup(notes),
    )


def _motion(run: Run) -> list[list[list[float] | None]]:
    """Return x, y, heading, station and speed of every vehicle, every `_EVERY` states; None while it is absent."""
    motion = np.concatenate((run.need("pose"), run.need("station")[..., None], run.need("speed")[..., None]), axis=2)
    for column, (begin, end) in enumerate(run.spans.tolist()):
        motion[begin:end, column, 2] = np.unwrap(motion[begin:end, column, 2])
    stored: list[list[list[float] | None]] = np.nan_to_num(motion[::_EVERY].round(3)).tolist()  # who is gone may have no place
    for row, column in np.argwhere(run.zone[::_EVERY] == Zone.ABSENT).tolist():
        stored[row][column] = None
    return stored


def events(run: Run) -> list[tuple[float, str]]:
    """Return what happens in a run: zones entered, lights that change, collisions, a fault; time [s] and text."""
    found: list[tuple[float, str]] = []
    first = run.start
    junction = run.junction
    out = [f"{lane.arm}.{lane.lane}" if len(junction.arms[lane.arm].exits) > 1 else f"{lane.arm}" for lane in junction.exits]
    words = {Zone.ENTRANCE: "at entrance {0}", Zone.JUNCTION: "enters the junction", Zone.EXIT: "leaves by exit {1}"}
    for column, agent in enumerate(run.agents):
        found += [
            (
                round(first + tick * run.dt, 6),
                f"{agent.name} {words[Zone(zone)].format(label(junction, agent.entrance), out[agent.exit])}",
            )
            for tick, zone in _changes(run.zone[:, column])
            if zone in words and not (run.excerpt and _found_there(run, tick, column))
        ]
    for entrance in range(run.lights.shape[1]):
        found += [
            (round(first + tick * run.dt, 6), f"light {label(junction, entrance)} turns {Colour(colour).name.lower()}")
            for tick, colour in _changes(run.lights[:, entrance])[1:]
        ]
    found += [(first + c.time, f"{c.agents[0]} and {c.agents[1]} collide at {c.speed:.1f} m/s") for c in run.collisions or ()]
    if run.fault:
        found.append((first + run.fault.time, run.fault.reason))
    return sorted(found)


def _found_there(run: Run, tick: int, column: int) -> bool:
    """Whether a vehicle was in its zone when the recording of it began, so that nobody saw it come there."""
    return tick == 0 or bool(run.zone[tick - 1, column] == Zone.ABSENT)


def _changes(values: NDArray[np.int8]) -> list[tuple[int, int]]:
    """Return (tick, value) wherever a series takes a new value, its first state included."""
    ticks = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
    return [(int(tick), int(values[tick])) for tick in ticks]
