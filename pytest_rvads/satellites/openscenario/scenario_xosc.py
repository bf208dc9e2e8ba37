"""Scenarios in OpenSCENARIO XML: `save_scenario` writes a scenario, and `load_scenario` reads the same subset of elements.

A written file has the start, speed and route of every vehicle, so that controllers in another simulator can drive the vehicles.
The note of a written file (`ScenarioNote`) holds the values of the scenario that the elements of OpenSCENARIO can't express.
"""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from pytest_rvads.geometry.finder import find, load, names
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import NAMES
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.geometry.ways import Key
from pytest_rvads.runs.archive import Name
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.runs.states import Colour, Vehicle
from pytest_rvads.satellites.openscenario.document import Actor, Document, body_of, library, mapped, phases_of_plan, put_map
from pytest_rvads.satellites.openscenario.run_export import write
from pytest_rvads.satellites.openscenario.xosc import Entity, Node, entities_of, lights_of, map_of, note_of, read_tree
from pytest_rvads.satellites.tracks.lightlog import lights_at
from pytest_rvads.scenarios.case import Fleet
from pytest_rvads.scenarios.classes import Orbits, rotate
from pytest_rvads.scenarios.configurations import QUEUE_GAP, QUEUE_TIME
from pytest_rvads.scenarios.ids import recalled
from pytest_rvads.scenarios.scenario import Scenario, usual_duration
from pytest_rvads.support.decoding import decode, encode
from pytest_rvads.support.errors import RunError, ScenarioError, require
from pytest_rvads.support.wording import one_line

_ACTIONS_READ = ("TeleportAction", "SpeedAction", "AssignRouteAction", "AcquirePositionAction")
_FARTHEST_POINT = 1.5
"""Largest distance of a start or goal from the centre of its lane [m]."""
_LONGEST = 100.0
"""Greatest length of a vehicle that is accepted [m]."""
_LINE_TOLERANCE = 1e-6
"""A start at most this far past the stopping line, from rounding, counts as a start on the line [m]."""


@dataclass(frozen=True, slots=True)
class Intention:
    """Start, speed and route of a vehicle, in coordinates of the map."""

    name: str
    length: float | None
    """Length of the vehicle [m]; None if the file states no length."""
    point: tuple[float, float]
    """Initial position of the reference point [m]."""
    heading: float | None
    """Initial heading [rad]; None if the file states no heading, so that the vehicle faces along its lane."""
    ahead: float
    """Distance from the reference point to the front [m]."""
    speed: float
    """Initial speed [m/s]."""
    route: tuple[tuple[float, float], ...]
    """Waypoints [m], at least one; the last waypoint is the goal."""


@dataclass(frozen=True, slots=True)
class Drive:
    """The start and the movement of a vehicle at a junction, as they follow from its `Intention`."""

    vehicle: Intention
    key: Key
    """Entrance and exit."""
    start: tuple[float, float]
    """Initial distance from the front to the stopping line [m], and initial speed [m/s], as in a `Scenario`."""


def intentions(root: Node, where: str) -> Mapping[str, Intention]:
    """Return start, speed and route of each vehicle by name, in the order in which the file declares the vehicles."""
    for story in root.walk("Story"):
        for node in _innermost_actions(story):
            hint = ": the file is a run, which rvads check reads" if node.tag == "FollowTrajectoryAction" else ""
            raise node.refused(f"in a story is not read, expected actions in <Init> alone{hint}")
    starts: dict[str, Node] = {}
    for init in root.walk("Init"):
        for node in _innermost_actions(init):
            if node.tag not in _ACTIONS_READ:
                raise node.refused("at the start is not read, expected teleports, speeds, and routes or positions to acquire")
        for private in init.walk("Private"):
            starts.setdefault(private.text("entityRef"), Node("Private", private.attributes, private.where)).children.extend(
                private.children
            )
    entities = entities_of(root)
    if not entities:
        raise RunError(f"{where}: the file has no vehicles")
    by_name = {}
    for entity in entities:
        if entity.name not in starts:
            raise RunError(f"{where}: {entity.name!r:.60} has no start, expected a <Private> with a <TeleportAction>")
        by_name[entity.name] = _intention(entity, starts[entity.name], where)
    return by_name


