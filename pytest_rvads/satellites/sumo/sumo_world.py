"""The world of the simulator ``sumo``: SUMO moves the vehicles with SUMO's driver, and a physics engine moves all other vehicles.

SUMO gets the positions of the engine's vehicles in every step, so that SUMO's vehicles react to the engine's vehicles.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from xml.etree.ElementTree import Element, SubElement, tostring

from pytest_rvads.logic.conduct.bodies import Box, gap
from pytest_rvads.physics import engines
from pytest_rvads.physics.body import Motion, World
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.satellites.sumo.road_network import lane_in, lane_limit, lane_out, network
from pytest_rvads.satellites.sumo.sumo_process import SumoFailed, acquire, release
from pytest_rvads.scenarios.case import Case
from pytest_rvads.support.errors import RunError

_EMERGENCY = 9.0
"""SUMO's default for the deceleration of a vehicle in an emergency [m/s^2]."""
_AHEAD = 100
"""Steps per request if SUMO drives all vehicles; the motions are the same as with single steps."""
_EXACT = 0.01
"""Largest difference between departure in SUMO and start of the case [m], [m/s]; joints between lanes can have such gaps."""


class SumoWorld:
    """A `World` in which SUMO drives the vehicles in some columns, at least one; a column is a position among the agents.

    A vehicle of SUMO is in contact with another vehicle if the boxes of the two vehicles overlap. Such a contact has no effect on
    the motions.
    """

    def __init__(
        self,
        case: Case,
        driven: Collection[int],
        seed: int,
        attributes: Mapping[str, str],
        limit: float,
        vehicles: Sequence[Vehicle],
        starts: Sequence[Motion],
    ) -> None:
        self._names = [agent.name for agent in case.vehicles()]
        self._vehicles = list(vehicles)
        self._driven = sorted(driven)
        self._ours = [column for column in range(len(vehicles)) if column not in driven]
        self._gone: set[int] = set()
        self._leaving: list[str] = []
        self._rows, self._next = array("d"), 0
        net = network(case.scenario.place, case.scenario.signals())
        self._plane: World | None = None
        self._sumo = acquire(limit)
        try:
            if self._ours:
                self._plane = engines.usual().world([vehicles[k] for k in self._ours], [starts[k] for k in self._ours])
            others = [self._names[column] for column in self._ours]
            row = self._sumo.load(net, departures(case, attributes), self._names, others, seed)
            self._motions = list(starts)
            self._motions = self._motions_from(row, 0)
            self._check_departures(starts)
        except BaseException:
            self.close()
            raise
        self._before = self._motions

    def motions(self) -> list[Motion]:
        """Return the present motion of every vehicle."""
        return list(self._motions)

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one time step: the vehicles of the engine move under `forces`, and SUMO moves its vehicles.

        SUMO's vehicles react to the positions that the other vehicles had before the step.
        """
        self._before = self._motions
        try:
            if self._plane is not None:
                self._plane.step([force for column in self._ours for force in forces[3 * column : 3 * column + 3]])
                moved = zip(self._ours, self._plane.motions(), strict=True)
                fronts = {
                    self._names[column]: self._front(column, motion) for column, motion in moved if column not in self._gone
                }
                self._rows, self._next = self._sumo.step(1, fronts, self._leaving), 0
                self._leaving = []
            elif self._next >= len(self._rows):
                self._rows, self._next = self._sumo.step(_AHEAD, {}, []), 0
        except SumoFailed as error:
            raise Halt(self._names[self._driven[0]], str(error), error.detail) from None
        self._motions = self._motions_from(self._rows, self._next)
        self._next += 4 * len(self._names)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs of vehicles that were in contact at the beginning of the latest step."""
        touching = [] if self._plane is None else self._plane.contacts()
        pairs = {(self._ours[first], self._ours[second]) for first, second in touching}
        boxes: dict[int, Box] = {}
        for column, (motion, vehicle) in enumerate(zip(self._before, self._vehicles, strict=True)):
            if column not in self._gone:
                x, y, *_ = self._front(column, motion)
                boxes[column] = Box(x, y, motion.yaw, vehicle.length, vehicle.width)
        for first, second in combinations(boxes, 2):
            if (first in self._driven or second in self._driven) and gap(boxes[first], boxes[second]) < 0.0:
                pairs.add((first, second))
        return sorted(pairs)

    def remove(self, body: int) -> None:
        """Remove a vehicle from the physics engine; SUMO removes its own vehicles at the end of their ways."""
        self._gone.add(body)
        if body in self._ours and self._plane is not None:
            self._plane.remove(self._ours.index(body))
            self._leaving.append(self._names[body])

    def close(self) -> None:
        """Close the physics engine, and release the process of SUMO for the next simulation."""
        if self._plane is not None:
            self._plane.close()
        release(self._sumo)

    def _motions_from(self, rows: array[float], first: int) -> list[Motion]:
        """Return the new motions of all vehicles, those of SUMO's vehicles from SUMO's answer."""
        motions = list(self._motions)
        if self._plane is not None:
            for column, motion in zip(self._ours, self._plane.motions(), strict=True):
                motions[column] = motion
        for column in self._driven:
            x, y, heading, speed = rows[first + 4 * column : first + 4 * column + 4]
            before = motions[column]
            if math.isnan(x):  # the vehicle has left SUMO; it continues straight until its zone is gone
                motions[column] = before._replace(x=before.x + before.vx * DT, y=before.y + before.vy * DT, yaw_rate=0.0)
                continue
            yaw = before.yaw + math.remainder(math.radians(90.0 - heading) - before.yaw, math.tau)
            cos, sin, behind = math.cos(yaw), math.sin(yaw), self._vehicles[column].gravity_offset
            rate = (yaw - before.yaw) / DT
            motions[column] = Motion(x - behind * cos, y - behind * sin, yaw, speed * cos, speed * sin, rate)
        return motions

    def _front(self, column: int, motion: Motion) -> tuple[float, float, float, float]:
        """Return a motion in SUMO's terms: x, y of the front bumper [m], heading clockwise from north [degrees], speed [m/s]."""
        cos, sin, ahead = math.cos(motion.yaw), math.sin(motion.yaw), self._vehicles[column].gravity_offset
        heading = (90.0 - math.degrees(motion.yaw)) % 360.0
        return motion.x + ahead * cos, motion.y + ahead * sin, heading, motion.vx * cos + motion.vy * sin

    def _check_departures(self, starts: Sequence[Motion]) -> None:
        """Check that SUMO's vehicles depart with the positions and speeds of `starts`, and set their yaw rates to 0."""
        for column in self._driven:
            x, y, _, speed = self._front(column, self._motions[column])
            expected = self._front(column, starts[column])
            if max(math.hypot(x - expected[0], y - expected[1]), abs(speed - expected[3])) > _EXACT:
                raise RunError(
                    f"SUMO lets {self._names[column]} depart at ({x:.2f}, {y:.2f}) with {speed:.2f} m/s, expected "
                    f"({expected[0]:.2f}, {expected[1]:.2f}) with {expected[3]:.2f} m/s: choose another start"
                )
            self._motions[column] = self._motions[column]._replace(yaw_rate=0.0)


