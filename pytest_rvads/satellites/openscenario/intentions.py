"""Start, speed and route of every vehicle in an OpenSCENARIO file, and the movements through a junction that match the routes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.satellites.openscenario.xosc import Entity, entities_of
from pytest_rvads.satellites.openscenario.xosctree import Node
from pytest_rvads.support.errors import RunError

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
