"""Reads tracks from OpenSCENARIO XML: vehicles and pedestrians, trajectories with times, and the colours of traffic lights."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.openscenario.xosctree import Node, read_tree
from pytest_rvads.satellites.tracks.facing import with_headings
from pytest_rvads.satellites.tracks.importing import recordings_in
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.logformats import Format
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import RunError

LAMPS = {Colour.NONE: "off;off;off", Colour.RED: "on;off;off", Colour.YELLOW: "off;on;off", Colour.GREEN: "off;off;on"}
"""Per colour, the state of a light in a written file: the lamps from top to bottom, which are red, yellow and green."""
_COLOUR_OF_STATE = {lamps: colour for colour, lamps in LAMPS.items()}
_COLOUR_OF_STATE |= {
    "on;on;off": Colour.RED,
    "off": Colour.NONE,
    "red": Colour.RED,
    "yellow": Colour.YELLOW,
    "green": Colour.GREEN,
}
_MOST_CHANGES = 1_000_000
"""Largest number of phases of a signal controller that are read up to the end of the run."""
_COLUMNS = {"time": "time", "heading": "h", "size": "Dimensions"}


@dataclass(frozen=True, slots=True)
class Entity:
    """A declared vehicle or pedestrian."""

    name: str
    kind: Kind
    size: tuple[float, float] | None
    """Length and width [m]; None for an entity that is declared in a catalogue, or whose size was unknown at the export."""
    ahead: float | None
    """Distance from the reference point, the middle of the rear axle, to the front [m]; None for an entity of a catalogue."""


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryFile:
    """The content of a file with trajectories."""

    entities: tuple[Entity, ...]
    ways: Mapping[str, NDArray[np.float64]]
    """Vertices of the trajectory by name of the entity, each of shape ``(vertices, 5)``; `VERTEX` names the columns."""
    reasons: Mapping[str, str]
    """By name of an entity without a readable trajectory, the reason, in words that follow the name and a colon."""
    lights: Mapping[str, Changes]
    """Changes of colour by id of the signal."""
    map: Path | None
    """Path of the OpenDRIVE file; the file names the map by a path relative to its own folder. None if it names no map."""


def read_xosc(path: Path, columns: Mapping[str, str] | None, *, strict: bool, watch: Watch | None) -> Log:
    """Return the tracks of the vehicles in a file, the colours of its traffic lights, and the map that the file names.

    The positions of a vehicle are the positions of the middle of its rear axle. The bounding box in the file gives the distance
    from the rear axle to the front.
    """
    if columns:
        raise RunError(f"{path.name}: OpenSCENARIO has fixed attributes, leave --columns out")
    file = read_trajectories(path, watch)
    if not file.ways:
        raise RunError(
            f"{path.name}: no vehicle follows a trajectory, expected a run: rvads.files.load_scenario reads files of scenarios"
        )
    gather = Gather(path.name, _COLUMNS, strict=strict)
    for entity in file.entities:
        way = file.ways.get(entity.name)
        if way is not None and len(way):
            gather.extend(entity.name, way[:, 0].astype(np.int64), np.column_stack((way[:, 1:], np.full(len(way), np.nan))))
            gather.describe(entity.name, entity.size, entity.kind, entity.ahead)
    gather.lights = dict(file.lights)
    log = gather.log()
    return replace(log, refused=(*log.refused, *file.reasons.items()), map=file.map)


def read_trajectories(path: Path, watch: Watch | None = None) -> TrajectoryFile:
    """Return the vehicles, trajectories, lights and map of a file."""
    root = read_tree(path, watch)
    note = note_of(root, "run")  # of an exported run; it lists the vehicles of unknown size
    place = f"{path.name}: the property rvads.run"
    unsized = [] if note is None else decode(note.encode(), _Note, place, RunError).unsized
    entities = [replace(entity, size=None) if entity.name in unsized else entity for entity in entities_of(root)]
    ways: dict[str, list[NDArray[np.float64]]] = {entity.name: [] for entity in entities}
    reasons: dict[str, str] = {}
    for name, action, trigger in _trajectory_actions(root):
        line, timing = action.first("Polyline"), action.first("TimeReference", "Timing")
        if name not in ways:
            raise action.refused(f"is for {name!r:.60}, which is no vehicle of this file")
        if line is None:
            reasons[name] = "its trajectory is no polyline, and only polylines are read"
        elif timing is None or bool(np.isnan(line.points()[:, 1]).any()):
            reasons[name] = "its trajectory has no times"
        else:
            start, points = 0.0, line.points()
            if trigger is not None and timing.attributes.get("domainAbsoluteRelative") == "relative":
                begins = trigger.first("SimulationTimeCondition")
                if begins is None:
                    raise trigger.refused("has no <SimulationTimeCondition>, expected the time at which the trajectory begins")
                start = begins.number("value")
            # The times are counted from the beginning of the simulation.
            points[:, 1] = start + timing.number("offset", 0.0) + timing.number("scale", 1.0) * points[:, 1]
            ways[name].append(points)
    trajectories = {name: np.vstack(parts) for name, parts in ways.items() if parts and name not in reasons}
    all_reasons = {name: reasons.get(name, "it follows no trajectory") for name in ways if name not in trajectories}
    end = max((float(way[-1, 1]) for way in trajectories.values() if len(way)), default=0.0)
    return TrajectoryFile(tuple(entities), trajectories, all_reasons, lights_of(root, end), map_of(root, path))


class _Note(msgspec.Struct):
    unsized: list[str] = []


def note_of(root: Node, subject: str) -> str | None:
    """Return the note of a file that this package exported, as JSON; None for other files."""
    header = root.first("FileHeader")
    properties = () if header is None else header.walk("Property")
    return next((node.text("value") for node in properties if node.attributes.get("name") == f"rvads.{subject}"), None)


def map_of(root: Node, path: Path) -> Path | None:
    """Return the path of the OpenDRIVE file that a file at `path` names; None if the file names no map."""
    logic = root.first("RoadNetwork", "LogicFile")
    return None if logic is None else path.parent / logic.text("filepath").replace("\\", "/")


def entities_of(root: Node) -> list[Entity]:
    """Return the declared entities, without objects that can't move by themselves."""
    entities = []
    for node in root.walk("ScenarioObject"):
        body = next(node.walk("Vehicle", "Pedestrian", "CatalogReference"), None)
        if body is None:
            continue
        kind = kind_of(f"{body.tag} {body.attributes.get('vehicleCategory', '')} {body.attributes.get('entryName', '')}")
        centre, box = body.first("BoundingBox", "Center"), body.first("BoundingBox", "Dimensions")
        size = ahead = None
        if centre is not None and box is not None:
            size = box.number("length"), box.number("width")
            ahead = centre.number("x") + size[0] / 2
        entities.append(Entity(node.text("name"), kind, size, ahead))
    return entities


