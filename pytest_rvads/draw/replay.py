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

__all__ = ["Track", "events", "replay"]

_EVERY = 5
"""Positions are stored every so many states and drawn on straight lines between; zones and lights are exact."""


@dataclass(frozen=True, slots=True)
class Track:
    """A value that changes now and then, such as the state of a monitor."""

    label: str
    changes: tuple[tuple[int, str], ...]
    """Since which tick it has been what; the words ``watching``, ``due``, ``violated``, ``satisfied`` have colours."""


def replay(
    run: Run,
    title: str,
    notes: str = "",
    marked: Iterable[tuple[float, str]] = (),
    tracks: Iterable[Track] = (),
    responsible: Collection[str] = (),
) -> str:
    """Return an HTML page that replays `run`, state by state.

    Args:
        run: a run with positions.
        title: heading of the page.
        notes: text shown beside the picture, such as an explanation.
        marked: further events (time [s], text), such as a violation; they stand out.
        tracks: what else to show over time, such as the monitors of a rule.
        responsible: names of the vehicles to point out.

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
    bodies = "".join(body(run.pose[0, i], a, size(run, i), colours[i], a.name in responsible) for i, a in enumerate(run.agents))
    told = sorted(marked)
    motion = np.concatenate((run.pose, run.station[..., None], run.speed[..., None]), axis=2)
    motion[..., 2] = np.unwrap(motion[..., 2], axis=0)
    data = {
        "dt": run.dt,
        "steps": run.steps,
        "every": _EVERY,
        "lengths": [size(run, i)[0] for i in range(len(run.agents))],
        "agents": [a.name for a in run.agents],
        "kinds": [a.kind for a in run.agents],
        "motion": np.nan_to_num(motion[::_EVERY].round(3)).tolist(),  # who is gone may have no place
        "zones": [_changes(run.zone[:, i]) for i in range(len(run.agents))],
        "entrances": [label(run.junction, e) for e in range(run.lights.shape[1])],
        "lights": [_changes(run.lights[:, e]) for e in range(run.lights.shape[1])],
        "tracks": [(track.label, track.changes) for track in tracks],
        "responsible": [a.name for a in run.agents if a.name in responsible],
        "marked": [time for time, _ in told],
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


def events(run: Run) -> list[tuple[float, str]]:
    """Return what happens in a run: zones entered, lights that change, collisions, a fault; time [s] and text."""
    found: list[tuple[float, str]] = []
    junction = run.junction
    out = [f"{lane.arm}.{lane.lane}" if len(junction.arms[lane.arm].exits) > 1 else f"{lane.arm}" for lane in junction.exits]
    words = {Zone.ENTRANCE: "at entrance {0}", Zone.JUNCTION: "enters the junction", Zone.EXIT: "leaves by exit {1}"}
    for column, agent in enumerate(run.agents):
        found += [
            (
                round(tick * run.dt, 6),
                f"{agent.name} {words[Zone(zone)].format(label(junction, agent.entrance), out[agent.exit])}",
            )
            for tick, zone in _changes(run.zone[:, column])
            if zone in words
        ]
    for entrance in range(run.lights.shape[1]):
        found += [
            (round(tick * run.dt, 6), f"light {label(junction, entrance)} turns {Colour(colour).name.lower()}")
            for tick, colour in _changes(run.lights[:, entrance])[1:]
        ]
    found += [(c.time, f"{c.agents[0]} and {c.agents[1]} collide at {c.speed:.1f} m/s") for c in run.collisions or ()]
    if run.fault:
        found.append((run.fault.time, run.fault.reason))
    return sorted(found)


def _changes(values: NDArray[np.int8]) -> list[tuple[int, int]]:
    """Return (tick, value) wherever a series takes a new value, its first state included."""
    ticks = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1))
    return [(int(tick), int(values[tick])) for tick in ticks]
