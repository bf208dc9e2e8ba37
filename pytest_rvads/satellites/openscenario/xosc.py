"""Reads OpenSCENARIO XML as a tree of elements, and its tracks: vehicles, pedestrians, trajectories with times, and lights.

The size of the tree is bounded. The vertices of a polyline are stored in an array. Parameters and expressions in attributes
(``$speed``, ``${$speed / 3.6}``) are replaced by their values.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from pytest_rvads.runs.recording import Changes
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Kind
from pytest_rvads.satellites.tracks.correcting import with_headings
from pytest_rvads.satellites.tracks.importing import recordings_in
from pytest_rvads.satellites.tracks.lightlog import changes_of, limit_lights
from pytest_rvads.satellites.tracks.logformats import Format
from pytest_rvads.satellites.tracks.samples import Gather, Log, kind_of
from pytest_rvads.satellites.tracks.source import Watch, opened
from pytest_rvads.support.decoding import decode
from pytest_rvads.support.errors import RunError
from pytest_rvads.support.storage import number_in, read_xml
from pytest_rvads.support.wording import one_line

_LONGEST_EXPRESSION, _LONGEST_NUMBER = 1000, 40
"""Greatest length of an expression, and of the value of a parameter inside of an expression [characters]."""
_PARAMETER = re.compile(r"\$(\w+)")
_OPERATORS: Mapping[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.And: lambda *values: all(values),
    ast.Or: lambda *values: any(values),
}
_FUNCTIONS: Mapping[str, Callable[..., float]] = {
    **{name: getattr(math, name) for name in ("floor", "ceil", "sqrt", "pow", "sin", "cos", "tan", "asin", "acos", "atan")},
    "round": lambda x: math.floor(x + 0.5),
    "sign": lambda x: (x > 0) - (x < 0),
    "max": max,
    "min": min,
}
VERTEX = ("row", "time", "x", "y", "h")
"""Fields of a vertex: line in the file, time [s], position [m], heading [rad]."""
_MOST_NODES = 200_000
"""Largest number of elements of a file, without the elements inside of polylines."""
_MOST_VERTICES = 5_000_000
"""Largest number of vertices of a polyline: an hour of fourteen vehicles at 100 Hz has as many."""
_LONGEST = 2**20
"""Greatest length of the value of an attribute [characters]."""
_MOST_CHARACTERS = 2**26
"""Largest sum of the lengths of all attributes of a file, without the attributes inside of polylines [characters]."""


@dataclass(slots=True, eq=False)
class Node:
    """An element of the tree."""

    tag: str
    attributes: dict[str, str]
    where: str
    """File and line, for messages."""
    children: list[Node] = field(default_factory=list)
    vertices: array[float] | None = None
    """The vertices of a polyline one after the other, each with the fields of `VERTEX`; a missing number is NaN."""

    def walk(self, *tags: str) -> Iterator[Node]:
        """Yield the elements inside of this element that have any of these tags, in the order of the file."""
        for child in self.children:
            if child.tag in tags:
                yield child
            yield from child.walk(*tags)

    def first(self, *path: str) -> Node | None:
        """Return the first element of each tag of a path inside of the one before, the last of them; None if there is none."""
        node: Node | None = self
        for tag in path:
            node = None if node is None else next(node.walk(tag), None)
        return node

    def text(self, name: str) -> str:
        """Return an attribute."""
        if name not in self.attributes:
            raise self.refused(f"has no attribute {name!r}")
        return self.attributes[name]

    def number(self, name: str, default: float | None = None) -> float:
        """Return an attribute as a finite number."""
        if default is not None and name not in self.attributes:
            return default
        text = self.text(name)
        value = number_in(text)
        if not abs(value) <= 1e12:
            raise self.refused(f"has {name}={text!r:.60}, expected a finite number")
        return value

    def points(self) -> NDArray[np.float64]:
        """Return the vertices of a polyline with the fields of `VERTEX`, shape ``(vertices, 5)``."""
        return np.array(self.vertices or (), dtype=np.float64).reshape(-1, len(VERTEX))

    def refused(self, why: str) -> RunError:
        """Return an error about this element, whose message names file, line, tag and reason."""
        return RunError(one_line(f"{self.where}: <{self.tag}> {why}"))


class _Builder:
    """Builds the tree from the events of the parser."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.root: Node | None = None
        self._stack: list[Node] = []
        self._parameters: dict[str, str] = {}
        self._nodes = self._characters = 0
        self._line: Node | None = None
        """The polyline that the parser is inside of; None outside of polylines."""
        self._inside = 0
        """Number of elements inside of the polyline whose end tags the parser has not reached."""
        self._time = (0, math.nan)

    def start(self, tag: str, attributes: dict[str, str], row: int) -> None:
        place = f"{self.where}: row {row}"
        if tag == "ParameterDeclaration":  # some tools put a dollar sign before the declared name
            attributes["name"] = attributes.get("name", "").removeprefix("$")
        node = Node(tag, dict(attributes), place)
        for name, text in attributes.items():
            if len(text) > _LONGEST:
                raise RunError(f"{place}: an attribute has {len(text):,} characters, expected at most {_LONGEST:,}")
            if text.startswith("$"):
                try:
                    node.attributes[name] = evaluate(text, self._parameters)
                except ValueError as error:
                    raise RunError(one_line(f"{place}: {text[:60]!r} {error}")) from error
        if self._line is not None:
            self._inside += 1
            self._vertex(self._line, node, row)
            return
        self._nodes += 1
        self._characters += sum(map(len, attributes.values()))
        if self._nodes > _MOST_NODES or self._characters > _MOST_CHARACTERS:
            raise RunError(
                f"{self.where}: the file has more than {_MOST_NODES:,} elements, or more than {_MOST_CHARACTERS:,} characters in "
                "attributes: cut the file into several files"
            )
        if self._stack:
            self._stack[-1].children.append(node)
        elif tag != "OpenSCENARIO":
            raise RunError(one_line(f"{self.where}: the root is <{tag[:60]}>, expected <OpenSCENARIO>"))
        else:
            self.root = node
        self._stack.append(node)
        if tag == "ParameterDeclaration":
            self._parameters[node.attributes.get("name", "")] = node.attributes.get("value", "")
        elif tag == "Polyline":
            self._line, node.vertices = node, array("d")

    def end(self, _tag: str) -> None:
        if self._inside:
            self._inside -= 1
        else:
            self._line = None
            self._stack.pop()

    def _vertex(self, line: Node, node: Node, row: int) -> None:
        """Store a part of a vertex: the time in the element `Vertex`, or the position in the inner element `WorldPosition`."""
        if node.tag == "Vertex":
            self._time = row, number_in(node.attributes.get("time", "nan"))
        elif node.tag == "WorldPosition" and line.vertices is not None:
            place = node.number("x"), node.number("y")
            heading = node.number("h") if "h" in node.attributes else math.nan
            line.vertices.extend((*self._time, *place, heading))
            if len(line.vertices) > _MOST_VERTICES * len(VERTEX):
                raise RunError(
                    f"{self.where}: a polyline has more than {_MOST_VERTICES:,} vertices: cut the file into several files"
                )
        elif node.tag != "Position":
            raise node.refused("is not read as a position of a trajectory, expected a <WorldPosition>")


