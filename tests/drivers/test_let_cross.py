"""The reference driver at crosswalks: pedestrians cross in peace, crosswalks stay clear, and vehicles get on."""

from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest

import pytest_rvads as rvads
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.let_cross import BEFORE, BRIEFLY
from pytest_rvads.drivers.signs_and_lights import WAIVER
from pytest_rvads.drivers.spacing import STAND_OFF
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.drivers.walking import BEHAVIOURS
from pytest_rvads.geometry.crosswalks import MODERATE, Side
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.rules.book import rules_for

from ..policies import EVERYWHERE

REFERENCE = partial(rvads.Reference, tie=0.5)
STANDS = 0.01
"""A vehicle slower than this stands [m/s]."""


def drive(behaviour: str, difference: float = 0.0, driver: Any = REFERENCE, **more: Any) -> rvads.Run:
    """Return the run of a vehicle that meets a pedestrian; the vehicle does not see through a parked vehicle."""
    given: dict[str, Any] = {"name": "zebra4", "directions": "2000", "subject": 0, "crossing": 0, "side": Side.NEAR} | more
    scenario = rvads.Scenario(
        find(given["name"]).walked,
        given["directions"],
        distance=given.get("distance", 36),
        speed=given.get("speed", 10),
        subject=given["subject"],
        pedestrians=[rvads.Pedestrian(given["crossing"], given["side"], behaviour, difference)],
        senses=rvads.Senses(occlusion=behaviour == "hidden"),
    )
    return rvads.simulate(rvads.Case(scenario, driver))


def complaints(run: rvads.Run, *more: str) -> dict[str, str]:
    """Return the outcome of every rule that a run breaks, whoever is to blame, and how the run ended if a vehicle stayed."""
    verdicts = [rvads.check(run, rule) for rule in rules_for(("road", *more), run.junction)]
    bad = {verdict.rule: verdict.outcome.name for verdict in verdicts if verdict.outcome.name not in ("PASS", "NA")}
    return bad if run.provenance["end"] == "left" else {**bad, "end": str(run.provenance["end"])}


@pytest.mark.parametrize(("behaviour", "side"), [*product(BEHAVIOURS, Side)])
@pytest.mark.parametrize(("name", "directions", "crossing"), [("zebra4", "2000", 0), ("zebra4", "1000", 1), ("walk4", "3000", 3)])
def test_every_rule_is_kept_whatever_the_pedestrian_does(
    behaviour: str, side: Side, name: str, directions: str, crossing: int
) -> None:
    if behaviour == "hidden" and side is Side.FAR:
        pytest.skip("vehicles are parked on the near side alone")
    for difference in (0.5, 1.5, 3.0):
        run = drive(behaviour, difference, name=name, directions=directions, crossing=crossing, side=side)
        found = complaints(run, *(("crosswalk_waiting",) if (name, crossing) == ("zebra4", 0) else ()))
        if behaviour == "darts":  # nobody can stop for every pedestrian who runs onto the crosswalk
            assert set(found.values()) <= {"PROVOKED", "collision"}, (difference, found)
        else:
            assert not found, (difference, found)


@pytest.mark.parametrize("name", EVERYWHERE)
@pytest.mark.parametrize("behaviour", ["steady", "hidden"])
def test_every_policy_drives_where_pedestrians_walk(name: str, behaviour: str) -> None:
    run = drive(behaviour, 1.0, traffic(name), directions="2222", distance=20, speed=8)
    assert run.fault is None


def test_traffic_without_rules_for_pedestrians_drives_as_if_nobody_stood_at_the_kerb() -> None:
    walked = drive("waits", -1.0, rvads.LgsvlLike, directions="2130")
    alone = rvads.Scenario(find("zebra4"), "2130", distance=36, speed=10, subject=0)
    run = rvads.simulate(rvads.Case(alone, rvads.LgsvlLike))
    count = len(run.agents)
    assert np.array_equal(walked.station[:, :count], run.station)
    assert np.array_equal(walked.speed[:, :count], run.speed)


