"""Smoothed stations are as exact as they say, on ways whose truth is known by formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads.runs.smoothing import BRIEF, PACE, ROLL, beside, delay, linkage, roughness, smoothed


def drive(often: int, stand: float = 3.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, stations and speeds: 10 m/s, braking at 3 m/s^2, a stand, and setting off at 2 m/s^2 up to 8 m/s."""
    times = np.arange(0.0, 20.0, 1.0 / often)
    fine = np.arange(0.0, 20.0, 0.001)
    halt = 4.0 + 10.0 / 3.0
    speed = np.where(fine < 4.0, 10.0, np.maximum(10.0 - 3.0 * (fine - 4.0), 0.0))
    speed = np.where(fine < halt + stand, speed, np.minimum(2.0 * (fine - halt - stand), 8.0))
    station = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.001))) - 60.0
    return times, np.interp(times, fine, station), np.interp(times, fine, speed)


@pytest.mark.extended
@pytest.mark.parametrize("often", [10, 25])
@pytest.mark.parametrize("accuracy", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("measured", [True, False], ids=["speeds", "positions"])
def test_errors_are_within_the_spread(often: int, accuracy: float, measured: bool) -> None:
    times, station, speed = drive(often)
    errors, spreads = [], []
    for seed in range(30):
        noisy = station + np.random.default_rng(seed).normal(0, accuracy, len(station))
        found, _, spread = smoothed(times, noisy, speed if measured else None, accuracy)
        assert spread is not None
        errors.append(np.abs(found - station))
        spreads.append(spread)
    outside = np.concatenate(errors) > np.concatenate(spreads)
    assert outside.mean() <= 0.005  # three standard deviations leave out 0.3 %
    assert np.sqrt((np.concatenate(errors) ** 2).mean()) < 0.6 * accuracy  # worth its while


def test_speeds_make_places_more_exact() -> None:
    """An average over n samples is sqrt(n) times as exact: at 10 Hz over 0.8 s and more that is a third."""
    times, station, speed = drive(10)
    noisy = station + np.random.default_rng(1).normal(0, 0.1, len(station))
    found, _, _ = smoothed(times, noisy, speed, 0.1)
    assert np.sqrt(((found - station) ** 2).mean()) < 0.1 / np.sqrt(8)


@pytest.mark.extended
@pytest.mark.parametrize("late", [-0.05, 0.0, 0.08])
def test_on_a_straight_way_the_delay_of_speeds_is_found_and_stations_are_exact(late: float) -> None:
    times, station, _ = drive(10)
    speed = np.interp(times - late, times, drive(10)[2])  # each is told so long after the place that it is of
    straight = np.ones(len(times), dtype=np.bool_)
    samples = [station + np.random.default_rng(seed).normal(0, 0.1, len(station)) for seed in range(40)]
    each = np.array([delay(times, noisy, speed, straight) for noisy in samples])
    found = float(np.average(each[:, 0], weights=each[:, 1]))
    assert found == pytest.approx(late, abs=0.01)
    fits = [smoothed(times, noisy, speed, 0.1, straight, found) for noisy in samples]
    errors = np.abs(np.concatenate([fit[0] - station for fit in fits]))
    spreads = np.concatenate([fit[2] for fit in fits if fit[2] is not None])
    assert (errors > spreads).mean() <= 0.005
    assert np.median(spreads) < 0.6 * np.median(smoothed(times, samples[0], speed, 0.1)[2])  # what no stretch is known of


def test_a_stand_is_one_place_and_a_full_stop() -> None:
    times, station, _ = drive(10)
    noisy = station + np.random.default_rng(2).normal(0, 0.05, len(station))
    found, speed, spread = smoothed(times, noisy, None, 0.05)
    stands = (times > 8.0) & (times < 9.8)
    assert spread is not None
    assert (speed[stands] == 0.0).all()
    assert np.ptp(found[stands]) == 0.0
    assert spread[stands].max() < 0.05  # 3 sigma over the root of 19 samples is 3.4 cm


def test_who_rolls_slowly_does_not_stand() -> None:
    times = np.arange(0.0, 12.0, 0.1)
    noisy = 0.5 * times + np.random.default_rng(3).normal(0, 0.05, len(times))
    _, speed, _ = smoothed(times, noisy, None, 0.05)
    assert (speed != 0.0).all()


def test_exact_samples_stay_as_they_are() -> None:
    times, station, speed = drive(10)
    found, fast, spread = smoothed(times, station, speed, 0.0)
    assert found is station
    assert fast is speed
    assert spread is None


@pytest.mark.parametrize("often", [10, 25, 100])
def test_roughness_estimates_the_noise(often: int) -> None:
    times, station, _ = drive(often)
    assert roughness(times, station) < 0.005
    for accuracy in (0.05, 0.1, 0.2):
        noisy = station + np.random.default_rng(4).normal(0, accuracy, len(station))
        assert roughness(times, noisy) == pytest.approx(accuracy, rel=0.2)


def test_gaps_add_no_roughness() -> None:
    times, station, _ = drive(10)
    keep = np.random.default_rng(5).random(len(times)) > 0.2
    assert roughness(times[keep], station[keep]) < 0.005


@pytest.mark.parametrize("count", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("measured", [True, False])
def test_few_samples_are_smoothed_without_a_complaint(count: int, measured: bool) -> None:
    times = np.linspace(0.0, 0.1 * count, count)
    found, speed, spread = smoothed(times, 5.0 * times, np.full(count, 5.0) if measured else None, 0.1)
    assert spread is not None
    assert np.isfinite(found).all()
    assert np.isfinite(speed).all()
    assert (spread > 0.0).all()


@pytest.mark.extended
@pytest.mark.parametrize("often", [10, 25])
@pytest.mark.parametrize("accuracy", [0.05, 0.1])
def test_offsets_are_as_exact_as_told(often: int, accuracy: float) -> None:
    """Three deviations hold 99.5 % of the errors of somebody who drifts aside by 20 cm and back, within its track."""
    times = np.arange(0.0, 20.0, 1.0 / often)
    offset = 0.1 * np.sin(times)
    errors = []
    for seed in range(30):
        noisy = offset + np.random.default_rng(seed).normal(0, accuracy, len(times))
        errors.append(np.abs(smoothed(times, noisy, None, accuracy)[0] - offset)[often:-often])
    told = beside(accuracy, 1.0 / often)
    assert (np.concatenate(errors) > 3 * told).mean() <= 0.005
    assert told < 0.6 * accuracy


def test_exact_or_rare_offsets_are_not_smoothed() -> None:
    assert beside(0.0, 0.1) == 0.0
    assert beside(0.1, 1.0) == 0.1


def slows_down(often: int, least: float, lasts: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, stations and speeds: braking at 3 m/s^2 to the `least` speed, which `lasts`, and setting off at 2 m/s^2."""
    fine = np.arange(0.0, 12.0, 0.001)
    speed = np.minimum(least + np.where(fine < 4.0, 3.0 * (4.0 - fine), 2.0 * np.maximum(fine - 4.0 - lasts, 0.0)), 8.0)
    station = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.001)))
    times = np.arange(0.0, 12.0, 1.0 / often)
    return times, np.interp(times, fine, station), np.interp(times, fine, speed)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(
    often=st.sampled_from([10, 25, 30]),
    noise=st.floats(0.03, 0.2),
    least=st.floats(ROLL, 2.0) | st.just(0.0),
    lasts=st.floats(BRIEF, 3.0),
    seed=st.integers(0, 2**32),
    magnitude=st.booleans(),
)
def test_noise_neither_makes_a_stop_nor_hides_one(
    often: int, noise: float, least: float, lasts: float, seed: int, magnitude: bool
) -> None:
    """Who rolls has no speed at which a vehicle stands; who stops has such a speed, or one that is nearer than its accuracy."""
    times, station, speed = slows_down(often, least, lasts)
    errors = np.random.default_rng(seed).normal(0.0, noise, (2, len(times)))
    speed = np.abs(speed + errors[1]) if magnitude else speed + errors[1]
    slowest = smoothed(times, station + errors[0], speed, noise, noise=noise)[1].min()
    if least > 0.0:
        assert slowest > PACE
    else:
        assert slowest <= PACE + 3 * beside(noise, 1.0 / often)


@pytest.mark.parametrize("often", [10, 25])
@pytest.mark.parametrize("link", [0.0, 0.5, 0.8])
def test_errors_that_are_alike_count_as_larger_independent_errors(often: int, link: float) -> None:
    """A mean of autoregressive errors varies as that of independent errors that are sqrt((1 + link) / (1 - link)) as large."""
    rng, times, estimates = np.random.default_rng(6), np.arange(0.0, 30.0, 1.0 / often), []
    for _ in range(40):
        errors = rng.normal(0.0, 0.1 * np.sqrt(1.0 - link**2), len(times))
        errors[0] = rng.normal(0.0, 0.1)
        for k in range(1, len(errors)):
            errors[k] += link * errors[k - 1]
        estimates.append(roughness(times, errors) * linkage(times, errors))
    assert np.median(estimates) == pytest.approx(0.1 * np.sqrt((1.0 + link) / (1.0 - link)), rel=0.25)
