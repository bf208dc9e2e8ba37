"""Writes a `Document` as XML by the library scenariogeneration. No other module uses this library.

The files have version 1.2 of OpenSCENARIO XML, the first version whose file header holds properties. All rules of ASAM's quality
checker apply to version 1.2.

The library is imported only for an export, because the import takes a second.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from importlib import import_module
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from pytest_rvads.geometry.segment import Pose
from pytest_rvads.runs.states import Kind
from pytest_rvads.satellites.openscenario.document import Actor, Body, Document
from pytest_rvads.satellites.openscenario.xosc import LAMPS
from pytest_rvads.support.errors import RvadsError, needs

_MINOR = 2
_DATE = datetime(2000, 1, 1)
"""Creation date in every file; it is constant so that equal runs give equal files."""
_FASTEST = 70.0
"""Top speed that is declared for every vehicle [m/s]."""
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
            creation_date=_DATE,
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
            _FASTEST,
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
