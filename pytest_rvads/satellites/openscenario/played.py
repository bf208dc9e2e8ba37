"""What an OpenSCENARIO file says about who is there, on which trajectories, and what the lights show."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.decoding import decode
from pytest_rvads.errors import RunError
from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.openscenario.xosctree import Node, read_tree
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.samples import kind_of
from pytest_rvads.satellites.tracks.source import Watch

__all__ = ["LAMPS", "Entity", "Played", "entities_of", "lights_of", "map_of", "no_trajectories", "note_of", "played"]

LAMPS = {Colour.NONE: "off;off;off", Colour.RED: "on;off;off", Colour.YELLOW: "off;on;off", Colour.GREEN: "off;off;on"}
"""How the state of a light is written: its lamps from above, red, yellow, green."""
_COLOUR = {lamps: colour for colour, lamps in LAMPS.items()}
_COLOUR |= {"on;on;off": Colour.RED, "off": Colour.NONE, "red": Colour.RED, "yellow": Colour.YELLOW, "green": Colour.GREEN}
_MOST_CHANGES = 1_000_000


@dataclass(frozen=True, slots=True)
class Entity:
    """A vehicle or pedestrian, as it is declared."""

    name: str
    kind: Kind
    size: tuple[float, float] | None
    """Length and width [m]; None where it is of a catalogue, or was not known when the file was exported."""
    ahead: float | None
    """How far ahead of its reference point, the middle of the rear axle, its front is [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """A file with trajectories."""

    where: str
    """Names it in messages."""
    entities: tuple[Entity, ...]
    """In the order of the file."""
    ways: Mapping[str, NDArray[np.float64]]
    """By name of an entity the vertices of its trajectories, shape ``(vertices, 5)``, see `xosctree.VERTEX`."""
    untold: Mapping[str, str]
    """For each entity without a trajectory the reason, as a sentence that begins with ``it``."""
    speeds: Mapping[str, float]
    """Initial speeds of the entities for which the file states a speed [m/s]."""
    lights: Mapping[str, Changes]
    """Colour changes by id of the signal."""
    map: Path | None
    """The OpenDRIVE file that the scenario names, relative to the scenario's folder."""
    note: str | None
    """What an export of ours says beside, as JSON; None of the files of others."""


def played(path: Path, watch: Watch | None = None) -> Played:
    """Read a file.

    Raises:
        RunError: it can't be read; the message names file, line and element.
    """
    root = read_tree(path, watch)
    unsized = _unsized(root, path.name)
    entities = [replace(entity, size=None) if entity.name in unsized else entity for entity in entities_of(root)]
    ways: dict[str, list[NDArray[np.float64]]] = {entity.name: [] for entity in entities}
    untold: dict[str, str] = {}
    for name, action, trigger in _following(root):
        line, timing = action.first("Polyline"), action.first("TimeReference", "Timing")
        if name not in ways:
            raise action.refused(f"is for {name!r:.60}, which is no vehicle of this file")
        if line is None:
            untold[name] = "its trajectory is no polyline, which alone is read"
        elif timing is None or bool(np.isnan(line.points()[:, 1]).any()):
            untold[name] = "its trajectory has no times"
        else:
            ways[name].append(_timed(line.points(), timing, trigger))
    found = {name: np.vstack(parts) for name, parts in ways.items() if parts and name not in untold}
    told = {name: untold.get(name, "it follows no trajectory") for name in ways if name not in found}
    end = max((float(way[-1, 1]) for way in found.values() if len(way)), default=0.0)
    return Played(
        path.name, tuple(entities), found, told, _speeds(root), lights_of(root, end), map_of(root, path), note_of(root, "run")
    )


class _Excerpt(msgspec.Struct):
    unsized: list[str] = []


def _unsized(root: Node, where: str) -> list[str]:
    """Return who has a box only because there must be one, as an export of an excerpt says."""
    note = note_of(root, "excerpt")
    return [] if note is None else decode(note.encode(), _Excerpt, f"{where}: the property rvads.excerpt", RunError).unsized


def note_of(root: Node, what: str) -> str | None:
    """Return what an export of ours says of the run or scenario, as JSON; None where it is somebody else's."""
    header = root.first("FileHeader")
    properties = () if header is None else header.walk("Property")
    return next((node.text("value") for node in properties if node.attributes.get("name") == f"rvads.{what}"), None)


def map_of(root: Node, path: Path) -> Path | None:
    """Return the OpenDRIVE file that a file names, from beside it."""
    logic = root.first("RoadNetwork", "LogicFile")
    return None if logic is None else path.parent / logic.text("filepath").replace("\\", "/")


def entities_of(root: Node) -> list[Entity]:
    """Return who is declared, but for objects that do not move by themselves."""
    found = []
    for node in root.walk("ScenarioObject"):
        body = next(node.walk("Vehicle", "Pedestrian", "CatalogReference"), None)
        if body is None:
            continue
        kind = kind_of(f"{body.tag} {body.attributes.get('vehicleCategory', '')} {body.attributes.get('entryName', '')}")
        centre, box = body.first("BoundingBox", "Center"), body.first("BoundingBox", "Dimensions")
        if centre is None or box is None:
            found.append(Entity(node.text("name"), kind, None, None))
        else:
            length, width = box.number("length"), box.number("width")
            found.append(Entity(node.text("name"), kind, (length, width), centre.number("x") + length / 2))
    return found


def _following(root: Node) -> Iterator[tuple[str, Node, Node | None]]:
    """Yield who is to follow a trajectory, the action, and what triggers it; None: it begins with the run."""
    for private in root.walk("Private"):
        for action in private.walk("FollowTrajectoryAction"):
            yield private.text("entityRef"), action, None
    for group in root.walk("ManeuverGroup"):
        actors = [node.text("entityRef") for node in group.walk("EntityRef")]
        for event in group.walk("Event"):
            for action in event.walk("FollowTrajectoryAction"):
                for name in actors:
                    yield name, action, event.first("StartTrigger")


def _timed(points: NDArray[np.float64], timing: Node, trigger: Node | None) -> NDArray[np.float64]:
    """Return the vertices of a trajectory with their times on the clock of the simulation."""
    start = 0.0
    if trigger is not None and timing.attributes.get("domainAbsoluteRelative") == "relative":
        begins = trigger.first("SimulationTimeCondition")
        if begins is None:
            raise trigger.refused("has no <SimulationTimeCondition>, so that nobody knows when the trajectory begins")
        start = begins.number("value")
    points[:, 1] = start + timing.number("offset", 0.0) + timing.number("scale", 1.0) * points[:, 1]
    return points


def _speeds(root: Node) -> dict[str, float]:
    found = {}
    for private in root.walk("Private"):
        target = private.first("SpeedAction", "AbsoluteTargetSpeed")
        if target is not None:
            found[private.text("entityRef")] = target.number("value")
    return found


def lights_of(root: Node, end: float) -> dict[str, Changes]:
    """Return what the signals of all controllers show up to a time [s]; controllers begin again when they are through.

    Raises:
        RunError: phases without a duration, or a state that is none.
    """
    shown: dict[str, list[tuple[float, Colour]]] = {}
    states_shown = 0
    for controller in root.walk("TrafficSignalController"):
        phases = [
            (
                phase.number("duration"),
                {s.text("trafficSignalId"): _colour(s) for s in phase.walk("TrafficSignalState")},
            )
            for phase in controller.walk("Phase")
        ]
        time, total = controller.number("delay", 0.0), math.fsum(duration for duration, _ in phases)
        if not phases:
            continue
        if min(duration for duration, _ in phases) < 0.0 or not end * len(phases) < _MOST_CHANGES * total:
            raise controller.refused(f"has phases of {total:g} s together, expected positive durations")
        for duration, states in cycle(phases):
            if time > end:
                break
            states_shown += 1 + len(states)
            limit_lights(states_shown, len(shown), controller.where)
            for name, colour in states.items():
                before = shown.setdefault(name, [])
                if not before or before[-1][1] is not colour:
                    before.append((round(time, 9), colour))
            time += duration
    return changes_of(shown)


def _colour(state: Node) -> Colour:
    said = state.text("state").replace(" ", "").lower()
    if said not in _COLOUR:
        raise state.refused(f"has the state {said!r:.60}, expected red, yellow, green, off, or three lamps such as 'on;off;off'")
    return _COLOUR[said]


def no_trajectories(where: str) -> RunError:
    """Return the error that nobody drives in a file."""
    return RunError(f"{where}: nobody in it follows a trajectory, it is a scenario to be driven: rvads.load_scenario reads it")