def _innermost_actions(node: Node) -> Iterator[Node]:
    """Yield the actions inside of an element; instead of an action that contains actions, the contained actions are yielded."""
    for child in node.children:
        holds = any(inner.tag.endswith("Action") for inner in child.children)
        if child.tag.endswith("Action") and not holds:
            yield child
        else:
            yield from _innermost_actions(child)


def _intention(entity: Entity, private: Node, where: str) -> Intention:
    name, length, ahead = entity.name, None if entity.size is None else entity.size[0], entity.ahead
    if length is not None and not 0.0 < length <= _LONGEST:
        raise RunError(f"{where}: {name!r:.60} is {length:g} m long, expected more than 0 and up to {_LONGEST:g} m")
    teleport = private.first("TeleportAction")
    if teleport is None or ahead is None:
        lacking = "a <TeleportAction>" if teleport is None else "a <BoundingBox> of its own"
        raise private.refused(f"for {name!r} needs {lacking}")
    start = _world_position(teleport)
    speed = private.first("SpeedAction")
    target = None if speed is None else speed.first("AbsoluteTargetSpeed")
    if speed is not None and target is None:
        raise speed.refused(f"for {name!r} has another target, expected an <AbsoluteTargetSpeed>")
    route, goal = private.first("AssignRouteAction"), private.first("AcquirePositionAction")
    stops = [_world_position(node) for node in route.walk("Waypoint")] if route else [_world_position(goal)] if goal else []
    if not stops:
        raise private.refused(f"for {name!r} needs an <AssignRouteAction> with a <Route> in it, or an <AcquirePositionAction>")
    return Intention(
        name,
        length,
        (start.number("x"), start.number("y")),
        start.number("h") if "h" in start.attributes else None,
        ahead,
        0.0 if target is None else target.number("value"),
        tuple((stop.number("x"), stop.number("y")) for stop in stops),
    )


def _world_position(node: Node) -> Node:
    position = node.first("Position")
    place = position.children[0] if position is not None and position.children else None
    if place is None or place.tag != "WorldPosition":
        tag = "none" if place is None else f"<{place.tag}>"
        raise node.refused(f"must have a <WorldPosition>, got {tag}")
    return place


def matched(intention: Intention, junction: Junction) -> Drive | None:
    """Return the movement of a vehicle through a junction; None if it starts on no approach, or its route leads elsewhere.

    Of the movements that fit, it is the movement with the least sum of distances between its path and the vehicle's start and
    waypoints.
    """
    best: tuple[float, Drive] | None = None
    for key in sorted(junction.movements):
        way = itinerary(junction, *key)
        long, middle = way.path.length, way.path.length / 2
        x, y = intention.point
        if intention.heading is not None:
            x += intention.ahead * math.cos(intention.heading)
            y += intention.ahead * math.sin(intention.heading)
        along, beside = way.path.project(x, y, middle, long)
        along += intention.ahead if intention.heading is None else 0.0
        offsets = [way.path.project(*stop, middle, long) for stop in intention.route]
        distance = way.line - (along - way.origin)
        reached = offsets[-1][0] - way.origin > way.length
        if distance < -_LINE_TOLERANCE or along < 0.0 or not reached or max(abs(beside), abs(offsets[-1][1])) > _FARTHEST_POINT:
            continue
        cost = abs(beside) + math.fsum(abs(offset) for _, offset in offsets)
        if best is None or cost < best[0]:
            best = cost, Drive(intention, key, (round(max(distance, 0.0), 6) + 0.0, intention.speed))
    return None if best is None else best[1]


VERSION = 1
"""Version of the fields of `ScenarioNote`; a file with another version is refused."""


class _Site(msgspec.Struct, frozen=True):
    """The junction of an exported scenario."""

    name: Name
    id: Name
    """Id of the junction in its map."""
    digest: str
    """`Junction.digest`, which shows whether the map file has changed since the export."""


class ScenarioNote(msgspec.Struct, frozen=True):
    """The scenario as a property in the header of its file, including values that elements of OpenSCENARIO can't express."""

    version: int
    site: _Site
    scenario: Mapping[str, Any]
    """Result of `Scenario.record`."""


