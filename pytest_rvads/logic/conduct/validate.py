"""Finds impossible states in a run, such as jumps, wrong speeds or unrecorded collisions, simulated or from another tool."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pytest_rvads.logic.conduct.bodies import contacts
from pytest_rvads.runs.itineraries import ENTRANCE_ZONE, itinerary
from pytest_rvads.runs.run import Run, once
from pytest_rvads.runs.states import Agent, Colour, Kind, Zone
from pytest_rvads.support.errors import MapError, RunError, require

PROGRESS_TOLERANCE = (0.005, 0.3)
"""Largest difference between a step's progress and speed times time: the sum of a distance [m] and a share of the latter.

The bumper swings in bends, where its projection on the centre line is a quarter slower or faster than the car.
"""
OFFSET_LIMIT = 2.0
"""Largest distance of a reference point from the centre line of its itinerary [m]; a little more than half a lane."""
_PACE = (0.3, 0.2)
"""Largest difference between a simulated vehicle's speed and the motion of its body: the sum of a speed [m/s] and a share."""
_BETWEEN = 0.5
"""Half of the longest usual time between samples of a recording [s]: between two samples, a vehicle can have any speed that the
recording has within this time."""
_LONG = 10
"""Number of states in which a difference larger than `_PACE` is accepted, because bodies that touch are thrown aside."""
_SHORT = 0.5
"""Length of a part of a way below which a vehicle may skip the part in one step [m]; maps have exit roads of some centimetres."""
_EVERY = 10
"""Number of states from one check of offsets to the next."""
_ORDER = {Colour.GREEN: Colour.YELLOW, Colour.YELLOW: Colour.RED, Colour.RED: Colour.GREEN}


@dataclass(frozen=True, slots=True)
class Finding:
    """An impossible state of a run, with its kind, its time and a message."""

    kind: str
    """The kind: jump, progress, missing ticks, sampling, speed, zone, itinerary, colour, collision, values."""
    time: float
    """Time of the first occurrence, on the clock of the recording [s]."""
    message: str
    """One sentence with the vehicle or light, the time, and the error."""

    def __str__(self) -> str:
        return self.message


def validate(run: Run) -> tuple[Finding, ...]:
    """Return the impossible states of a run, sorted by time; empty for an intact run.

    A kind of finding is reported once per vehicle or light, or once per run. Values that the run does not record are not checked.

    Args:
        run: the run, simulated or recorded.
    """
    require(run, Run, "validate takes a run, such as rvads.simulate(case) returns", RunError)
    broken = once(run, damage)
    if broken:
        return broken
    findings: list[Finding] = []
    for column, agent in enumerate(run.agents):
        findings += _zones(run, column, agent)
        # A recorded pedestrian walks anywhere on a crosswalk, and starts and stops within a sample.
        if agent.kind is not Kind.PEDESTRIAN or run.excerpt is None:
            findings += _progress(run, column, agent)
            findings += _itinerary(run, column, agent)
    findings += _of_run(run)
    return tuple(sorted(findings, key=lambda f: f.time))


def impossible(run: Run) -> Iterator[Finding]:
    """Yield the findings for which a simulator is at fault: a run unfit to be judged, zones out of order, wrong speeds.

    Every simulated run is checked. Therefore the function checks less than `validate`.
    """
    broken = once(run, damage)
    yield from broken
    for column, agent in enumerate(() if broken else run.agents):
        yield from _zones(run, column, agent)
        if run.pose is None or run.speed is None or run.steps < 2:
            continue
        # The motion of the body is more exact than its station.
        step, heading = np.diff(run.pose[:, column, :2], axis=0) / run.dt, run.pose[:-1, column, 2]
        ahead = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
        speed, (absolute, relative) = run.speed[1:, column], _PACE
        present = run.here[1:, column] & run.here[:-1, column]
        wrong = np.flatnonzero(present & (np.abs(ahead - speed) > absolute + relative * np.abs(speed)))
        if len(wrong) > _LONG:
            time, moves, speed_given = run.start + (int(wrong[0]) + 1) * run.dt, ahead[wrong[0]], speed[wrong[0]]
            yield Finding(
                "speed",
                time,
                f"{agent.name} moves ahead at {moves:.1f} m/s at {time:.2f} s, its speed is given as {speed_given:.1f} m/s",
            )


def damage(run: Run) -> tuple[Finding, ...]:
    """Return the errors that make a run unfit to be judged: no states, arrays that don't fit together, meaningless values."""
    return (*_arrays(run), *_agents(run))


