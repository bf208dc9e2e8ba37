"""Bodies of vehicles: worlds that move bodies, vehicle dynamics, and how a motion in a world becomes a state of a run.

A world has rigid bodies in the plane, moved by an engine that detects and resolves collisions.

The dynamics are the actuators and tyre forces of a dynamic single-track model. The model has one wheel per axle (Rajamani,
Vehicle Dynamics and Control, 2nd ed., section 2.3). Every axle has a linear cornering stiffness inside a friction circle, whose
radius follows the quasi-static load transfer. Two caps replace a special model for low speeds: no force reverses a motion
within one step, so a standing vehicle stays at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from pytest_rvads.logic.conduct.lane import MAX_OFFSET, beside
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import DT, Halt
from pytest_rvads.runs.states import GRAVITY, Agent, Vehicle, VehicleState

_LATERAL_CAP = 0.5
"""Largest share of an axle's lateral velocity that its tyres take away in one step."""
_REST = 1e-9
"""A vehicle slower than this is at rest [m/s, rad/s]."""

MAX_SPEED = 70.0
"""A vehicle at least this fast was thrown away by an error of the engine; no vehicle drives this fast [m/s]."""
_WINDOW = 0.75
"""Greatest change of the station in a step [m]: more than MAX_SPEED times the step."""
_ROLLING_BACK = 0.01
"""Backward speed above which a vehicle counts as moving backwards, for example after a collision [m/s]."""


class Motion(NamedTuple):
    """Place and velocity of a body's centre of gravity, in the frame of the map."""

    x: float
    """East coordinate [m]."""
    y: float
    """North coordinate [m]."""
    yaw: float
    """Heading, counter-clockwise from east, not wrapped [rad]."""
    vx: float
    """Velocity to the east [m/s]."""
    vy: float
    """Velocity to the north [m/s]."""
    yaw_rate: float
    """Change of the heading [rad/s]."""


class World(Protocol):
    """Rigid bodies in the plane: the part of a physics engine that a simulation uses."""

    def motions(self) -> list[Motion]:
        """Return the motion of every body, in the order of the vehicles given to the `WorldMaker`."""

    def step(self, forces: Sequence[float]) -> None:
        """Advance by one step of `DT` under forces along x [N] and y [N] and a moment about the vertical [N m] per body, flat."""

    def contacts(self) -> list[tuple[int, int]]:
        """Return the pairs (lower index first) of bodies that touched at the start of the last step."""

    def remove(self, body: int) -> None:
        """Take `body` out of the world: the body stands still and touches nothing any more."""

    def close(self) -> None:
        """Free the resources of the world, which can't be used afterwards."""


WorldMaker = Callable[[Sequence[Vehicle], Sequence[Motion]], World]
"""Makes a world from vehicles (mass, inertia, body) and their initial motions, in the same order.

The state of the engine is built anew for every world, so that a run does not depend on earlier runs.
"""


