"""The project's own file of a run: an npz archive with a JSON header, versioned.

Entries: ``header`` (UTF-8 bytes of JSON: format, version, label, dt, agents, junction, collisions, fault, facts, meta), ``zone``,
``lights``, those of ``station``, ``speed``, ``pose``, ``controls`` that the run holds, with the shapes and units of `Run`,
and ``segment_<k>``: the centre lines that the header's geometry refers to, shape ``(points, 2)`` [m]. Nothing is pickled.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError, RunError
from pytest_rvads.junctions.junction import Geometry, Junction, Movement
from pytest_rvads.maps.control import JunctionControl
from pytest_rvads.maps.segment import Segment, Turn
from pytest_rvads.runs.header import check_header
from pytest_rvads.runs.run import Collision, Facts, Fault, Run
from pytest_rvads.runs.states import Agent

__all__ = ["FORMAT", "VERSION", "load_run", "save_run"]

FORMAT, VERSION = "rvads-run", 2
_ARRAYS = {"zone": (2, "i"), "lights": (2, "i"), "station": (2, "f"), "speed": (2, "f"), "pose": (3, "f"), "controls": (3, "f")}
"""The arrays of a run: how many dimensions they have, and of which kind of numbers."""


def save_run(run: Run, path: str | Path) -> None:
    """Write a run; equal runs give equal files.

    Args:
        run: the run; its ``meta`` must be builtins.
        path: of the file, by convention ``.npz``; folders are made.

    Raises:
        RunError: the file can't be written, or ``meta`` is not builtins.
    """
    path = Path(path)
    arrays = {name: array for name in _ARRAYS if (array := getattr(run, name)) is not None}
    segments: list[Segment] = []
    header = {
        "format": FORMAT,
        "version": VERSION,
        "label": run.label,
        "dt": run.dt,
        "agents": [[a.name, a.entrance, a.exit, a.turn.value] for a in run.agents],
        "junction": _junction(run.junction, segments),
        "collisions": None if run.collisions is None else [[c.time, *c.agents, c.speed] for c in run.collisions],
        "fault": run.fault and [run.fault.time, run.fault.agent, run.fault.reason],
        "facts": asdict(run.facts),
        "meta": dict(run.meta),
    }
    try:
        text = json.dumps(header, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RunError(f"run {run.label!r} can't be kept: {error}") from error
    arrays["header"] = np.frombuffer(text.encode(), dtype=np.uint8)
    arrays |= {f"segment_{k}": s.points for k, s in enumerate(segments)}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as out:
            np.savez_compressed(out, **arrays)
    except OSError as error:
        raise RunError(f"{path}: can't be written: {error.strerror}") from error


def _junction(junction: Junction, segments: list[Segment]) -> dict[str, Any]:
    def put(segment: Segment) -> list[Any]:
        segments.append(segment)
        return [len(segments) - 1, segment.id, segment.turn.value, segment.junction]

    found: dict[str, Any] = {
        "name": junction.name,
        "id": junction.id,
        "control": junction.control.value,
        "movements": [[m.entrance, m.exit, m.turn.value, m.length, m.segment] for m in junction.movements.values()],
        "right_of": sorted(map(list, junction.right_of)),
        "opposite": sorted(map(list, junction.opposite)),
        "phase_groups": [sorted(g) for g in junction.phase_groups],
        "setbacks": list(junction.setbacks),
        "left_hand": junction.left_hand,
        "geometry": None,
    }
    geometry = junction.geometry
    if geometry is not None:
        found["geometry"] = {
            "approaches": [put(s) for s in geometry.approaches],
            "movements": [[*way, *put(s)] for way, s in geometry.movements.items()],
            "exits": [put(s) for s in geometry.exits],
            "lane_width": geometry.lane_width,
        }
    return found


def load_run(path: str | Path) -> Run:
    """Read a run that `save_run` wrote.

    Raises:
        RunError: not such a file, a damaged one, or one of a later version.
    """
    path = Path(path)
    try:
        # Opened here, as np.load leaves a file open that is no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except OSError as error:
        raise RunError(f"{path}: can't be read: {error.strerror or error}") from error
    except (ValueError, zipfile.BadZipFile, EOFError, KeyError) as error:
        raise RunError(f"{path}: not a run kept by rvads: {error}") from error
    try:
        header = json.loads(bytes(arrays["header"]).decode())
        if header["format"] != FORMAT:
            raise RunError(f"{path}: not a run kept by rvads: its format is {header['format']!r}")
        if header["version"] != VERSION:
            raise RunError(f"{path}: written in version {header['version']} of the format, this library reads version {VERSION}")
        check_header(header)
        for name, (dimensions, kind) in _ARRAYS.items():
            if name in arrays and (arrays[name].ndim, arrays[name].dtype.kind) != (dimensions, kind):
                what = "whole numbers" if kind == "i" else "numbers"
                raise ValueError(f"{name} must be {what} in {dimensions} dimensions")
        return _run(header, arrays)
    except (KeyError, TypeError, ValueError, OverflowError, MapError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(f"{path}: damaged: {what}") from error


def _run(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Run:
    fault, hits, facts = header["fault"], header["collisions"], header["facts"]
    sizes = facts.get("sizes")
    return Run(
        header["label"],
        _load_junction(header["junction"], arrays),
        tuple(Agent(name, entrance, leaving, Turn(turn)) for name, entrance, leaving, turn in header["agents"]),
        arrays["zone"],
        arrays["lights"],
        header["dt"],
        arrays.get("station"),
        arrays.get("speed"),
        arrays.get("pose"),
        arrays.get("controls"),
        hits if hits is None else tuple(Collision(time, (one, two), speed) for time, one, two, speed in hits),
        Fault(*fault) if fault else None,
        Facts(
            facts.get("subject"),
            sizes and tuple((length, width) for length, width in sizes),
            facts.get("speed_limit"),
            tuple(facts.get("strayed") or ()),
        ),
        header["meta"],
    )


def _load_junction(record: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Junction:
    def get(entry: list[Any]) -> Segment:
        number, name, turn, junction = entry
        return Segment(name, arrays[f"segment_{number}"], Turn(turn), junction)

    geometry = None
    if record["geometry"]:
        lines = record["geometry"]
        geometry = Geometry(
            tuple(get(e) for e in lines["approaches"]),
            {(entrance, leaving): get(rest) for entrance, leaving, *rest in lines["movements"]},
            tuple(get(e) for e in lines["exits"]),
            lines["lane_width"],
        )
    movements = [
        Movement(entrance, leaving, Turn(turn), length, name) for entrance, leaving, turn, length, name in record["movements"]
    ]
    return Junction(
        record["name"],
        record["id"],
        JunctionControl(record["control"]),
        {(m.entrance, m.exit): m for m in movements},
        frozenset((a, b) for a, b in record["right_of"]),
        frozenset((a, b) for a, b in record["opposite"]),
        tuple(frozenset(g) for g in record["phase_groups"]),
        tuple(record["setbacks"]),
        record["left_hand"],
        geometry,
    )
