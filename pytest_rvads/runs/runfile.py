"""The file of a run: an npz archive with a JSON header and a version.

Entries are ``header`` (UTF-8 bytes of JSON, see `_Header`), ``zone``, ``lights``, and, if the run has these arrays, ``station``,
``speed``, ``pose``, ``controls`` and ``spread``, in the shapes and units of `Run`. The entries ``line_<k>`` are the centre lines
to which the header refers, shape ``(points, 2)`` [m]. Nothing is pickled.
"""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.runs.archive import FARTHEST, MOST_BYTES, Kept, Name, Size, Step, check_array, check_size, peek
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.junctionfile import Exits, JunctionRecord, Key, check_ways, get_junction, put_junction
from pytest_rvads.runs.run import Collision, Excerpt, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Kind
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import MapError, RunError, require

_MOST = 2**21
"""Largest part of a header that `glance` reads [bytes]."""
FORMAT, VERSION = "rvads-run", 3
_ARRAYS = {"zone": "i", "lights": "i", "station": "f", "speed": "f", "pose": "f", "controls": "f", "spread": "f"}
"""Per array of a run the kind of its numbers: whole numbers (``i``) or floats (``f``)."""
_KEPT = Kept("run", FORMAT, VERSION, MOST_BYTES, 2**20)


class _Agent(msgspec.Struct, frozen=True, omit_defaults=True):
    name: Name
    route: Key
    """Entrance and exit."""
    kind: Kind
    size: tuple[Size, Size] | None
    other_exits: Exits = ()


class _Header(msgspec.Struct, frozen=True):
    format: str
    version: int
    label: Name
    dt: Step
    agents: list[_Agent]
    junction: JunctionRecord
    collisions: list[Collision] | None
    fault: Fault | None
    facts: Facts
    provenance: dict[str, Any]
    excerpt: Excerpt | None = None


def save_run(run: Run, path: str | Path) -> None:
    """Write a run; equal runs give equal files.

    Args:
        run: the run; its ``provenance`` must be builtins.
        path: path of the file, by convention ``.npz``; missing folders are created.

    Raises:
        RunError: the file can't be written, ``provenance`` is not builtins, or the run is larger than `load_run` allows.
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
        [_Agent(a.name, a.way.key, a.kind, a.size, a.other_exits) for a in run.agents],
        put_junction(run.junction, lines),
        None if run.collisions is None else list(run.collisions),
        run.fault and replace(run.fault, detail=""),
        run.facts,
        {},
        run.excerpt,
    )
    try:
        values = msgspec.to_builtins(header) | {"provenance": dict(run.provenance)}
        text = json.dumps(values, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise RunError(f"run {run.label!r} can't be kept: {error}") from error
    typed(values, _Header, f"run {run.label!r} can't be kept", RunError)
    check_size(f"run {run.label!r} can't be kept", [(run.steps, len(run.agents), len(run.junction.starts))])
    _KEPT.write(run.label, path, text, arrays, lines)


def load_run(path: str | Path) -> Run:
    """Read a run that `save_run` wrote.

    Raises:
        RunError: the file holds no run, is damaged, is too large, or is of another version.
    """
    path = Path(path)
    return _KEPT.read(path, _Header, lambda header, arrays: _run(header, arrays, path))


def _run(header: _Header, arrays: Mapping[str, NDArray[Any]], path: Path) -> Run:
    steps, *_ = arrays["zone"].shape or (0,)
    starts, names = header.junction.starts, [agent.name for agent in header.agents]
    check_size(str(path), [(steps, len(names), starts)])
    each = (steps, len(names))
    shapes = {"lights": (steps, starts), "pose": (*each, 3), "controls": (*each, 3)}
    for name, kind in _ARRAYS.items():
        if (array := arrays.get(name)) is not None:
            check_array(name, array, shapes.get(name, each), kind)
            if kind == "f" and (np.abs(array) > FARTHEST).any():
                raise ValueError(f"{name} holds numbers beyond {FARTHEST:g}")
    junction = get_junction(header.junction, arrays)
    agents = []
    for agent in header.agents:
        check_ways(junction, agent.name, agent.route, agent.other_exits)
        if junction.drivable:
            itinerary(junction, *agent.route)  # raises an error about lanes that do not meet
        agents.append(Agent(agent.name, junction.every_way[agent.route], agent.kind, agent.size, agent.other_exits))
    if len(set(names)) < len(names):
        raise ValueError(f"the names of vehicles must differ, got {reprlib.repr(names)}")
    if header.facts.subject not in (None, *names):
        raise ValueError(f"subject in facts must be one of the vehicles, got {header.facts.subject!r}")
    for collision in header.collisions or ():
        if not ({*collision.agents} <= {*names} and 0 <= round(collision.time / header.dt) < steps):
            raise ValueError(f"a collision must name vehicles of the run and a time within the run, got {collision}")
    optional = {name: arrays.get(name) for name in ("station", "speed", "pose", "controls", "spread")}
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
        excerpt=header.excerpt,
        provenance=header.provenance,
    )


def glance(path: Path) -> Junction | None:
    """Return the junction of a run that `save_run` wrote, without its centre lines, or None.

    Only the header of the file is read, so reading the junctions of a thousand runs takes a second. None means that the file
    holds no run or is damaged; the error of `load_run` says which.
    """
    try:
        head = msgspec.json.decode(peek(path, "header", _MOST), type=_Head)
        if (head.format, head.version) != (FORMAT, VERSION):
            return None
        record = structs.replace(
            head.junction,
            entrances=[structs.replace(entrance, approach=None) for entrance in head.junction.entrances],
            exits=[structs.replace(exit, road=None) for exit in head.junction.exits],
            movements=[structs.replace(movement, path=None) for movement in head.junction.movements],
        )
        return get_junction(record, {})
    except (msgspec.MsgspecError, KeyError, ValueError, MapError):
        return None


class _Head(msgspec.Struct, frozen=True):
    format: str
    version: int
    junction: JunctionRecord