class Dynamics:
    """Actuators and tyres of one vehicle. The state consists of the actuators and the last acceleration.

    The braking level `aggression`, 1, 2 or 3, selects the deceleration at full service brake.
    """

    def __init__(self, vehicle: Vehicle, aggression: int = 1) -> None:
        v = vehicle
        self._mass = v.mass
        self._push, self._push_share = v.drive, 1.0 - math.exp(-DT / v.drive_lag)
        self._hold, self._hold_share = v.brake[aggression - 1], 1.0 - math.exp(-DT / v.brake_lag)
        self._steering_limit, self._steering_step = v.steering_limit, v.steering_rate * DT
        self._front, self._rear = v.front_axle, v.rear_axle
        self._front_stiffness, self._rear_stiffness = v.front_stiffness, v.rear_stiffness
        # The caps follow from the mass that an axle moves when a force pushes the axle sideways.
        self._front_cap = _LATERAL_CAP / DT / (1 / v.mass + v.front_axle**2 / v.yaw_inertia)
        self._rear_cap = _LATERAL_CAP / DT / (1 / v.mass + v.rear_axle**2 / v.yaw_inertia)
        self._weight = v.mass * GRAVITY
        self._front_load = self._weight * v.rear_axle / v.wheelbase
        self._transfer = v.gravity_height / v.wheelbase
        self._friction = v.friction
        self._rolling = v.rolling * self._weight
        self._drag = v.drag
        self._stop, self._turn_stop = v.mass / DT, v.yaw_inertia / DT
        self.drive = 0.0
        """Drive acceleration that the lag has let through [m/s^2]."""
        self.brake = 0.0
        """Brake deceleration that the lag has let through [m/s^2]."""
        self.steering = 0.0
        """Angle of the front wheels [rad]."""
        self._pull = 0.0
        """Force of the tyres along the vehicle in the last step, which shifts load between the axles [N]."""

    def forces(
        self, cos: float, sin: float, vx: float, vy: float, yaw_rate: float, throttle: float, brake: float, steering: float
    ) -> tuple[float, float, float]:
        """Advance the actuators by one step, and return force along the map's x [N], along its y [N], and moment [N m] during it.

        `vx` and `vy` are the velocity of the centre of gravity along the map's x and y [m/s], and `yaw_rate` is the change of the
        heading [rad/s]. `steering`, the wanted angle of the front wheels [rad], is clamped to what the vehicle can turn.
        """
        self.drive += self._push_share * (throttle * self._push - self.drive)
        self.brake += self._hold_share * (brake * self._hold - self.brake)
        limit, rate = self._steering_limit, self._steering_step
        target = limit if steering > limit else -limit if steering < -limit else steering
        change = target - self.steering
        self.steering += rate if change > rate else -rate if change < -rate else change

        forward = vx * cos + vy * sin
        left = vy * cos - vx * sin

        push = self._mass * self.drive
        resistance = self._mass * self.brake + self._rolling
        if push <= resistance and -_REST < forward < _REST and -_REST < left < _REST and -_REST < yaw_rate < _REST:
            # At rest the tyres stick: the forces stop the motion that rounding errors have left.
            self._pull = 0.0
            return -self._stop * vx, -self._stop * vy, -self._turn_stop * yaw_rate

        # Along the vehicle: brake and rolling resistance can stop the vehicle within the step, but not reverse it.
        free = forward + push / self._stop
        enough = self._stop * (free if free > 0.0 else -free)
        resistance = resistance if resistance < enough else enough
        if free < 0.0:
            resistance = -resistance

        shift = self._pull * self._transfer
        front_load = self._front_load - shift
        # Each axle brakes in proportion to its load, and only the front axle drives.
        share = front_load / self._weight
        share = 0.0 if share < 0.0 else 1.0 if share > 1.0 else share
        front_load = share * self._weight
        front_along = push - resistance * share
        rear_along = -resistance * (1.0 - share)

        # Across the vehicle: slip angle times stiffness.
        c, s = (math.cos(self.steering), math.sin(self.steering)) if self.steering else (1.0, 0.0)
        across = left + self._front * yaw_rate
        slip = across * c - forward * s
        along = forward * c + across * s
        front_across = _cornering(slip, along, self._front_stiffness, self._front_cap)
        slip = left - self._rear * yaw_rate
        rear_across = _cornering(slip, forward, self._rear_stiffness, self._rear_cap)

        radius = self._friction * front_load
        size = front_along * front_along + front_across * front_across
        if size > radius * radius:
            scale = radius / math.sqrt(size)
            front_along *= scale
            front_across *= scale
        radius = self._friction * (self._weight - front_load)
        size = rear_along * rear_along + rear_across * rear_across
        if size > radius * radius:
            scale = radius / math.sqrt(size)
            rear_along *= scale
            rear_across *= scale

        side = front_along * s + front_across * c
        along = front_along * c - front_across * s + rear_along
        self._pull = along
        along -= self._drag * forward * (forward if forward > 0.0 else -forward)
        across = side + rear_across
        return along * cos - across * sin, along * sin + across * cos, self._front * side - self._rear * rear_across


def _cornering(slip: float, along: float, stiffness: float, cap: float) -> float:
    """Return the lateral force of an axle [N] that moves at `slip` sideways and `along` its wheels [m/s]."""
    if slip == 0.0:
        return 0.0
    speed = slip if slip > 0.0 else -slip
    force = stiffness * math.atan2(speed, along if along > 0.0 else -along)
    cap_force = cap * speed
    force = force if force < cap_force else cap_force
    return -force if slip > 0.0 else force


class Body:
    """One simulated vehicle: its dynamics, and the place of its reference point on the itinerary, at the start `station` [m]."""

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
        """Return the next state of the vehicle in the run, for its motion one step after the last sample."""
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
            if not all(map(math.isfinite, motion)):
                raise Halt(self._name, f"the motion of {self._name} is no longer finite: {tuple(motion)}")
            pace = math.hypot(vx, vy)
            if pace >= MAX_SPEED:
                raise Halt(self._name, f"{self._name} was thrown away: it moves at {pace:.0f} m/s")
        if along < self._along and speed > -_ROLLING_BACK:
            # At a joint of overlapping lanes, the nearest point can jump back although the vehicle moves forward.
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


def start(itinerary: Itinerary, station: float, speed: float, vehicle: Vehicle) -> Motion:
    """Return the motion of a vehicle placed with its reference point at `station` [m], driving at `speed` [m/s]."""
    x, y, yaw = itinerary.placed(station, vehicle.rear_axle_offset)
    cos, sin = math.cos(yaw), math.sin(yaw)
    ahead = vehicle.gravity_offset
    return Motion(x - ahead * cos, y - ahead * sin, yaw, speed * cos, speed * sin, 0.0)
