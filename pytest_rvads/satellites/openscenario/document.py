"""The parts of an OpenSCENARIO file that the exports write, as plain values, and the writing of these values as XML.

Traffic lights are described by phases: periods in which every signal of the map keeps its colour. The map file of a junction is
copied into the folder of an exported file.

The files have version 1.2 of OpenSCENARIO XML, the first version whose file header holds properties. All rules of ASAM's quality
checker apply to version 1.2. The library scenariogeneration, which no other module uses, is imported only for an export, because
the import takes a second.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from hashlib import sha256
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.crosswalks import Crossing
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.opendrive.map_file import MAX_BYTES, NAMES, path_of
from pytest_rvads.geometry.segment import Pose
from pytest_rvads.runs.states import AXLE, Agent, Colour, Kind, SignalPlan, Vehicle
from pytest_rvads.satellites.openscenario.xosc import LAMPS
from pytest_rvads.satellites.tracks.lightlog import ENTRANCE, signal_ids
from pytest_rvads.support.errors import MapError, RvadsError, needs
from pytest_rvads.support.storage import read_file, write_file

_TALL = 1.8
"""Height of a pedestrian in pictures of other tools [m]: an adult."""


@dataclass(frozen=True, slots=True)
class Body:
    """Size and axles of a vehicle [m], which other tools need to draw and drive the vehicle."""

    kind: Kind
    length: float
    width: float
    height: float
    back: float
    """Distance from the front bumper to the reference point of OpenSCENARIO, which is the middle of the rear axle."""
    wheelbase: float
    vehicle: Vehicle
    """Parameters of the vehicle's mass, acceleration, braking and steering."""


@dataclass(frozen=True, slots=True, eq=False)
class Actor:
    """A vehicle or pedestrian in a file, which has either a trajectory to replay or a route for its controller."""

    name: str
    body: Body
    start: Pose
    """Initial pose of the reference point."""
    speed: float
    """Initial speed [m/s]."""
    trajectory: NDArray[np.float64] | None = None
    """Time [s], x [m], y [m] and heading [rad] of the reference point at each vertex of a polyline, shape ``(vertices, 4)``."""
    route: tuple[Pose, ...] = ()
    """Waypoints of the route; the first waypoint is the start."""
    appears: float | None = None
    """Time at which the actor is added [s]; None for an actor that exists from the beginning."""
    leaves: float | None = None
    """Time at which the actor is deleted [s]; None for an actor that stays."""


Phase = tuple[float, Mapping[str, Colour]]
"""Duration of a period in which no traffic light changes its colour [s], and the colour of each signal by its id."""


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """The content of an OpenSCENARIO file."""

    title: str
    """Description of the content in one line, for the file header."""
    map: str
    """Name of the OpenDRIVE file, which lies in the folder of the OpenSCENARIO file."""
    note: tuple[str, str]
    """Name and value of the property in the file header that holds facts for this package; other tools ignore the property."""
    actors: tuple[Actor, ...]
    phases: tuple[Phase, ...]
    """Phases of all traffic lights in order; a single signal controller repeats the phases."""
    duration: float
    """Time at which the scenario ends [s]."""


def body_of(agent: Agent, vehicle: Vehicle | None = None) -> Body:
    """Return the body of an agent; `vehicle` are the parameters with which it was simulated, None if they are unknown.

    Parameters of another size than the agent count as unknown: the axles then lie symmetrically about the middle, as in a usual
    car, the rear axle at the share `AXLE` of the length. A pedestrian has no axles, and its reference point is its middle.
    """
    usual = Vehicle()
    if vehicle is not None and agent.size in (None, (vehicle.length, vehicle.width)):
        back, wheelbase = vehicle.rear_axle_offset, vehicle.wheelbase
        return Body(agent.kind, vehicle.length, vehicle.width, vehicle.height, back, wheelbase, vehicle)
    length, width = agent.size or (usual.length, usual.width)
    if agent.kind is Kind.PEDESTRIAN:
        return Body(agent.kind, length, width, _TALL, length / 2.0, 0.0, usual)
    return Body(agent.kind, length, width, usual.height, AXLE * length, (2 * AXLE - 1) * length, usual)


def phases_of_run(junction: Junction, lights: NDArray[np.int8], dt: float) -> tuple[Phase, ...]:
    """Return the phases of the traffic lights in a run; the result is empty for a junction without lights.

    The shape of `lights` is ``(steps, starts)``, and `dt` is the time between two states [s].
    """
    if not lights.any():
        return ()
    bounds = [0, *(np.flatnonzero((np.diff(lights, axis=0) != 0).any(axis=1)) + 1).tolist(), len(lights)]
    return _phases(junction, lights[bounds[:-1]], [round((end - begin) * dt, 9) for begin, end in pairwise(bounds)])


def phases_of_plan(junction: Junction, plan: SignalPlan) -> tuple[Phase, ...]:
    """Return the phases of one cycle of a signal plan; the result is empty for a plan without lights."""
    count, phases = len(junction.entrances), plan.phases()
    lights = np.array([plan.colours(begin, count) for begin, _ in phases], dtype=np.int8).reshape(-1, count)
    return _phases(junction, lights, [seconds for _, seconds in phases])