def _trajectory_actions(root: Node) -> Iterator[tuple[str, Node, Node | None]]:
    """Yield the entity, the action, and the trigger of the event of each trajectory; None as the trigger of an initial action."""
    for private in root.walk("Private"):
        for action in private.walk("FollowTrajectoryAction"):
            yield private.text("entityRef"), action, None
    for group in root.walk("ManeuverGroup"):
        actors = [node.text("entityRef") for node in group.walk("EntityRef")]
        for event in group.walk("Event"):
            for action in event.walk("FollowTrajectoryAction"):
                for name in actors:
                    yield name, action, event.first("StartTrigger")


def lights_of(root: Node, end: float) -> dict[str, Changes]:
    """Return the changes of colour of each signal, by its id, up to the time `end` [s]; a controller repeats its phases."""
    colours_by_signal: dict[str, list[tuple[float, Colour]]] = {}
    state_count = 0
    for controller in root.walk("TrafficSignalController"):
        phases: list[tuple[float, dict[str, Colour]]] = []
        for phase in controller.walk("Phase"):
            phases.append((phase.number("duration"), {}))
            for state in phase.walk("TrafficSignalState"):
                name, lamps = state.text("trafficSignalId"), state.text("state").replace(" ", "").lower()
                if lamps not in _COLOUR_OF_STATE:
                    expected = "red, yellow, green, off, or three lamps such as 'on;off;off'"
                    raise state.refused(f"has the state {lamps!r:.60}, expected {expected}")
                phases[-1][1][name] = _COLOUR_OF_STATE[lamps]
        time, total = controller.number("delay", 0.0), math.fsum(duration for duration, _ in phases)
        if not phases:
            continue
        if min(duration for duration, _ in phases) < 0.0 or not end * len(phases) < _MOST_CHANGES * total:
            raise controller.refused(f"has phases of {total:g} s together, expected positive durations")
        for duration, states in cycle(phases):
            if time > end:
                break
            state_count += 1 + len(states)
            limit_lights(state_count, len(colours_by_signal), controller.where)
            for name, colour in states.items():
                earlier_colours = colours_by_signal.setdefault(name, [])
                if not earlier_colours or earlier_colours[-1][1] is not colour:
                    earlier_colours.append((round(time, 9), colour))
            time += duration
    return changes_of(colours_by_signal)


def read_played(path: str | Path) -> Sequence[Run]:
    """Return the runs into which the traffic of a file is cut, at all junctions of the named map that vehicles pass."""
    log = read_xosc(Path(path), None, strict=False, watch=None)
    recordings = recordings_in(with_headings(log), FORMAT.point)
    return recordings[0] if len(recordings) == 1 else [run for recording in recordings for run in recording]


FORMAT = Format(read_xosc, (".xosc",), "rear_axle", with_map=True)
