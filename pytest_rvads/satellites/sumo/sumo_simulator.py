"""The simulator ``sumo``: runs of cases in which SUMO's models drive the vehicles with the driver ``sumo``.

A vehicle with another driver is moved by the commands of that driver and by the vehicle dynamics of this package, because a
verdict must be about the driver that was named. SUMO runs in another process, so that a crash or hang of SUMO ends a single run.
"""

from __future__ import annotations

import math
import os
from array import array
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from importlib.util import find_spec
from itertools import combinations
from numbers import Real
from types import MappingProxyType
from xml.etree.ElementTree import Element, SubElement, tostring

from pytest_rvads.drivers.traffic import SumoDriver
from pytest_rvads.logic.conduct.bodies import Box, gap
from pytest_rvads.physics import engines
from pytest_rvads.physics.body import Motion, World
from pytest_rvads.physics.braking import FASTEST, cached, check_start, greatest_safe, vmax
from pytest_rvads.runs.run import DT, Halt, Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.satellites.sumo.road_network import lane_in, lane_limit, lane_out, network, straight
from pytest_rvads.satellites.sumo.sumo_process import SumoFailed, acquire, release
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.configurations import forks
from pytest_rvads.scenarios.senses import Senses
from pytest_rvads.simulators.loop import Loop, usual
from pytest_rvads.simulators.patience import USUAL, Watch
from pytest_rvads.support.errors import RunError, ScenarioError, needs, require
from pytest_rvads.support.installed import versions

SEED = 23423
"""SUMO's default seed; a run uses the sum of this seed and the seed of the scenario's senses."""
_FIXED_ATTRIBUTES = ("id", "length", "width", "height")
"""Attributes of vehicle types that the case determines, so that users can't set them."""
_LIBRARIES = ("libsumo", "eclipse-sumo")