def save_scenario(
    scenario: Scenario, path: str | Path, *, map: str | os.PathLike[str] | None = None, fleet: Fleet | None = None
) -> None:
    """Write a scenario as OpenSCENARIO XML 1.2, and the map of its junction into the same folder.

    Equal scenarios give equal files. `load_scenario` reads the file.
    Vehicles are declared in the order of their creation. Each vehicle is teleported to its start, gets its initial speed, and is
    assigned its route. The traffic lights follow the signal plan of the scenario. The stop trigger is the scenario's duration.

    Args:
        scenario: the scenario.
        path: path of the file, by convention ``.xosc``; missing folders are made.
        map: map file of the junction; by default the file that the junction names.
        fleet: the vehicle parameters; passenger cars by default.

    Raises:
        ScenarioError: a vehicle does not fit on its approach, or the scenario has pedestrians.
        MapError: the map of the junction is unknown.
        RvadsError: the library scenariogeneration is not installed, or the file can't be written.
    """
    require(scenario, Scenario, "save_scenario takes a rvads.Scenario(rvads.find('stop4'), '1133')", ScenarioError)
    require(fleet, Fleet | None, "fleet= must be a rvads.Fleet(vehicle)", ScenarioError)
    if scenario.pedestrians:
        raise ScenarioError(
            f"{scenario.name} has pedestrians, and elements of OpenSCENARIO can't express how they behave: save the scenario "
            "without pedestrians, or export a run of it, which holds where they walked"
        )
    library()
    path, bodies = Path(path), fleet or Fleet()
    place = mapped(scenario.place, map)
    rows = list(zip(scenario.agents(), scenario.itineraries(), scenario.starts(bodies.of), strict=True))
    created = scenario.creation.index
    actors = []
    for agent, way, (distance, speed) in sorted(rows, key=lambda row: created(row[0].entrance)):
        vehicle = bodies.of(agent.name)
        body = body_of(replace(agent, kind=vehicle.kind), vehicle)
        station = way.start(distance)
        front, axle = way.pose(station), way.pose(station - body.back)  # both lie on the centre line, as at a start
        heading = math.atan2(front.y - axle.y, front.x - axle.x)
        back_x, back_y = body.back * float(np.cos(heading)), body.back * float(np.sin(heading))
        start = Pose(front.x - back_x, front.y - back_y, heading)
        ahead = [way.pose(station) for station in (0.0, way.length / 2, way.length, way.leave)]
        actors.append(Actor(agent.name, body, start, speed, route=(start, *ahead)))
    site = _Site(scenario.place.name, scenario.place.id, scenario.place.digest)
    note = ScenarioNote(VERSION, site, scenario.record())
    document = Document(
        one_line(scenario.describe()),
        put_map(place, path.parent),
        ("rvads.scenario", encode(note).decode()),
        tuple(actors),
        phases_of_plan(place, scenario.signals()),
        scenario.duration,
    )
    write(path, document)


_END = ("StopTrigger", "SimulationTimeCondition")
"""Path of the element with the duration of a scenario."""
_TOLERANCE = 1e-3
"""Largest difference at which two positions [m] or two speeds [m/s] count as equal."""
_EVERY, _WITHIN = 0.25, 0.1
"""The colours of lights are compared every `_EVERY` [s], and `_WITHIN` [s] after the multiples of a quarter of a second, because
signal plans change their colours at these multiples."""


