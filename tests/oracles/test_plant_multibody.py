"""The plant against the 29-state multibody model of `commonroad-vehicle-models` (Althoff and Würsching 2020), a BMW 320i.

Both get the same initial motion and the same actuator histories; rolling and air resistance, which the multibody model
lacks, are switched off. Needs an environment of its own: `pip install commonroad-vehicle-models==3.0.2 scipy`.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pytest_rvads.physics.body import Dynamics, Motion
from pytest_rvads.physics.engines import usual
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import GRAVITY, Vehicle

pytest.importorskip("vehiclemodels")
integrate = pytest.importorskip("scipy.integrate")

Command = Callable[[float], tuple[float, float]]
"""Time [s] to brake deceleration [m/s^2] and wanted steering angle [rad]."""


@pytest.fixture(scope="module")
def parameters() -> Any:
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2

    return parameters_vehicle2()


@pytest.fixture(scope="module")
def bmw(parameters: Any) -> Vehicle:
    p = parameters
    weight = p.m * GRAVITY
    return Vehicle(
        mass=p.m,
        yaw_inertia=p.I_z,
        front_axle=p.a,
        rear_axle=p.b,
        gravity_height=p.h_s,
        length=p.l,
        width=p.w,
        friction=p.tire.p_dy1,
        # Initial slope of the magic formula, per axle.
        front_stiffness=-p.tire.p_ky1 * weight * p.b / (p.a + p.b),
        rear_stiffness=-p.tire.p_ky1 * weight * p.a / (p.a + p.b),
        steering_limit=p.steering.max,
        steering_rate=p.steering.v_max,
        brake=(8.0, 8.0, 8.0),
        rolling=1e-9,
        drag=1e-9,
    )


def drive(
    vehicle: Vehicle, speed: float, command: Command, until: Callable[[float, Motion], bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Our plant: motions (k, 6), and the brake deceleration and steering angle in force in each step (k, 2)."""
    dynamics = Dynamics(vehicle)
    world = usual().world([vehicle], [Motion(0.0, 0.0, 0.0, speed, 0.0, 0.0)])
    motions, actuators = [], []
    for k in range(2000):
        (motion,) = world.motions()
        motions.append(motion)
        if until(k * DT, motion):
            break
        brake, steering = command(k * DT)
        world.step(
            dynamics.forces(
                math.cos(motion.yaw), math.sin(motion.yaw), motion.vx, motion.vy, motion.yaw_rate, 0.0, brake / 8.0, steering
            )
        )
        actuators.append((dynamics.brake, dynamics.steering))
    world.close()
    return np.array(motions), np.array(actuators)


def multibody(parameters: Any, speed: float, actuators: np.ndarray) -> np.ndarray:
    """The multibody model under the same actuator histories: states (k, 29) at our steps."""
    from vehiclemodels.init_mb import init_mb
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

    start = init_mb([0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0], parameters)
    rates = np.diff(actuators[:, 1], prepend=0.0) / DT
    last = len(actuators) - 1

    def change(x: np.ndarray, time: float) -> Any:
        k = min(int(time / DT), last)
        return vehicle_dynamics_mb(x, [rates[k], -actuators[k, 0]], parameters)

    return integrate.odeint(change, start, np.arange(last + 2) * DT, rtol=1e-5, atol=1e-7, hmax=DT)


@pytest.mark.parametrize("deceleration", [4.0, 6.0, 8.0])
def test_straight_braking_within_six_percent(parameters: Any, bmw: Vehicle, deceleration: float) -> None:
    # Down to 2 m/s: the slips of the multibody model have no limit at a standstill.
    motions, actuators = drive(bmw, 10.0, lambda _: (deceleration, 0.0), lambda _, m: m.vx < 2.0)
    actuators = np.vstack([actuators, np.repeat(actuators[-1:], 20, axis=0)])
    other = multibody(parameters, 10.0, actuators)
    reached = np.flatnonzero(other[:, 3] < 2.0)[0]
    ours, theirs = motions[-1, 0], other[reached, 0]
    assert ours == pytest.approx(theirs, rel=0.06)


@pytest.mark.parametrize(("speed", "radius"), [(5.6, 10.0), (6.5, 13.0), (8.0, 17.0), (8.0, 20.0)])
def test_quarter_turn_within_half_a_metre_and_three_degrees(parameters: Any, bmw: Vehicle, speed: float, radius: float) -> None:
    steering = math.atan(bmw.wheelbase / radius)
    motions, actuators = drive(bmw, speed, lambda _: (0.0, steering), lambda _, m: m.yaw >= math.pi / 2)
    other = multibody(parameters, speed, actuators)
    # Cross-track: from the end of the one to the nearest point of the other.
    cross = np.hypot(other[:, 0] - motions[-1, 0], other[:, 1] - motions[-1, 1]).min()
    turned = math.degrees(other[-1, 4] - motions[-1, 2])
    assert cross < 0.5
    assert abs(turned) < 3.0


@pytest.mark.parametrize(("speed", "steering"), [(6.0, 0.1), (8.0, 0.1), (10.0, 0.05), (11.176, 0.1)])
def test_yaw_rate_of_a_step_steer_within_ten_percent(parameters: Any, bmw: Vehicle, speed: float, steering: float) -> None:
    motions, actuators = drive(bmw, speed, lambda _: (0.0, steering), lambda t, _: t >= 2.0)
    other = multibody(parameters, speed, actuators)
    for second in (0.5, 1.0, 2.0):
        k = round(second / DT)
        assert motions[k, 5] == pytest.approx(other[k, 5], rel=0.10)
