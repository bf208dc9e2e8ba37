"""Vehicles and their departures, as SUMO reads them (page "Definition of Vehicles, Vehicle Types, and Routes")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element, SubElement, tostring

from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.satellites.sumo.road_network import lane_in, lane_limit, lane_out
from pytest_rvads.scenarios.case import Case

__all__ = ["departures", "lone_departure"]

_EMERGENCY = 9.0
"""SUMO's own deceleration in an emergency [m/s^2]."""


def departures(case: Case, attributes: Mapping[str, str]) -> str:
    """Return the text of a file of routes: who departs at time 0, where, how fast and where to, in creation order.

    Args:
        case: what is simulated.
        attributes: of the vehicle types, in place of what follows from the vehicles.
    """
    scenario, root = case.scenario, Element("routes")
    created = scenario.creation.index
    rows = sorted(zip(case.agents(), case.starts(), strict=True), key=lambda row: created(row[0].entrance))
    for agent, (distance, speed) in rows:
        vehicle = case.fleet.of(agent.name)
        _add_type(root, agent.name, vehicle, scenario.aggression, attributes)
        (start, lane), (end, other) = lane_in(scenario.place, agent.entrance), lane_out(scenario.place, agent.exit)
        # The front bumper is where SUMO has its vehicles, too.
        place = scenario.place.approach(agent.entrance) - distance
        speed = min(speed, lane_limit(scenario.place.way_in(agent.entrance), -1))  # others are moved from outside anyway
        _add_vehicle(root, agent.name, (start, end), (lane, other), place, speed)
    return tostring(root, encoding="unicode")


def lone_departure(name: str, speed: float, vehicle: Vehicle, aggression: int, attributes: Mapping[str, str]) -> str:
    """Return the same for a single vehicle on a straight road, at a speed [m/s]."""
    root = Element("routes")
    _add_type(root, name, vehicle, aggression, attributes)
    _add_vehicle(root, name, ("in0",), (0, 0), vehicle.length, speed)
    return tostring(root, encoding="unicode")


def _add_type(root: Element, name: str, vehicle: Vehicle, aggression: int, attributes: Mapping[str, str]) -> None:
    decel = vehicle.brake[aggression - 1]
    given = {
        "length": repr(vehicle.length),
        "width": repr(vehicle.width),
        "height": repr(vehicle.height),
        "accel": repr(vehicle.drive),
        "decel": repr(decel),
        "emergencyDecel": repr(max(decel, _EMERGENCY)),
        "speedFactor": "1",  # nobody is by nature faster or slower than the limit
        "speedDev": "0",
    }
    SubElement(root, "vType", {"id": name, **given, **attributes})


def _add_vehicle(root: Element, name: str, edges: Sequence[str], lanes: tuple[int, int], place: float, speed: float) -> None:
    given = {
        "id": name,
        "type": name,
        "depart": "0",
        "departLane": str(lanes[0]),
        "departPos": repr(place),
        "departSpeed": repr(speed),  # SUMO lets nobody depart faster than the limit
        "arrivalLane": str(lanes[1]),
        "insertionChecks": "none",
    }
    SubElement(SubElement(root, "vehicle", given), "route", edges=" ".join(edges))
