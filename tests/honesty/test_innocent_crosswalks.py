"""Drivers who could not stop for pedestrians, and who wait for them with good reason."""

from dataclasses import replace

import numpy as np

import pytest_rvads as rvads
from pytest_rvads.logic.conduct.blame import cause_of

from .cases import Case
from .drivers import paced, stops_at
from .shown import shows_each
from .test_cheats_crosswalks import LIT, PLAIN, walk

HIT = {"no_collision": "PROVOKED p0", "no_conflict": "PROVOKED p0", "end": "collision"}
CASES = {
    "hit_who_darts_onto_the_crosswalk": Case(
        walk(PLAIN, "2000", 0, "near", "darts", -0.2), paced(lambda _: 8.0), {"crosswalk": "PROVOKED p0", **HIT}
    ),
    "hit_who_comes_out_behind_a_parked_vehicle_at_a_moderate_speed": Case(
        walk(PLAIN, "2000", 0, "near", "hidden", 0.0), paced(lambda _: 6.5), {"crosswalk": "PROVOKED p0", **HIT}
    ),
    "hit_who_steps_out_against_the_light": Case(walk(LIT, "2000", 0, "near", "against", -0.2), paced(lambda _: 8.0), HIT),
    # Stands 0.1 m over the edge.
    "wait_on_the_edge_for_who_stops_half_way": Case(
        walk(PLAIN, "2000", 0, "far", "stops", 6.0), stops_at(1.4, go=16.0), {"crosswalk": "PASS", "crosswalk_clear": "PASS"}
    ),
    "wait_for_who_stands_on_the_crosswalk": Case(
        walk(PLAIN, "2000", 0, "far", "stops", 0.0), stops_at(-0.3, go=13.0), {"crosswalk": "PASS", "progress": "PASS"}
    ),
}


@shows_each(CASES)
def test_who_meets_pedestrians_without_a_fault_is_not_blamed(case: Case) -> None:
    assert case.told() == case.tells


def test_pedestrian_whose_recording_begins_on_the_crosswalk_was_not_hidden() -> None:
    run = rvads.simulate(rvads.Case(walk(PLAIN, "2000", 0, "near", "hidden", 0.0), paced(lambda _: 8.0)))
    assert cause_of(run, run.collisions[0]).agents == ("a0",)
    person = [agent.name for agent in run.agents].index("p0")
    begin = int(np.flatnonzero(run.zone[:, person] == rvads.Zone.JUNCTION)[0])
    arrays = {name: getattr(run, name).copy() for name in ("zone", "station", "speed", "pose")}
    arrays["zone"][:begin, person] = rvads.Zone.ABSENT
    for name in ("station", "speed", "pose"):
        arrays[name][:begin, person] = np.nan
    assert cause_of(replace(run, **arrays), run.collisions[0]).agents == ("p0",)