def departures(case: Case, attributes: Mapping[str, str]) -> str:
    """Return the content of SUMO's route file for a case (page "Definition of Vehicles, Vehicle Types, and Routes" of SUMO).

    Every vehicle departs at time 0. The vehicles stand in the order of their creation.
    """
    scenario, root = case.scenario, Element("routes")
    created = scenario.creation.index
    rows = sorted(zip(case.vehicles(), case.starts(), strict=True), key=lambda row: created(row[0].entrance))
    for agent, (distance, speed) in rows:
        (start, lane), (end, exit_lane) = lane_in(scenario.place, agent.entrance), lane_out(scenario.place, agent.exit)
        # SUMO refuses speeds above the limit; vehicles with another driver get their speed in the first step.
        allowed = min(speed, lane_limit(scenario.place.way_in(agent.entrance), -1))
        # SUMO's position of a vehicle is the position of its front bumper, as in a scenario.
        departure = lane, scenario.place.approach(agent.entrance) - distance, allowed
        vehicle = case.fleet.of(agent.name)
        _add_vehicle(root, agent.name, vehicle, scenario.aggression, attributes, (start, end), departure, exit_lane)
    return tostring(root, encoding="unicode")


def lone_departure(name: str, speed: float, vehicle: Vehicle, aggression: int, attributes: Mapping[str, str]) -> str:
    """Return the content of a route file with a single vehicle on a straight road, departing at a speed [m/s]."""
    root = Element("routes")
    _add_vehicle(root, name, vehicle, aggression, attributes, ("in0",), (0, vehicle.length, speed), 0)
    return tostring(root, encoding="unicode")


def _add_vehicle(
    root: Element,
    name: str,
    vehicle: Vehicle,
    aggression: int,
    attributes: Mapping[str, str],
    edges: Sequence[str],
    departure: tuple[int, float, float],
    exit_lane: int,
) -> None:
    """Add a vehicle type and its vehicle, which departs on a lane, at a position [m] and with a speed [m/s]."""
    decel = vehicle.brake[aggression - 1]
    defaults = {
        "length": repr(vehicle.length),
        "width": repr(vehicle.width),
        "height": repr(vehicle.height),
        "accel": repr(vehicle.drive),
        "decel": repr(decel),
        "emergencyDecel": repr(max(decel, _EMERGENCY)),
        "speedFactor": "1",  # no vehicle prefers a speed other than the limit
        "speedDev": "0",
    }
    SubElement(root, "vType", {"id": name, **defaults, **attributes})
    lane, place, speed = departure
    departing = {
        "id": name,
        "type": name,
        "depart": "0",
        "departLane": str(lane),
        "departPos": repr(place),
        "departSpeed": repr(speed),
        "arrivalLane": str(exit_lane),
        "insertionChecks": "none",
    }
    SubElement(SubElement(root, "vehicle", departing), "route", edges=" ".join(edges))
