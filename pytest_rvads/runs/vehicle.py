"""The parameters and the kind of a vehicle, from which the plant is built and which autopilots may read."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from pytest_rvads.geometry.sweep import CAR, Body
from pytest_rvads.runs.states import Kind
from pytest_rvads.support.errors import ScenarioError, require

__all__ = ["GRAVITY", "Vehicle", "usual_body"]

GRAVITY = 9.81
"""[m/s^2]."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A passenger car on a dry road; every default is measured or typical of the class.

    Raises:
        ScenarioError: a parameter that is not finite or not positive, a wheelbase longer than the body, or no `Kind`.
    """

    mass: float = 1500.0
    """[kg]."""
    yaw_inertia: float = 2500.0
    """About the vertical axis [kg m^2]."""
    front_axle: float = 1.2
    """Centre of gravity to front axle [m]."""
    rear_axle: float = 1.5
    """Centre of gravity to rear axle [m]."""
    gravity_height: float = 0.55
    """Centre of gravity above the road [m]."""
    length: float = 4.6
    """Body, bumper to bumper [m]."""
    width: float = 1.86
    """Body [m]."""
    height: float = 1.4
    """Body [m]."""
    friction: float = 0.9
    """Coefficient between tyre and road."""
    front_stiffness: float = 90e3
    """Cornering stiffness of the front axle [N/rad]."""
    rear_stiffness: float = 100e3
    """Cornering stiffness of the rear axle [N/rad]."""
    drive: float = 3.0
    """Acceleration at full throttle [m/s^2]."""
    drive_lag: float = 0.25
    """Time constant of the drive [s]."""
    brake: tuple[float, float, float] = (4.0, 6.0, 8.0)
    """Deceleration at full service brake by aggression 1, 2, 3 [m/s^2]."""
    brake_lag: float = 0.12
    """Time constant of the brake [s]."""
    drag: float = 0.35
    """Air drag over speed squared [N s^2/m^2]."""
    rolling: float = 0.012
    """Rolling resistance over weight."""
    steering_limit: float = 0.61
    """Largest front wheel angle [rad]."""
    steering_rate: float = 0.8
    """Fastest change of the front wheel angle [rad/s]."""
    kind: Kind = Kind.CAR
    """The kind that other vehicles see; the plant depends on the parameters alone."""

    def __post_init__(self) -> None:
        *parameters, _ = fields(self)
        for item in parameters:
            value = getattr(self, item.name)
            for number in value if isinstance(value, tuple) else (value,):
                if not (isinstance(number, int | float) and math.isfinite(number) and number > 0):
                    raise ScenarioError(f"vehicle parameter {item.name} must be a positive number, got {value!r}")
        if len(self.brake) != 3:
            raise ScenarioError(f"vehicle parameter brake needs a deceleration for aggression 1, 2 and 3, got {self.brake!r}")
        require(self.kind, Kind, "vehicle parameter kind must be a rvads.Kind, such as rvads.Kind.TRUCK", ScenarioError)
        if self.wheelbase >= self.length:
            raise ScenarioError(f"vehicle wheelbase {self.wheelbase} m does not fit into a body of {self.length} m")

    @property
    def wheelbase(self) -> float:
        """Front axle to rear axle [m]."""
        return self.front_axle + self.rear_axle

    @property
    def turning_radius(self) -> float:
        """Radius of the circle on which the rear axle drives with the wheels turned as far as they go [m]."""
        return self.wheelbase / math.tan(min(self.steering_limit, 1.5))  # beyond, it turns on the spot

    @property
    def rear_axle_offset(self) -> float:
        """Reference point (front bumper) to rear axle [m]; the axles are centred in the body."""
        return (self.length + self.wheelbase) / 2

    @property
    def gravity_offset(self) -> float:
        """Reference point (front bumper) to centre of gravity [m]."""
        return self.rear_axle_offset - self.rear_axle

    @property
    def body(self) -> Body:
        """The dimensions that decide where the vehicle can go."""
        return Body(self.length, self.width, self.rear_axle_offset, self.turning_radius)


def usual_body(length: float, width: float) -> Body:
    """Return the body of a usual car of this size [m], where its axles and steering are not known."""
    size = length / CAR.length
    return Body(length, width, CAR.axle * size, CAR.radius * size)