class Sumo:
    """SUMO's microscopic traffic simulation, in steps of 0.01 s.

    SUMO's models move the vehicles with the driver ``sumo`` along their lanes. Vehicles with other drivers are driven as in
    every simulator and moved by the vehicle dynamics of this package. SUMO gets the positions of these vehicles in every step.

    Args:
        attributes: attributes of the vehicle types in SUMO that replace SUMO's defaults for all vehicles, such as ``sigma=0`` or
            ``jmTimegapMinor=2``; see SUMO's page "Definition of Vehicles, Vehicle Types, and Routes". The sizes of vehicles can't
            be set, because the case determines them.

    Raises:
        ScenarioError: a name is no name of an attribute, a value is no number or text, or the case determines the attribute.
    """

    name = "sumo"
    caveat = (
        "SUMO's driver drives only where it is named (--rvads-autopilot sumo, traffic='sumo'); its vehicles have no tyres, brake "
        "without a lag and never leave their lanes, and v(d)max is the smaller of theirs and that of our dynamics"
    )
    drivers = (SumoDriver,)
    libraries = ("libsumo",)

    def __init__(self, **attributes: str | float) -> None:
        for name, value in attributes.items():
            if name in _FIXED_ATTRIBUTES or not (name.isascii() and name.isidentifier()):
                raise ScenarioError(
                    f"rvads.Sumo takes attributes of a vType of SUMO other than {', '.join(_FIXED_ATTRIBUTES)}, such as sigma=0, "
                    f"got {name!r:.60}: sizes are those of the vehicles in the fleet of a case"
                )
            require(value, str | Real, f"rvads.Sumo({name}=) takes a number or a text", ScenarioError)
        self.attributes: Mapping[str, str] = MappingProxyType({name: f"{value}" for name, value in attributes.items()})

    def __call__(self, case: Case, watch: Watch | None = None) -> Run:
        """Simulate a case, see `pytest_rvads.simulators.simulator.simulate`.

        A case in which no vehicle has the driver ``sumo`` is simulated by the default simulator, which the provenance of the
        run names. A ScenarioError is raised if SUMO can't represent the junction or the case, a RunError if SUMO failed.
        """
        _check_installation()
        scenario, agents = case.scenario, case.vehicles()
        drivers = [case.driver if case.traffic is None or a.name == scenario.under_test else case.traffic for a in agents]
        driven = tuple(column for column, driver in enumerate(drivers) if driver is SumoDriver)
        if case.driver is SumoDriver and scenario.senses != Senses(seed=scenario.senses.seed):
            raise ScenarioError(
                f"SUMO's driver has ideal senses and no delay, got senses with {scenario.senses.label} in {scenario.name}: "
                "choose ideal senses, or name another driver"
            )
        if driven and scenario.pedestrians:
            raise ScenarioError(
                f"SUMO's driver does not see pedestrians, and {scenario.name} has some: leave the pedestrians out, or name "
                "another driver"
            )
        farthest = {agent.entrance: distance for agent, (distance, _) in zip(agents, case.starts(), strict=True)}
        for fork in forks(scenario.place) if driven else ():
            first, second = fork.entrances
            if all(farthest.get(e, -math.inf) > parted for e, parted in zip(fork.entrances, fork.distances, strict=True)):
                raise ScenarioError(
                    f"the lanes of entrances {first} and {second} of junction {scenario.place.name!r} are one lane at the starts "
                    f"of {scenario.name}, where SUMO's vehicles would not see each other: choose smaller distances"
                )
        if not driven:
            return usual()(case, watch)
        seed = (SEED + scenario.senses.seed) % 2**31  # SUMO's seeds are smaller
        make = partial(SumoWorld, case, driven, seed, self.attributes, (watch or Watch()).limits.decision)
        loop = Loop(case, self.name, make, versions(*_LIBRARIES, engines.usual().library), driven, watch=watch)
        run = loop.drive()
        return replace(run, provenance={**run.provenance, "sumo": {"seed": seed, "attributes": dict(self.attributes)}})

    def vmax(self, distance: float, aggression: int = 1, vehicle: Vehicle | None = None) -> float | None:
        """Return the greatest speed [m/s] from which every vehicle can stop within a distance before its stopping line.

        For vehicles that SUMO drives, the speed is found by braking in SUMO, whose brakes have no lag. For vehicles with other
        drivers, the speed is the result of `pytest_rvads.physics.braking.vmax`. The smaller of the two speeds is returned.
        """
        check_start(distance, aggression)
        body = vehicle or Vehicle()
        attributes = dict(self.attributes)
        values = {"distance": float(distance), "aggression": aggression, "vehicle": asdict(body), "attributes": attributes}
        cache_key = {"what": self.name, "up to": FASTEST} | values
        limit_of_sumo = cached(cache_key, lambda: self._measured_vmax(distance, aggression, body), *_LIBRARIES)
        limit_of_dynamics = vmax(distance, aggression, body, limit=FASTEST)
        return None if limit_of_sumo is None or limit_of_dynamics is None else min(limit_of_sumo, limit_of_dynamics)

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value}" for name, value in self.attributes.items())
        return f"rvads.Sumo({arguments})" if arguments else "rvads.sumo"

    def _measured_vmax(self, distance: float, aggression: int, vehicle: Vehicle) -> float | None:
        _check_installation()
        road, process = straight(5000.0), acquire(USUAL.decision)  # a vehicle that needs more than 5 km can't stop
        try:

            def safe(speed: float) -> bool:
                return process.brake(road, lone_departure("a0", speed, vehicle, aggression, self.attributes), "a0") <= distance

            return greatest_safe(safe, FASTEST)
        finally:
            release(process)


def _check_installation() -> None:
    if os.name != "posix":
        raise ScenarioError(
            f"simulator 'sumo' needs a POSIX system for the process of SUMO, got {os.name!r}: choose another simulator"
        )
    if not find_spec("libsumo"):
        raise ScenarioError(needs("simulator 'sumo'", "libsumo", "sumo"))


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
            for column in self._driven:
                x, y, _, speed = self._front(column, self._motions[column])
                expected = self._front(column, starts[column])
                if max(math.hypot(x - expected[0], y - expected[1]), abs(speed - expected[3])) > _EXACT:
                    raise RunError(
                        f"SUMO lets {self._names[column]} depart at ({x:.2f}, {y:.2f}) with {speed:.2f} m/s, expected "
                        f"({expected[0]:.2f}, {expected[1]:.2f}) with {expected[3]:.2f} m/s: choose another start"
                    )
                self._motions[column] = self._motions[column]._replace(yaw_rate=0.0)
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


sumo: Sumo = Sumo()
