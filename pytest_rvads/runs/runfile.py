"""The project's own file of a run: an npz archive with a JSON header, versioned.

Entries: ``header`` (UTF-8 bytes of JSON, see `_Header`), ``zone``, ``lights``, those of ``station``, ``speed``, ``pose``,
``controls`` that the run holds, with the shapes and units of `Run`, and ``line_<k>``: the centre lines that the header refers
to, shape ``(points, 2)`` [m]. Nothing is pickled.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.errors import MapError, RunError, require
from pytest_rvads.junctions.junction import Entrance, Exit, Junction, Movement
from pytest_rvads.maps.control import Sign
from pytest_rvads.maps.segment import Segment, Turn
from pytest_rvads.runs.run import Collision, Facts, Fault, Positive, Run
from pytest_rvads.runs.states import Agent, Kind
from pytest_rvads.storage import write_file

__all__ = ["FORMAT", "VERSION", "load_run", "save_run"]

FORMAT, VERSION = "rvads-run", 3
_ARRAYS = {"zone": (2, "i"), "lights": (2, "i"), "station": (2, "f"), "speed": (2, "f"), "pose": (3, "f"), "controls": (3, "f")}
"""The arrays of a run: how many dimensions they have, and of which kind of numbers."""
_Count = Annotated[int, msgspec.Meta(ge=0)]


class _Line(msgspec.Struct, frozen=True):
    """A centre line: the number of its array, and what its segment says of itself."""

    number: _Count
    id: str
    turn: Turn
    junction: str | None


class _Entrance(msgspec.Struct, frozen=True):
    arm: _Count
    lane: _Count
    sign: Sign
    phase: _Count | None
    setback: float
    approach: _Line | None


class _Exit(msgspec.Struct, frozen=True):
    arm: _Count
    lane: _Count
    road: _Line | None


class _Movement(msgspec.Struct, frozen=True):
    entrance: _Count
    exit: _Count
    turn: Turn
    length: float
    segment: str
    path: _Line | None


class _Junction(msgspec.Struct, frozen=True):
    name: str
    id: str
    entrances: list[_Entrance]
    exits: list[_Exit]
    movements: list[_Movement]
    right_of: list[tuple[_Count, _Count]]
    opposite: list[tuple[_Count, _Count]]
    left_hand: bool
    lane_width: Positive


class _Agent(msgspec.Struct, frozen=True):
    name: str
    route: tuple[_Count, _Count]
    """Entrance and exit."""
    kind: Kind
    size: tuple[Positive, Positive] | None


class _Header(msgspec.Struct, frozen=True):
    format: str
    version: int
    label: str
    dt: float
    agents: list[_Agent]
    junction: _Junction
    collisions: list[Collision] | None
    fault: Fault | None
    facts: Facts
    provenance: dict[str, Any]


def save_run(run: Run, path: str | Path) -> None:
    """Write a run; equal runs give equal files.

    Args:
        run: the run; its ``provenance`` must be builtins.
        path: of the file, by convention ``.npz``; folders are made.

    Raises:
        RunError: the file can't be written, or ``provenance`` is not builtins.
    """
    require(run, Run, "save_run takes a run, such as rvads.simulate(case) returns", RunError)
    path = Path(path)
    arrays = {name: array for name in _ARRAYS if (array := getattr(run, name)) is not None}
    lines: list[Segment] = []
    header = _Header(
        FORMAT,
        VERSION,
        run.label,
        run.dt,
        [_Agent(a.name, a.route.key, a.kind, a.size) for a in run.agents],
        _put(run.junction, lines),
        None if run.collisions is None else list(run.collisions),
        run.fault and replace(run.fault, detail=""),
        run.facts,
        {},
    )
    try:
        values = msgspec.to_builtins(header) | {"provenance": dict(run.provenance)}
        text = json.dumps(values, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RunError(f"run {run.label!r} can't be kept: {error}") from error
    arrays["header"] = np.frombuffer(text.encode(), dtype=np.uint8)
    arrays |= {f"line_{k}": line.points for k, line in enumerate(lines)}
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    try:
        write_file(path, content.getvalue())
    except OSError as error:
        raise RunError(f"{path}: can't be written: {error.strerror}") from error


def _put(junction: Junction, lines: list[Segment]) -> _Junction:
    def put(line: Segment | None) -> _Line | None:
        if line is None:
            return None
        lines.append(line)
        return _Line(len(lines) - 1, line.id, line.turn, line.junction)

    return _Junction(
        junction.name,
        junction.id,
        [_Entrance(e.arm, e.lane, e.sign, e.phase, e.setback, put(e.approach)) for e in junction.entrances],
        [_Exit(e.arm, e.lane, put(e.road)) for e in junction.exits],
        [_Movement(*m.key, m.turn, m.length, m.segment, put(m.path)) for m in junction.movements.values()],
        sorted(junction.right_of),
        sorted(junction.opposite),
        junction.left_hand,
        junction.lane_width,
    )


def load_run(path: str | Path) -> Run:
    """Read a run that `save_run` wrote.

    Raises:
        RunError: not such a file, a damaged one, or one of another version.
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
        head = msgspec.json.decode(bytes(arrays["header"]), type=dict[str, Any])
        if head.get("format") != FORMAT:
            raise RunError(f"{path}: not a run kept by rvads: its format is {head.get('format')!r}")
        if head.get("version") != VERSION:
            raise RunError(
                f"{path}: written in version {head.get('version')} of the format, this library reads version {VERSION}"
            )
        for name, (dimensions, kind) in _ARRAYS.items():
            if name in arrays and (arrays[name].ndim, arrays[name].dtype.kind) != (dimensions, kind):
                what = "whole numbers" if kind == "i" else "numbers"
                raise ValueError(f"{name} must be {what} in {dimensions} dimensions")
        return _run(msgspec.convert(head, _Header), arrays)
    except (KeyError, ValueError, MapError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise RunError(f"{path}: damaged: {what}") from error


def _run(header: _Header, arrays: Mapping[str, NDArray[Any]]) -> Run:
    junction = _get(header.junction, arrays)
    agents = []
    for agent in header.agents:
        if agent.route not in junction.movements:
            raise ValueError(
                f"{agent.name} goes from entrance {agent.route[0]} to exit {agent.route[1]}, where no movement leads"
            )
        agents.append(Agent(agent.name, junction.movements[agent.route], agent.kind, agent.size))
    if header.facts.subject not in (None, *(agent.name for agent in agents)):
        raise ValueError(f"subject in facts must be one of the vehicles, got {header.facts.subject!r}")
    optional = {name: arrays.get(name) for name in ("station", "speed", "pose", "controls")}
    return Run(
        header.label,
        junction,
        tuple(agents),
        arrays["zone"],
        arrays["lights"],
        header.dt,
        **optional,
        collisions=None if header.collisions is None else tuple(header.collisions),
        fault=header.fault,
        facts=header.facts,
        provenance=header.provenance,
    )


def _get(record: _Junction, arrays: Mapping[str, NDArray[Any]]) -> Junction:
    def get(line: _Line | None) -> Segment | None:
        return None if line is None else Segment(line.id, arrays[f"line_{line.number}"], line.turn, line.junction)

    movements = [Movement(m.entrance, m.exit, m.turn, m.length, m.segment, get(m.path)) for m in record.movements]
    return Junction(
        record.name,
        record.id,
        tuple(Entrance(e.arm, e.lane, e.sign, e.phase, e.setback, get(e.approach)) for e in record.entrances),
        tuple(Exit(e.arm, e.lane, get(e.road)) for e in record.exits),
        {m.key: m for m in movements},
        frozenset(record.right_of),
        frozenset(record.opposite),
        record.left_hand,
        record.lane_width,
    )