def read_tree(path: Path, watch: Watch | None = None) -> Node:
    """Return the root element of a file."""
    with opened(path, watch) as source:
        builder = _Builder(source.where)
        read_xml(source.chunks(), "OpenSCENARIO XML", builder.start, builder.end)
    assert builder.root is not None, "expat refuses a file without elements"
    return builder.root


def evaluate(text: str, parameters: Mapping[str, str]) -> str:
    """Return the value of an attribute that begins with a dollar sign."""
    for name in _PARAMETER.findall(text):
        if name not in parameters:
            raise ValueError(f"refers to {name!r}, which is no declared parameter")
    if not text.startswith("${"):
        return parameters[text[1:]]
    if len(text) > _LONGEST_EXPRESSION or not text.endswith("}"):
        raise ValueError(f"is no expression in braces of at most {_LONGEST_EXPRESSION:,} characters")
    inner = _PARAMETER.sub(lambda match: f"({parameters[match[1]][:_LONGEST_NUMBER]})", text[2:-1])
    try:
        value = _value_of_node(ast.parse(inner.strip(), mode="eval").body)
    except (SyntaxError, TypeError, ArithmeticError, ValueError, RecursionError, MemoryError) as error:
        raise ValueError(f"can't be evaluated: {error}") from error
    if not math.isfinite(value):
        raise ValueError("has no finite value")
    return str(value).lower() if isinstance(value, bool) else f"{value:.17g}"


def _value_of_node(node: ast.AST) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id="true" | "false" as word):
            return word == "true"
        case ast.UnaryOp(op=op, operand=inner) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value_of_node(inner))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_value_of_node(left), _value_of_node(right))
        case ast.BoolOp(op=op, values=values):
            return _OPERATORS[type(op)](*map(_value_of_node, values))
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](*map(_value_of_node, args))
    raise ValueError("expected only numbers, + - * / %, not, and, or, and the functions of OpenSCENARIO 1.2")


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
    gather = Gather(path.name, {"time": "time", "heading": "h", "size": "Dimensions"}, strict=strict)
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
