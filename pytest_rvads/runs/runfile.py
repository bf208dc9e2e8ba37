"""The files of runs and of recordings: npz archives with a JSON header and a version. Nothing is pickled.

Entries of both are ``header`` (UTF-8 bytes of JSON), and ``line_<k>``, the centre lines to which the header refers, shape
``(points, 2)`` [m]. The file of a run, see `_RunHeader`, has ``zone``, ``lights``, and, if the run has these arrays, ``station``,
``speed``, ``pose``, ``controls`` and ``spread``, in the shapes and units of `Run`. The file of a recording, see
`_RecordingHeader`, has ``times``, ``station``, ``speed`` and ``pose`` with the samples of all tracks one after another, in the
shapes and units of `Track`; ``spread`` has the samples of the tracks with a spread, ``light_times`` and ``light_colours`` have
the changes of all lights.
"""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from dataclasses import replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import Segment
from pytest_rvads.runs.archive import (
    FARTHEST,
    MOST_BYTES,
    Count,
    Exits,
    JunctionRecord,
    Kept,
    Key,
    Name,
    Size,
    Step,
    check_array,
    check_size,
    check_ways,
    get_junction,
    peek,
    put_junction,
)
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import ARRAYS, PARTS, Collision, Excerpt, Facts, Fault, Run
from pytest_rvads.runs.states import Agent, Colour, Kind
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import MapError, RunError, require
from pytest_rvads.support.wording import one_line

_MOST = 2**21
"""Largest part of a header that `glance` reads [bytes]."""
_ARRAYS = {name: "i" if name in ("zone", "lights") else "f" for name in (*ARRAYS, "spread")}
"""Per array of a run the kind of its numbers: whole numbers (``i``) or floats (``f``)."""
RUN = Kept("run", "rvads-run", 3, MOST_BYTES, 2**20)


class _Agent(msgspec.Struct, frozen=True, omit_defaults=True):
    name: Name
    route: Key
    """Entrance and exit."""
    kind: Kind
    size: tuple[Size, Size] | None
    other_exits: Exits = ()


