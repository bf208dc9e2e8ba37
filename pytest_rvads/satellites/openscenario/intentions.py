"""What vehicles of a scenario are to do: where they start, how fast, where they go; and the movements that this means."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pytest_rvads.errors import RunError
from pytest_rvads.junctions.conflicts import Key
from pytest_rvads.junctions.junction import Junction
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.satellites.openscenario.played import Entity, entities_of
from pytest_rvads.satellites.openscenario.xosctree import Node

__all__ = ["Drive", "Intention", "intentions", "matched"]

_READ = ("TeleportAction", "SpeedAction", "AssignRouteAction", "AcquirePositionAction")
_BESIDE = 1.5
"""Farthest that a start or a goal lies beside the centre of its lane [m]."""
_LONGEST = 100.0
"""Longest vehicle [m]."""
_BEHIND = 1e-6
"""A start on the line is not behind it [m]."""


@dataclass(frozen=True, slots=True)
class Intention:
    """What one vehicle is to do."""

    name: str
    length: float | None
    """[m]."""
    point: tuple[float, float]
    """Of its reference point [m]."""
    heading: float | None
    """[rad]; None: along its lane."""
    ahead: float
    """How far its front is ahead of that [m]."""
    speed: float
    """[m/s]."""
    route: tuple[tuple[float, float], ...]
    """Waypoints, at least the goal [m]."""


@dataclass(frozen=True, slots=True)
class Drive:
    """The same at a junction."""

    name: str
    length: float | None
    key: Key
    """Entrance and exit."""
    distance: float
    """Reference point, the front, to the stopping line [m]."""
    speed: float
    """[m/s]."""


def intentions(root: Node, where: str) -> Mapping[str, Intention]:
    """Return what everybody is to do, in the order in which they are declared.

    Raises:
        RunError: an element that is not read, or one that is missing; the message names it and its line.
    """
    for story in root.walk("Story"):
        for node in _actions(story):
            hint = ": it is a run, which rvads check reads" if node.tag == "FollowTrajectoryAction" else ""
            raise node.refused(f"in a story is not read, a scenario holds what happens at its start{hint}")
    privates: dict[str, Node] = {}
    for init in root.walk("Init"):
        for node in _actions(init):
            if node.tag not in _READ:
                raise node.refused("at the start is not read, expected teleports, speeds, and routes or positions to acquire")
        for private in init.walk("Private"):
            privates.setdefault(private.text("entityRef"), Node("Private", private.attributes, private.where)).children.extend(
                private.children
            )
    entities = entities_of(root)
    if not entities:
        raise RunError(f"{where}: it has no vehicles")
    found = {}
    for entity in entities:
        if entity.name not in privates:
            raise RunError(f"{where}: {entity.name!r:.60} has no <Private> that says where it starts")
        found[entity.name] = _intention(entity, privates[entity.name], where)
    return found


def _actions(node: Node) -> Iterator[Node]:
    """Yield the actions inside, but for those that only hold others."""
    for child in node.children:
        holds = any(inner.tag.endswith("Action") for inner in child.children)
        if child.tag.endswith("Action") and not holds:
            yield child
        else:
            yield from _actions(child)


def _intention(entity: Entity, private: Node, where: str) -> Intention:
    name, length, ahead = entity.name, None if entity.size is None else entity.size[0], entity.ahead
    if length is not None and not 0.0 < length <= _LONGEST:
        raise RunError(f"{where}: {name!r:.60} is {length:g} m long, expected more than 0 and up to {_LONGEST:g} m")
    teleport = private.first("TeleportAction")
    if teleport is None or ahead is None:
        lacking = "a <TeleportAction>" if teleport is None else "a <BoundingBox> of its own"
        raise private.refused(f"for {name!r} needs {lacking}")
    start = _world(teleport)
    speed = private.first("SpeedAction")
    target = None if speed is None else speed.first("AbsoluteTargetSpeed")
    if speed is not None and target is None:
        raise speed.refused(f"for {name!r} has another target than an <AbsoluteTargetSpeed>")
    route, goal = private.first("AssignRouteAction"), private.first("AcquirePositionAction")
    stops = [_world(node) for node in route.walk("Waypoint")] if route else [_world(goal)] if goal else []
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


def _world(node: Node) -> Node:
    """Return the place inside an element."""
    position = node.first("Position")
    place = position.children[0] if position is not None and position.children else None
    if place is None or place.tag != "WorldPosition":
        told = "none" if place is None else f"<{place.tag}>"
        raise node.refused(f"must have a <WorldPosition>, got {told}")
    return place


def matched(intention: Intention, junction: Junction) -> Drive | None:
    """Return the movement of a vehicle through a junction; None if it starts on no approach or does not pass the junction."""
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
        if distance < -_BEHIND or along < 0.0 or not reached or max(abs(beside), abs(offsets[-1][1])) > _BESIDE:
            continue
        cost = abs(beside) + math.fsum(abs(offset) for _, offset in offsets)
        if best is None or cost < best[0]:
            found = Drive(intention.name, intention.length, key, round(max(distance, 0.0), 6) + 0.0, intention.speed)
            best = cost, found
    return None if best is None else best[1]