def _arrays(run: Run) -> Iterator[Finding]:
    shape = (run.steps, len(run.agents))
    shapes: list[tuple[str, NDArray[Any] | None, tuple[int, ...]]] = [
        ("zone", run.zone, shape),
        ("lights", run.lights, (run.steps, len(run.junction.starts))),
        ("station", run.station, shape),
        ("speed", run.speed, shape),
        ("pose", run.pose, (*shape, 3)),
        ("spread", run.spread, shape),
    ]
    recorded = run.zone != Zone.ABSENT if run.zone.shape == shape else np.ones(shape, dtype=np.bool_)
    if not run.steps:
        yield Finding("values", 0.0, "the run is empty: it has no states")
    if not (np.isfinite(run.dt) and run.dt > 0):
        yield Finding("values", 0.0, f"the time between two states must be positive, got {run.dt} s")
    for name, array, expected in shapes:
        if array is None:
            continue
        if array.shape != expected:
            yield Finding("values", 0.0, f"{name} must have shape {expected}, got {array.shape}")
        elif array.dtype.kind == "f" and not np.isfinite(array[recorded]).all():
            tick, column, *_ = np.argwhere(~np.isfinite(array) & (recorded if array.ndim == 2 else recorded[..., None]))[0]
            time = run.start + int(tick) * run.dt
            yield Finding("values", time, f"{name} of {run.agents[column].name} at {time:.2f} s is not a finite number")
    for name, codes, allowed in (("zone", run.zone, Zone), ("colour", run.lights, Colour)):
        if codes.size and not np.isin(codes, [int(v) for v in allowed]).all():
            yield Finding("values", 0.0, f"the run has a {name} that is none of {', '.join(v.name.lower() for v in allowed)}")


def _agents(run: Run) -> Iterator[Finding]:
    names = [agent.name for agent in run.agents]
    if len(set(names)) < len(names):
        yield Finding("values", 0.0, f"every vehicle must have a name of its own, got {', '.join(names)}")
    collided = [name for collision in run.collisions or () for name in collision.agents]
    for named in dict.fromkeys((run.facts.subject, *run.facts.strayed, *collided)):
        if named not in (None, *names):
            what = "facts" if named not in collided else "collisions"
            yield Finding("values", 0.0, f"the {what} name {named!r}, which is none of the vehicles {', '.join(names)}")
    for agent in run.agents:
        way = run.junction.every_way.get(agent.way.key)
        where = f"{agent.name} goes from entrance {agent.entrance} to exit {agent.exit}"
        if way is None:
            yield Finding("values", 0.0, f"{where}, where junction {run.junction.name!r} has no movement")
        elif way.turn is not agent.turn:
            yield Finding("values", 0.0, f"{where}, which is {way.turn.value} and not {agent.turn.value}")
        if agent.size is not None and not (len(agent.size) == 2 and all(0 < v < np.inf for v in agent.size)):
            yield Finding("values", 0.0, f"the size of {agent.name} must be a positive length and width, got {agent.size}")


def _zones(run: Run, column: int, agent: Agent) -> Iterator[Finding]:
    """Check the order of the zones of an itinerary: an agent skips no zone, and no vehicle drives backwards through zones."""
    zone = run.zone[:, column].astype(np.int64)
    recorded = (zone != Zone.ABSENT)[1:] & (zone != Zone.ABSENT)[:-1]
    road, step = run.junction.ends[agent.exit].road, np.diff(zone)
    lengths = {Zone.JUNCTION: agent.way.length, Zone.EXIT: np.inf if road is None else road.length}
    passed = (step == 2) & np.isin(zone[:-1] + 1, [part for part, length in lengths.items() if length < _SHORT])
    back = step < (-1 if agent.kind is Kind.PEDESTRIAN else 0)  # pedestrians may turn back
    jumps = np.flatnonzero((back | (step > 1)) & ~passed & recorded) + 1
    if len(jumps):
        tick = int(jumps[0])
        before, after = (Zone(int(zone[t])).name.lower() for t in (tick - 1, tick))
        time = run.start + tick * run.dt
        yield Finding("jump", time, f"{agent.name} jumps on the graph at {time:.2f} s: from {before} to {after} in one step")
    if run.station is None:
        return
    station, line = run.station[:, column], -run.junction.setbacks[agent.entrance]
    length = run.junction.every_way[agent.way.key].length
    entry = min(max(line, 0.0), length)
    spread = 0.0 if run.spread is None else run.spread[:, column]
    first, last = (
        np.select([at < line - ENTRANCE_ZONE, at <= entry, at < length], [Zone.APPROACH, Zone.ENTRANCE, Zone.JUNCTION], Zone.EXIT)
        for at in (station - spread, station + spread)
    )
    wrong = np.flatnonzero(((zone < first) | (zone > last)) & run.here[:, column])
    if len(wrong):
        tick = int(wrong[0])
        name, time = Zone(int(zone[tick])).name.lower(), run.start + tick * run.dt
        yield Finding(
            "zone",
            time,
            f"{agent.name} at {time:.2f} s is said to be in zone {name}, but its station is {station[tick]:.2f} m",
        )


