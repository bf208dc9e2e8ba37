"""Controllers among traffic that breaks the rules, stands in the way, or crashes: what others do is not held against them.

The subject is a0 if nothing else is said. PROVOKED names the vehicle that broke the rule, or still waits for what is open.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

import pytest_rvads as rvads

from ..policies import EVERYWHERE
from .cases import Case, at, verdicts
from .drivers import beside, cast, gated, lawful, paced, stops_at
from .shown import shows_each

REFERENCE = partial(rvads.Reference, tie=0.5)
BLIND = paced(lambda _: 8.0)
CROSSED = {"no_collision": "PROVOKED a1", "no_conflict": "PROVOKED a1", "end": "collision"}
HIT_LEFT = {"left_yields": "PROVOKED a2", "no_collision": "PROVOKED a2", "no_conflict": "PROVOKED a2", "end": "collision"}


def ends_at(station: float) -> type[rvads.Reference]:
    """Return a lawful controller that stops for good with its front at a station [m]."""
    return lawful(lambda seen: math.sqrt(2.0 * max(station - seen.me.station, 0.0)))


# Turns left when who comes from ahead is through, and waits for it 5 m inside, before the way of the other.
TURNS_LATE = gated(
    lambda _: True,
    lambda seen: 8.0 if all(o.station > 30.0 for o in seen.others) else math.sqrt(2.0 * max(5.0 - seen.me.station, 0.0)),
)


class OffTheRoad(rvads.Follower):
    """Leaves its route before the line."""

    def steer(self, seen: rvads.Observation) -> float:
        return -0.2


VICTIMS = {
    # a1 enters on red a little before a0 enters on green.
    "cross_on_green_and_be_hit": Case(
        at("light4", "2200", distance=(21, 20, 20, 20), speed=8.0), BLIND, {"red": "PROVOKED a1", **CROSSED}, BLIND
    ),
    # a1 runs the sign, and comes when a0 has long been inside.
    "be_cut_off_by_who_runs_the_sign": Case(
        at("stop4", "2200", distance=(2, 42, 20, 20), speed=(0, 8, 0, 0)),
        REFERENCE,
        {"full_stop": "PROVOKED a1", **CROSSED},
        BLIND,
    ),
    "meet_who_comes_in_the_wrong_lane": Case(
        at("light4", "2020", distance=(40, 20, 5, 20)),
        BLIND,
        {"keep_lane": "PROVOKED a2", "no_collision": "PROVOKED a2", "end": "collision"},
        beside(2.6),
    ),
    # a0 waits inside, and goes when the light of a2 is red; a2, which had 3 s of yellow to stop, comes all the same.
    "leave_the_junction_and_be_hit_by_who_runs_a_red_light": Case(
        at("light4", "3020", distance=(70, 20, 110, 20), speed=(5, 0, 6, 0)),
        gated(
            lambda _: True,
            lambda seen: 8.0 if seen.time > 18.1 else min(5.0, math.sqrt(2.0 * max(5.0 - seen.me.station, 0.0))),
        ),
        {"red": "PROVOKED a2", "no_collision": "PROVOKED a2", "no_conflict": "PROVOKED a2", "end": "collision"},
        paced(lambda _: 6.0),
    ),
    "traffic_runs_the_sign": Case(
        at("stop4", "2200", distance=20.0), REFERENCE, {"full_stop": "PROVOKED a1"}, rvads.traffic("rolling_stop")
    ),
    "traffic_runs_a_red_light": Case(
        at("light4", "2200", distance=(30, 20, 20, 20)), REFERENCE, {"red": "PROVOKED a1"}, rvads.traffic("red_light_runner")
    ),
    "traffic_leaves_its_route": Case(
        at("stop4", "2200", distance=(2, 20, 20, 20)),
        REFERENCE,
        {"keep_lane": "PROVOKED a1", "on_route": "PROVOKED a1", "end": "route", "full_stop": "PASS", "progress": "PASS"},
        OffTheRoad,
    ),
    "others_crash": Case(
        at("light4", "2130", distance=(14, 60, 0.3, 20), speed=(8, 0, 0, 0), subject=1),
        REFERENCE,
        {**HIT_LEFT, "keep_lane": "PASS", "speed_limit": "PASS"},
        cast(a0=BLIND, a2=stops_at(0.0, go=0.5)),
    ),
}


@shows_each(VICTIMS)
def test_victim_of_a_conflict_is_not_blamed(case: Case) -> None:
    assert case.told() == case.tells


WAITS = {
    # a1 came first, and stays: it waives its right, but nobody must pass in front of it.
    "wait_for_who_never_goes": Case(
        at("stop4", "2200", distance=(20, 5, 20, 20)),
        REFERENCE,
        {"first_come": "PASS", "progress": "PROVOKED a1", "full_stop": "PASS"},
        rvads.traffic("stopped"),
    ),
    "wait_at_red_until_others_crash": Case(
        at("light4", "2230", subject=1, distance=(14, 0.3, 0.3, 20), speed=(8, 0, 0, 0)),
        REFERENCE,
        {"red": "PROVOKED a1", **HIT_LEFT},
        cast(a0=BLIND, a2=stops_at(0.0, go=0.5)),
    ),
    # a0 stands across the way of a2, which has green up to 15 s and does not enter until the run ends in the yellow phase.
    "wait_for_who_turns_left_and_stops": Case(
        at("light4", "3020", subject=2, distance=(0.3, 20, 30, 20), duration=17.5),
        REFERENCE,
        {"keep_clear": "PROVOKED a0", "progress": "PROVOKED a0"},
        stops_at(11.0, go=99.0),
    ),
    "wait_at_the_line_for_a_blocked_exit": Case(
        at("stop4", "3010", distance=(8, 20, 2, 20), duration=25),
        gated(lambda _: False),
        {"progress": "PROVOKED a2", "full_stop": "NA"},
        ends_at(27.0),
    ),
    # a1 is on its way through when a2 turns right into the same exit road, ahead of it, and stops there.
    "wait_inside_behind_who_pushed_in": Case(
        at("stop4", "0210", subject=1, distance=(20, 2, 51, 20), speed=(0, 0, 6, 0), duration=30),
        lawful(lambda _: 2.5),
        {"full_stop": "PROVOKED a2", "progress": "PROVOKED a2"},
        stops_at(27.0, speed=6.0),
    ),
    "wait_for_who_blocks_the_junction": Case(
        at("stop4", "2200", distance=(20, 2, 20, 20), duration=30),
        REFERENCE,
        {"keep_clear": "PROVOKED a1", "progress": "PROVOKED a1", "full_stop": "NA"},
        ends_at(14.0),
    ),
    # a2 comes at 2.5 m/s: it is nearer than 4 s from 10 m before to its end of what both ways share, for longer than 4 s.
    "wait_in_the_middle_for_a_slow_one": Case(
        at("light4", "3020", distance=(0.3, 20, 4, 20), speed=(0, 0, 2.5, 0)),
        TURNS_LATE,
        {"keep_clear": "PASS", "progress": "PASS", "left_yields": "PASS"},
        paced(lambda _: 2.5),
    ),
}


@shows_each(WAITS)
def test_who_waits_with_good_reason_is_not_blamed(case: Case) -> None:
    assert case.told() == case.tells


GOES = {
    # a0 waits 5 m inside, before the way of the subject, which drives past it at 8 m/s.
    "pass_a_left_turner_that_waits": Case(
        at("light4", "3020", subject=2, distance=(0.3, 20, 30, 20), speed=(0, 0, 8, 0)),
        BLIND,
        {"no_conflict": "PASS", "progress": "PASS"},
        TURNS_LATE,
    ),
    # a0 is 90 m away at 8 m/s: far more than the 4 s within which it would be due.
    "right_on_red_with_a_large_gap": Case(
        at("light4", "2100", subject=1, distance=(90, 0.3, 20, 20), speed=(8, 0, 0, 0)),
        gated(lambda seen: seen.time >= 1.0),
        {"right_on_red": "PASS", "no_conflict": "PASS"},
        BLIND,
    ),
    "left_turn_with_a_large_gap": Case(
        at("light4", "3020", distance=(0.3, 20, 70, 20), speed=(0, 0, 8, 0)),
        gated(lambda seen: seen.time >= 1.0),
        {"no_conflict": "PASS"},
        BLIND,
    ),
    "tie_of_two_that_face_each_other": Case(
        at("stop4", "2020", distance=5.0), REFERENCE, {"full_stop": "PASS", "first_come": "NA", "right_first": "NA"}
    ),
    # Everybody has to wait for somebody; somebody has to go.
    "go_first_of_four": Case(at("stop4", "2222"), REFERENCE, {"right_first": "UNAVOIDABLE a0", "full_stop": "PASS"}),
    "see_another_go_first_of_four": Case(
        at("stop4", "2222", subject=2), REFERENCE, {"right_first": "UNAVOIDABLE a0", "full_stop": "PASS"}
    ),
}


@shows_each(GOES)
def test_who_goes_with_good_reason_is_not_blamed(case: Case) -> None:
    assert case.told() == case.tells


AMONG = {f"reference_among_{policy}": rvads.traffic(policy) for policy in EVERYWHERE}


@pytest.mark.extended
@shows_each(AMONG)
def test_who_keeps_the_rules_is_blamed_among_no_traffic(case: Callable[[], Any]) -> None:
    """Three others, at an all-way stop and at lights; what is broken was broken by them, or could not be kept."""
    for junction in ("stop4", "light4"):
        found = verdicts(Case(at(junction, "2312", distance=(20, 15, 10, 20), duration=30), REFERENCE, {}, case).run())
        assert {told.split()[0] for told in found.values()} <= {"PASS", "NA", "PROVOKED", "UNAVOIDABLE"}
        assert found["speed_limit"] == "PASS"
