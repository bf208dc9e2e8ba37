"""The reference autopilot where signs differ, where there are none, where arms have several lanes, and in queues."""

import math
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pytest_rvads.drivers.follower import Track
from pytest_rvads.drivers.give_way import GiveWay
from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.reference import Reference
from pytest_rvads.drivers.signs_and_lights import Queue
from pytest_rvads.drivers.traffic import traffic
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.finder import find, load
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.standing import TIE
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.itineraries import Itinerary
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Vehicle, VehicleState, Zone
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate

from ..policies import EVERYWHERE

ROAD = partial(Reference, tie=TIE)
NONE, STOP, YIELD, PRIORITY = Sign.NONE, Sign.STOP, Sign.YIELD, Sign.PRIORITY
SIGNS = {
    "right before left": (NONE, NONE, NONE, NONE),
    "yield": (PRIORITY, YIELD, PRIORITY, YIELD),
    "stop at the minor road": (NONE, STOP, NONE, STOP),
    "one of each": (PRIORITY, STOP, YIELD, NONE),
}
LIMIT = 11.176


def signed(*signs: Sign, base: str = "stop4") -> Junction:
    """A built-in junction with other signs."""
    place = find(base)
    lanes = tuple(replace(lane, sign=sign) for lane, sign in zip(place.entrances, signs, strict=True))
    return replace(place, name=f"{base}_{'_'.join(signs)}", entrances=lanes)


def drive(place: Junction, code: str, **more: Any) -> Run:
    run = simulate(Case(Scenario(place, code, **more), ROAD))
    assert (run.fault, run.collisions, run.provenance["end"]) == (None, (), "left")
    return run


def entering(run: Run) -> list[str]:
    """Names in the order in which they enter."""
    first = [int(np.argmax(run.zone[:, k] >= Zone.JUNCTION)) for k in range(len(run.agents))]
    return [run.agents[k].name for k in np.argsort(first, kind="stable")]


def wrong(run: Run) -> list[str]:
    """Rules of the road that are not kept although they can be."""
    verdicts = {rule.name: check(run, rule) for rule in rules_for(("road",), run.junction.control)}
    return [name for name, v in verdicts.items() if v.status in ("FAIL", "OPEN") and not (v.unavoidable or v.provoked)]


def braking(run: Run, name: str) -> float:
    """Hardest braking of an agent, over a tenth of a second [m/s^2]."""
    (column,) = (k for k, agent in enumerate(run.agents) if agent.name == name)
    speed = run.need("speed")[:, column]
    return float((speed[:-10] - speed[10:]).max() / 0.1)


def test_priority_road_does_not_brake_for_yielding_traffic() -> None:
    run = drive(signed(*SIGNS["yield"]), "2200", distance=25, speed=8)
    assert entering(run) == ["a0", "a1"]
    assert braking(run, "a0") < 0.5
    assert wrong(run) == []


def test_yield_sign_requires_no_stop_on_an_empty_road() -> None:
    run = drive(signed(*SIGNS["yield"]), "0200", distance=25, speed=8)
    assert float(run.need("speed").min()) > 7.5


def test_stop_sign_requires_a_stop_on_an_empty_road() -> None:
    place = signed(*SIGNS["stop at the minor road"])
    for code, stands in (("0200", True), ("2000", False)):
        run = drive(place, code, distance=25, speed=8)
        before = run.zone[:, 0] <= Zone.ENTRANCE
        assert bool(run.need("speed")[before, 0].min() < 0.01) is stands
        assert wrong(run) == []


def test_vehicle_from_the_right_goes_first_without_a_stop_in_the_junction() -> None:
    run = drive(signed(*SIGNS["right before left"]), "2200", distance=25, speed=8)
    assert entering(run) == ["a1", "a0"], "entrance 1 lies to the right of entrance 0"
    assert braking(run, "a1") < 0.5
    assert wrong(run) == []


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (2, 0, 3, 1)])
def test_first_created_vehicle_resolves_a_circle_of_right_before_left(order: tuple[int, ...]) -> None:
    run = drive(signed(*SIGNS["right before left"]), "2222", distance=20, order=order)
    ticks = np.argmax(run.zone >= Zone.JUNCTION, axis=0)
    assert ticks[order[0]] == ticks.min(), "maybe together with who comes the other way, whom it does not meet"
    assert not ((run.zone == Zone.JUNCTION) & (run.need("speed") < 0.05)).any()


@pytest.mark.parametrize("signs", SIGNS.values(), ids=SIGNS)
@pytest.mark.parametrize("code", ["1322", "2130", *(pytest.param(code * 4, marks=pytest.mark.extended) for code in "123")])
def test_the_rules_of_the_road_are_kept_at_every_kind_of_sign(signs: tuple[Sign, ...], code: str) -> None:
    assert wrong(drive(signed(*signs), code, distance=25, speed=8)) == []