class _RunHeader(msgspec.Struct, frozen=True):
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
    header = _RunHeader(
        RUN.format,
        RUN.version,
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
    typed(values, _RunHeader, f"run {run.label!r} can't be kept", RunError)
    check_size(f"run {run.label!r} can't be kept", [(run.steps, len(run.agents), len(run.junction.starts))])
    RUN.write(run.label, path, text, arrays, lines)


def load_run(path: str | Path) -> Run:
    """Read a run that `save_run` wrote.

    Raises:
        RunError: the file holds no run, is damaged, is too large, or is of another version.
    """
    path = Path(path)
    return RUN.read(path, _RunHeader, lambda header, arrays: _run(header, arrays, path))


def _run(header: _RunHeader, arrays: Mapping[str, NDArray[Any]], path: Path) -> Run:
    steps, *_ = arrays["zone"].shape or (0,)
    starts, names = header.junction.starts, [agent.name for agent in header.agents]
    check_size(str(path), [(steps, len(names), starts)])
    each = (steps, len(names))
    shapes = {"lights": (steps, starts)} | {name: (*each, len(parts)) for name, parts in PARTS.items()}
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
    optional = {name: arrays.get(name) for name, kind in _ARRAYS.items() if kind == "f"}
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
        if (head.format, head.version) != (RUN.format, RUN.version):
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


RECORDING = Kept("recording", "rvads-recording", 1, most_bytes=2**30, most_header=2**26)
"""The file format of a recording; the largest file has room for ten million samples."""
_MOST_TRACKS = 200_000
_LONGEST = 1e5
"""Longest time from the first to the last sample of a vehicle [s]: more than a day."""
_SAMPLES = {"times": (), "station": (), "speed": (), "pose": (3,), "spread": (), "light_times": (), "light_colours": ()}
"""Per array, the shape of one entry, such as the pose of a sample."""
_Accuracy = Annotated[float, msgspec.Meta(ge=0.0, le=100.0)]
_Samples = Annotated[int, msgspec.Meta(ge=2, le=100_000_000)]


class _Track(msgspec.Struct, frozen=True, omit_defaults=True):
    name: Name
    route: Key
    """Entrance and exit."""
    kind: Kind
    size: tuple[Size, Size] | None
    samples: _Samples
    spread: bool
    """Whether the file has the spread of the track."""
    offset: Annotated[float, msgspec.Meta(ge=0.0, le=1e4)]
    other_exits: Exits = ()


class _Light(msgspec.Struct, frozen=True):
    entrance: Count
    changes: Annotated[int, msgspec.Meta(ge=0, le=10_000_000)]


class _RecordingHeader(msgspec.Struct, frozen=True):
    format: str
    version: int
    label: Name
    dt: Step
    tracks: Annotated[list[_Track], msgspec.Meta(max_length=_MOST_TRACKS)]
    junction: JunctionRecord
    lights: list[_Light]
    facts: Facts
    position_accuracy: _Accuracy
    speed_accuracy: _Accuracy
    left_out: list[tuple[str, str]]


def save_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording; equal recordings give equal files.

    Args:
        recording: the recording.
        path: path of the file, by convention ``.npz``; missing folders are created.

    Raises:
        RunError: the file can't be written, or the recording is larger than `load_recording` allows.
    """
    require(recording, Recording, "save_recording takes a recording, such as rvads.files.read_tracks returns", RunError)
    path, tracks = Path(path), recording.tracks
    lines: list[Segment] = []
    header = _RecordingHeader(
        RECORDING.format,
        RECORDING.version,
        recording.label,
        recording.dt,
        [
            _Track(a.name, a.way.key, a.kind, a.size, len(t.times), t.spread is not None, t.offset, a.other_exits)
            for t in tracks
            for a in (t.agent,)
        ],
        put_junction(recording.junction, lines),
        [_Light(entrance, len(changes.times)) for entrance, changes in recording.lights.items()],
        recording.facts,
        recording.position_accuracy,
        recording.speed_accuracy,
        list(recording.left_out),
    )
    values = msgspec.to_builtins(header)
    typed(values, _RecordingHeader, f"recording {one_line(recording.label, 60)!r} can't be kept", RunError)
    text = json.dumps(values, sort_keys=True)
    lights = list(recording.lights.values())
    arrays: dict[str, Any] = {
        "times": _joined([t.times for t in tracks]),
        "station": _joined([t.station for t in tracks]),
        "speed": _joined([t.speed for t in tracks]),
        "pose": _joined([t.pose for t in tracks], (0, 3)),
        "spread": _joined([t.spread for t in tracks if t.spread is not None]),
        "light_times": _joined([light.times for light in lights]),
        "light_colours": _joined([light.colours for light in lights]).astype(np.int8),
    }
    RECORDING.write(recording.label, path, text, arrays, lines)


def _joined(parts: list[NDArray[Any]], empty: tuple[int, ...] = (0,)) -> NDArray[Any]:
    return np.concatenate(parts) if parts else np.zeros(empty)


def load_recording(path: str | Path) -> Recording:
    """Read a recording that `save_recording` wrote.

    Raises:
        RunError: the file holds no recording, is damaged, is too large, or is of another version.
    """
    return RECORDING.read(Path(path), _RecordingHeader, _recording)


def _recording(header: _RecordingHeader, arrays: Mapping[str, NDArray[Any]]) -> Recording:
    samples = [track.samples for track in header.tracks]
    lengths = dict.fromkeys(("times", "station", "speed", "pose"), sum(samples))
    lengths["spread"] = sum(track.samples for track in header.tracks if track.spread)
    lengths |= dict.fromkeys(("light_times", "light_colours"), sum(light.changes for light in header.lights))
    for name, length in lengths.items():
        array, kind, limit = arrays[name], "i" if name == "light_colours" else "f", 1e12 if "times" in name else FARTHEST
        check_array(name, array, (length, *_SAMPLES[name]), kind)
        if kind == "f" and not (np.abs(array) <= limit).all():
            raise ValueError(f"{name} holds numbers beyond {limit:g}, or NaN")
        if name == "spread" and (array < 0.0).any():
            raise ValueError("spread holds numbers below 0")
    junction = get_junction(header.junction, arrays)
    if not junction.drivable:
        raise ValueError("its junction has no centre lines")
    names = [track.name for track in header.tracks]
    if len(set(names)) < len(names):
        raise ValueError("two of its vehicles have the same name")
    if header.facts.subject not in (None, *names):
        raise ValueError(f"subject in facts must be one of the vehicles, got {header.facts.subject!r}")
    spreads = iter(_parts(arrays["spread"], [track.samples for track in header.tracks if track.spread]))
    parts = {name: _parts(arrays[name], samples) for name in ("times", "station", "speed", "pose")}
    tracks = []
    for k, record in enumerate(header.tracks):
        times, station, speed, pose = (parts[name][k] for name in ("times", "station", "speed", "pose"))
        if (np.diff(times) <= 0.0).any() or times[-1] - times[0] > _LONGEST:
            raise ValueError(f"the times of {record.name} must increase, and by at most {_LONGEST:g} s")
        check_ways(junction, record.name, record.route, record.other_exits)
        agent = Agent(record.name, junction.every_way[record.route], record.kind, record.size, record.other_exits)
        tracks.append(Track(agent, times, station, speed, pose, next(spreads) if record.spread else None, record.offset))
    for key in {track.route for track in header.tracks}:
        itinerary(junction, *key)  # raises an error about lanes that do not meet
    changes = [light.changes for light in header.lights]
    lights = {}
    for light, times, colours in zip(
        header.lights, _parts(arrays["light_times"], changes), _parts(arrays["light_colours"], changes), strict=True
    ):
        if light.entrance >= len(junction.starts) or (np.diff(times) <= 0.0).any() or not np.isin(colours, [*Colour]).all():
            raise ValueError(
                f"the light of entrance {light.entrance} must have an existing entrance, increasing times and valid colours"
            )
        lights[light.entrance] = Changes(times, colours)
    return Recording(
        header.label,
        junction,
        tuple(tracks),
        lights,
        header.facts,
        header.position_accuracy,
        header.speed_accuracy,
        header.dt,
        tuple(header.left_out),
    )


def _parts(array: NDArray[Any], lengths: list[int]) -> list[NDArray[Any]]:
    return [array[begin:end] for begin, end in pairwise(accumulate(lengths, initial=0))]
