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
    """A `World` in which SUMO drives some vehicles.

    A vehicle of SUMO is in contact with another vehicle if the boxes of the two vehicles overlap. Such a contact has no effect on
    the motions.

    Args:
        case: the case to simulate.
        driven: columns (positions among the agents of the case) of the vehicles that SUMO drives, at least one.
        seed: seed of SUMO's random numbers.
        attributes: attributes of the vehicle types, see `departures`.
        vehicles: parameters of the vehicle in each column.
        starts: initial motion of the vehicle in each column.

    Raises:
        MapError: the geometry of the junction is not known.
        ScenarioError: SUMO can't represent the junction.
        RunError: SUMO or netconvert is not installed or failed.
    """

    def __init__(
        self,
        case: Case,
        driven: Collection[int],
        seed: int,
        attributes: Mapping[str, str],
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
        self._sumo = acquire()
        try:
            others = [self._names[column] for column in self._ours]
            row = self._sumo.load(net, departures(case, attributes), self._names, others, seed)
            self._motions = list(starts)
            self._motions = self._motions_from(row, 0)
            self._check_departures(starts)
            if self._ours:
                self._plane = engines.usual().world([vehicles[k] for k in self._ours], [starts[k] for k in self._ours])
                self._copy_motions(self._plane)
        except BaseException:
            self.close()
            raise
        self._before, self._touching = self._motions, self._contacts_in_plane()

    def motions(self) -> list[Motion]:
        """Return the present motion of every vehicle."""
        return list(self._motions)

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one time step: the vehicles of the engine move under `forces`, and SUMO moves its vehicles.

        SUMO's vehicles react to the positions that the other vehicles had before the step.
        """
        self._before = self._motions
        if self._plane is not None:
            self._plane.step([force for column in self._ours for force in forces[3 * column : 3 * column + 3]])
            self._touching = self._contacts_in_plane()
        try:
            if self._next >= len(self._rows):
                self._advance()
        except SumoFailed as error:
            raise Halt(self._names[self._driven[0]], str(error), error.detail) from None
        self._motions = self._motions_from(self._rows, self._next)
        self._next += 4 * len(self._names)
        if self._plane is not None:
            self._copy_motions(self._plane)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs of vehicles that were in contact at the beginning of the latest step."""
        pairs = set(self._touching)
        for first, second in combinations(range(len(self._names)), 2):
            if (
                (first in self._driven or second in self._driven)
                and not {first, second} & self._gone
                and self._overlap(first, second)
            ):
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

    def _advance(self) -> None:
        """Let SUMO simulate `_AHEAD` steps, or a single step if there are vehicles that the engine moves."""
        if self._plane is None:
            self._rows = self._sumo.step(_AHEAD, {}, [])
        else:
            moved = zip(self._ours, self._plane.motions(), strict=True)
            positions = {self._names[column]: self._front(column, motion) for column, motion in moved if column not in self._gone}
            self._rows, self._leaving = self._sumo.step(1, positions, self._leaving), []
        self._next = 0

    def _copy_motions(self, plane: World) -> None:
        """Take over the motions of the vehicles that the physics engine moves."""
        for column, motion in zip(self._ours, plane.motions(), strict=True):
            self._motions[column] = motion

    def _motions_from(self, rows: array[float], first: int) -> list[Motion]:
        """Return the motions of all vehicles, with new motions of SUMO's vehicles from SUMO's answer."""
        motions = list(self._motions)
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

    def _contacts_in_plane(self) -> list[tuple[int, int]]:
        return (
            [] if self._plane is None else [(self._ours[first], self._ours[second]) for first, second in self._plane.contacts()]
        )

    def _overlap(self, first: int, second: int) -> bool:
        """Return whether the boxes of two vehicles overlapped at the beginning of the latest step."""
        return gap(self._box(first), self._box(second)) < 0.0

    def _box(self, column: int) -> Box:
        motion, vehicle = self._before[column], self._vehicles[column]
        ahead = vehicle.gravity_offset
        x, y = motion.x + ahead * math.cos(motion.yaw), motion.y + ahead * math.sin(motion.yaw)
        return Box(x, y, motion.yaw, vehicle.length, vehicle.width)


def departures(case: Case, attributes: Mapping[str, str]) -> str:
    """Return the content of SUMO's route file for a case (page "Definition of Vehicles, Vehicle Types, and Routes" of SUMO).

    Every vehicle departs at time 0. The vehicles stand in the order of their creation.
    """
    scenario, root = case.scenario, Element("routes")
    created = scenario.creation.index
    rows = sorted(zip(case.vehicles(), case.starts(), strict=True), key=lambda row: created(row[0].entrance))
    for agent, (distance, speed) in rows:
        vehicle = case.fleet.of(agent.name)
        _add_type(root, agent.name, vehicle, scenario.aggression, attributes)
        (start, lane), (end, exit_lane) = lane_in(scenario.place, agent.entrance), lane_out(scenario.place, agent.exit)
        # SUMO's position of a vehicle is the position of its front bumper, as in a scenario.
        place = scenario.place.approach(agent.entrance) - distance
        speed = min(
            speed, lane_limit(scenario.place.way_in(agent.entrance), -1)
        )  # SUMO refuses higher speeds; vehicles with another driver get their speed in the first step
        _add_vehicle(root, agent.name, (start, end), (lane, exit_lane), place, speed)
    return tostring(root, encoding="unicode")


def lone_departure(name: str, speed: float, vehicle: Vehicle, aggression: int, attributes: Mapping[str, str]) -> str:
    """Return the content of a route file with a single vehicle on a straight road, departing at a speed [m/s]."""
    root = Element("routes")
    _add_type(root, name, vehicle, aggression, attributes)
    _add_vehicle(root, name, ("in0",), (0, 0), vehicle.length, speed)
    return tostring(root, encoding="unicode")


def _add_type(root: Element, name: str, vehicle: Vehicle, aggression: int, attributes: Mapping[str, str]) -> None:
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


def _add_vehicle(root: Element, name: str, edges: Sequence[str], lanes: tuple[int, int], place: float, speed: float) -> None:
    attributes = {
        "id": name,
        "type": name,
        "depart": "0",
        "departLane": str(lanes[0]),
        "departPos": repr(place),
        "departSpeed": repr(speed),  # SUMO refuses departures above the speed limit
        "arrivalLane": str(lanes[1]),
        "insertionChecks": "none",
    }
    SubElement(SubElement(root, "vehicle", attributes), "route", edges=" ".join(edges))
