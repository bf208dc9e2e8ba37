"""Drivers keep the limit at their place, and have slowed down where a lower one begins."""

from dataclasses import replace

import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.traffic import Hesitant, LateYielder, RedLightRunner, RollingStop
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.segment import NO_LIMIT, SPEED_LIMIT, Limits
from pytest_rvads.runs.itineraries import itinerary
from pytest_rvads.scenarios.configurations import configuration, explicit, started


def with_approaches(place: Junction, limits: Limits) -> Junction:
    """Return a junction with speed limits along its approaches; those behind the line go on."""
    entrances = (replace(lane, approach=replace(lane.approach, limits=limits)) for lane in place.entrances if lane.approach)
    return replace(place, entrances=tuple(entrances))


LIMITED = with_approaches(find("light4"), ((0.0, 20.0), (70.0, 8.0)))
"""20 m/s as far as 50 m before the entrance vertex, then 8 m/s."""


def driven(driver: type[rvads.Reference], place: Junction, speed: float, distance: float = 119.0) -> rvads.Run:
    scenario = rvads.Scenario(place, "2000", distance=distance, speed=speed, duration=25)
    return rvads.simulate(rvads.Case(scenario, driver))


@pytest.mark.extended
@pytest.mark.parametrize("driver", [rvads.Reference, Hesitant, LateYielder, RedLightRunner, RollingStop])
def test_a_lower_limit_is_kept_from_its_first_metre_on(driver: type[rvads.Reference]) -> None:
    run = driven(driver, LIMITED, 15.0)
    station, speed = run.need("station")[:, 0], run.need("speed")[:, 0]
    assert rvads.check(run, "speed_limit").status == "PASS"
    assert speed[station < -50.0].max() > SPEED_LIMIT, "the higher limit is made use of"
    assert (speed[(station > -50.0) & (station < 0.0)] < 8.5).all()
    assert run.facts.speed_limit == SPEED_LIMIT, "what holds where the map states none"


@pytest.mark.extended
def test_a_driver_who_looks_no_further_than_its_place_breaks_the_lower_limit() -> None:
    class Short(rvads.Reference):
        def target_speed(self, seen: Observation) -> float:
            return seen.speed_limit

    verdict = rvads.check(driven(Short, LIMITED, 15.0), "speed_limit")
    assert verdict.status == "FAIL"


@pytest.mark.extended
def test_every_state_is_seen_with_the_limit_at_its_place() -> None:
    seen: list[tuple[float, float]] = []

    class Watches(rvads.Reference):
        def target_speed(self, now: Observation) -> float:
            seen.append((now.me.station, now.speed_limit))
            return super().target_speed(now)

    driven(Watches, LIMITED, 15.0)
    assert {limit for station, limit in seen if station < -50.0} == {20.0}
    assert {limit for station, limit in seen if station > -50.0} >= {8.0}


@pytest.mark.extended
@pytest.mark.parametrize("limit", [5.0, 25.0])
def test_one_limit_is_reached_and_kept(limit: float) -> None:
    run = driven(rvads.Reference, find("light4").limited(limit), 0.0, 60.0)
    speed = run.need("speed")[:, 0]
    assert rvads.check(run, "speed_limit").status == "PASS"
    assert speed.max() > min(limit - 0.5, SPEED_LIMIT + 1.0)


def test_without_a_limit_drivers_are_shown_the_advised_speed() -> None:
    place = find("light4").limited(NO_LIMIT)
    assert itinerary(place, *min(place.movements)).limit_at(-10.0) == pytest.approx(130 / 3.6)


def test_named_configurations_start_no_faster_than_the_limit_allows() -> None:
    def speeds(place: Junction, label: str, subject: int | None) -> tuple[float, ...]:
        start: tuple[float, ...] = started(configuration(label, 4), place, 0, subject, 0)["speed"]
        return start

    place = with_approaches(find("stop4"), ((0.0, 9.0), (90.0, 7.0)))  # 7 m/s from 30 m before the line on
    assert speeds(place, "D", None) == (7.0,) * 4, "20 m before the line"
    assert speeds(place, "S21", 0) == (7.0,) * 4, "the lower limit begins 6 m behind the start of the subject"
    later = with_approaches(find("stop4"), ((0.0, 7.0), (90.0, 9.0)))
    assert speeds(later, "S21", 0) == (7.0, 8.0, 8.0, 8.0), "the subject starts 36 m before the line, the others 21 m"
    assert speeds(find("stop4"), "D", None) == (10.0,) * 4
    point = explicit(20.0, 10.0, 4)[0]
    assert started(point, place, 0, None, 0)["speed"] == (10.0,) * 4, "what a user asks for is kept"


def test_grids_of_fast_roads_reach_beyond_25_mph() -> None:
    assert rvads.vmax(100.0, 1) == SPEED_LIMIT
    fast = rvads.vmax(100.0, 1, limit=30.0)
    assert fast is not None
    # v^2 / 2a with the service brake of 4 m/s^2 alone; resistances help, the lag of the brake does not.
    assert fast == pytest.approx((2 * 4.0 * 100.0) ** 0.5, rel=0.1)
    assert rvads.vmax(1000.0, 1, limit=60.0) == 30.0
