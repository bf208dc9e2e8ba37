"""Orders of events: what is certain stays so in every trajectory within the spread, and what is not is UNSURE."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pytest_rvads import Status, check, find
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.recording import Recording, Track
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Agent

PLACE = find("stop4")
SPEED = 5.0


def passes(name: str, key: tuple[int, int], enters: float, spread: float | None = None, shift: np.ndarray | None = None) -> Track:
    """Return the track of who drives at `SPEED` over the entrance vertex at a time [s], known to a spread [m]."""
    way = Itinerary.through(PLACE, *key)
    times = np.arange(enters - 5.0, enters + 8.0, 0.1)
    station = (times - enters) * SPEED
    if shift is not None:
        station = station + np.interp(times, np.linspace(times[0], times[-1], len(shift)), shift)
    pose = np.array([way.pose(float(s)) for s in (times - enters) * SPEED])
    known = None if spread is None else np.full(len(times), spread)
    return Track(Agent(name, PLACE.movements[key], size=(4.6, 1.8)), times, station, np.full(len(times), SPEED), pose, known)


def run_of(*tracks: Track) -> Run:
    (run,) = Recording("by hand", PLACE, tracks)
    return run


KEYS = sorted(PLACE.movements)
ONE = KEYS[0]
TWO = next(key for key in KEYS if key[0] != ONE[0] and key[1] != ONE[1])
LENGTH = PLACE.movements[ONE].length
THROUGH = LENGTH / SPEED
"""How long the first one is in the junction [s]."""


@pytest.mark.parametrize(
    ("after", "status"),
    [
        (-0.30, Status.FAIL),  # 1.5 m at 5 m/s, known to 2 times 0.2 m
        (-0.05, Status.UNSURE),
        (0.05, Status.UNSURE),
        (0.30, Status.PASS),
    ],
)
def test_p1_is_unsure_if_entries_lie_within_the_spread(after: float, status: Status) -> None:
    """The second one enters when the first one is through, or a little before or after that."""
    verdict = check(run_of(passes("v1", ONE, 10.0, 0.2), passes("v2", TWO, 10.0 + THROUGH + after, 0.2)), "p1")
    assert verdict.status is status
    if status is Status.UNSURE:
        (instance,) = verdict.instances
        assert instance.margin == pytest.approx(abs(after), abs=0.02)
        assert "v1 was through at" in verdict.message
        assert "v2 entered at" in verdict.message
        assert "known to 0.08 s" in instance.hangs  # each within 0.2 m before and behind: 0.4 m at 5 m/s
        assert verdict.message.startswith("p1 UNSURE: ")
        # A border counts as crossed when the vehicle is surely beyond it: 0.2 m, or 0.04 s, later.
        assert verdict.time == pytest.approx(10.0 + THROUGH + 0.04 + max(after, 0.0), abs=0.02)


def test_what_is_exact_is_never_unsure() -> None:
    for after in (-0.01, 0.0, 0.01):
        verdict = check(run_of(passes("v1", ONE, 10.0), passes("v2", TWO, 10.0 + THROUGH + after)), "p1")
        assert verdict.status in (Status.FAIL, Status.PASS)


def waits(name: str, key: tuple[int, int], arrives: float, enters: float, spread: float) -> Track:
    """Return the track of who comes to the entrance zone, 1 m before the vertex, stands in it, and enters, at times [s]."""
    way = Itinerary.through(PLACE, *key)
    times = np.arange(arrives - 5.0, enters + 8.0, 0.1)
    station = np.minimum((times - arrives) * SPEED - 1.0, np.maximum((times - enters) * SPEED, -0.5))
    pose = np.array([way.pose(float(s)) for s in station])
    speed = np.where(station == -0.5, 0.0, SPEED)
    agent = Agent(name, PLACE.movements[key], size=(4.6, 1.8))
    return Track(agent, times, station, speed, pose, np.full(len(times), spread))


@pytest.mark.parametrize(("gap", "status"), [(0.3, Status.NA), (0.48, Status.UNSURE), (0.52, Status.UNSURE), (0.7, Status.FAIL)])
def test_arrivals_near_the_end_of_the_tie_window_are_unsure(gap: float, status: Status) -> None:
    """Arrivals within 0.5 s are a tie, to which the rule does not apply; each is known to 0.2 m at 5 m/s, that is 0.04 s."""
    ways = min((one, two) for one, two in PLACE.conflicts or () if (one[0], two[0]) in PLACE.right_of)
    first, second = waits("v1", ways[0], 10.0, 20.0, 0.2), waits("v2", ways[1], 10.0 + gap, 12.0, 0.2)
    verdict = check(run_of(first, second), "first_come")
    assert verdict.status is status
    if status is Status.UNSURE:
        assert "how far it had come, known to 0.20 m" in verdict.reason


def test_appearance_at_the_entrance_fails_no_order_of_arrival() -> None:
    one, two = passes("v1", ONE, 10.0), passes("v2", TWO, 10.1)
    late = two.times >= 10.0  # half a metre before the vertex: within the entrance zone
    cut = replace(two, times=two.times[late], station=two.station[late], speed=two.speed[late], pose=two.pose[late])
    verdict = check(run_of(one, cut), "p3")
    assert verdict.status is not Status.FAIL


smooth = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=8).map(np.array)


@pytest.mark.extended
@settings(max_examples=60, deadline=None)
@given(
    st.floats(-1.0, 1.0), st.floats(0.02, 0.4), smooth, smooth, st.sampled_from(["p1", "p2", "p3", "first_come", "right_first"])
)
def test_no_trajectory_within_the_spread_contradicts_a_definite_verdict(
    after: float, spread: float, mine: np.ndarray, yours: np.ndarray, rule: str
) -> None:
    told = check(run_of(passes("v1", ONE, 10.0, spread), passes("v2", TWO, 10.0 + after + THROUGH / 2, spread)), rule)
    # Interpolation between samples may add a hair.
    allowed = spread * 0.99
    truth = check(
        run_of(
            passes("v1", ONE, 10.0, None, mine * allowed), passes("v2", TWO, 10.0 + after + THROUGH / 2, None, yours * allowed)
        ),
        rule,
    )
    kept = {Status.PASS, Status.NA}
    for instance in told.instances:
        if instance.status is Status.UNSURE:
            continue
        twin = next(i for i in truth.instances if i.binding == instance.binding)
        assert twin.status is instance.status or {twin.status, instance.status} <= kept
