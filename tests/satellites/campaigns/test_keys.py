"""Hashes of cases: equal where runs have to be, another one where anything that decides a run is."""

import re
import threading
from collections import deque
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pytest_rvads as rvads
from pytest_rvads.drivers.identity import identity, source
from pytest_rvads.satellites.campaigns.campaign import Keys

STOP = rvads.find("stop4")
BASE: dict[str, Any] = {"place": STOP, "directions": "1133"}
CHANGES: dict[str, Any] = {
    "place": rvads.find("light4"),
    "directions": "1131",
    "distance": 19.99,
    "speed": 0.01,
    "rotation": 1,
    "configuration": "mine",
    "duration": 7.5,
    "aggression": 2,
    "wait": 1.25,
    "order": (1, 0, 2, 3),
    "senses": rvads.Senses(delay=0.1),
    "followers": 1,
}


def key(case: rvads.Case, simulator: rvads.Simulator = rvads.bullet) -> str:
    return Keys(simulator).of(case)


def case(driver: Any = rvads.Reference, fleet: rvads.Fleet | None = None, **changes: Any) -> rvads.Case:
    arguments = {**BASE, **changes}
    return rvads.Case(rvads.Scenario(**arguments), driver, fleet=fleet or rvads.Fleet())


def test_every_change_of_a_scenario_is_another_case() -> None:
    known = {"place", "directions", "distance", "speed", *(item.name for item in fields(rvads.Scenario)[4:])}
    assert set(CHANGES) == known - {"subject", "elapsed", "pedestrians"}
    keys = [key(case()), *(key(case(**{name: value})) for name, value in CHANGES.items())]
    assert len(set(keys)) == len(keys)


def test_elapsed_time_of_the_lights_is_part_of_a_case() -> None:
    at_lights: dict[str, Any] = {"place": rvads.find("light4")}
    assert key(case(**at_lights)) != key(case(**at_lights, elapsed=12))


def test_pedestrians_are_part_of_a_case() -> None:
    walked: dict[str, Any] = {"place": rvads.find("zebra4"), "directions": "2222"}
    walkers = [[], [rvads.Pedestrian(0)], [rvads.Pedestrian(0, difference=0.5)], [rvads.Pedestrian(0), rvads.Pedestrian(2)]]
    assert len({key(case(**walked, pedestrians=each)) for each in walkers}) == len(walkers)


def test_what_drives_is_part_of_a_case() -> None:
    around = [rvads.traffic(name) for name in ("reference", "hesitant")]
    seated = rvads.Scenario(STOP, "1133", subject=0)
    keys = [
        key(case()),
        key(case(partial(rvads.Reference, tie=0.5))),
        key(case(partial(rvads.Reference, tie=0.25))),
        key(case(rvads.LgsvlLike)),
        *(key(rvads.Case(seated, rvads.Reference, traffic=traffic)) for traffic in around),
        key(rvads.Case(replace_subject(seated, 1), rvads.Reference, traffic=around[0])),
        key(case(), rvads.mujoco),
    ]
    assert len(set(keys)) == len(keys)


def replace_subject(scenario: rvads.Scenario, subject: int) -> rvads.Scenario:
    return scenario.but(subject=subject)


def test_bodies_are_part_of_a_case() -> None:
    usual = rvads.Vehicle()
    other = [replace(usual, length=4.7), replace(usual, brake_lag=0.1), replace(usual, friction=0.8)]
    fleets = [
        rvads.Fleet(usual),
        *map(rvads.Fleet, other),
        rvads.Fleet(usual, {"a1": other[0]}),
        rvads.Fleet(usual, {"a2": other[0]}),
    ]
    keys = [key(case(fleet=fleet)) for fleet in fleets]
    assert len(set(keys)) == len(keys)


@given(st.lists(st.floats(0.01, 30), min_size=4, max_size=4), st.floats(0, 5))
def test_the_same_case_made_twice_has_one_hash(distances: list[float], wait: float) -> None:
    one, two = (key(case(distance=tuple(distances), wait=wait)) for _ in range(2))
    assert one == two