def load_scenario(path: str | Path, *, junction: str | None = None, map: str | os.PathLike[str] | None = None) -> Scenario:
    """Read a scenario that `save_scenario` wrote, or a scenario of another tool with the same kinds of elements.

    In a file of another tool, the start of every vehicle is projected onto an approach, and its route onto a movement. The names
    and bodies of the vehicles are not read, because a `Scenario` has neither.

    Args:
        path: path of the file.
        junction: argument of `find`; by default the single junction of the map through which all routes lead.
        map: map file; by default the file that the scenario names, with a path relative to the folder of the scenario.

    Raises:
        ScenarioError: the file can't be read, or holds elements that no `Scenario` has; the message names file, line and element.
        MapError: the map can't be read, or has no such junction.
    """
    path = Path(path)
    try:
        root = read_tree(path)
        note, map_beside = note_of(root, "scenario"), map_of(root, path)
        by_name = intentions(root, path.name)
        map_file = map_beside if map is None else Path(map)
        if note is not None and junction is None:
            content = decode(note.encode(), ScenarioNote, f"{path.name}: the property rvads.scenario", RunError)
            if content.version != VERSION:
                raise ScenarioError(f"{path.name}: the property rvads.scenario has version {content.version}, expected {VERSION}")
            place = _site_of(content.site, map_file, path.name)
            scenario = recalled(content.scenario, place, f"{path.name}: the property rvads.scenario")
            if edited := _edited_part(scenario, by_name, root):
                raise ScenarioError(
                    f"{path.name}: the file has {edited}, and the property rvads.scenario has another value: remove the property "
                    "if the file was changed on purpose"
                )
            return scenario
        if junction is not None:
            places = [find(junction, None if junction in names() else map_file)]
        elif map_file is None:
            raise ScenarioError(f"{path.name}: <LogicFile> names no map: give a map (map=), or a built-in junction (junction=)")
        else:
            places = [find(report.id, map_file) for report in load(map_file).junctions if report.usable]
        return _foreign_scenario(by_name, root, places, path.name)
    except RunError as error:
        raise ScenarioError(str(error)) from error


def _site_of(site: _Site, map: Path | None, where: str) -> Junction:
    """Return the junction of an exported scenario, from the built-in maps or from the map file that the scenario names."""
    if site.name in NAMES:
        builtin = find(site.name)
        for junction in (builtin.walked, builtin):  # the exported junction had the ways of pedestrians, or had none
            if junction.digest == site.digest:
                return junction
    if map is None:
        raise RunError(f"{where}: the file names no map in <LogicFile>, expected the map of junction {site.name!r}")
    mapped_junction = _with_name(find(site.id, map), site.name)
    for junction in (mapped_junction.walked, mapped_junction):
        if junction.digest == site.digest:
            return junction
    raise RunError(
        f"{where}: junction {site.name!r} of map file {map} has changed since the export: put the original map into the "
        "folder, or remove the property rvads.scenario, and the file is read like a file of another tool"
    )


@lru_cache(maxsize=16)
def _with_name(junction: Junction, name: str) -> Junction:
    """Return a junction with another name; equal arguments give the same object, so that values cached in the object are kept."""
    return junction if junction.name == name else replace(junction, name=name)


def _edited_part(scenario: Scenario, by_name: Mapping[str, Intention], root: Node) -> str | None:
    """Return in words which elements of an exported file differ from the scenario in its note; None if they agree."""
    agents = scenario.agents()
    if {agent.name for agent in agents} != by_name.keys():
        return f"vehicles {', '.join(sorted(by_name))}"
    starts = _starts(scenario, {name: intention.length for name, intention in by_name.items()})
    for agent, start in zip(agents, starts, strict=True):
        drive = matched(by_name[agent.name], scenario.place)
        if drive is None or drive.key != agent.way.key or not np.allclose(drive.start, start, rtol=0.0, atol=_TOLERANCE):
            return f"a start or route of {agent.name}"
    end = root.first(*_END)
    duration = None if end is None else end.number("value")
    if duration is None or abs(duration - scenario.duration) > _TOLERANCE:
        return f"an end at {duration} s"
    return None if _lights_match(scenario, root) else "colours of the lights"


def _starts(scenario: Scenario, lengths: Mapping[str, float | None]) -> tuple[tuple[float, float], ...]:
    """Return the starts of a scenario, given the lengths of vehicles [m], which alone decide on the positions in a queue."""
    usual = Vehicle().length
    known = {name: usual if length is None else length for name, length in lengths.items()}
    return scenario.starts(lambda name: Vehicle(length=known[name], front_axle=known[name] / 4, rear_axle=known[name] / 4))


def _foreign_scenario(by_name: Mapping[str, Intention], root: Node, places: list[Junction], where: str) -> Scenario:
    """Return the scenario in a file of another tool, at the single junction through which the routes of all vehicles lead."""
    fitting: list[tuple[Junction, list[Drive]]] = []
    unplaced = next(iter(by_name))
    for place in places:
        matches = {name: matched(intention, place) for name, intention in by_name.items()}
        unplaced = next((name for name, drive in matches.items() if drive is None), unplaced)
        drives = [drive for drive in matches.values() if drive is not None]
        if len(drives) == len(matches):
            fitting.append((place, drives))
    if not fitting:
        raise ScenarioError(
            f"{where}: all vehicles must start on approaches of the same junction and have routes to its exit roads, got "
            f"{unplaced!r:.60} without such a junction among the {len(places)} usable junctions of the map"
        )
    if len(fitting) > 1:
        ids = ", ".join(place.id for place, _ in fitting)
        raise ScenarioError(
            f"{where}: all routes lead through {len(fitting)} junctions ({ids:.100}): name a junction (junction=)"
        )
    return _scenario_of_drives(*fitting[0], root, where)