def _phases(junction: Junction, lights: NDArray[np.int8], durations: list[float]) -> tuple[Phase, ...]:
    """Return phases from the colour of each start in each phase, shape ``(phases, starts)``, and the durations [s]."""
    ids = signal_ids(junction)
    names: dict[str, int] = {}  # by id of a signal to write, an entrance whose light has the colours of the signal
    for entrance in np.flatnonzero(lights.any(axis=0)).tolist():
        way = None if entrance < len(junction.entrances) else junction.further[entrance - len(junction.entrances)].way
        if isinstance(way, Crossing):
            names[f"w{way.crosswalk}"] = entrance  # as in w0
            continue
        own = lights[:, [entrance]]
        signals = [id for id, others in ids.items() if entrance in others and (lights[:, list(others)] == own).all()]
        # Without a signal in the map of the entrance's colours, the id is made from the label of the entrance.
        label = junction.vehicle_at(entrance).removeprefix("a")
        names |= dict.fromkeys(signals or [f"{ENTRANCE}{label}"], entrance)
    return tuple(
        (seconds, {name: Colour(int(colours[entrance])) for name, entrance in names.items()})
        for colours, seconds in zip(lights, durations, strict=True)
    )


def mapped(junction: Junction, *maps: str | os.PathLike[str] | None) -> Junction:
    """Return a junction with `map` set to a map file in which it is unchanged; `maps` are searched before the file it names."""
    candidates = [path_of(junction.name)] if junction.name in NAMES else []
    candidates += [Path(map) for map in (*maps, junction.map) if map is not None]
    error_of_last: MapError | None = None
    for path in candidates:
        try:
            mapped_junction = find(junction.id, path)
        except MapError as error:
            error_of_last = error
            continue
        mapped_junction = mapped_junction.walked if junction.further else mapped_junction
        if mapped_junction.digest == junction.digest:
            return replace(junction, map=str(path))
        error_of_last = MapError(
            f"junction {junction.name!r} differs from the junction in map file {path}: the file has changed since, or U-turns "
            "were kept; give the original map of the junction (--map, --rvads-map, map=)"
        )
    raise error_of_last or MapError(
        f"the map file of junction {junction.name!r} is not known, and a file of OpenSCENARIO needs the map: give the OpenDRIVE "
        "map (--map, --rvads-map, map=)"
    )


def put_map(junction: Junction, folder: Path) -> str:
    """Copy the map file of a junction into a folder, and return the name of the copy.

    An equal copy in the folder is not written again. If a file with other content has the name, the copy gets another name.
    """
    source = Path(str(junction.map))
    try:
        content = read_file(source, MAX_BYTES)
        other_name = f"{source.stem}-{sha256(content).hexdigest()[:8]}{source.suffix}"
        for target in (folder / source.name, folder / other_name):
            if not target.exists():
                break
            if target.stat().st_size == len(content) and target.read_bytes() == content:
                return target.name
        write_file(target, content)
    except OSError as error:
        raise MapError(f"map file {source} can't be copied to {folder}: {error.strerror}") from error
    return target.name


