"""Writes a run as OpenSCENARIO XML: a trajectory per vehicle, the phases of the lights, and the map in the same folder.

An exported file is read like a file of another tool, as recorded traffic. Only writing needs the library scenariogeneration.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pytest_rvads.geometry.segment import Pose
from pytest_rvads.logic.judging.verdicts import Verdict
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle, Zone
from pytest_rvads.satellites.openscenario.document import (
    Actor,
    Body,
    Document,
    body_of,
    library,
    mapped,
    phases_of_run,
    put_map,
    written,
)
from pytest_rvads.support.decoding import encode
from pytest_rvads.support.errors import RunError, RvadsError, require
from pytest_rvads.support.storage import write_file
from pytest_rvads.support.wording import one_line


def export_run(run: Run, path: str | Path, *, map: str | os.PathLike[str] | None = None, verdict: Verdict | None = None) -> None:
    """Write a run as OpenSCENARIO XML 1.2, and the map of its junction into the same folder; equal runs give equal files.

    Every vehicle follows a trajectory of its rear axle, with a vertex per state in which the vehicle moves. The traffic lights
    are phases of a signal controller. `read_runs` and ``rvads check`` read the file as recorded traffic, whose verdicts may
    differ from those of the run: `save_run` writes the file (``.npz``) that gives the same verdicts.

    Args:
        run: the run.
        path: path of the file, by convention ``.xosc``; missing folders are made.
        map: map file of the junction; by default the file that the junction or its scenario names.
        verdict: a verdict on the run, which the file quotes.

    Raises:
        RunError: the run holds no positions, or the file can't be written.
        MapError: the map of the junction is unknown.
        RvadsError: the library scenariogeneration is not installed.
    """
    require(run, Run, "export_run takes a run, such as rvads.simulate(case) returns", RunError)
    require(verdict, Verdict | None, "verdict= must be what rvads.check(run, rule) returns", RunError)
    library()
    path = Path(path)
    if run.steps < 2 or not run.agents:
        raise RunError(
            f"run {run.label!r} can't be exported: it has {run.steps} states and {len(run.agents)} vehicles, expected at least 2 "
            "states and a vehicle"
        )
    run.need("pose")
    place = mapped(run.junction, map, recorded_map(run.provenance))
    title, quoted = run.label, dict[str, str]()
    if verdict is not None:
        quoted = {"rule": verdict.rule, "status": str(verdict.status), "message": one_line(verdict.message)}
        title += f": {quoted['message']}"
    parameters = vehicles(run)
    bodies = [body_of(agent, parameters.get(agent.name)) for agent in run.agents]
    actors = tuple(actor for k, body in enumerate(bodies) if (actor := _actor(run, k, body)) is not None)
    # Only `unsized` is read again: a vehicle of unknown size has the box of a usual car in the file.
    unsized = [agent.name for agent in run.agents if agent.size is None]
    note = {"label": run.label, "hash": run.hash, "verdict": quoted or None, "unsized": unsized}
    document = Document(
        one_line(title),
        put_map(place, path.parent),
        ("rvads.run", encode(note).decode()),
        actors,
        phases_of_run(place, run.lights, run.dt),
        run.duration,
    )
    write(path, document)


def write(path: Path, document: Document) -> None:
    """Write a document to a file."""
    if path.name == document.map:
        raise RvadsError(f"{path}: the map has this name: give the file another name, such as {path.with_suffix('.xosc')}")
    try:
        write_file(path, written(document))
    except OSError as error:
        raise RvadsError(f"{path}: can't be written: {error.strerror}") from error


def recorded_map(provenance: Mapping[str, Any]) -> str | None:
    """Return the map file that the provenance of a run records for its scenario; None if the provenance names no map."""
    scenario = provenance.get("scenario")
    path = scenario.get("map") if isinstance(scenario, Mapping) else None
    return path if isinstance(path, str) else None


def vehicles(run: Run) -> dict[str, Vehicle]:
    """Return the vehicle parameters in the provenance of a run, by name of the agent; agents without parameters are left out."""
    by_agent: dict[str, Vehicle] = {}
    others = run.provenance.get("others")
    for agent in run.agents:
        record = (others.get(agent.name) if isinstance(others, Mapping) else None) or run.provenance.get("vehicle")
        with suppress(msgspec.ValidationError, RvadsError):
            by_agent[agent.name] = msgspec.convert(record, Vehicle)
    return by_agent


def _actor(run: Run, column: int, body: Body) -> Actor | None:
    """Return a vehicle with its trajectory while it was present; None for a vehicle with a single state."""
    agent, zone, pose = run.agents[column], run.zone[:, column], run.need("pose")[:, column]
    begin, end = run.spans[column].tolist()
    gone = np.flatnonzero(zone == Zone.GONE)
    leaves = end < run.steps or bool(len(gone))
    if len(gone):
        end = int(gone[0]) + 1
    if end - begin < 2:
        return None
    axle = pose[begin:end].copy()
    axle[:, 0] -= body.back * np.cos(axle[:, 2])
    axle[:, 1] -= body.back * np.sin(axle[:, 2])
    # Of a time in which the vehicle stands, only the first and the last state are written.
    same = (np.diff(axle, axis=0) == 0.0).all(axis=1)
    idle = np.concatenate(([False], same[:-1] & same[1:], [False]))
    rows = np.flatnonzero(~idle)
    times = np.round((begin + rows) * run.dt, 9)
    speed = 0.0 if run.speed is None else float(run.speed[begin, column])
    return Actor(
        agent.name,
        body,
        Pose(*axle[0].tolist()),
        speed,
        np.column_stack((times, axle[rows])),
        appears=float(times[0]) if begin else None,
        leaves=float(times[-1]) if leaves else None,
    )