@given(st.lists(st.tuples(*[st.sampled_from([0.3, 5.0, 5.1, 20.0])] * 4), min_size=2, max_size=6, unique=True))
def test_no_two_cases_share_a_hash(distances: list[tuple[float, ...]]) -> None:
    keys = [key(case(distance=distance, configuration="same")) for distance in distances]
    assert len(set(keys)) == len(distances)


def test_the_path_of_a_map_is_no_part_of_a_case() -> None:
    moved = replace(STOP, map="/elsewhere/town.xodr")
    assert key(case(place=moved)) == key(case())


class Driver(rvads.Follower):
    """One with settings."""

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        self.settings = settings

    def target_speed(self, seen: Any) -> float:
        return 1.0


def test_drivers_are_told_apart() -> None:
    drivers: list[Any] = [
        Driver,
        rvads.Follower,
        partial(Driver, speed=1.0),
        partial(Driver, speed=2.0),
        partial(Driver, weights=(1.0, 2.0)),
        partial(Driver, weights=(2.0, 1.0)),
        partial(Driver, table={"a": 1}),
        partial(Driver, table={"a": 2}),
        Driver(speed=1.0),
        Driver(speed=2.0),
        rvads.Process(["stack"]),
        rvads.Process(["stack", "--quick"]),
        rvads.Process(["stack"], rate=10),
        rvads.Process(["stack"], env={"SPEED": "8"}),
    ]
    assert len(set(map(identity, drivers))) == len(drivers)


class Slotted:
    """Its values are in no dictionary."""

    __slots__ = ("speed",)

    def __init__(self, speed: float) -> None:
        self.speed = speed


class Named(dict[str, float]):
    """A mapping with an attribute."""

    def __init__(self, speed: float) -> None:
        super().__init__()
        self.speed = speed


def nested(speed: float) -> Any:
    value: Any = speed
    for _ in range(50):
        value = [value]
    return partial(Driver, within=value)


def stated(speed: float) -> Any:
    def driver() -> Driver:
        return Driver(speed=1)

    driver.version = f"weights {speed}"  # type: ignore[attr-defined]
    return driver


WAYS = {
    "a slot": lambda speed: partial(Driver, of=Slotted(speed)),
    "a long array": lambda speed: partial(Driver, of=np.full(5000, speed)),
    "a queue": lambda speed: partial(Driver, of=deque([speed])),
    "an attribute of a mapping": lambda speed: partial(Driver, of=Named(speed)),
    "a value deep in others": nested,
    "a version that its author states": stated,
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_a_driver_is_another_one_whatever_way_its_speed_comes_to_it(way: Any) -> None:
    slow, again, fast = (identity(way(speed)) for speed in (1.0, 1.0, 2.0))
    assert slow == again != fast


def local() -> Any:
    class Local(Driver):
        pass

    return Local


@pytest.mark.parametrize(
    "driver",
    [lambda: Driver(speed=1), local(), partial(Driver, of=threading.Lock())],
    ids=["a lambda", "a local class", "a lock"],
)
def test_a_driver_of_which_nothing_tells_whether_it_is_the_same_is_never_the_same(driver: Any) -> None:
    assert identity(driver) != identity(driver)
    if not isinstance(driver, partial):
        driver.version = "3"
        assert identity(driver) == identity(driver)


class Versioned(Driver):
    """Its weights are in a file that its code does not show."""

    version = "weights\n2.1"


def test_reports_name_the_version_of_a_driver_beside_the_digest_of_its_code() -> None:
    here = Path(__file__).parent
    plain = source(Driver, here)
    assert re.fullmatch(r"test_keys\.py [0-9a-f]{8}", plain)
    for driver in (Versioned, Versioned(), partial(Versioned, speed=1.0)):
        assert source(driver, here) == f"{plain} version weights 2.1"
    assert source(partial(Driver, version="argument"), here) == plain


def test_a_driver_made_twice_is_the_same() -> None:
    assert identity(partial(Driver, speed=1.0, of={"b": 1})) == identity(partial(Driver, speed=1.0, of={"b": 1}))
    assert identity(rvads.Process("stack --quick")) == identity(rvads.Process(["stack", "--quick"]))
