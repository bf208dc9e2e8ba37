"""Dynamics of a driver: the published law, closed forms of the settings, and measurements in closed loop."""

import math

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.runs.run import Run
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.driver_dynamics import LENGTH, LIMIT, PUBLISHED, RED, Measured, settings, stopped
from pytest_rvads.simulators.loop import usual

HELD = 6.0
"""[m/s]."""


class Holding(rvads.Autopilot):
    """Holds its speed, at red lights too."""

    def control(self, seen: rvads.Observation, /) -> rvads.TargetSpeed:
        return rvads.TargetSpeed(HELD)


class Uniform:
    """Brakes at 4 m/s^2 and accelerates at 2 m/s^2 without a limit."""

    def braking(self, speed: float) -> float:
        return speed**2 / 8

    def driving(self, speed: float, distance: float) -> tuple[float, float]:
        after = math.sqrt(speed**2 + 4 * distance)
        return after, (after - speed) / 2


class LgsvlLaw:
    """The law of motion of the LGSVL autopilot, as Li and others state it.

    B(v) = v / 4. The speed t seconds after a start at v is vl - (vl - v) exp(-0.3 t^2 - t) up to 4 s, and later
    vl - (vl - v) exp(4.8 - 3.4 t), where vl is the speed limit.
    """

    def braking(self, speed: float) -> float:
        return speed / 4

    def driving(self, speed: float, distance: float) -> tuple[float, float]:
        """Integrate the law in steps of 1 ms by the trapezoidal rule."""
        step = 1e-3
        times = np.arange(0.0, 10.0 + distance / (0.5 * LIMIT), step)
        exponent = np.where(times <= 4.0, -0.3 * times**2 - times, 4.8 - 3.4 * times)
        speeds = LIMIT - (LIMIT - speed) * np.exp(exponent)
        distances = np.concatenate(([0.0], np.cumsum((speeds[1:] + speeds[:-1]) * step / 2)))
        return float(np.interp(distance, distances, speeds)), float(np.interp(distance, distances, times))


def test_law_of_lgsvl_gives_the_published_distance_of_the_arriving_vehicle() -> None:
    crossing = settings(LgsvlLaw(), 0.0)[0]
    assert crossing.before == 0.0
    assert crossing.arriving == pytest.approx(PUBLISHED["LGSVL"], abs=0.06)
    assert LgsvlLaw().driving(0.0, LENGTH)[1] * LIMIT == crossing.arriving


@pytest.mark.parametrize("speed", [0.0, 5.0, 15.0])
def test_law_of_lgsvl_has_the_speed_that_the_law_states(speed: float) -> None:
    law = LgsvlLaw()
    assert law.braking(speed) == speed / 4
    assert law.driving(speed, 0.0) == (speed, 0.0)
    for distance in (1.0, 24.0, 60.0):
        after, time = law.driving(speed, distance)
        exponent = -0.3 * time**2 - time if time <= 4.0 else 4.8 - 3.4 * time
        assert after == pytest.approx(LIMIT - (LIMIT - speed) * math.exp(exponent), abs=1e-4)


def test_law_of_lgsvl_at_the_speed_limit_is_a_constant_speed() -> None:
    assert LgsvlLaw().driving(LIMIT, 100.0) == (LIMIT, pytest.approx(100.0 / LIMIT, abs=1e-9))


@pytest.mark.parametrize("speed", [0.0, 4.0, 8.0])
def test_settings_follow_from_the_dynamics_in_closed_form(speed: float) -> None:
    """A vehicle that accelerates at 2 m/s^2 over x metres has AV^2 = v^2 + 4x and needs (AV - v)/2 for them."""
    limit, length = 12.0, 20.0
    before = speed**2 / 8
    beyond, joining = math.sqrt(speed**2 + 4 * (before + length)), math.sqrt(speed**2 + 4 * before)
    crossing, lights, merging = settings(Uniform(), speed, limit, length)
    assert crossing == ("crossing with yield signs", before, beyond**2 / 8, (beyond - speed) / 2 * limit)
    assert lights == ("crossing with lights", before, beyond**2 / 8, None)
    assert merging == ("merging", before, joining**2 / 8, limit**2 / 8 + (joining - speed) / 2 * limit)


def before_red(speed: float, distance: float) -> Run:
    """Return the run of the reference alone, from a distance [m] to the line of a red light."""
    scenario = Scenario(rvads.find("light4"), "0200", distance=distance, speed=speed, duration=RED)
    return rvads.simulate(Case(scenario, rvads.Reference))


def test_braking_distance_of_the_reference_stops_before_a_red_light_and_less_does_not() -> None:
    measured = Measured(rvads.Reference, usual())
    distances = [measured.braking(speed) for speed in (2.0, 8.0)]
    assert 0.0 < distances[0] < distances[1] < math.inf
    assert distances[1] > 8.0**2 / (2 * 9.81), "no tyre brakes at more than 1 g on a dry road"
    assert stopped(before_red(8.0, distances[1]))
    assert not stopped(before_red(8.0, distances[1] - 0.2))


def test_driver_that_holds_its_speed_never_stops_and_needs_the_time_of_a_constant_speed() -> None:
    measured = Measured(Holding, usual())
    assert measured.braking(HELD) == math.inf
    for distance in (5.0, 60.0):
        after, time = measured.driving(HELD, distance)
        assert after == pytest.approx(HELD, abs=0.01)
        assert time == pytest.approx(distance / HELD, abs=0.01)


def test_distance_beyond_the_end_of_a_drive_takes_for_ever() -> None:
    after, time = Measured(Holding, usual()).driving(HELD, 10_000.0)
    assert (after, time) == (pytest.approx(HELD, abs=0.01), math.inf)
