"""Vehicle dynamics: actuators and tyre forces of a dynamic single-track model.

The model has one wheel per axle (Rajamani, Vehicle Dynamics and Control, 2nd ed., section 2.3). Every axle has a linear cornering
stiffness inside a friction circle, whose radius follows the quasi-static load transfer. Two caps replace a special model for low
speeds: no force reverses a motion within one step, so a standing vehicle stays at rest.
"""

from __future__ import annotations

import math

from pytest_rvads.runs.run import DT
from pytest_rvads.runs.vehicle import GRAVITY, Vehicle

__all__ = ["Dynamics"]

_LATERAL_CAP = 0.5
"""Share of an axle's lateral motion that its tyres may undo in one step."""
_REST = 1e-9
"""A vehicle slower than this is at rest [m/s, rad/s]."""


class Dynamics:
    """Actuators and tyres of one vehicle. The state consists of the actuators and the last acceleration.

    Args:
        vehicle: parameters of the vehicle.
        aggression: braking level 1, 2 or 3, which selects the deceleration at full service brake.
    """

    def __init__(self, vehicle: Vehicle, aggression: int = 1) -> None:
        v = vehicle
        self._mass = v.mass
        self._push, self._push_share = v.drive, 1.0 - math.exp(-DT / v.drive_lag)
        self._hold, self._hold_share = v.brake[aggression - 1], 1.0 - math.exp(-DT / v.brake_lag)
        self._steering_limit, self._steering_step = v.steering_limit, v.steering_rate * DT
        self._front, self._rear = v.front_axle, v.rear_axle
        self._front_stiffness, self._rear_stiffness = v.front_stiffness, v.rear_stiffness
        # Mass that an axle moves when pushed sideways.
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

    def forces(  # noqa: PLR0913 - plain numbers, because every step calls it
        self, cos: float, sin: float, vx: float, vy: float, yaw_rate: float, throttle: float, brake: float, steering: float
    ) -> tuple[float, float, float]:
        """Advance the actuators by one step and return the forces on the body during this step.

        Args:
            cos: of the heading.
            sin: of the heading.
            vx: velocity of the centre of gravity along the map's x [m/s].
            vy: along the map's y [m/s].
            yaw_rate: [rad/s].
            throttle: share of the drive force, 0..1.
            brake: share of the service brake, 0..1.
            steering: wanted angle of the front wheels [rad]; clamped to what the vehicle can turn.

        Returns:
            Force along the map's x [N], along its y [N], moment about the vertical [N m].
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

        # Along the vehicle: brake and rolling resistance may stop the vehicle within the step, but not reverse it.
        free = forward + push / self._stop
        enough = self._stop * (free if free > 0.0 else -free)
        resistance = resistance if resistance < enough else enough
        if free < 0.0:
            resistance = -resistance

        shift = self._pull * self._transfer
        front_load = self._front_load - shift
        # The brakes are distributed by load, the front axle drives.
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