@pytest.mark.parametrize("base", ["stop4", "light4"])
def test_who_follows_keeps_its_distance_and_stops_at_the_line_itself(base: str) -> None:
    run = drive(find(base), "0200", distance=15, speed=5, followers=2)
    station, speed = run.need("station"), run.need("speed")
    there = run.zone < Zone.GONE
    for ahead, behind in ((0, 1), (1, 2)):
        both = there[:, ahead] & there[:, behind]
        gap = station[both, ahead] - 4.6 - station[both, behind]
        assert gap.min() > 1.0
    assert wrong(run) == []
    if base == "stop4":
        stood = (run.zone == Zone.ENTRANCE) & (speed < 0.01)
        assert stood.any(axis=0).all()
        assert check(run, "p1").status != "FAIL"


def test_minor_road_crosses_before_priority_traffic_only_with_a_gap() -> None:
    """From standing at the line of entrance 1 straight across one that comes on the priority road, by hand."""
    place = signed(*SIGNS["yield"])
    way = Itinerary.through(place, 1, 3)
    shared = (place.stretches or {})[(1, 3), (0, 2)]
    # It sets off after 0.35 s, gains 2.3 m/s^2, and has left with its 4.6 m; 1.6 s later the other one may be there.
    seconds = 0.35 + math.sqrt(2.0 * (shared.mine.end + 4.6 + 0.5) / 2.3) + 1.6
    for before, goes in ((0.3, True), (-0.3, False)):
        me = VehicleState("a1", 1, Turn.STRAIGHT, Zone.ENTRANCE, -0.5, 0, 0, 0, 0.0, 0.0, 4.6, 1.86)
        comes = me._replace(name="a0", entrance=0, zone=Zone.APPROACH, speed=LIMIT)
        comes = comes._replace(station=shared.yours.start - LIMIT * seconds - before)
        seen = Observation(0.0, me, (comes,), (Colour.NONE,) * 4, way, place, Vehicle(), LIMIT, created=1)
        assert GiveWay(seen, Track(way, 3.65)).allows(seen) is goes


def minor(entrance: int, *others: VehicleState, time: float = 0.0, turn: Turn = Turn.RIGHT) -> Observation:
    """What a vehicle sees that stands at the yield sign of `entrance`."""
    place = signed(*SIGNS["yield"])
    me = VehicleState(f"a{entrance}", entrance, turn, Zone.ENTRANCE, -0.5, 0, 0, 0, 0.0, 0.0, 4.6, 1.86)
    way = Itinerary.through(place, entrance, place.by_turn[entrance, turn][0].exit)
    return Observation(time, me, others, (Colour.NONE,) * 4, way, place, Vehicle(), LIMIT, created=1)


@pytest.mark.parametrize(("distance", "at_once"), [(64.0, False), (85.0, True)])
def test_gap_for_a_right_turn_covers_the_part_of_the_exit_road_that_is_owed(distance: float, at_once: bool) -> None:
    """The rear is 15 m down the exit road some 6.1 s after the vehicle entered at 2.3 s, and 1 s has to remain.

    The other vehicle, at 11.2 m/s by then, would come to the common stretch 5.5 s later if it started 64 m away, 7.4 s if 85 m.
    """
    scenario = Scenario(find("yield4"), "1213", distance=(distance, distance, 20.0, distance), speed=8.0, subject=2)
    run = simulate(Case(scenario, ROAD, traffic=traffic("stopped")))
    assert wrong(run) == []
    assert ((run.entry(2) or math.inf) < 3.0) is at_once


def test_first_vehicle_at_its_line_keeps_its_right_until_the_right_is_waived() -> None:
    """From the priority road one that stands at its line comes past where a right turn from the minor road ends."""
    stands = VehicleState("a0", 0, Turn.STRAIGHT, Zone.ENTRANCE, -0.5, 0, 0, 0, 0.0, 0.0, 4.6, 1.86)
    comes = stands._replace(zone=Zone.APPROACH, station=-60.0)
    gate = GiveWay(minor(1, stands), Track(minor(1).itinerary, 3.65), TIE)
    assert GiveWay(minor(1, comes), Track(minor(1).itinerary, 3.65), TIE).allows(minor(1, comes)) is True
    told = [gate.allows(minor(1, stands, time=tick / 10)) for tick in range(60)]
    assert told.index(True) == 40, "3.5 s, and half a second more for one that was there as early and was created first"


def test_a_queue_is_looked_at_beyond_its_first_vehicle_as_long_as_it_rolls() -> None:
    """The first one has passed when the own vehicle arrives, the second one meets it."""
    gone = VehicleState("a0", 0, Turn.STRAIGHT, Zone.APPROACH, -1.5, 0, 0, 0, 11.0, 0.0, 4.6, 1.86)
    next_one = gone._replace(name="a0+1", station=-14.0)
    for others, goes in (((gone,), True), ((gone, next_one), False), ((gone, next_one._replace(station=-140.0)), True)):
        seen = minor(1, *others, turn=Turn.STRAIGHT)
        seen = seen._replace(me=seen.me._replace(station=-25.0, zone=Zone.APPROACH, speed=8.0))
        assert GiveWay(seen, Track(seen.itinerary, 3.65), TIE).allows(seen) is goes