_MINOR = 2
_TRACK, _WHEEL = 0.85, 0.64
"""Track width as a share of the width of the body, and diameter of the wheels [m], of usual cars; only pictures depend on these
values."""
_PERSON = 75.0
"""Mass of a pedestrian [kg]: an adult, as crash test dummies of 50th percentile."""
_NOT_IN_XML = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0, section 2.2, excludes."""


def library() -> Any:
    """Return ``scenariogeneration.xosc``."""
    try:
        return import_module("scenariogeneration.xosc")
    except ImportError as error:
        raise RvadsError(needs("writing OpenSCENARIO", "scenariogeneration", "openscenario")) from error


def written(document: Document) -> bytes:
    """Return the content of an OpenSCENARIO file for a document; equal documents give equal bytes."""
    signals = {name for _, colours in document.phases for name in colours}
    names = (document.title, document.map, *(actor.name for actor in document.actors), *sorted(signals))
    for text in (*names, *document.note):
        if text.startswith("$"):
            raise RvadsError(f"{text!r:.60} can't stand in OpenSCENARIO, where '$' begins the name of a parameter: rename it")
        if match := _NOT_IN_XML.search(text):
            raise RvadsError(f"{text!a:.60} can't stand in XML, which has no character {match[0]!a}: rename it")
    xosc = library()
    version_before = xosc.VersionBase.version_minor
    xosc.VersionBase.version_minor = _MINOR
    try:
        root = _Writer(xosc).scenario(document).get_element()
    finally:
        xosc.VersionBase.version_minor = version_before
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return content + b"\n"


class _Writer:
    """Makes objects of the library scenariogeneration from the parts of a document."""

    def __init__(self, xosc: Any) -> None:
        self.xosc = xosc

    def scenario(self, document: Document) -> Any:
        xosc = self.xosc
        properties = xosc.Properties()
        properties.add_property(*document.note)
        roads = xosc.RoadNetwork(document.map)
        if document.phases:
            controller = xosc.TrafficSignalController("lights")
            for number, (duration, colours) in enumerate(document.phases):
                step = xosc.Phase(f"phase {number}", duration)
                for name, colour in colours.items():
                    step.add_signal_state(name, LAMPS[colour])
                controller.add_phase(step)
            roads.add_traffic_signal_controller(controller)
        entities, init = xosc.Entities(), xosc.Init()
        for actor in document.actors:
            entities.add_scenario_object(actor.name, self.body(actor.body))
            for action in self.starting(actor):
                init.add_init_action(actor.name, action)
        board = xosc.StoryBoard(init, self.at(document.duration, "the end", "stop"))
        groups = [self.group(actor, actor.trajectory) for actor in document.actors if actor.trajectory is not None]
        if groups:
            act = xosc.Act("trajectories", self.at(0.0, "the start"))
            for group in groups:
                act.add_maneuver_group(group)
            story = xosc.Story("run")
            story.add_act(act)
            board.add_story(story)
        return xosc.Scenario(
            document.title,
            "pytest-rvads",
            xosc.ParameterDeclarations(),
            entities,
            board,
            roads,
            xosc.Catalog(),
            osc_minor_version=_MINOR,
            creation_date=datetime(2000, 1, 1),  # constant, so that equal runs give equal files
            header_properties=properties,
        )

    def body(self, body: Body) -> Any:
        """Return a vehicle or pedestrian whose bounding box has its center relative to the reference point, the rear axle."""
        xosc, vehicle = self.xosc, body.vehicle
        box = xosc.BoundingBox(body.width, body.length, body.height, body.back - body.length / 2, 0.0, body.height / 2)
        if body.kind is Kind.PEDESTRIAN:
            return xosc.Pedestrian(str(body.kind), _PERSON, xosc.PedestrianCategory.pedestrian, box)
        turned = vehicle.steering_limit, _WHEEL, _TRACK * body.width
        return xosc.Vehicle(
            str(body.kind),
            getattr(xosc.VehicleCategory, body.kind.words[0]),
            box,
            xosc.Axle(*turned, body.wheelbase, _WHEEL / 2),
            xosc.Axle(*turned, 0.0, _WHEEL / 2),
            70.0,  # top speed [m/s]
            vehicle.drive,
            max(vehicle.brake),
            mass=vehicle.mass,
        )

    def starting(self, actor: Actor) -> Iterator[Any]:
        """Yield the initial actions of an actor (vehicle or pedestrian); an actor that appears during the run has none."""
        xosc = self.xosc
        if actor.appears is not None:
            return
        yield xosc.TeleportAction(self.place(actor.start))
        step = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0)
        yield xosc.AbsoluteSpeedAction(actor.speed, step)
        if actor.route:
            route = xosc.Route(f"way of {actor.name}")
            for pose in actor.route:
                route.add_waypoint(self.place(pose), xosc.RouteStrategy.shortest)
            yield xosc.AssignRouteAction(route)

    def group(self, actor: Actor, way: NDArray[np.float64]) -> Any:
        """Return the actions of an actor with a trajectory: to appear, to follow the trajectory, and to leave."""
        xosc = self.xosc
        maneuver = xosc.Maneuver(f"{actor.name} drives")
        begins = 0.0 if actor.appears is None else actor.appears
        line = xosc.Trajectory(f"of {actor.name}", False)
        line.add_shape(xosc.Polyline(way[:, 0].tolist(), [self.place(Pose(*pose)) for pose in way[:, 1:].tolist()]))
        follow = xosc.FollowTrajectoryAction(line, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1.0, 0.0)
        steps = [("follows", begins, follow)]
        if actor.appears is not None:
            steps.insert(0, ("appears", begins, xosc.AddEntityAction(actor.name, self.place(actor.start))))
        if actor.leaves is not None:
            steps.append(("leaves", actor.leaves, xosc.DeleteEntityAction(actor.name)))
        for what, time, action in steps:
            event = xosc.Event(f"{actor.name} {what}", xosc.Priority.parallel)
            event.add_trigger(self.at(time, f"{actor.name} {what}"))
            event.add_action(f"{actor.name} {what}", action)
            maneuver.add_event(event)
        group = xosc.ManeuverGroup(actor.name)
        group.add_actor(actor.name)
        group.add_maneuver(maneuver)
        return group

    def place(self, pose: Pose) -> Any:
        return self.xosc.WorldPosition(pose.x, pose.y, h=pose.heading)

    def at(self, time: float, name: str, what: str = "start") -> Any:
        xosc = self.xosc
        rule = xosc.Rule.greaterThan if what == "stop" else xosc.Rule.greaterOrEqual
        return xosc.ValueTrigger(name, 0, xosc.ConditionEdge.none, xosc.SimulationTimeCondition(time, rule), what)
