"""Bodies: a body turns the motion of a vehicle in the world into a state of the semantic model."""

from __future__ import annotations

import math

from pytest_rvads.logic.conduct.lane import MAX_OFFSET, beside
from pytest_rvads.physics.dynamics import Dynamics
from pytest_rvads.physics.world import Motion
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import Agent, VehicleState
from pytest_rvads.runs.vehicle import Vehicle

__all__ = ["Body", "start"]

MAX_SPEED = 70.0
"""A vehicle at least this fast was thrown away by an error of the engine; no vehicle drives this fast [m/s]."""
_WINDOW = 0.75
"""Greatest change of the station in a step [m]: more than MAX_SPEED times the step."""
_ROLLING_BACK = 0.01
"""Backward speed above which a vehicle counts as moving backwards, for example after a collision [m/s]."""


class Body:
    """One simulated vehicle: its station on the itinerary, and its dynamics.

    Args:
        agent: the agent of the body.
        itinerary: itinerary of the agent.
        station: station of the reference point at the start [m].
        vehicle: parameters of the vehicle.
        aggression: braking level 1, 2 or 3 of the scenario.
    """

    state: VehicleState
    """The last sampled state."""

    def __init__(self, agent: Agent, itinerary: Itinerary, station: float, vehicle: Vehicle, aggression: int) -> None:
        self.agent = agent
        self.itinerary = itinerary
        self.dynamics = Dynamics(vehicle, aggression)
        self.cos = 1.0
        self.sin = 0.0
        self.strayed = False
        """Whether the vehicle has left its route."""
        self._path, self._origin = itinerary.path, itinerary.origin
        self._along = station + itinerary.origin
        self._ahead = vehicle.gravity_offset
        self._length, self._width = vehicle.length, vehicle.width
        self._name, self._entrance, self._turn, self._kind = agent.name, agent.entrance, agent.turn, agent.kind
        self._motion: Motion | None = None

    def sample(self, motion: Motion) -> VehicleState:
        """Return the next state of the semantic model, for the motion of the vehicle one step after the last sample.

        Raises:
            Halt: the motion is not finite, or the vehicle was thrown away.
        """
        before, self._motion = self._motion, motion
        if motion == before:
            # The vehicle is at rest, as waiting vehicles are most of the time.
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
            self._check_plausible(motion)
        if along < self._along and speed > -_ROLLING_BACK:
            # At a joint of overlapping lanes, the nearest point may jump back although the vehicle moves forward.
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

    def _check_plausible(self, motion: Motion) -> None:
        """Raise a `Halt` for a motion that is not finite or too fast."""
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
