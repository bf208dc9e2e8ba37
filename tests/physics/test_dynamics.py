"""The plant: closed forms of straight driving, braking and cornering, and exact stand-still."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.physics.body import Dynamics, Motion
from pytest_rvads.physics.engines import usual
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import GRAVITY, Vehicle

IDEAL = Vehicle(brake=(50.0, 50.0, 50.0), brake_lag=1e-6, drive_lag=1e-6, drag=1e-9, rolling=1e-9)
"""No resistance, no lag, brakes that only the tyres limit."""


def drive(
    vehicle: Vehicle, speed: float, seconds: float, throttle: float = 0.0, brake: float = 0.0, steering: float = 0.0
) -> list[Motion]:
    """Motions of a vehicle at every step, the first at the origin heading east."""
    dynamics = Dynamics(vehicle)
    world = usual().world([vehicle], [Motion(0.0, 0.0, 0.0, speed, 0.0, 0.0)])
    motions = world.motions()
    for _ in range(round(seconds / DT)):
        m = motions[-1]
        world.step(dynamics.forces(math.cos(m.yaw), math.sin(m.yaw), m.vx, m.vy, m.yaw_rate, throttle, brake, steering))
        motions += world.motions()
    world.close()
    return motions


@pytest.mark.parametrize("speed", [5.0, 10.0, 15.0, 20.0])
def test_locked_brakes_stop_in_the_closed_form_distance(speed: float) -> None:
    # v^2 / 2 mu g, less v dt / 2 because velocities are integrated before positions.
    expected = speed**2 / (2 * IDEAL.friction * GRAVITY) - speed * DT / 2
    assert drive(IDEAL, speed, 5.0, brake=1.0)[-1].x == pytest.approx(expected, abs=2e-3)


def test_drive_and_resistances_balance() -> None:
    vehicle = Vehicle()
    motions = drive(vehicle, 0.0, 4.0, throttle=0.5)
    m = motions[-1]
    acceleration = (m.vx - motions[-2].vx) / DT
    resistance = vehicle.rolling * GRAVITY + vehicle.drag * m.vx**2 / vehicle.mass
    assert acceleration == pytest.approx(0.5 * vehicle.drive - resistance, rel=1e-3)


def test_brake_lag_is_first_order() -> None:
    vehicle = Vehicle(drag=1e-9, rolling=1e-9)
    speed = drive(vehicle, 10.0, 0.5, brake=1.0)[-1].vx
    lag = vehicle.brake_lag
    lost = vehicle.brake[0] * (0.5 - lag * (1 - math.exp(-0.5 / lag)))
    # A step commands for its whole length, so the lag is ahead by half a step.
    assert 10.0 - speed == pytest.approx(lost, abs=vehicle.brake[0] * DT)


@pytest.mark.parametrize("steering", [0.0, 0.3, -0.61])
def test_a_standing_vehicle_does_not_move_for_a_minute(steering: float) -> None:
    motions = drive(Vehicle(), 0.0, 60.0, brake=0.5, steering=steering)
    assert motions[-1] == motions[0] == Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_stopped_vehicle_stays_where_it_stopped() -> None:
    motions = drive(Vehicle(), 8.0, 60.0, brake=0.7, steering=0.2)
    assert abs(motions[500].vx) < 1e-9
    assert motions[-1][:3] == motions[500][:3]


def test_rolling_resistance_stops_a_vehicle_and_never_turns_it_round() -> None:
    motions = drive(Vehicle(), 1.0, 20.0)
    assert min(m.vx for m in motions) > -1e-9
    assert motions[-1].vx < 1e-9


@pytest.mark.parametrize(("speed", "steering"), [(4.0, 0.1), (8.0, 0.05), (11.0, 0.05), (11.0, -0.05)])
def test_steady_circle_has_the_yaw_rate_of_the_linear_single_track_model(speed: float, steering: float) -> None:
    # Rajamani, section 3.3: yaw rate = v delta / (L + K v^2), K = m / L (lr / Cf - lf / Cr).
    vehicle = Vehicle(drag=1e-9, rolling=1e-9)
    motions = drive(vehicle, speed, 1.5, steering=steering)
    m = motions[-1]
    v = math.hypot(m.vx, m.vy)
    gradient = (vehicle.rear_axle / vehicle.front_stiffness - vehicle.front_axle / vehicle.rear_stiffness) * vehicle.mass
    expected = v * math.tan(steering) / (vehicle.wheelbase + gradient / vehicle.wheelbase * v**2)
    assert m.yaw_rate == pytest.approx(expected, rel=0.02)


def test_tyres_never_give_more_than_friction() -> None:
    vehicle = Vehicle(drag=1e-9)
    motions = drive(vehicle, 20.0, 3.0, brake=0.6, steering=0.5)
    for one, two in pairwise(motions):
        pull = math.hypot(two.vx - one.vx, two.vy - one.vy) / DT
        assert pull <= vehicle.friction * GRAVITY * (1 + 1e-9)


@given(st.floats(0.0, 15.0), st.floats(0.0, 0.61), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_left_is_the_mirror_of_right(speed: float, steering: float, throttle: float, brake: float) -> None:
    left = drive(Vehicle(), speed, 1.0, throttle, brake, steering)[-1]
    right = drive(Vehicle(), speed, 1.0, throttle, brake, -steering)[-1]
    assert left.x == pytest.approx(right.x, abs=1e-9)
    assert left.y == pytest.approx(-right.y, abs=1e-9)
    assert left.yaw == pytest.approx(-right.yaw, abs=1e-9)


@given(st.floats(0.0, 30.0), st.floats(-0.61, 0.61), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_no_control_makes_the_plant_gain_energy_beyond_the_drive(
    speed: float, steering: float, throttle: float, brake: float
) -> None:
    vehicle = Vehicle()
    end = drive(vehicle, speed, 2.0, throttle, brake, steering)[-1]
    energy = math.hypot(end.vx, end.vy) ** 2 + vehicle.yaw_inertia / vehicle.mass * end.yaw_rate**2
    assert energy <= (speed + throttle * vehicle.drive * 2.0) ** 2 + 1e-6


def test_steering_is_limited_in_rate_and_angle() -> None:
    dynamics = Dynamics(Vehicle())
    angles = []
    for _ in range(100):
        dynamics.forces(1.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 1.5)
        angles.append(dynamics.steering)
    assert angles[0] == pytest.approx(0.8 * DT)
    assert angles[-1] == 0.61
