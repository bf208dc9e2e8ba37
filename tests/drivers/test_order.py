"""Whose turn it is, and which movements conflict."""

from itertools import permutations, product

import pytest

from pytest_rvads.drivers.interface import Observation
from pytest_rvads.drivers.signs_and_lights import Queue
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.runs.states import Vehicle, VehicleState, Zone
from pytest_rvads.scenarios.scenario import Scenario

JUNCTION = find("stop4")
ITINERARY = Scenario(find("stop4"), "2000").itineraries()[0]


def view(zones: dict[int, tuple[Zone, float]], tick: int, me: int = 0) -> Observation:
    """What the driver at entrance `me` sees; zone and speed per entrance, in the order of creation."""
    states = {
        e: VehicleState(
            f"a{e}", e, Turn.STRAIGHT, zone, -0.5 if zone is Zone.ENTRANCE else -20.0, 0.0, 0.0, 0.0, speed, 0.0, 4.6, 1.86
        )
        for e, (zone, speed) in zones.items()
    }
    others = tuple(s for e, s in states.items() if e != me)
    created = list(states).index(me)
    return Observation(tick * 0.01, states[me], others, (), ITINERARY, JUNCTION, Vehicle(), 11.176, created=created)


def who(arrivals: dict[int, int], me: int = 0, tie: float = 0.0) -> tuple[list[int], int]:
    """In which order they go when the vehicle of each entrance arrives in the given tick; how many wait for nobody.

    They are created in this order.
    """
    queue = Queue(tie)
    for tick in range(max(arrivals.values()) + 1):
        seen = view({e: (Zone.ENTRANCE if tick >= t else Zone.APPROACH, 0.0) for e, t in arrivals.items()}, tick, me)
        queue.watch(seen)
    first, free = queue.first(seen)
    return [s.entrance for s in first], free


def test_first_come_first_served() -> None:
    for order in permutations(range(4)):
        assert who({e: 5 + 3 * place for place, e in enumerate(order)}) == ([order[0]], 1)


@pytest.mark.parametrize("entrance", range(4))
def test_right_before_left_on_a_tie(entrance: int) -> None:
    right = (entrance + 1) % 4
    assert (right, entrance) in JUNCTION.right_of
    for me in (entrance, right):
        assert who({entrance: 7, right: 7}, me) == ([right], 1)


def test_one_tick_decides() -> None:
    assert who({0: 7, 1: 8}) == ([0], 1)


def test_arrivals_in_states_0_and_1_are_a_tie() -> None:
    # Waiting time is 0 in state 0 whatever the place, and 1 in the first state after a state elsewhere.
    assert who({0: 0, 1: 1}) == ([1], 1)
    assert who({0: 0, 1: 2}) == ([0], 1)


def test_four_at_once_are_a_cycle_and_three_are_not() -> None:
    assert who({0: 3, 1: 3, 2: 3, 3: 3}) == ([0, 1, 2, 3], 0)
    assert who({2: 3, 1: 3, 3: 3, 0: 3}) == ([2, 1, 3, 0], 0), "in the order of creation"
    for gone in range(4):
        left = {e: 3 for e in range(4) if e != gone}
        # The first in the chain has the empty entrance to its right.
        assert who(left, me=min(left)) == ([(gone + 3) % 4], 1)


def test_all_vehicles_compute_the_same_order() -> None:
    for ticks in product((3, 4), repeat=4):
        answers = [who(dict(enumerate(ticks)), me) for me in range(4)]
        assert all(a == answers[0] for a in answers)


def test_first_created_of_two_opposite_vehicles_goes_first() -> None:
    assert who({0: 7, 2: 7}) == ([0, 2], 2)
    assert who({2: 7, 0: 7}) == ([2, 0], 2)


def test_a_tie_window_lets_the_right_one_go_first() -> None:
    assert who({0: 7, 1: 57}, tie=0.5) == ([1, 0], 1)
    assert who({0: 7, 1: 58}, tie=0.5) == ([0, 1], 1)
    assert who({0: 57, 1: 7}, tie=0.5) == ([1, 0], 1), "the first one is the right one, too"
    assert who({2: 20, 0: 7}, tie=0.5) == ([0, 2], 2), "they face each other: nobody is to the right, who came first leads"


def test_vehicles_whose_ways_do_not_meet_do_not_take_turns() -> None:
    """All go straight on: opposite ways share nothing, so that the order of arrival binds crossing ways only."""
    assert who({0: 7, 2: 200}) == ([0], 1), "by the paper's rules all take turns"
    assert who({0: 7, 2: 200}, tie=0.5) == ([0, 2], 2)
    assert who({0: 7, 1: 100, 2: 200}, tie=0.5) == ([0, 1], 1), "the third one waits for one that waits itself"


def test_chain_of_ties_ends_at_the_vehicle_without_a_right_neighbour() -> None:
    # 1 ties with 0 and is to its right; 2 ties with 1 and is to its right, and comes the other way than 0.
    assert who({0: 0, 1: 40, 2: 80}, tie=0.5) == ([2, 1], 1)
    assert who({0: 0, 1: 40, 2: 45}, tie=0.5) == ([2, 1], 1)


