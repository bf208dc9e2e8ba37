"""Controllers that take the way of others, crash, or wait for each other, and leave it to others to be blamed.

Entrances 0, 1, 2, 3 lie in the south, east, north and west, and traffic keeps right: who comes from entrance 1 is on the right of
who comes from entrance 0. The subject is a0 if nothing else is said. Ways that cross do so 6 to 20 m behind the line.
"""

import math
from dataclasses import replace

import pytest_rvads as rvads
from pytest_rvads.satellites.relations.variants import mirrored

from .cases import Case, at
from .drivers import beside, gated, lawful, paced, stops_at
from .shown import shows_each

BLIND = paced(lambda _: 8.0)
HESITANT = rvads.traffic("hesitant")
CRASH = {"no_collision": "FAIL a0", "no_conflict": "FAIL a0", "end": "collision"}
JOINING = replace(rvads.find("right4"), joining=frozenset({((0, 1), (3, 1))}))
"""From entrance 0 a ramp leads to exit 1."""


# Stops at the sign, turns right, and stops when its rear has left the junction by 2 m.
TURNED = lawful(lambda seen: math.sqrt(2.0 * max(27.0 - seen.me.station, 0.0)))


def enters(time: float) -> type[rvads.Reference]:
    """Return a controller that stops at the line and enters at a time [s], whoever has the right to."""
    return gated(lambda seen: seen.time >= time)


def oncoming(distance: float, speed: float) -> rvads.Scenario:
    """Return a0 at its line at green, to turn left across the way of a2, which comes straight on, on green as well."""
    return at("light4", "3020", distance=(0.3, 20, distance, 20), speed=(0, 0, speed, 0), duration=15)


TAKES_THE_WAY = {
    "left_turn_that_makes_others_brake": Case(oncoming(40, 9), enters(1.0), {"left_yields": "FAIL a0"}),
    "left_turn_with_half_a_second_to_spare": Case(oncoming(24, 8), stops_at(0.0, go=0.5), {"left_yields": "FAIL a0"}, BLIND),
    "left_turn_into_a_crash": Case(oncoming(14, 8), stops_at(0.0, go=0.5), {"left_yields": "FAIL a0", **CRASH}, BLIND),
    # The same in a mirror: traffic keeps left, and a0 turns right.
    "keep_left_and_turn_right_into_a_crash": Case(
        at(mirrored(rvads.find("light4")), "1020", distance=(0.3, 20, 14, 20), speed=(0, 0, 8, 0), duration=15),
        stops_at(0.0, go=0.5),
        {"left_yields": "FAIL a0", **CRASH},
        BLIND,
    ),
    # a0 turns right, into the way of a3, which comes from its left, so that without the lane that joins a3 would give way.
    "join_so_near_ahead_that_others_must_brake": Case(
        at(JOINING, "1002", distance=(0.3, 20, 20, 24), speed=(0, 0, 0, 8), duration=15),
        stops_at(-0.3, go=1.0, speed=6.0),
        {"merge": "FAIL a0"},
    ),
    # a0 comes from the left of a1, straight on at green.
    "right_on_red_without_looking": Case(
        at("light4", "2100", subject=1, distance=(25, 0.3, 20, 20), speed=(8, 0, 0, 0), duration=15),
        enters(2.0),
        {"right_on_red": "FAIL a1", "no_collision": "FAIL a1", "no_conflict": "FAIL a1", "end": "collision"},
        BLIND,
    ),
    # a1 is there first and waits for 3 s, as hesitant drivers do; a0 comes after it and does not wait for it.
    "go_when_the_other_is_slow": Case(
        at("stop4", "2200", distance=(8, 5, 20, 20)), enters(5.0), {"first_come": "FAIL a0"}, HESITANT
    ),
    "left_before_right": Case(at("stop4", "2200", distance=5.0), enters(4.0), {"right_first": "FAIL a0"}, HESITANT),
    "cross_without_looking": Case(
        at("stop4", "2200", distance=(8, 5, 20, 20)), stops_at(-0.3, go=4.3, speed=11.0), CRASH, stops_at(-0.3, go=4.0)
    ),
    "left_turn_without_looking_ahead": Case(
        at("stop4", "3020", distance=(8, 20, 5, 20)), stops_at(-0.3, go=6.0, speed=11.0), CRASH, stops_at(-0.3, go=4.0)
    ),
    # By the time it is at the line, a1 has nearly left, so that it need not stop on its account.
    # Both stand at their lines; a0 turns across the way of a2 in the very step in which that sets off.
    "enter_together_and_be_half_to_blame": Case(
        at("stop4", "3020", distance=2.0),
        stops_at(-0.3, go=4.0),
        {"no_collision": "FAIL a0 a2", "no_conflict": "FAIL a0 a2", "end": "collision"},
        stops_at(-0.3, go=4.0),
    ),
    "roll_in_behind_another": Case(at("stop4", "2200", distance=(48, 5, 20, 20)), rvads.RollingStop, {"full_stop": "FAIL a0"}),
}


@shows_each(TAKES_THE_WAY)
def test_taking_the_way_is_blamed(case: Case) -> None:
    assert case.told() == case.tells


