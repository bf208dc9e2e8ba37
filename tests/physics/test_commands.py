"""Answers that are no controls: a target speed, an acceleration, a trajectory; driven by the tracking controller."""

import math
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.interface import Acceleration, Observation, TargetSpeed, Trajectory, Waypoint
from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Vehicle
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate


def answering(answer: Any, period: float = 0.05) -> Any:
    class Stack:
        period = 0.0

        def control(self, seen: Observation) -> Any:
            return answer(seen) if callable(answer) else answer

    Stack.period = period
    return Stack


def drive(answer: Any, directions: str = "2000", period: float = 0.05, **start: Any) -> Run:
    start = {"distance": 40, "speed": 5, "duration": 8} | start
    run = simulate(Case(Scenario(find("stop4"), directions, **start), answering(answer, period)))
    assert run.fault is None
    return run


def beside(run: Run) -> float:
    """How far the rear axle ever was from the centre line that it should be on [m]."""
    scenario = Scenario(find("stop4"), "".join("0123"[(a.exit - a.entrance) % 4] for a in run.agents) + "000")
    (itinerary,), axle = scenario.itineraries(), Vehicle().rear_axle_offset
    off = [
        itinerary.project(x - axle * math.cos(yaw), y - axle * math.sin(yaw), station - axle)[1]
        for (x, y, yaw), station in zip(run.pose[:, 0], run.station[:, 0], strict=True)
    ]
    return max(map(abs, off))


@pytest.mark.parametrize("period", [0.01, 0.05, 0.1])
def test_a_target_speed_is_reached_and_held(period: float) -> None:
    run = drive(TargetSpeed(8.0), period=period)
    assert run.speed[-100:, 0] == pytest.approx(8.0, abs=0.15)
    assert drive(TargetSpeed(0), period=period).speed[-1, 0] == 0.0


def test_a_target_speed_is_lower_in_bends() -> None:
    run = drive(TargetSpeed(11), "1000", speed=9, duration=10)
    lateral = run.speed[1:, 0] * np.diff(run.pose[:, 0, 2]) / run.dt
    assert np.abs(lateral).max() < 3.0, "comfort ends between 2 and 3 m/s^2"
    assert beside(run) < 0.25


def test_acceleration_command_is_followed() -> None:
    run = drive(Acceleration(1.5), duration=3)
    # One second is enough for the lag of the drive.
    assert np.diff(run.speed[100:, 0]).mean() / run.dt == pytest.approx(1.5, abs=0.05)
    run = drive(Acceleration(-2.0), speed=9, duration=3)
    assert np.diff(run.speed[100:, 0]).mean() / run.dt == pytest.approx(-2.0, abs=0.05)


def test_steering_beside_an_acceleration_is_taken_as_it_is() -> None:
    run = drive(Acceleration(0.0, 0.02), duration=1)
    assert (run.controls[:-1, 0, 2] == 0.02).all()
    assert run.pose[-1, 0, 2] > run.pose[0, 0, 2], "left is positive"


def along(seen: Observation, speed: float, until: float) -> Trajectory:
    """Points on the itinerary, one per half second, at constant speed up to station `until`."""
    points = []
    for k in range(10):
        station = min(seen.me.station + speed * 0.5 * k, until)
        pose = seen.itinerary.pose(station)
        points.append(Waypoint(seen.time + 0.5 * k, pose.x, pose.y))
        if station == until:
            break
    return Trajectory((*points, points[-1]._replace(time=points[-1].time + 1.0)))


@pytest.mark.parametrize("directions", ["1000", "2000", "3000"])
def test_a_trajectory_is_followed_in_space_and_time(directions: str) -> None:
    run = drive(lambda seen: along(seen, 5.0, 100.0), directions, distance=20, duration=10)
    assert beside(run) < 0.25
    assert run.speed[100:, 0] == pytest.approx(5.0, abs=0.3)


def test_one_long_trajectory_held_for_the_whole_run_is_kept_to_time() -> None:
    """Four seconds at 5 m/s, then an even stop at 2 m/s^2: 20 m and 6.25 m."""
    plan: list[Trajectory] = []
    times = np.arange(0.0, 6.6, 0.1)
    late = np.maximum(times - 4.0, 0.0)
    places = 5.0 * times - late**2

    def once(seen: Observation) -> Trajectory:
        if not plan:
            poses = [seen.itinerary.pose(seen.me.station + s) for s in places]
            plan.append(Trajectory(tuple(Waypoint(seen.time + t, p.x, p.y) for t, p in zip(times, poses, strict=True))))
        return plan[0]

    run = drive(once, duration=8)
    driven = run.station[:, 0] - run.station[0, 0]
    assert np.abs(driven - np.interp(run.times, times, places)).max() < 0.3
    assert driven[-1] == pytest.approx(26.25, abs=0.1), "at the last point it stands"
    assert run.speed[-1, 0] == 0.0


def test_standing_trajectory_holds_the_vehicle() -> None:
    def stay(seen: Observation) -> Trajectory:
        return Trajectory((Waypoint(seen.time, seen.me.x, seen.me.y), Waypoint(seen.time + 1, seen.me.x, seen.me.y)))

    run = drive(stay, speed=0, duration=3)
    assert run.station[-1, 0] == pytest.approx(run.station[0, 0], abs=0.01)


POINT = Waypoint(0.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (TargetSpeed(math.nan), "a target speed nan, expected a finite number"),
        (TargetSpeed(-1.0), "a target speed -1 m/s, expected 0 to 70"),
        (TargetSpeed("fast"), "a target speed of type str, expected a number"),  # type: ignore[arg-type]
        (Acceleration(math.nan), "an acceleration nan, expected a finite number"),
        (Acceleration(-math.inf), "an acceleration -inf, expected a finite number"),
        (Acceleration(1.0, 30.0), "a steering 30 rad, expected -1.5708 to 1.5708"),
        (Acceleration(1.0, True), "a steering of type bool, expected a number"),
        (Trajectory(()), "a trajectory of 0 points, expected at least 2"),
        (Trajectory((POINT,)), "a trajectory of 1 points, expected at least 2"),
        (Trajectory((POINT, POINT)), "a trajectory whose point 1 comes at 0 s, not after the one before it"),
        (Trajectory((POINT, (1.0, math.inf, 0.0))), "a trajectory whose point 1 has x inf, expected a finite number"),  # type: ignore[arg-type]
        (Trajectory((POINT, 3)), "a trajectory whose point 1 is of type int, expected (time, x, y)"),  # type: ignore[arg-type]
        (Trajectory(3), "a trajectory of type int, expected a sequence of points"),  # type: ignore[arg-type]
    ],
)
def test_invalid_commands_are_faults(answer: Any, says: str) -> None:
    run = simulate(Case(Scenario(find("stop4"), "2000", duration=0.1), answering(answer)))
    assert run.fault is not None
    assert run.fault.reason.endswith(f"driving a0 at 0.00 s returned {says}")
