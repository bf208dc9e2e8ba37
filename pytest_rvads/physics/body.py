"""Bodies: a vehicle of a run, between the world that moves it and the semantic model that describes it."""

from __future__ import annotations

import math

from pytest_rvads.conduct.lane import MAX_OFFSET, beside
from pytest_rvads.physics.dynamics import Dynamics
from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import Agent, VehicleState
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["Body", "start"]

MAX_SPEED = 70.0
"""No vehicle here gets this fast by itself; one that does was thrown away [m/s]."""
_WINDOW = 0.75
"""How far around the last station the next one is looked for [m]: more than MAX_SPEED times the step."""
_ROLLING_BACK = 0.01
"""A vehicle faster than this backwards really moves backwards, as after a collision [m/s]."""


class Body:
    """One simulated vehicle: its place on the itinerary, and its dynamics.

    Args:
        agent: whose body it is.
        itinerary: its way.
        station: where its reference point starts [m].
        vehicle: its parameters.
        aggression: of the scenario.
    """

    state: VehicleState
    """The last one sampled."""

    def __init__(self, agent: Agent, itinerary: Itinerary, station: float, vehicle: Vehicle, aggression: int) -> None:
        self.agent = agent
        self.itinerary = itinerary
        self.dynamics = Dynamics(vehicle, aggression)
        self.cos = 1.0
        self.sin = 0.0
        self.strayed = False
        """Whether it has left its route."""
        self._path, self._origin = itinerary.path, itinerary.origin
        self._along = station + itinerary.origin
        self._ahead = vehicle.gravity_offset
        self._length, self._width = vehicle.length, vehicle.width
        self._name, self._entrance, self._turn, self._kind = agent.name, agent.entrance, agent.turn, agent.kind
        self._motion: Motion | None = None

    def sample(self, motion: Motion) -> VehicleState:
        """Return what the semantic model says of `motion`, the next state after the last one sampled.

        Raises:
            Halt: it is not finite, or the vehicle was thrown away.
        """
        before, self._motion = self._motion, motion
        if motion == before:
            # At rest, as vehicles that wait are most of the time.
            if self.state.acceleration:
                self.state = self.state._replace(acceleration=0.0)
            return self.state
        x, y, yaw, vx, vy, _ = motion
        cos = self.cos = math.cos(yaw)
        sin = self.sin = math.sin(yaw)
        x += self._ahead * cos
        y += self._ahead * sin
        along, offset = self._path.project(x, y, self._along, _WINDOW)
        speed = vx * cos + vy * sin
        # Comparisons with NaN are false, so this also catches a motion that is not finite.
        if not vx * vx + vy * vy < MAX_SPEED * MAX_SPEED or not -MAX_OFFSET <= offset <= MAX_OFFSET:
            self._check(motion)
        if along < self._along and speed > -_ROLLING_BACK:
            # Where lanes overlap at a joint, the nearest point may jump back; a vehicle that moves on does not.
            along = self._along
        self._along = along
        station = along - self._origin
        if not -MAX_OFFSET <= offset <= MAX_OFFSET:
            self.strayed = beside(self.itinerary, x, y, yaw, station, self._length)
        self.state = VehicleState(
            self._name,
            self._entrance,
            self._turn,
            self.itinerary.zone(station),
            station,
            x,
            y,
            yaw,
            speed,
            (speed - self.state.speed) / DT if before is not None else 0.0,
            self._length,
            self._width,
            self._kind,
        )
        return self.state

    def _check(self, motion: Motion) -> None:
        """Say what is wrong with a motion, if anything is."""
        name = self.agent.name
        if not all(map(math.isfinite, motion)):
            raise Halt(name, f"the motion of {name} is no longer finite: {tuple(motion)}")
        speed = math.hypot(motion.vx, motion.vy)
        if speed >= MAX_SPEED:
            raise Halt(name, f"{name} was thrown away: it moves at {speed:.0f} m/s")


def start(itinerary: Itinerary, station: float, speed: float, vehicle: Vehicle) -> Motion:
    """Return the motion of a vehicle placed with its reference point at `station` [m], driving at `speed` [m/s]."""
    x, y, yaw = itinerary.placed(station, vehicle.rear_axle_offset)
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead = vehicle.gravity_offset
    return Motion(x - ahead * cos, y - ahead * sin, yaw, speed * cos, speed * sin, 0.0)
