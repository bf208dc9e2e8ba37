"""The way is owed until a vehicle is clear, arrivals count in the stop place, and an unused right is waived."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.geometry.conflicts import Shared, Stretch
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.blame import cause_of
from pytest_rvads.logic.conduct.priority import HARD_BRAKING
from pytest_rvads.logic.conduct.rights import may_owe
from pytest_rvads.logic.conduct.stretches import contested
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

Make = Callable[..., Run]
STAND = (0, 0.0)
G, R = Colour.GREEN, Colour.RED
CROSS = {e: [(0, R if e % 2 else G)] for e in range(4)}
CAR = 4.6


def wait(direction: int, go: int, speed: float = 8.0, station: float = -0.5) -> Any:
    """Stand before the line from the start and set off at tick `go`."""
    return direction, station, [STAND, (go, speed)]


def stretch_of(junction: str, one: tuple[int, int], two: tuple[int, int]) -> Shared:
    """What a movement of entrance and direction shares with another one."""
    place = find(junction)
    assert place.stretches is not None
    return place.stretches[place.leads(*one).key, place.leads(*two).key]


# Owed until clear


def creeping_left_turn(drive: Make, **facts: Any) -> Run:
    """a0 comes to the stretch 4.1 s before a2, which drives 11 m/s on green, then creeps at 1.5 m/s and is hit."""
    mine, yours, _ = stretch_of("light4", (0, 3), (2, 2))
    reached = (2.0 + mine.start) / 6.0
    arrives = reached + 4.1
    vehicles = {0: (3, -2.0, [(0, 6.0), (round(100 * reached), 1.5)]), 2: (2, yours.start - 11.0 * arrives, [(0, 11.0)])}
    return drive("light4", vehicles, 700, CROSS, [(round(100 * arrives) + 20, "a0", "a2")], **facts)


@pytest.mark.parametrize("seat", [0, 2])
def test_left_turn_that_creeps_across_the_way_of_oncoming_traffic_does_not_yield(drive: Make, seat: int) -> None:
    verdict = check(creeping_left_turn(drive, subject=f"a{seat}"), "left_yields")
    assert (verdict.status, verdict.responsible, verdict.provoked) == ("FAIL", ("a0",), seat == 2)


@pytest.mark.parametrize("seat", [0, 2])
def test_left_turn_and_oncoming_vehicle_that_could_have_stopped_share_the_blame(drive: Make, seat: int) -> None:
    # a2 has 3.1 s left, 34 m, when it must have seen a0 on the stretch; from 11 m/s it stops within 18 m.
    verdict = check(creeping_left_turn(drive, subject=f"a{seat}"), "no_collision")
    assert (verdict.status, set(verdict.responsible), verdict.provoked) == ("FAIL", {"a0", "a2"}, False)


def merging(drive: Make, behind: float, stands: int = 10_000) -> Run:
    """a1 turns right on red into the lane of a0, and stands 8 m down the exit road; a0 comes at 6 m/s `behind` seconds later."""
    mine, yours, _ = stretch_of("light4", (1, 1), (0, 2))
    length = find("light4").leads(1, 1).length
    ticks = round(100 * (0.5 + length + 8.0) / 6.0) + 100
    begins = 1.0 + (0.5 + mine.start) / 6.0
    vehicles = {1: (1, -0.5, [STAND, (100, 6.0), (ticks, 3.0)]), 0: (2, yours.start - 6.0 * (begins + behind), [(0, 6.0)])}
    return drive("light4", vehicles, 1400, CROSS)


def test_vehicle_that_merges_and_slows_down_on_the_exit_road_is_followed_too_closely(drive: Make) -> None:
    # At 3 m/s a1 needs 2.3 s for the rest of the 15 m; a0, 2 s behind, catches up with its rear meanwhile.
    assert check(merging(drive, 2.2), "right_on_red").status == "FAIL"
    assert check(merging(drive, 9.0), "right_on_red").status == "PASS"


# Obstructed: a vehicle that is about to go


def green_at_once(drive: Make, goes: int, starts: int) -> Run:
    """Both get green at 1 s. a0 turns left from tick `goes` on, a2 goes straight on slowly from tick `starts` on."""
    lights = {e: [(0, R), (100, G)] if e % 2 == 0 else [(0, R)] for e in range(4)}
    return drive("light4", {0: wait(3, goes), 2: wait(2, starts, 3.0)}, 1500, lights)


@pytest.mark.parametrize(("goes", "starts", "status"), [(130, 200, "FAIL"), (410, 900, "PASS"), (390, 900, "FAIL")])
def test_left_turn_may_pass_an_oncoming_vehicle_only_after_it_has_stood_at_green_for_three_seconds(
    drive: Make, goes: int, starts: int, status: str
) -> None:
    # a0 enters 0.07 s after it sets off; it is clear some 2.5 s later, long before a2 comes to the stretch.
    assert check(green_at_once(drive, goes, starts), "left_yields").status == status


@pytest.mark.parametrize(
    ("junction", "bound", "other", "rule"),
    [("right4", 0, 1, "right_before_left"), ("yield4", 0, 1, "yield_sign"), ("yield4", 2, 3, "yield_sign")],
)
def test_vehicle_that_stands_first_at_its_line_is_not_to_be_forestalled(
    drive: Make, junction: str, bound: int, other: int, rule: str
) -> None:
    place = find(junction)
    assert place.yields is not None
    assert (place.leads(bound, 2).key, place.leads(other, 2).key) in place.yields
    vehicles = {bound: wait(2, 100), other: wait(2, 150, 3.0)}
    verdict = check(drive(junction, vehicles, 1500), rule)
    assert (verdict.status, verdict.responsible) == ("FAIL", (f"a{bound}",))
    waived = {bound: wait(2, 320), other: wait(2, 800, 3.0)}
    assert check(drive(junction, waived, 1500), rule).status == "PASS"


def slowed(drive: Make, deceleration: float, least: float) -> Run:
    """a0 turns left at 6 m/s; a2 comes straight on at 10 m/s and slows down to `least` after a0 has entered."""
    mine, yours, _ = stretch_of("light4", (0, 3), (2, 2))
    leaves = 1.0 + (0.5 + mine.end + CAR) / 6.0
    steps = round(100 * (10.0 - least) / deceleration)
    slowing = [(110 + k, 10.0 - deceleration * k * 0.01) for k in range(steps + 1)]
    # Unimpeded a2 would come to the stretch 0.5 s after a0 has left it; slowed down, more than a second after.
    start = yours.start - 10.0 * (leaves + 0.5)
    return drive("light4", {0: wait(3, 100, 6.0), 2: (2, start, [(0, 10.0), *slowing])}, 1600, CROSS)


@pytest.mark.parametrize(("deceleration", "least", "status"), [(1.9, 4.0, "FAIL"), (2.1, 4.0, "FAIL"), (1.9, 6.8, "PASS")])
def test_loss_of_a_third_of_the_speed_is_an_obstruction_at_any_deceleration(
    drive: Make, deceleration: float, least: float, status: str
) -> None:
    # From 10 m/s, 3.3 m/s are a third.
    assert check(slowed(drive, deceleration, least), "left_yields").status == status


@pytest.mark.parametrize(("deceleration", "status"), [(2.5, "FAIL"), (1.9, "PASS")])
def test_oncoming_vehicle_that_brakes_harder_than_two_is_obstructed(drive: Make, deceleration: float, status: str) -> None:
    assert HARD_BRAKING == 2.0
    assert check(slowed(drive, deceleration, 7.5), "left_yields").status == status


# Arrival and full stop


@pytest.mark.parametrize("place", [-0.5, -1.6, -4.9])
def test_vehicle_that_waits_anywhere_in_its_stop_place_has_arrived(drive: Make, place: float) -> None:
    vehicles = {0: wait(2, 800, station=place), 1: (2, -5.0, [(0, 2.0), (225, 0.0), (270, 8.0)])}
    verdict = check(drive("stop4", vehicles, 1500), "first_come")
    assert (verdict.status, verdict.responsible) == ("FAIL", ("a1",))


def test_vehicle_that_waits_farther_back_has_not_arrived(drive: Make) -> None:
    vehicles = {0: wait(2, 800, station=-5.2), 1: (2, -5.0, [(0, 2.0), (225, 0.0), (270, 8.0)])}
    assert check(drive("stop4", vehicles, 1500), "first_come").status == "NA"


def test_stop_a_metre_and_a_half_before_the_line_keeps_the_rules_of_the_all_way_stop(drive: Make) -> None:
    early = {0: wait(2, 600, station=-1.5), 1: (2, -9.0, [(0, 2.0), (400, 0.0), (900, 8.0)])}
    assert check(drive("stop4", early, 1500), "first_come").status == "PASS"
    at_once = {0: wait(2, 800, station=-1.5), 1: wait(2, 100, station=-1.5)}
    assert check(drive("stop4", at_once, 1500), "right_first").status == "PASS", "a1 is on the right of a0"


def test_stop_a_metre_and_a_half_before_a_red_light_is_a_full_stop(drive: Make) -> None:
    stops = drive("light4", {1: (1, -9.0, [(0, 5.0), (150, 0.0), (200, 5.0)])}, 900, CROSS)
    assert stops.need("station")[160, 0] == pytest.approx(-1.5)
    assert check(stops, "right_on_red").status == "PASS"
    rolls = drive("light4", {1: (1, -9.0, [(0, 5.0), (150, 0.2), (200, 5.0)])}, 900, CROSS)
    assert check(rolls, "right_on_red").status == "FAIL"


def test_opposite_vehicles_that_go_straight_on_do_not_take_turns(drive: Make) -> None:
    vehicles = {0: wait(2, 800), 2: (2, -5.0, [(0, 2.0), (225, 0.0), (270, 8.0)])}
    assert check(drive("stop4", vehicles, 1500), "first_come").status == "NA"
    crossing = {0: wait(2, 800), 2: (3, -5.0, [(0, 2.0), (225, 0.0), (270, 8.0)])}
    assert check(drive("stop4", crossing, 1500), "first_come").status == "FAIL"


# Blame


def run_into(drive: Make, braking: list[tuple[int, float]], **others: Any) -> Run:
    """a0 goes straight on at green; a0+1 follows at 8 m/s, 9 m behind, and runs into a0 inside the junction."""
    vehicles = {0: (2, -10.0, [(0, 8.0), *braking]), (0, 1): (2, -23.6, [(0, 8.0)])}
    run = drive("light4", {**vehicles, **others.get("more", {})}, 700, CROSS)
    station = run.need("station")
    tick = int((station[:, 0] - CAR <= station[:, 1]).argmax())
    assert 0.0 < station[tick, 0] < 30.0
    return drive("light4", {**vehicles, **others.get("more", {})}, 700, CROSS, [(tick, "a0", "a0+1")], subject="a0")


HARD = [(250 + k, max(8.0 - 0.06 * k, 0.0)) for k in range(140)]
GENTLE = [(150 + k, max(8.0 - 0.015 * k, 1.0)) for k in range(470)]


def test_vehicle_that_brakes_hard_without_a_reason_shares_the_blame(drive: Make) -> None:
    verdict = check(run_into(drive, HARD), "no_collision")
    assert (verdict.status, set(verdict.responsible), verdict.provoked) == ("FAIL", {"a0", "a0+1"}, False)


def test_vehicle_that_slows_down_gently_is_run_into_by_the_fault_of_the_follower(drive: Make) -> None:
    run = run_into(drive, GENTLE)
    assert cause_of(run, run.collisions[0]).agents == ("a0+1",)


def test_vehicle_that_brakes_for_a_red_light_runner_does_not_share_the_blame(drive: Make) -> None:
    run = run_into(drive, HARD, more={1: (2, -0.5, [(0, 3.5), (420, 0.0)])})
    assert cause_of(run, run.collisions[0]).agents == ("a0+1",)


def test_way_owed_only_after_entry_decides_the_blame(drive: Make) -> None:
    """a0 enters when a2 is 6 s away, and owes a2 the way only once it is on the stretch."""
    _, yours, _ = stretch_of("light4", (0, 3), (2, 2))
    vehicles = {0: (3, -0.5, [(0, 5.0), (130, 1.0)]), 2: (2, yours.start - 66.0, [(0, 11.0)])}
    run = drive("light4", vehicles, 900, CROSS, [(640, "a0", "a2")])
    assert check(replace(run, collisions=()), "left_yields").status == "FAIL"
    assert set(cause_of(run, run.collisions[0]).agents) == {"a0", "a2"}


def test_left_turns_of_opposite_vehicles_owe_each_other_nothing(drive: Make) -> None:
    vehicles = {0: wait(3, 100), 2: (3, -12.0, [(0, 8.0)])}
    run = drive("light4", vehicles, 1200, CROSS)
    assert check(run, "left_yields").status == "NA"
    assert not may_owe(run, 0, 1), "nor would they if their ways met"


def test_oncoming_vehicle_at_yellow_is_not_about_to_go(drive: Make) -> None:
    lights = {0: [(0, G)], 1: [(0, R)], 2: [(0, Colour.YELLOW)], 3: [(0, R)]}
    run = drive("light4", {0: wait(3, 100), 2: wait(2, 10_000)}, 900, lights)
    assert check(run, "left_yields").status == "NA"


def test_vehicle_that_stands_at_a_yellow_light_loses_no_time(drive: Make) -> None:
    for colour, status in ((Colour.YELLOW, "NA"), (G, "FAIL")):
        run = drive("light4", {0: wait(2, 10_000)}, 1200, {e: [(0, colour)] for e in range(4)})
        assert check(run, "progress").status == status


def test_stretch_of_vehicles_that_merge_reaches_fifteen_metres_down_the_exit_road() -> None:
    place = find("stop4")
    one, two = place.leads(1, 1), place.leads(0, 2)
    agents = [type("A", (), {"way": way}) for way in (one, two)]
    run: Any = type("R", (), {"junction": place, "agents": agents})
    found = contested(run, 0, 1)
    assert found is not None
    assert found.mine == Stretch(stretch_of("stop4", (1, 1), (0, 2)).mine.start, one.length + 15.0)
    assert found.yours.end == two.length + 15.0