def _progress(run: Run, column: int, agent: Agent) -> Iterator[Finding]:
    """Check that progress along the itinerary is speed times time; in a recording, some speed within `_BETWEEN` has to fit.

    If progress is a whole multiple of speed times time, states seem to be missing.
    """
    if run.station is None or run.speed is None or run.steps < 2:
        return
    present = run.here[1:, column] & run.here[:-1, column]
    progress = np.diff(run.station[:, column])
    expected = (run.speed[1:, column] + run.speed[:-1, column]) / 2 * run.dt
    if run.excerpt is not None:
        wide = 2 * round(_BETWEEN / run.dt) + 1
        near = sliding_window_view(np.pad(run.speed[:, column], wide // 2, mode="edge"), wide)[1:]
        expected = np.clip(progress, np.fmin.reduce(near, axis=1) * run.dt, np.fmax.reduce(near, axis=1) * run.dt)
    absolute, relative = PROGRESS_TOLERANCE
    unknown = 0.0 if run.spread is None else run.spread[1:, column] + run.spread[:-1, column]
    wrong = np.flatnonzero(present & (np.abs(progress - expected) > absolute + relative * np.abs(expected) + unknown))
    if not len(wrong):
        return
    tick = int(wrong[0])
    ratio = float(progress[tick] / expected[tick]) if abs(expected[tick]) > 1e-9 else 0.0
    distance, due, time = f"{progress[tick]:.3f}", f"{expected[tick]:.3f}", run.start + tick * run.dt
    text = f"{agent.name} makes {distance} m from {time:.2f} s to the next state, speed times time is {due} m"
    if ratio > 1.8 and abs(ratio - round(ratio)) < 0.2:
        yield Finding("missing ticks", time, f"{text}: {round(ratio) - 1} states seem to be missing")
    else:
        yield Finding("progress", time, text)


def _of_run(run: Run) -> Iterator[Finding]:
    """Check sampling (no vehicle passes a whole entrance zone between two states), colours of lights, and recorded collisions."""
    if run.speed is not None and (fast := np.abs(run.speed) * run.dt > ENTRANCE_ZONE).any():
        tick, column = np.argwhere(fast)[0].tolist()
        time, further = run.start + tick * run.dt, int(fast.any(axis=0).sum()) - 1
        more = f", as do {further} others" if further > 1 else ", as does another vehicle" if further else ""
        yield Finding(
            "sampling",
            time,
            f"{run.agents[column].name} drives {run.speed[tick, column]:.1f} m/s at {time:.2f} s{more}: in {run.dt:g} s that is "
            f"more than the entrance zone of {ENTRANCE_ZONE:g} m, so rules may miss when it was there",
        )
    for entrance in range(run.lights.shape[1]):
        series = run.lights[:, entrance]
        for tick in (np.flatnonzero(np.diff(series)) + 1).tolist():
            before, after = Colour(int(series[tick - 1])), Colour(int(series[tick]))
            if _ORDER.get(before) is not after:
                time, change = run.start + tick * run.dt, f"from {before.name.lower()} to {after.name.lower()}"
                yield Finding("colour", time, f"light {entrance} turns {change} at {time:.2f} s, out of order")
                break
    if run.pose is not None and run.collisions is not None and all(agent.size for agent in run.agents):
        recorded = {frozenset(collision.agents) for collision in run.collisions}
        for contact in contacts(replace(run, collisions=None)):
            if frozenset(contact.agents) not in recorded:
                time, names = run.start + contact.time, " and ".join(contact.agents)
                yield Finding("collision", time, f"{names} touch at {time:.2f} s, and no collision is recorded")


def _itinerary(run: Run, column: int, agent: Agent) -> Iterator[Finding]:
    """Check that the reference point stays near the centre line of the itinerary."""
    if run.pose is None or run.station is None or not run.junction.drivable:
        return
    try:
        way = itinerary(run.junction, *agent.way.key)
    except MapError as error:
        yield Finding("itinerary", 0.0, f"{agent.name} has no itinerary: {error}")
        return
    ticks = np.flatnonzero(run.here[::_EVERY, column]) * _EVERY
    place, along = run.pose[ticks, column, :2], run.station[ticks, column] + way.origin
    # Projection takes long, and is not needed for a vehicle near the point of the centre line at its station.
    line = way.path
    centre = np.stack([np.interp(along, line.stations, values) for values in line.points.T], axis=-1)
    near = (np.hypot(*(place - centre).T) < OFFSET_LIMIT - 1e-6) & (along >= 0.0) & (along <= line.length)
    for tick in ticks[~near].tolist():
        x, y, _ = run.pose[tick, column]
        _, offset = way.project(float(x), float(y), float(run.station[tick, column]))
        if abs(offset) > OFFSET_LIMIT:
            time = run.start + tick * run.dt
            yield Finding("itinerary", time, f"{agent.name} is {abs(offset):.1f} m off its itinerary at {time:.2f} s")
            return
