"""The file of a recording: an npz archive with a JSON header and a version.

Entries are ``header`` (UTF-8 bytes of JSON, see `_Header`), and ``times``, ``station``, ``speed`` and ``pose`` with the samples
of all tracks one after another, in the shapes and units of `Track`. ``spread`` has the samples of the tracks with a spread,
``light_times`` and ``light_colours`` have the changes of all lights. ``line_<k>`` are centre lines, as in the file of a run.
Nothing is pickled.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import Segment
from pytest_rvads.runs.archive import FARTHEST, Kept, Name, Size, Step, check_array
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.junctionfile import Count, Exits, JunctionRecord, Key, check_ways, get_junction, put_junction
from pytest_rvads.runs.recording import Changes, Recording, Track
from pytest_rvads.runs.run import Facts
from pytest_rvads.runs.states import Agent, Colour, Kind
from pytest_rvads.support.decoding import typed
from pytest_rvads.support.errors import RunError, require
from pytest_rvads.support.wording import one_line

FORMAT, VERSION = "rvads-recording", 1
_KEPT = Kept("recording", FORMAT, VERSION, most_bytes=2**30, most_header=2**26)
"""The file format of a recording; the largest file has room for ten million samples."""
_MOST_TRACKS = 200_000
_LONGEST = 1e5
"""Longest time from the first to the last sample of a vehicle [s]: more than a day."""
_ARRAYS = {"times": (), "station": (), "speed": (), "pose": (3,), "spread": (), "light_times": (), "light_colours": ()}
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


class _Header(msgspec.Struct, frozen=True):
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
    header = _Header(
        FORMAT,
        VERSION,
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
    typed(values, _Header, f"recording {one_line(recording.label, 60)!r} can't be kept", RunError)
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
    _KEPT.write(recording.label, path, text, arrays, lines)


def _joined(parts: list[NDArray[Any]], empty: tuple[int, ...] = (0,)) -> NDArray[Any]:
    return np.concatenate(parts) if parts else np.zeros(empty)


def load_recording(path: str | Path) -> Recording:
    """Read a recording that `save_recording` wrote.

    Raises:
        RunError: the file holds no recording, is damaged, is too large, or is of another version.
    """
    return _KEPT.read(Path(path), _Header, _recording)


def _recording(header: _Header, arrays: Mapping[str, NDArray[Any]]) -> Recording:
    samples = [track.samples for track in header.tracks]
    lengths = dict.fromkeys(("times", "station", "speed", "pose"), sum(samples))
    lengths["spread"] = sum(track.samples for track in header.tracks if track.spread)
    lengths |= dict.fromkeys(("light_times", "light_colours"), sum(light.changes for light in header.lights))
    for name, length in lengths.items():
        array, kind, limit = arrays[name], "i" if name == "light_colours" else "f", 1e12 if "times" in name else FARTHEST
        check_array(name, array, (length, *_ARRAYS[name]), kind)
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
