"""The braking envelope v(d)max."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.geometry.segment import SPEED_LIMIT
from pytest_rvads.physics.braking import envelope, greatest_safe, stopping_distance, vmax
from pytest_rvads.runs.run import DT
from pytest_rvads.runs.states import GRAVITY, Vehicle
from pytest_rvads.scenarios.configurations import PAPER, configuration, outside
from pytest_rvads.support.errors import RunError, ScenarioError

CAR = Vehicle()


@given(st.floats(0.05, 14.0), st.sampled_from((1, 2, 3)))
@settings(derandomize=True, deadline=None, max_examples=30)
def test_vmax_is_safe_and_a_little_more_is_not(distance: float, aggression: int) -> None:
    speed = vmax(distance, aggression)
    assert speed is not None
    assert stopping_distance(speed, aggression, CAR) <= distance
    if speed < SPEED_LIMIT:
        assert stopping_distance(speed + 0.011, aggression, CAR) > distance


@pytest.mark.parametrize("aggression", [1, 2, 3])
@pytest.mark.parametrize("speed", [2.0, 5.0, 9.0])
def test_stopping_distance_matches_integration_with_brake_lag(speed: float, aggression: int) -> None:
    # dv/dt = -r - c v^2 - b (1 - exp(-t / lag)), integrated here with small steps.
    v, x, t, h = speed, 0.0, 0.0, 1e-5
    while v > 0.0:
        resistance = CAR.rolling * GRAVITY + CAR.drag * v * v / CAR.mass
        v -= h * (resistance + CAR.brake[aggression - 1] * (1 - math.exp(-t / CAR.brake_lag)))
        x += v * h
        t += h
    # In steps of 0.01 s the lag is half a step ahead, and velocities are half a step ahead of positions.
    assert stopping_distance(speed, aggression, CAR) == pytest.approx(x - speed * DT, abs=0.01)


def test_the_envelope_grows_with_distance_and_aggression() -> None:
    table = envelope((0.01, 0.1, 0.3, 1.0, 3.0, 5.0, 10.0, 15.0, 20.0, 40.0))
    assert all(row[0] > 0 for row in table.values())
    assert table[1][-1] == SPEED_LIMIT
    assert table[1] <= table[2] <= table[3]


def test_the_envelope_grows_with_friction() -> None:
    speeds = [vmax(5.0, 3, Vehicle(friction=mu)) for mu in (0.2, 0.4, 0.6, 0.9, 1.1)]
    assert speeds == sorted(speeds)
    # On ice the tyres limit, not the brake: v^2 = 2 mu g d.
    assert speeds[0] == pytest.approx(math.sqrt(2 * 0.2 * GRAVITY * 5.0), rel=0.06)


def test_the_papers_configurations_lie_inside() -> None:
    for letter in "".join(PAPER.values()):
        assert outside(configuration(letter, 4), vmax) is None
    assert outside(configuration("D", 4), lambda distance: vmax(distance / 4)) == (20.0, 10.0)


def test_greatest_safe_speed_is_none_without_a_safe_speed() -> None:
    assert greatest_safe(lambda speed: False, 10.0) is None
    assert greatest_safe(lambda speed: speed <= 3.14159, 10.0) == 3.14
    assert greatest_safe(lambda speed: True, 11.176) == 11.176
    assert vmax(0.0) == 0.0


def test_envelope_must_be_monotone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pytest_rvads.physics.braking._vmax", lambda distance, *_: 10.0 - distance)
    with pytest.raises(RunError, match="not monotone: 9 m/s at 1 m and aggression 1, but 8 m/s at 2 m"):
        envelope((1.0, 2.0))


@pytest.mark.parametrize(("distance", "aggression"), [(-1.0, 1), (math.nan, 1), (math.inf, 1), (5.0, 0), (5.0, 4)])
def test_wrong_use_is_refused(distance: float, aggression: int) -> None:
    with pytest.raises(ScenarioError):
        vmax(distance, aggression)