def test_earliest_arrival_resolves_a_circle_of_queues() -> None:
    """Everybody waits for the vehicle on its right, with another one behind it: no queue goes before the other ones."""
    run = drive(signed(*SIGNS["right before left"]), "2222", distance=(8, 11, 14, 17), speed=0, followers=1)
    order = entering(run)
    assert set(order[:4]) == {"a0", "a1", "a2", "a3"}, order


def test_one_of_two_opposite_vehicles_leaves_a_circle_first() -> None:
    """Together they would take the way of a vehicle that may go as soon as the vehicle on its right has entered."""
    run = drive(signed(*SIGNS["right before left"]), "2222", distance=(1, 30, 8, 14.5), speed=(1.7, 8, 3, 6.6))
    ticks = sorted(np.argmax(run.zone >= Zone.JUNCTION, axis=0).tolist())
    assert ticks[1] - ticks[0] > 200
    assert wrong(run) == []


def test_empty_queue_has_no_first_vehicle() -> None:
    """As after a collision that pushed everybody away from the entrances."""
    place = find("stop4")
    away = VehicleState("a0", 0, Turn.STRAIGHT, Zone.JUNCTION, 2.0, 0, 0, 0, 0.0, 0.0, 4.6, 1.86)
    seen = Observation(0.0, away, (), (), Itinerary.through(place, 0, 2), place, Vehicle(), LIMIT)
    queue = Queue()
    queue.watch(seen)
    assert queue.first(seen) == ([], 0)


def test_first_vehicle_of_a_queue_represents_its_entrance() -> None:
    """Where the line is far before the vertex, two stand in the entrance zone."""
    place = find("stop4")
    first = VehicleState("a0", 0, Turn.STRAIGHT, Zone.ENTRANCE, -0.5, 0, 0, 0, 0.0, 0.0, 4.6, 1.86)
    second = first._replace(name="a0+1", station=-7.5)
    seen = Observation(0.0, first, (second,), (), Itinerary.through(place, 0, 2), place, Vehicle(), LIMIT)
    queue = Queue()
    queue.watch(seen)
    assert queue.first(seen) == ([first], 1)
    behind = seen._replace(me=second, others=(first,), created=1)
    assert queue.first(behind) == ([first], 1)


@pytest.mark.extended
@pytest.mark.parametrize("policy", EVERYWHERE)
def test_traffic_policies_drive_where_signs_differ_and_in_queues(policy: str) -> None:
    case = Scenario(signed(*SIGNS["one of each"]), "2222", distance=15, subject=0, followers=1)
    run = simulate(Case(case, ROAD, traffic=traffic(policy)))
    assert run.fault is None
    assert "a0" not in {name for hit in run.collisions for name in hit.agents} or policy in ("red_light_runner", "lgsvl")


@pytest.mark.extended
def test_lanes_of_an_arm_go_by_their_own_lights(shared: Path) -> None:
    place = load(shared / "maps" / "multi_intersections.xodr").junction("146")
    assert place.lanes == (1, 1, 1, 2)
    for code in ("22020", "22003", "03203"):
        run = simulate(Case(Scenario(place, code), ROAD))
        assert (run.fault, run.collisions, run.provenance["end"]) == (None, (), "left")
        assert wrong(run) == []


def test_all_way_stop_with_lanes_ignores_vehicles_without_a_conflict() -> None:
    """Right turns of opposite arms share nothing; the other vehicle came first and never goes."""
    place = signed(*[STOP] * 8, base="lanes4")
    assert (place.by_direction[0, 1].key, place.by_direction[4, 1].key) not in (place.conflicts or ())
    far = [12.0] * 4 + [8.0] + [12.0] * 3
    alone, beside = (Scenario(place, code, distance=far, speed=3, subject=0) for code in ("10000000", "10001000"))
    runs = [simulate(Case(case, ROAD, traffic=traffic("stopped"))) for case in (alone, beside)]
    assert runs[1].entry(0) == runs[0].entry(0)


@pytest.mark.slow
@pytest.mark.parametrize("signs", SIGNS.values(), ids=SIGNS)
@pytest.mark.parametrize(("turn", "distance", "speed"), [(0, 20, 0), (1, 32, 9), (2, (12, 25, 20, 30), 6)])
def test_every_occupancy_at_every_kind_of_sign(signs: tuple[Sign, ...], turn: int, distance: Any, speed: float) -> None:
    """Every third one from each start."""
    place = signed(*signs)
    found = {}
    for code in [*product(range(4), repeat=4)][1 + turn :: 3]:
        found[code] = wrong(drive(place, "".join(map(str, code)), distance=distance, speed=speed))
    assert {code: rules for code, rules in found.items() if rules} == {}