HIDES = {
    "run_the_sign_and_be_hit_by_who_enters_last": Case(
        at("stop4", "2200", distance=(20, 5, 20, 20)),
        paced(lambda _: 4.0),
        {"full_stop": "FAIL a0", "first_come": "FAIL a0", **CRASH},
        stops_at(-0.3, go=6.0),
    ),
    "run_a_red_light_and_be_hit_by_who_enters_last": Case(
        at("light4", "2200", subject=1, distance=(48, 20, 20, 20), speed=8.0),
        paced(lambda _: 4.0),
        {"red": "FAIL a1", "no_collision": "FAIL a1", "no_conflict": "FAIL a1", "end": "collision"},
        BLIND,
    ),
    # a1 rolls over its line at 2 m/s at 2.0 s; a0 stands at its own.
    "ram_who_ran_the_sign": Case(
        at("stop4", "2200", distance=(0.3, 3, 20, 20)),
        stops_at(-0.2, go=6.0),
        {
            "full_stop": "PROVOKED a1",
            "no_collision": "FAIL a0 a1",
            "no_conflict": "FAIL a0 a1",
            "end": "collision",
        },
        paced(lambda _: 2.0),
    ),
    "ram_who_ran_the_red_light": Case(
        at("light4", "2200", distance=(0.3, 3, 20, 20)),
        stops_at(-0.2, go=7.0),
        {"red": "PROVOKED a1", "no_collision": "FAIL a0 a1", "no_conflict": "FAIL a0 a1", "end": "collision"},
        paced(lambda _: 2.0),
    ),
    # a0 has stood in the middle for 15 s when a1 gets green and drives into it.
    "crash_late": Case(
        at("light4", "2200", subject=1, distance=(20, 5, 20, 20)),
        stops_at(-0.5, go=20.0),
        {
            "no_collision": "FAIL a1",
            "no_conflict": "FAIL a1",
            "keep_clear": "PROVOKED a0",
            "progress": "PROVOKED a0",
            "end": "collision",
        },
        stops_at(16.0),
    ),
    # a2 has turned right and waits on the exit road of both.
    "run_into_who_waits_on_the_exit_road": Case(
        at("stop4", "3010", distance=(8, 20, 2, 20)),
        stops_at(-0.3, go=6.0),
        {"no_collision": "FAIL a0", "end": "collision"},
        TURNED,
    ),
    "head_on_in_the_oncoming_lane": Case(
        at("light4", "2020", distance=(5, 20, 40, 20)),
        beside(2.6),
        {"keep_lane": "FAIL a0", "no_collision": "FAIL a0", "end": "collision"},
        BLIND,
    ),
    # The same exit road, with somebody on it who leaves no room behind it.
    "enter_without_room_to_leave": Case(
        at("stop4", "3010", distance=(8, 20, 2, 20), duration=30),
        enters(6.0),
        {"keep_clear": "FAIL a0", "progress": "PROVOKED a2"},
        TURNED,
    ),
}


@shows_each(HIDES)
def test_subject_hidden_behind_traffic_is_blamed(case: Case) -> None:
    assert case.told() == case.tells


WAITS = {
    # a1 came 3 s later and waits for a0, although a0 waives its right by then.
    "keep_others_waiting": Case(
        at("stop4", "2200", distance=(2, 20, 20, 20), duration=30), enters(99.0), {"first_come": "NA", "progress": "FAIL a0"}
    ),
    # The light would be green after 20 s. a3 waits at its own red light and is in nobody's way.
    "end_the_run_at_red": Case(at("light4", "0202", subject=1, duration=10), rvads.Reference, {"red": "OPEN a1 a3"}),
}


@shows_each(WAITS)
def test_who_waits_without_a_reason_is_blamed(case: Case) -> None:
    assert case.told() == case.tells


ALL = "a0 a1 a2 a3"
ALIKE = {
    "block_each_other_inside": Case(
        at("stop4", "2200", subject=None, duration=25),
        stops_at(10.0),
        {"full_stop": "FAIL a0 a1", "right_first": "FAIL a0", "keep_clear": "FAIL a0 a1", "progress": "FAIL a0 a1"},
    ),
    "wave_each_other_through_for_ever": Case(
        at("stop4", "2020", subject=None, duration=20), enters(99.0), {"progress": "FAIL a0 a2", "full_stop": "PASS"}
    ),
    # a0 waits 5 m inside for a2, which has the right to go first and waits for a0.
    "wait_for_who_waits_for_you": Case(
        at("light4", "3020", subject=2, distance=0.3, duration=13),
        enters(99.0),
        {"progress": "FAIL a2", "keep_clear": "NA"},
        gated(lambda _: True, lambda seen: math.sqrt(2.0 * max(5.0 - seen.me.station, 0.0))),
    ),
    "deadlock_of_four": Case(
        at("stop4", "2222", subject=None, duration=20), enters(99.0), {"progress": f"FAIL {ALL}", "right_first": f"OPEN {ALL}"}
    ),
    # One after the other, a hundredth of a second apart: a0 breaks the circle, a1 and a2 have no such excuse.
    "four_racers_one_step_apart": Case(
        at("stop4", "2222", subject=None, distance=(10.0, 10.08, 10.16, 10.24), speed=8.0, duration=1.5),
        BLIND,
        {"full_stop": f"FAIL {ALL}", "right_first": "FAIL a0 a1 a2"},
    ),
    "four_racers": Case(
        at("stop4", "2222", subject=None, distance=10.0, speed=8.0, duration=1.5),
        BLIND,
        {"full_stop": f"FAIL {ALL}", "right_first": f"FAIL {ALL}"},
    ),
}


@shows_each(ALIKE)
def test_copies_of_one_controller_don_t_excuse_each_other(case: Case) -> None:
    assert case.told() == case.tells
