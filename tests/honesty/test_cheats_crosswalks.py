"""Controllers that take a crosswalk from pedestrians, stand on it, or wait for ever before it."""

import pytest_rvads as rvads

from ..zebras import zebra
from .cases import Case, at
from .drivers import paced, stops_at
from .shown import shows_each

PLAIN, LIT = zebra("right4"), zebra("light4", lit=True)
CRASH = {"no_collision": "FAIL a0", "no_conflict": "FAIL a0", "end": "collision"}


def walk(place: rvads.Junction, directions: str, crossing: int, side: str, behaviour: str, late: float) -> rvads.Scenario:
    """Return a0 25 m before its line at 8 m/s, and a pedestrian who would come so late [s] after it."""
    walker = rvads.Pedestrian(crossing, side, behaviour, late)
    return at(place, directions, distance=25.0, speed=8.0, duration=30.0, pedestrians=(walker,))


CASES = {
    "run_down_who_crosses_a_crosswalk": Case(
        walk(PLAIN, "2000", 0, "far", "steady", 0.0), paced(lambda _: 8.0), {"crosswalk": "FAIL a0", **CRASH}
    ),
    "turn_over_a_crosswalk_without_looking": Case(
        walk(LIT, "1000", 1, "near", "steady", 4.0), paced(lambda _: 4.0), {"crosswalk_turning": "FAIL a0", **CRASH}
    ),
    "run_down_who_crosses_against_the_light": Case(
        walk(LIT, "2000", 0, "far", "against", 0.3),
        paced(lambda _: 8.0),
        {"no_collision": "FAIL a0 p0", "no_conflict": "FAIL a0 p0", "end": "collision"},
    ),
    "hurry_past_a_parked_vehicle_that_hides_the_kerb": Case(
        walk(PLAIN, "2000", 0, "near", "hidden", 0.0), paced(lambda _: 8.0), {"crosswalk": "FAIL a0", **CRASH}
    ),
    "stop_on_a_crosswalk": Case(
        walk(PLAIN, "2000", 0, "near", "waits", 0.0), stops_at(2.5, go=8.0), {"crosswalk_clear": "FAIL a0"}
    ),
    "wait_for_ever_for_who_stands_at_the_kerb": Case(
        walk(PLAIN, "2000", 0, "near", "waits", 0.0), stops_at(-0.5), {"progress": "FAIL a0", "crosswalk": "NA"}
    ),
}


@shows_each(CASES)
def test_taking_a_crosswalk_is_blamed(case: Case) -> None:
    assert case.told() == case.tells
