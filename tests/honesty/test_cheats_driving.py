"""Controllers that get nowhere, block the junction, leave the lane, or do to signs and lights what looks like obeying them.

One vehicle each, but for `idle`. The stopping line of the built-in maps is at station 0, where the junction begins; straight on
it is 30 m long. At lights entrances 0 and 2 have green up to 15 s and yellow up to 18 s, 1 and 3 red up to 20 s.
"""

import math
from pathlib import Path

import pytest

import pytest_rvads as rvads
from pytest_rvads.logic.conduct.standing import entered
from tools.crossings import Layout, opendrive

from .cases import Case, at
from .drivers import REFERENCE, beside, gated, lawful, lawful_at, paced, stops_at, timed
from .shown import shows, shows_each

ALONE = at("stop4", "2000")
GREEN = at("light4", "2000", duration=14)
RED = at("light4", "0200", subject=1, duration=14)
ROUTE = {"keep_lane": "FAIL a0", "on_route": "FAIL a0"}


class Circles(rvads.Reference):
    """Drives in circles once it is in the middle of the junction."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        return super().control(seen)._replace(steering=0.0 if seen.me.station < 8.0 else 0.6)


class Swerves(rvads.Reference):
    """Turns the wheel to one side from somewhere on."""

    since, angle = 0.0, 0.0

    def control(self, seen: rvads.Observation) -> rvads.Control:
        asked = super().control(seen)
        return asked._replace(steering=self.angle) if seen.me.station > self.since else asked


class Left(Swerves):
    since, angle = 3.0, 0.2


class Right(Swerves):
    since, angle = -12.0, -0.2


class RedThenRight(gated(lambda _: True)):  # type: ignore[misc]
    """Enters on red as if to go straight on, and turns off as if to turn right on red."""

    def control(self, seen: rvads.Observation) -> rvads.Control:
        asked = super().control(seen)
        return asked._replace(steering=-0.3) if seen.me.station > 3.0 else asked


def bit_by_bit(seen: rvads.Observation) -> float:
    """Stand for 2.9 s, roll for a second, and so on, as long as it is in the junction."""
    return math.inf if not 1.0 < seen.me.station < 30.0 else 2.0 if seen.time % 3.9 > 2.9 else 0.0


NOWHERE = {
    # Its front stands 20 m before the line: it has nobody to wait for, and 10 s are over after 10 s.
    "idle": Case(
        at("stop4", "2200", duration=15),
        paced(lambda _: 0.0),
        {"progress": "FAIL a0", "full_stop": "NA", "no_collision": "NA", "keep_lane": "NA", "speed_limit": "NA"},
        REFERENCE,
    ),
    "idle_in_a_short_run": Case(
        at("light4", "2020", distance=0.3, duration=9),
        paced(lambda _: 0.0),
        {"progress": "NA", "keep_clear": "NA", "on_route": "NA"},
        REFERENCE,
    ),
    "idle_together": Case(
        at("stop4", "2020", distance=0.3, duration=9, subject=None),
        paced(lambda _: 0.0),
        {"progress": "NA", "full_stop": "NA", "no_conflict": "NA"},
    ),
    # At 0.11 m/s it loses 1 - 0.11/1.4 of the time: 10 s after 10.9 s.
    "creep_on_approach": Case(at("stop4", "2000", duration=13), paced(lambda _: 0.11), {"progress": "FAIL a0"}),
    "stop_short_of_the_line": Case(at("stop4", "2000", duration=25), stops_at(-3.0), {"progress": "FAIL a0", "full_stop": "NA"}),
    "stop_and_go": Case(
        at("stop4", "2000", duration=18), paced(lambda seen: 1.0 if seen.time % 5.0 > 4.0 else 0.0), {"progress": "FAIL a0"}
    ),
    "idle_at_green": Case(at("light4", "2000", distance=0.3, duration=13), gated(lambda _: False), {"progress": "FAIL a0"}),
    "creep_inside": Case(ALONE, lawful_at(2.0, 0.3), {"keep_clear": "FAIL a0", "progress": "FAIL a0", "full_stop": "NA"}),
    "twenty_short_stops_inside": Case(
        at("stop4", "2000", duration=90), lawful(bit_by_bit), {"keep_clear": "FAIL a0", "progress": "FAIL a0"}
    ),
    "stop_inside": Case(at("stop4", "2000", duration=25), lawful_at(12.0, 0.0), {"keep_clear": "FAIL a0", "progress": "FAIL a0"}),
    # Its rear, 4.6 m behind its front, has left the junction, so it blocks nothing.
    "stop_right_behind_the_junction": Case(
        at("stop4", "2000", duration=36),
        lawful(lambda seen: 3.0 if seen.me.station < 35.0 else 0.0),
        {"progress": "FAIL a0", "keep_clear": "PASS"},
    ),
}


@shows_each(NOWHERE)
def test_who_gets_nowhere_has_not_passed(case: Case) -> None:
    assert case.told() == case.tells


# A run that the subject itself cut short is OPEN where it kept a rule so far: nobody knows what would have come.
ASTRAY = {
    "circling": Case(
        ALONE, Circles, {**ROUTE, **dict.fromkeys(("full_stop", "keep_clear", "progress", "speed_limit"), "OPEN"), "end": "route"}
    ),
    "leave_the_route_inside": Case(
        ALONE, Left, {**ROUTE, **dict.fromkeys(("full_stop", "keep_clear", "progress", "speed_limit"), "OPEN"), "end": "route"}
    ),
    "leave_the_route_before_the_line": Case(
        ALONE, Right, {**ROUTE, "progress": "OPEN", "speed_limit": "OPEN", "full_stop": "NA", "keep_clear": "NA", "end": "route"}
    ),
    "red_then_off_the_route": Case(
        RED,
        RedThenRight,
        {
            **dict.fromkeys(("red", "keep_lane", "on_route"), "FAIL a1"),
            **dict.fromkeys(("keep_clear", "progress", "speed_limit"), "OPEN"),
            "end": "route",
        },
    ),
    # Lanes are 3.5 m wide and next to each other; a body of 1.86 m that is 2.6 m to the left is all in the oncoming lane,
    # and not as far out as a vehicle off its route, 3 m.
    "oncoming_lane": Case(GREEN, beside(2.6), {"keep_lane": "FAIL a0", "on_route": "PASS"}),
    # (3.5 - 1.86) / 2 = 0.82 m are free on either side of a body, and 0.3 m are allowed.
    "on_the_border_of_the_lane": Case(GREEN, beside(1.5), {"keep_lane": "FAIL a0", "on_route": "PASS"}),
    # The limit is 11.176 m/s, and 0.5 m/s are allowed.
    "a_little_too_fast": Case(
        at("light4", "2000", distance=60.0, speed=11.0, duration=12), paced(lambda _: 12.0), {"speed_limit": "FAIL a0"}
    ),
}


@shows_each(ASTRAY)
def test_who_leaves_lane_route_or_limit_has_not_passed(case: Case) -> None:
    assert case.told() == case.tells


SIGNS = {
    "stop_six_metres_before_the_line": Case(ALONE, stops_at(-6.0, go=10.0), {"full_stop": "FAIL a0"}),
    "red_after_a_stop": Case(RED, gated(lambda seen: seen.time > 8.0), {"red": "FAIL a1"}),
    # Yellow finds it 22 m before the line at 3.3 m/s, from which one stops within 2 m; it speeds up, and the light is red.
    "speed_up_on_yellow": Case(
        at("light4", "2000", distance=72.0, speed=3.3), timed((0.0, 3.3), (15.0, 8.0)), {"red": "FAIL a0"}
    ),
    "stand_beyond_the_line_at_red": Case(at("light4", "0200", subject=1, duration=14), stops_at(1.0), {"red": "FAIL a1"}),
    "right_on_red_without_a_stop": Case(
        at("light4", "0100", subject=1, duration=14), gated(lambda _: True), {"right_on_red": "FAIL a1"}
    ),
}


@shows_each(SIGNS)
def test_what_looks_like_a_stop_is_none(case: Case) -> None:
    assert case.told() == case.tells


ROLLS = {"roll_over_the_line": 0.5, "creep_over_the_line": 0.15}


@shows_each(ROLLS)
def test_however_slow_rolling_is_no_stop(case: float) -> None:
    """It brakes gently down to this speed [m/s] before the entrance zone and crosses the line with it."""
    slow = gated(
        lambda _: True, lambda seen: math.sqrt(case**2 + max(-1.2 - seen.me.station, 0.0)) if seen.me.station < 0.2 else 5.0
    )
    run = Case(ALONE, slow, {}).run()
    assert run.need("speed")[entered(run)[-1, 0], 0] == pytest.approx(case, abs=0.04)
    assert Case(ALONE, slow, {}).told(run) == {"full_stop": "FAIL a0"}


@shows("stop_beyond_the_line")
def test_a_stop_beyond_the_line_is_none(tmp_path: Path) -> None:
    """The line lies 3 m before the junction: 2 m before the junction there is room to stop, but not before the line."""
    path = tmp_path / "setback.xodr"
    path.write_text(opendrive(Layout(setback=3.0)), encoding="utf-8")
    for station, outcome in ((-2.0, "FAIL a0"), (-3.2, "PASS")):
        case = Case(at(rvads.find("1", path), "2000"), stops_at(station, go=10.0), {"full_stop": outcome})
        assert case.told() == case.tells
