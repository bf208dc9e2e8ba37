"""Recordings that begin or end in the middle of what a rule asks about."""

from dataclasses import replace

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.ways import Key
from pytest_rvads.logic.check import check
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent


def track(place: Junction, name: str, key: Key, begins: float, legs: list[tuple[float, float]], station: float) -> Track:
    """Return the track of a vehicle that begins at a station and drives legs of (seconds, speed), sampled at 10 Hz."""
    speed = np.repeat([v for _, v in legs], [round(10 * seconds) for seconds, _ in legs])
    stations = station + np.concatenate(([0.0], np.cumsum(speed[:-1]))) * 0.1
    way = Itinerary.through(place, *key)
    pose = np.array([way.pose(float(s)) for s in stations])
    agent = Agent(name, place.movements[key], size=(4.6, 1.8))
    return Track(
        agent, np.float64(begins) + np.arange(len(speed)) * 0.1, stations, speed.astype(float), pose, np.zeros(len(speed))
    )


def recorded(place: Junction, *tracks: Track) -> Run:
    (run,) = Recording("by hand", place, tracks)
    return run


STOP = find("stop4")
ONE, TWO = STOP.leads(0, 2).key, STOP.leads(1, 2).key


@pytest.mark.parametrize("legs", [[(1.0, 0.0), (6.0, 5.0)], [(6.0, 5.0)]], ids=["at rest", "rolling"])
@pytest.mark.parametrize("station", [-0.6, -1.5, -4.5])
def test_full_stop_of_a_vehicle_that_appears_in_its_stop_place_is_unsure(legs: list[tuple[float, float]], station: float) -> None:
    verdict = check(recorded(STOP, track(STOP, "v1", ONE, 0.0, legs, station)), "full_stop")
    assert verdict.status == "UNSURE"
    assert "what it did before it was seen" in verdict.reason


def test_full_stop_after_an_appearance_in_the_stop_place_passes() -> None:
    legs = [(1.0, 2.0), (1.0, 0.0), (6.0, 5.0)]
    assert check(recorded(STOP, track(STOP, "v1", ONE, 0.0, legs, -3.0)), "full_stop").status == "PASS"


def test_vehicle_that_appears_before_its_stop_place_and_rolls_through_breaks_full_stop() -> None:
    assert check(recorded(STOP, track(STOP, "v1", ONE, 0.0, [(8.0, 5.0)], -9.0)), "full_stop").status == "FAIL"


def test_order_of_arrival_against_a_vehicle_that_appears_in_its_stop_place_is_unsure() -> None:
    """v1 appears 4.5 m before its line and rolls up to it for 3 s; v2 comes to its line meanwhile, and enters first."""
    (right, left) = min((a, b) for a, b in STOP.conflicts or () if (a[0], b[0]) in STOP.right_of)
    rolls = track(STOP, "v1", right, 0.0, [(3.0, 1.3), (2.0, 0.0), (6.0, 5.0)], -4.5)
    comes = track(STOP, "v2", left, 0.0, [(1.2, 4.0), (1.0, 0.0), (6.0, 5.0)], -5.3)
    assert check(recorded(STOP, rolls, comes), "first_come").status == "UNSURE"
    before = track(STOP, "v1", right, -1.0, [(4.0, 1.3), (2.0, 0.0), (6.0, 5.0)], -5.8)
    assert check(recorded(STOP, before, comes), "first_come").status == "NA", "v2 has entered when v1 arrives"


YIELD = find("yield4")


def test_way_owed_by_a_vanishing_vehicle_is_unsure() -> None:
    """v1 crosses the way of v2 and is lost from the recording while v2, which has priority, is 3 s away."""
    minor, major = YIELD.leads(0, 2).key, YIELD.leads(1, 2).key
    assert YIELD.stretches is not None
    mine, yours, _ = YIELD.stretches[minor, major]
    crosses = track(YIELD, "v1", minor, 0.0, [(8.0, 5.0)], mine.start - 20.0)
    comes = track(YIELD, "v2", major, 0.0, [(12.0, 5.0)], yours.start - 35.0)
    seen = np.arange(int(10 * (20.0 + 2.0) / 5.0))
    columns = {name: getattr(crosses, name)[seen] for name in ("times", "station", "speed", "pose", "spread")}
    tracks = crosses, replace(crosses, **columns)
    whole, short = (check(recorded(YIELD, first, comes), "yield_sign") for first in tracks)
    assert whole.status == "PASS"
    assert short.status == "UNSURE"
    assert "had left the recording before it was clear" in short.reason
