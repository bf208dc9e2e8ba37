"""The world of the simulator ``sumo``: SUMO moves its vehicles, a physics engine ours, and each has those of the other in it."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

from pytest_rvads.conduct.bodies import Box, gap
from pytest_rvads.errors import RunError
from pytest_rvads.physics import engines
from pytest_rvads.physics.world import Motion, World
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.vehicle import Vehicle
from pytest_rvads.satellites.sumo.departures import departures
from pytest_rvads.satellites.sumo.road_network import network
from pytest_rvads.satellites.sumo.sumo_process import SumoFailed, acquire, release
from pytest_rvads.scenarios.case import Case

__all__ = ["SumoWorld"]

_AHEAD = 100
"""Steps per call if SUMO drives all vehicles; the results equal those of single steps."""
_EXACT = 0.01
"""Largest deviation of a departure in SUMO from the start [m], [m/s]: joints of lanes may have gaps of this size."""


class SumoWorld:
    """A `World` in which SUMO drives some vehicles.

    Contacts are those of the boxes, where a vehicle of SUMO takes part in them: it feels nothing of them.

    Args:
        case: what is simulated.
        driven: columns of SUMO's vehicles, one at least.
        seed: of SUMO's random numbers.
        attributes: of the vehicle types, see `departures`.
        vehicles: per column.
        starts: initial motion per column.

    Raises:
        MapError: it is not known where the lanes of the junction lie.
        ScenarioError: SUMO has no such junction.
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
        self._names = [agent.name for agent in case.agents()]
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
            self._motions = self._placed(row, 0)
            self._check(starts)
            if self._ours:
                self._plane = engines.usual().world([vehicles[k] for k in self._ours], [starts[k] for k in self._ours])
                self._take(self._plane)
        except BaseException:
            self.close()
            raise
        self._before, self._touching = self._motions, self._contacts_in_plane()

    def motions(self) -> list[Motion]:
        """Return the motion of every vehicle."""
        return list(self._motions)

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step: ours under `forces`, SUMO's by what was where before.

        Raises:
            Halt: SUMO ended or does not answer.
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
        self._motions = self._placed(self._rows, self._next)
        self._next += 4 * len(self._names)
        if self._plane is not None:
            self._take(self._plane)

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs of vehicles that touched at the start of the last step."""
        found = set(self._touching)
        for one, two in combinations(range(len(self._names)), 2):
            if (one in self._driven or two in self._driven) and not {one, two} & self._gone and self._overlap(one, two):
                found.add((one, two))
        return sorted(found)

    def remove(self, body: int) -> None:
        """Take a vehicle out; SUMO's arrive by themselves where their way ends."""
        self._gone.add(body)
        if body in self._ours and self._plane is not None:
            self._plane.remove(self._ours.index(body))
            self._leaving.append(self._names[body])

    def close(self) -> None:
        """Free the engine, and SUMO for the next world."""
        if self._plane is not None:
            self._plane.close()
        release(self._sumo)

    def _advance(self) -> None:
        """Let SUMO take the next steps: a single step if other vehicles are simulated outside SUMO and have to be moved."""
        if self._plane is None:
            self._rows = self._sumo.step(_AHEAD, {}, [])
        else:
            moved = zip(self._ours, self._plane.motions(), strict=True)
            told = {self._names[column]: self._front(column, motion) for column, motion in moved if column not in self._gone}
            self._rows, self._leaving = self._sumo.step(1, told, self._leaving), []
        self._next = 0

    def _take(self, plane: World) -> None:
        """Take over where ours are."""
        for column, motion in zip(self._ours, plane.motions(), strict=True):
            self._motions[column] = motion

    def _placed(self, rows: array[float], first: int) -> list[Motion]:
        """Return the motions of SUMO's vehicles from the row that begins at `first`, those of the others as they were."""
        motions = list(self._motions)
        for column in self._driven:
            x, y, heading, speed = rows[first + 4 * column : first + 4 * column + 4]
            before = motions[column]
            if math.isnan(x):  # it has arrived: it goes on until it counts as gone
                motions[column] = before._replace(x=before.x + before.vx * DT, y=before.y + before.vy * DT, yaw_rate=0.0)
                continue
            yaw = before.yaw + math.remainder(math.radians(90.0 - heading) - before.yaw, math.tau)
            cos, sin, behind = math.cos(yaw), math.sin(yaw), self._vehicles[column].gravity_offset
            rate = (yaw - before.yaw) / DT
            motions[column] = Motion(x - behind * cos, y - behind * sin, yaw, speed * cos, speed * sin, rate)
        return motions

    def _front(self, column: int, motion: Motion) -> tuple[float, float, float, float]:
        """Return a vehicle's position in SUMO's terms: front bumper [m], heading clockwise from north [degrees], speed [m/s]."""
        cos, sin, ahead = math.cos(motion.yaw), math.sin(motion.yaw), self._vehicles[column].gravity_offset
        heading = (90.0 - math.degrees(motion.yaw)) % 360.0
        return motion.x + ahead * cos, motion.y + ahead * sin, heading, motion.vx * cos + motion.vy * sin

    def _check(self, starts: Sequence[Motion]) -> None:
        """Check that SUMO's vehicles depart with the positions, headings and speeds of `starts`."""
        for column in self._driven:
            x, y, _, speed = self._front(column, self._motions[column])
            wanted = self._front(column, starts[column])
            if max(math.hypot(x - wanted[0], y - wanted[1]), abs(speed - wanted[3])) > _EXACT:
                raise RunError(
                    f"SUMO lets {self._names[column]} depart at ({x:.2f}, {y:.2f}) with {speed:.2f} m/s, expected "
                    f"({wanted[0]:.2f}, {wanted[1]:.2f}) with {wanted[3]:.2f} m/s: choose another start"
                )
            self._motions[column] = self._motions[column]._replace(yaw_rate=0.0)

    def _contacts_in_plane(self) -> list[tuple[int, int]]:
        return [] if self._plane is None else [(self._ours[one], self._ours[two]) for one, two in self._plane.contacts()]

    def _overlap(self, one: int, two: int) -> bool:
        """Tell whether the boxes of two vehicles overlapped before the last step."""
        return gap(self._box(one), self._box(two)) < 0.0

    def _box(self, column: int) -> Box:
        motion, vehicle = self._before[column], self._vehicles[column]
        ahead = vehicle.gravity_offset
        x, y = motion.x + ahead * math.cos(motion.yaw), motion.y + ahead * math.sin(motion.yaw)
        return Box(x, y, motion.yaw, vehicle.length, vehicle.width)