def _scenario_of_drives(place: Junction, drives: list[Drive], root: Node, where: str) -> Scenario:
    queues: dict[int, list[Drive]] = defaultdict(list)
    for drive in drives:
        queues[drive.key[0]].append(drive)
    lanes = range(len(place.entrances))
    order = [*queues, *(e for e in lanes if e not in queues)]
    heads = {entrance: min(queue, key=lambda drive: drive.start[0]) for entrance, queue in queues.items()}
    counts = {len(queue) for queue in queues.values()}
    if len(counts) > 1 or any(drive.key != heads[drive.key[0]].key for drive in drives):
        raise ScenarioError(f"{where}: every entrance must have equally many vehicles, and all of an entrance the same route")
    by_key = {movement.key: direction for (_, direction), movement in place.by_direction.items()}
    code = tuple(by_key[heads[e].key] if e in heads else 0 for e in lanes)
    known = {head.start for head in heads.values()}
    spare = known.pop() if len(known) == 1 else (0.0, 0.0)
    distances, speeds = zip(*(heads[e].start if e in heads else spare for e in lanes), strict=True)
    end = root.first(*_END)
    duration = usual_duration(place) if end is None else end.number("value")
    for row in Orbits.at(place).rows:
        try:
            scenario = Scenario(
                place,
                rotate(code, -row),
                distance=rotate(distances, -row),
                speed=rotate(speeds, -row),
                rotation=row,
                duration=duration,
                followers=max(counts) - 1,
            )
        except ScenarioError as error:
            raise ScenarioError(f"{where}: {error}") from error
        if scenario.creation != (*queues,):
            scenario = scenario.but(order=tuple((entrance - row) % len(lanes) for entrance in order))
        if _lights_match(scenario, root):
            break
    else:
        raise ScenarioError(f"{where}: the lights of the file follow none of the signal plans of junction {place.name!r}")
    _check_queues(scenario, queues, where)
    return scenario


def _check_queues(scenario: Scenario, queues: Mapping[int, list[Drive]], where: str) -> None:
    """Check that queued vehicles start at the positions and speeds that a `Scenario` gives to followers."""
    rows = [drive for entrance in sorted(queues) for drive in sorted(queues[entrance], key=lambda drive: drive.start[0])]
    lengths = {agent.name: drive.vehicle.length for agent, drive in zip(scenario.agents(), rows, strict=True)}
    for drive, start in zip(rows, _starts(scenario, lengths), strict=True):
        if not np.allclose(drive.start, start, rtol=0.0, atol=_TOLERANCE):
            distance, speed = drive.start
            raise ScenarioError(
                f"{where}: {drive.vehicle.name!r:.60} starts {distance:.2f} m before its line at {speed:g} m/s, expected "
                f"{start[0]:.2f} m at {start[1]:g} m/s: a follower starts at the speed of its leader, {QUEUE_GAP:g} m and "
                f"{QUEUE_TIME:g} s behind"
            )


def _lights_match(scenario: Scenario, root: Node) -> bool:
    """Return whether a file has no traffic lights, or its lights have the colours of a scenario's signal plan at all times."""
    place, plan = scenario.place, scenario.signals()
    file_lights = lights_of(root, scenario.duration)
    if not file_lights:
        return True
    lights = lights_at(place, file_lights)
    times = np.arange(0.0, scenario.duration, _EVERY) + _WITHIN
    expected = np.array([plan.colours(time, len(place.entrances)) for time in times.tolist()], dtype=np.int8)
    for entrance, light in lights.items():
        colours = np.concatenate(([Colour.NONE], light.colours))[np.searchsorted(light.times, times, side="right")]
        if not np.array_equal(colours, expected[:, entrance]):
            return False
    return bool(lights)
