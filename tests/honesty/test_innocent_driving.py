"""Controllers that drive as one may, though not as one would expect: none of them breaks a rule.

The subject is alone. Where it turns, or stops late, or passes on yellow, the law leaves it the choice.
"""

import math
from pathlib import Path
from typing import Any

import pytest_rvads as rvads
from pytest_rvads.drivers.traffic import LateYielder
from pytest_rvads.satellites.relations.variants import mirrored
from tools.crossings import Layout, opendrive

from .cases import Case, at
from .drivers import OnCentreLine, gated, lawful
from .shown import shows, shows_each

ALONE = at("stop4", "2000")
KEPT = dict.fromkeys(("keep_clear", "progress", "keep_lane", "on_route", "speed_limit"), "PASS")
STOPPED = {**KEPT, "full_stop": "PASS"}


def eases(seen: rvads.Observation) -> float:
    """Slow down early and creep the last two metres to the line."""
    to_go = -0.4 - seen.me.station
    return math.inf if to_go <= 0.05 else 0.3 + max(to_go - 2.0, 0.0) / 2


class Moment(rvads.Reference):
    """Stands at the line for half a second and goes on."""

    def make_gate(self, _seen: rvads.Observation) -> Any:
        return _Moment()


class _Moment:
    since = math.inf

    def allows(self, seen: rvads.Observation) -> bool:
        if seen.me.station > -1.0 and seen.me.speed < 0.1:
            self.since = min(self.since, seen.time)
        return seen.time >= self.since + 0.5


def mirror(junction: str, directions: str, **more: Any) -> rvads.Scenario:
    """Return a scenario at a built-in junction as a mirror shows it: traffic keeps left, and left turns are the near ones."""
    return at(mirrored(rvads.find(junction)), directions, **more)


DRIVES = {
    "stop_for_a_moment": Case(ALONE, Moment, STOPPED),
    "hesitate_for_three_seconds": Case(ALONE, rvads.traffic("hesitant"), STOPPED),
    "creep_the_last_two_metres": Case(ALONE, lawful(eases), STOPPED),
    "stop_at_the_last_moment": Case(ALONE, LateYielder, STOPPED),
    "drive_slowly_all_the_way": Case(ALONE, lawful(lambda _: 2.0), STOPPED),
    "wait_for_eight_seconds": Case(ALONE, gated(lambda seen: seen.time > 14.0), STOPPED),
    "a_little_over_the_limit": Case(ALONE, lawful(lambda _: 11.4), STOPPED),
    # Yellow comes at 15 s, 9 m before the line, and red ends at 40 s.
    "brake_on_yellow": Case(
        at("light4", "2000", distance=99.0, speed=6.0, duration=55), lawful(lambda _: 6.0), {**KEPT, "red": "PASS"}
    ),
    # Yellow finds it 6 m before the line; from 6.7 m/s it takes 5.5 m to stop at 4 m/s^2, and the brake a moment to bite.
    "pass_on_yellow_when_too_near_to_stop": Case(
        at("light4", "2000", distance=106.0, speed=6.66), lawful(lambda _: 6.66), {**KEPT, "red": "NA"}
    ),
    "wait_at_red": Case(at("light4", "0200", subject=1), rvads.Reference, {**KEPT, "red": "PASS"}),
    "right_on_red_after_a_stop": Case(at("light4", "0100", subject=1), rvads.Reference, {**KEPT, "right_on_red": "PASS"}),
    "wait_for_green_to_turn_right": Case(
        at("light4", "0100", subject=1), gated(lambda seen: seen.time > 20.5), {**KEPT, "right_on_red": "PASS"}
    ),
    "keep_left_at_stop_signs": Case(mirror("stop4", "3000"), rvads.Reference, STOPPED),
    "keep_left_and_turn_left_on_red": Case(
        mirror("light4", "0300", subject=1), gated(lambda seen: seen.time > 7.0), {**KEPT, "right_on_red": "PASS", "red": "NA"}
    ),
}


@shows_each(DRIVES)
def test_lawful_driving_is_not_blamed(case: Case) -> None:
    assert case.told() == case.tells


@shows("swing_out_in_a_narrow_corner")
def test_a_front_that_swings_out_has_not_left_its_lane(tmp_path: Path) -> None:
    """A bend of 5.25 m: the front of a car that follows it with its rear axle is far outside."""
    path = tmp_path / "narrow.xodr"
    path.write_text(opendrive(Layout(stop=7.0)), encoding="utf-8")
    case = Case(at(rvads.find("1", path), "1000"), OnCentreLine, STOPPED)
    run = case.run()
    way = rvads.values.Itinerary.through(run.junction, 0, 1)
    poses, stations = run.need("pose")[:, 0], run.need("station")[:, 0]
    swing = max(abs(way.project(x, y, s)[1]) for (x, y, _), s in zip(poses[::10], stations[::10], strict=True))
    assert swing > 0.82, "without this much room to the border of the lane nothing was tried"
    assert case.told(run) == case.tells
