"""The rule speed_limit where the limit changes along the way."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import NO_LIMIT, Limits
from pytest_rvads.logic.check import check
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.run import Run
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor

Make = Callable[..., Run]


def stating(limits: Limits) -> Junction:
    place = find("light4")
    entrances = (replace(lane, approach=replace(lane.approach, limits=limits)) for lane in place.entrances if lane.approach)
    return replace(place, entrances=tuple(entrances))


FALLS = stating(((0.0, 20.0), (70.0, 8.0)))
"""20 m/s as far as 50 m before the entrance vertex, then 8 m/s."""


def slowing_at(drive: Make, place: Junction, station: float, fast: float, **facts: float | None) -> Run:
    """Return a run of 3 s that drives at `fast` [m/s] from 60 m before the junction on, and at 8 m/s from `station` [m] on."""
    return drive(place, {0: (2, -60.0, [(0, fast), (round((station + 60.0) / fast * 100), 8.0)])}, 300, **facts)


@pytest.mark.parametrize(
    ("place", "station", "fast", "status"),
    [
        (FALLS, -51.0, 20.0, "PASS"),
        (FALLS, -49.0, 20.0, "FAIL"),
        (FALLS, -51.0, 20.4, "PASS"),  # 0.5 m/s are tolerated
        (FALLS, -51.0, 20.6, "FAIL"),
        (find("light4"), -51.0, 20.0, "FAIL"),
        (find("light4").limited(8.0), -51.0, 9.0, "FAIL"),
        (find("light4").limited(9.0), -51.0, 9.0, "PASS"),
        (find("light4").limited(NO_LIMIT), -51.0, 60.0, "PASS"),
    ],
)
def test_the_limit_at_the_place_of_a_vehicle_counts(
    drive: Make, place: Junction, station: float, fast: float, status: str
) -> None:
    run = slowing_at(drive, place, station, fast)
    assert check(run, "speed_limit").status == status
    monitor = RuleMonitor("speed_limit", place, run.agents, speed_limit=run.facts.speed_limit)
    for tick in range(run.steps):
        monitor.step(run.zone[tick], run.lights[tick], station=run.need("station")[tick], speed=run.need("speed")[tick])
    assert (monitor.verdict is Truth.FALSE) == (status == "FAIL")


def test_the_first_state_behind_the_border_breaks_the_rule(drive: Make) -> None:
    verdict = check(slowing_at(drive, FALLS, -49.0, 20.0), "speed_limit")
    assert verdict.message == "speed_limit at t=0.50 s: a0 is over the speed limit", "10 m at 20 m/s"


def test_the_map_comes_before_the_general_limit(drive: Make) -> None:
    assert check(slowing_at(drive, FALLS, -51.0, 20.0, speed_limit=5.0), "speed_limit").status == "PASS"
    partly = stating(((0.0, None), (70.0, 8.0)))
    assert check(slowing_at(drive, partly, -51.0, 12.0, speed_limit=12.0), "speed_limit").status == "PASS"
    assert check(slowing_at(drive, partly, -51.0, 12.0, speed_limit=11.0), "speed_limit").status == "FAIL"


def test_partly_unknown_speed_limit_is_na(drive: Make) -> None:
    slow = find("light4").limited(8.0)
    assert check(slowing_at(drive, slow, -51.0, 8.0, speed_limit=None), "speed_limit").status == "PASS"
    assert check(slowing_at(drive, slow, -51.0, 9.0, speed_limit=None), "speed_limit").status == "FAIL"
    verdict = check(slowing_at(drive, FALLS, -51.0, 20.0, speed_limit=None), "speed_limit")
    assert verdict.status == "NA"
    assert "the run holds no speed limit, and its map states none for a part of a way" in verdict.message


def test_the_delay_counts_from_the_time_that_the_limits_allow(drive: Make) -> None:
    from pytest_rvads.logic.conduct.kpis import kpis

    run = drive(FALLS, {0: (2, -60.0, [(0, 4.0)])}, 2600)
    (vehicle,) = kpis(run).vehicles
    length = run.agents[0].way.length
    allowed = 10.0 / 20.0 + (50.0 + length) / 8.0
    assert vehicle.delay == pytest.approx((60.0 + length) / 4.0 - allowed, abs=0.011), "up to one step"
