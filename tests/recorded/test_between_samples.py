"""What happens between two samples of a vehicle: against motions that are known exactly."""

import numpy as np
import pytest

from pytest_rvads.junctions.finder import find
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent

BRAKES, LEAVES = 4.0, 2.5
"""[m/s^2]."""


def stops(lowest: float, at: float, moments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds and stations of who brakes down to a speed and sets off at once, at a moment; below 0 it stands meanwhile.

    Stations are integrals of the speeds, summed in steps of a tenth of a millisecond.
    """
    fine = np.arange(0.0, 12.0, 1e-4)
    speed = np.maximum(np.maximum(lowest + BRAKES * (at - fine), lowest + LEAVES * (fine - at)), 0.0).clip(max=8.0)
    station = np.cumsum(speed) * 1e-4
    station -= np.interp(at, fine, station) + 0.5
    return np.interp(moments, fine, speed), np.interp(moments, fine, station)


def sampled(lowest: float, at: float, hertz: int) -> Run:
    place = find("stop4")
    way = Itinerary.through(place, 0, 2)
    moments = np.arange(0.0, 9.0, 1 / hertz)
    speed, station = stops(lowest, at, moments)
    pose = np.array([way.pose(s) for s in station])
    (run,) = Recording("by hand", place, (Track(Agent("a", place.movements[0, 2]), moments, station, speed, pose),))
    return run


@pytest.mark.parametrize("hertz", [10, 25])
@pytest.mark.parametrize("lowest", [-0.4, -0.05, 0.0, 0.05, 0.5, 2.0])
def test_who_brakes_and_sets_off_between_two_samples_was_as_slow_as_it_was(lowest: float, hertz: int) -> None:
    for shift in np.linspace(0.0, 0.1, 7):
        at = 5.0 + float(shift)
        run = sampled(lowest, at, hertz)
        here = run.here[:, 0]
        speed, (exact, _) = run.speed[here, 0], stops(lowest, at, run.times[here])
        # Where it comes to rest or leaves it, a straight line between two samples is off by a quarter of slope times interval.
        most = BRAKES / hertz / 4 if lowest < 0.0 else 0.0
        assert np.abs(speed - exact)[exact < 1.0].max(initial=0.0) < most + 0.001
        assert speed.min() == pytest.approx(exact.min(), abs=1e-6)


def test_who_drives_evenly_is_interpolated_straight() -> None:
    place = find("stop4")
    way = Itinerary.through(place, 0, 2)
    moments, noise = np.arange(0.0, 4.0, 0.1), np.random.default_rng(4).normal(0.0, 0.3, 40)
    station = -20.0 + 5.0 * moments
    pose = np.array([way.pose(s) for s in station])
    track = Track(Agent("a", place.movements[0, 2]), moments, station, 5.0 + noise, pose)
    (run,) = Recording("by hand", place, (track,))
    # Speeds that waver while positions go on evenly are errors of the speeds, and no reason to think that it braked.
    assert np.nanmin(run.speed) > 5.0 + noise.min() - 0.31