def test_observation_on_movements_has_neither_pedestrians_nor_parked_vehicles() -> None:
    seen: list[Observation] = []

    class Watching(rvads.Reference):
        def control(self, view: Observation) -> Any:
            seen.append(view)
            return super().control(view)

    drive("hidden", 1.0, Watching, directions="2130")
    first = seen[0]
    assert [other.name for other in first.others] == ["a1", "a2", "p0", "parked0"]
    assert [other.name for other in first.on_movements().others] == ["a1", "a2"]
    rvads.simulate(rvads.Case(rvads.Scenario(find("zebra4"), "2130", subject=0), Watching))
    assert seen[-1].on_movements() is seen[-1]


@pytest.mark.parametrize(("directions", "crossing", "patience"), [("2000", 0, WAIVER), ("2000", 2, BRIEFLY)])
def test_driver_goes_when_a_pedestrian_has_stood_for_long(directions: str, crossing: int, patience: float) -> None:
    run = drive("waits", -1.0, directions=directions, crossing=crossing)
    stood = np.flatnonzero(np.abs(run.speed[:, 0]) < STANDS) * run.dt
    assert run.provenance["end"] == "left"
    assert patience - 0.5 < stood[-1] - stood[0] < patience + 0.5


def test_driver_does_not_wait_for_a_pedestrian_who_waits_at_red() -> None:
    run = drive("waits", -2.0, name="walk4", directions="2000")  # crosswalk 0 has red while entrance 0 has green
    assert run.provenance["end"] == "left"
    assert run.speed[:, 0].min() > MODERATE / 2


@pytest.mark.parametrize(("crossing", "place"), [(0, "line"), (2, "area")])
def test_driver_stops_before_the_painted_area(crossing: int, place: str) -> None:
    """The crosswalk over the own arm lies 1.5 m behind the line: too little room for a car, so the driver waits at the line."""
    run = drive("stops", 0.5, crossing=crossing)
    cover = run.junction.covers[crossing, run.agents[0].way.key]
    stood = run.station[np.abs(run.speed[:, 0]) < STANDS, 0]
    assert stood == pytest.approx(-STAND_OFF if place == "line" else cover.start - BEFORE, abs=0.25)


def test_driver_does_not_drive_onto_a_crosswalk_without_room_behind_it() -> None:
    """Entrance 0 follows a car that stops before the crosswalk of its exit; the follower stops before its own crosswalk."""
    place = find("zebra4").walked
    walker = rvads.Pedestrian(2, Side.FAR, "stops", -1.0)
    scenario = rvads.Scenario(place, "2000", distance=20, speed=8, followers=3, subject=0, pedestrians=[walker])
    run = rvads.simulate(rvads.Case(scenario, REFERENCE))
    assert [agent.name for agent in run.agents[:4]] == ["a0", "a0+1", "a0+2", "a0+3"]
    for (_, key), cover in run.junction.covers.items():
        for column, agent in enumerate(run.agents[:4]):
            station, still = run.station[:, column], np.abs(run.speed[:, column]) < STANDS
            over = (station > cover.start) & (station - agent.size[0] < cover.end)
            assert key != agent.way.key or not (still & over).any(), agent.name


def test_driver_comes_slowly_to_a_kerb_that_it_does_not_see() -> None:
    """While the parked vehicle hides the kerb, the driver can stop with 2.5 m/s^2: at 4 m before its stop from 4.5 m/s."""
    run = drive("hidden", 4.0, distance=36, speed=10)
    place = run.junction.covers[0, run.agents[0].way.key].start - BEFORE
    column = run.station[:, 0]
    four_before = int(np.flatnonzero(column > place - 4.0)[0])
    assert run.speed[four_before, 0] < 5.0
    free = drive("steady", 4.0, distance=36, speed=10)
    four_before = int(np.flatnonzero(free.station[:, 0] > place - 4.0)[0])
    assert free.speed[four_before, 0] > 5.0


def test_driver_keeps_to_a_moderate_speed_near_pedestrians_on_the_sidewalk() -> None:
    run = drive("steady", 3.0, distance=36, speed=10)
    place = run.junction.covers[0, run.agents[0].way.key].start - BEFORE
    near = (run.station[:, 0] > place - 8.0) & (run.station[:, 0] < place) & (run.speed[:, 1] == 0.0)
    assert near.any()
    assert run.speed[near, 0].max() < MODERATE + 0.5
