"""What happens between two samples of a vehicle: against motions that are known exactly."""

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.judging.verdicts import Status
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
def test_least_speed_between_samples_is_reconstructed(lowest: float, hertz: int) -> None:
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


@pytest.mark.parametrize("hertz", [1, 2, 5, 10])
def test_whether_somebody_stopped_between_samples_far_apart_is_not_guessed(hertz: int) -> None:
    """Stopping for a moment, or not quite: who is seen so seldom may have done either."""
    shifts = np.arange(7) / 7 / hertz
    assert Status.FAIL not in {check(sampled(-0.05, 5.0 + at, hertz), "full_stop").status for at in shifts}
    assert Status.PASS not in {check(sampled(0.4, 5.0 + at, hertz), "full_stop").status for at in shifts}
    if hertz >= 5:
        assert {check(sampled(2.5, 5.0 + at, hertz), "full_stop").status for at in shifts} == {Status.FAIL}


def test_one_gap_in_a_track_hides_a_stop() -> None:
    """It brakes harder and harder, and is not seen for half a second around its stop: braking as before it would have passed."""
    place, fine = find("stop4"), np.arange(0.0, 10.0, 1e-4)
    way = Itinerary.through(place, 0, 2)
    speed = np.interp(fine, [0.0, 4.0, 4.7, 5.0, 5.3, 10.0], [8.0, 2.0, 1.5, 0.0, 0.9, 8.0])
    station = np.cumsum(speed) * 1e-4
    station -= np.interp(5.0, fine, station) + 0.5
    seen = np.arange(0.0, 9.0, 0.1)
    seen = seen[(seen < 4.75) | (seen > 5.25)]
    speed, station = np.interp(seen, fine, speed), np.interp(seen, fine, station)
    pose = np.array([way.pose(s) for s in station])
    (run,) = Recording("by hand", place, (Track(Agent("a", place.movements[0, 2]), seen, station, speed, pose),))
    assert check(run, "full_stop").status is Status.UNSURE


@pytest.mark.parametrize(("first", "status"), [(-20.0, Status.FAIL), (-0.5, Status.UNSURE)])
def test_who_appears_at_the_line_may_have_stopped_before(first: float, status: Status) -> None:
    place = find("stop4")
    way = Itinerary.through(place, 0, 2)
    moments = np.arange(0.0, 8.0, 0.1)
    station = first + 3.0 * moments
    pose = np.array([way.pose(s) for s in station])
    track = Track(Agent("a", place.movements[0, 2]), moments, station, np.full(len(moments), 3.0), pose)
    (run,) = Recording("by hand", place, (track,))
    verdict = check(run, "full_stop")
    assert verdict.status is status
    if status is Status.UNSURE:
        assert "what it did before it was seen" in verdict.instances[0].hangs