@pytest.mark.parametrize(("tie", "arrived"), [(0.5, True), (0.0, False)])
def test_a_stop_in_the_stop_place_is_an_arrival_of_the_road_and_not_of_the_paper(tie: float, arrived: bool) -> None:
    """The vehicle at entrance 1 stops 3 m before its line, 1 s before the own vehicle arrives, then rolls up to the line."""
    queue = Queue(tie)
    for tick, (mine, station, speed) in enumerate([(-9.0, -4.0, 2.0), *[(-5.5, -3.0, 0.0)] * 100, (-0.5, -3.0, 0.0)]):
        seen = view({0: (Zone.ENTRANCE if mine > -1.0 else Zone.APPROACH, 1.0), 1: (Zone.APPROACH, speed)}, tick)
        seen = seen._replace(me=seen.me._replace(station=mine), others=(seen.others[0]._replace(station=station),))
        queue.watch(seen)
    other = seen.others[0]
    assert queue.arrived(other) is arrived
    assert [s.entrance for s in queue.first(seen)[0]] == ([1, 0] if arrived else [0])
    queue.watch(seen._replace(time=2.0, others=(other._replace(station=-0.5, zone=Zone.ENTRANCE, speed=1.0),)))
    assert queue.before(other, seen.me) is arrived, "rolling on does not restart the arrival"


def test_who_queues_in_the_stop_place_has_not_arrived() -> None:
    queue, seen = Queue(0.5), view({0: (Zone.APPROACH, 5.0), 1: (Zone.ENTRANCE, 0.0)}, 0)
    behind = seen.others[0]._replace(name="a1+1", zone=Zone.APPROACH, station=-4.9)
    queue.watch(seen._replace(me=seen.me._replace(station=-20.0), others=(seen.others[0], behind)))
    assert (queue.arrived(seen.others[0]), queue.arrived(behind)) == (True, False)


def test_setting_off_is_moving_after_having_stood() -> None:
    queue = Queue()
    for tick, (zone, speed) in enumerate([(Zone.APPROACH, 3.0), (Zone.ENTRANCE, 1.0)]):
        seen = view({0: (Zone.ENTRANCE, 0.0), 1: (zone, speed)}, tick)
        queue.watch(seen)
        assert not any(queue.setting_off(other) for other in seen.others), "it is still arriving"
    for tick, (speed, sets_off) in enumerate([(0.0, False), (0.15, False), (0.16, True)], start=2):
        seen = view({0: (Zone.ENTRANCE, 0.0), 1: (Zone.ENTRANCE, speed)}, tick)
        queue.watch(seen)
        assert any(queue.setting_off(other) for other in seen.others) is sets_off


def test_who_comes_back_to_its_entrance_arrives_anew() -> None:
    queue = Queue()
    for tick, (zone, speed) in enumerate([(Zone.ENTRANCE, 0.0), (Zone.APPROACH, -1.0), (Zone.ENTRANCE, 1.0)]):
        seen = view({0: (Zone.ENTRANCE, 0.0), 1: (zone, speed)}, tick)
        queue.watch(seen)
    assert not any(queue.setting_off(other) for other in seen.others)
    assert queue.first(seen) == ([seen.me], 1), "it had left its place in the order"


PASS_EACH_OTHER = [((0, 2), (2, 0)), ((0, 1), (2, 3)), ((0, 1), (1, 2)), ((0, 3), (2, 1)), ((0, 1), (2, 0))]
MEET = [((0, 2), (1, 3)), ((0, 2), (2, 1)), ((0, 1), (3, 1)), ((0, 3), (1, 3)), ((0, 3), (1, 0))]


@pytest.mark.parametrize(("one", "two"), PASS_EACH_OTHER)
def test_movements_that_pass_each_other(one: tuple[int, int], two: tuple[int, int]) -> None:
    assert JUNCTION.stretches.get((one, two)) is None


@pytest.mark.parametrize(("one", "two"), MEET)
def test_stretches_of_conflicting_movements(one: tuple[int, int], two: tuple[int, int]) -> None:
    found = JUNCTION.stretches.get((one, two))
    assert found is not None
    back = JUNCTION.stretches.get((two, one))
    assert back is not None
    assert (back.mine, back.yours) == (found.yours, found.mine)
    for stretch, movement in zip(found[:2], (one, two), strict=True):
        assert 0.0 <= stretch.start <= stretch.end <= JUNCTION.movements[movement].length
    if one[1] == two[1]:
        assert found[0].end == pytest.approx(JUNCTION.movements[one].length, abs=0.5), "to the common exit"


def test_straight_ways_cross_where_the_lanes_do() -> None:
    # Lanes at 1.75 m from the centre cross 15 + 1.75 and 15 - 1.75 m after the vertices.
    found = JUNCTION.stretches.get(((0, 2), (1, 3)))
    assert (found[0].start + found[0].end) / 2 in (pytest.approx(16.75, abs=0.5), pytest.approx(13.25, abs=0.5))
    assert found[0].end - found[0].start == pytest.approx(2 * 2.6, abs=1.0)


def test_an_indicator_tells_the_movement() -> None:
    assert [m.exit for m in JUNCTION.by_turn[1, Turn.LEFT]] == [0]
    assert [m.exit for m in JUNCTION.by_turn[1, Turn.RIGHT]] == [2]
