"""Who could get on and does not, and who blocks the junction: speeds by hand, along the centre lines."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.rights import PACE, comes_first
from pytest_rvads.logic.conduct.standing import facing, inside
from pytest_rvads.logic.conduct.waiting import BLOCKING_TIME, PATIENCE, blocks, idles, losses, may_go
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor

from ..run_builders import coarse

Make = Callable[..., Run]
G, Y, R = Colour.GREEN, Colour.YELLOW, Colour.RED
CROSS = {e: [(0, R if e % 2 else G)] for e in range(4)}
ALL_RED = {e: [(0, R)] for e in range(4)}


def stands(direction: int, station: float = -0.5, *then: tuple[int, float]) -> tuple[Any, ...]:
    return direction, station, [(0, 0.0), *then]


def status(run: Run, rule: str) -> tuple[str, tuple[str, ...]]:
    """Judge a run. Of every tenth state, the monitor of single states finds the first violation where the whole shows it."""
    part = coarse(run, 10)
    monitor = RuleMonitor(rule, part.junction, part.agents, dt=part.dt)
    motion = [{name: part.need(name)[k] for name in ("station", "speed", "pose")} for k in range(part.steps)]
    truths = (monitor.step(part.zone[k], part.lights[k], **motion[k]) for k in range(part.steps))
    broken = next((k for k, truth in enumerate(truths) if truth is Truth.FALSE), None)
    whole = check(part, rule)
    assert broken == (round(whole.time / part.dt) if whole.status == "FAIL" and whole.time is not None else None)
    verdict = check(run, rule)
    return str(verdict.status), verdict.responsible


# Time lost on the way


def test_ten_seconds_at_rest_with_nothing_in_the_way(drive: Make) -> None:
    assert PATIENCE == 10.0
    run = drive("light4", {0: stands(2)}, 1200, CROSS)
    assert may_go(run, 0).all()
    assert np.flatnonzero(idles(run, 0))[0] == 1000
    assert status(run, "progress") == ("FAIL", ("a0",))


@pytest.mark.parametrize(("speed", "late"), [(0.11, 10.9), (0.7, 20.0), (1.3, 140.0), (PACE, None), (8.0, None)])
def test_who_creeps_loses_time_by_its_amount(drive: Make, speed: float, late: float | None) -> None:
    # At a share s of walking pace a second loses 1 - s: ten seconds are lost after 10 / (1 - s).
    run = drive("light4", {0: (2, -250.0, [(0, speed)])}, 15_000, {e: [(0, G)] for e in range(4)})
    hits = np.flatnonzero(idles(run, 0))
    assert (len(hits) > 0) == (late is not None)
    if late is not None:
        assert hits[0] * run.dt == pytest.approx(late, abs=0.1)


def test_each_part_of_the_way_has_its_own_patience(drive: Make) -> None:
    # 6 s at the entrance, 6 s in the junction, 6 s on the exit road.
    run = drive("light4", {0: stands(2, -0.5, (600, 5.0), (900, 0.0), (1500, 5.0), (2000, 0.0), (2600, 5.0))}, 2800, CROSS)
    assert {int(z) for z in run.zone[[300, 1200, 2200], 0]} == {Zone.ENTRANCE, Zone.JUNCTION, Zone.EXIT}
    lost = losses(run)
    assert [lost.idle[lost.part == part].max() for part in range(3)] == pytest.approx([6.0] * 3, abs=0.02)
    assert not idles(run, 0).any()
    assert status(run, "progress")[0] == "PASS"
    # Twice 6 s before the junction are not forgotten in between.
    twice = drive("light4", {0: (2, -60.0, [(0, 0.0), (600, 8.0), (700, 0.0), (1300, 8.0)])}, 1500, CROSS)
    assert idles(twice, 0).any()


def test_front_that_flickers_over_the_entrance_vertex_keeps_its_patience(drive: Make) -> None:
    # 6 s before the vertex, then the front is 4 cm beyond it every other second.
    swings = [(600 + 100 * k, 0.04 if k % 2 else -0.04) for k in range(12)]
    run = drive("light4", {0: (2, 0.0, [(0, 0.0), *((t, v) for t, v in swings)])}, 1800, {0: [(0, G)]})
    assert len(np.flatnonzero(np.diff(run.zone[:, 0]))) > 5
    assert status(run, "progress") == ("FAIL", ("a0",))


def test_patience_lasts_until_the_rear_is_a_metre_past_the_vertex(drive: Make) -> None:
    # The vehicle is 4.6 m long. It stands 6 s before the junction and 6 s in it.
    for station, late in ((5.5, True), (5.7, False)):
        run = drive("light4", {0: stands(2, -0.5, (600, 5.0), (600 + round((station + 0.5) * 20), 0.0))}, 1500, {0: [(0, G)]})
        assert idles(run, 0)[:1400].any() == late


def test_backing_off_is_no_way_to_get_on(drive: Make) -> None:
    run = drive("light4", {0: (2, -5.0, [(0, -3.0)])}, 1100, CROSS)
    assert idles(run, 0).any()
    assert status(run, "progress") == ("FAIL", ("a0",))


def test_speed_that_leads_nowhere_is_no_progress(drive: Make) -> None:
    """Circles: wheels turn, the station does not."""
    run = drive("light4", {0: (2, -30.0, [(0, 0.0)])}, 1100, CROSS)
    assert idles(replace(run, speed=np.full_like(run.need("speed"), 5.0)), 0).any()


def test_who_has_gone_or_arrived_is_left_alone(drive: Make) -> None:
    arrived = drive("light4", {0: (2, 60.0, [(0, 0.0)])}, 1200, CROSS)
    assert not may_go(arrived, 0).any()
    run = drive("light4", {0: stands(2)}, 1200, CROSS)
    assert not may_go(replace(run, zone=np.full_like(run.zone, Zone.GONE)), 0).any()


# Reasons to wait


def test_red_light_is_a_reason_to_wait_at_the_line_only(drive: Make) -> None:
    for colours, waits in ((ALL_RED, True), ({0: [(0, Y)]}, True), ({0: [(0, G)]}, False), ({}, False)):
        for station, near in ((-0.5, True), (-14.9, True), (-15.1, False)):
            run = drive("light4", {0: stands(2, station)}, 5, colours)
            assert may_go(run, 0).all() == (not (waits and near)), (colours, station)
    assert may_go(drive("light4", {0: (2, 5.0, [(0, 0.0)])}, 5, ALL_RED), 0).all(), "in the junction it clears it"
    assert may_go(drive("stop4", {0: stands(2)}, 5), 0).all()


@pytest.mark.parametrize(
    ("gap", "speed", "waits"), [(5.9, 0.0, True), (6.1, 0.0, False), (14.9, PACE, True), (15.1, PACE, False)]
)
def test_a_body_near_ahead_in_the_lane_is_a_reason(drive: Make, gap: float, speed: float, waits: bool) -> None:
    run = queue(drive, gap, speed)
    assert may_go(run, 0)[0] == (not waits)
    assert may_go(run, 1)[0]


def queue(drive: Make, gap: float, speed: float = 0.0) -> Run:
    """a0 stands 40 m before the line, another one's rear `gap` ahead of it."""
    one = drive("light4", {0: (2, -40.0, [(0, 0.0)])}, 3, CROSS)
    return together(one, drive("light4", {0: (2, -40.0 + 4.6 + gap, [(0, speed)])}, 3, CROSS))


def together(one: Run, two: Run) -> Run:
    both: dict[str, Any] = {
        name: np.concatenate((one.need(name), two.need(name)), axis=1) for name in ("station", "speed", "pose")
    }
    agents = (*one.agents, replace(two.agents[0], name="b0"))
    return replace(one, agents=agents, zone=np.concatenate((one.zone, two.zone), axis=1), **both)


def test_queue_before_a_red_light(drive: Make) -> None:
    # a0+1 stands 7 m behind a0, a0+2 stands 7 m behind a0+1. With green all three lose time, and the last two could go, too.
    queue = {0: stands(2, -5.5), (0, 1): stands(2, -17.1), (0, 2): stands(2, -28.7)}
    assert status(drive("light4", queue, 1500, ALL_RED), "progress") == ("NA", ()), "nobody could go"
    assert status(drive("light4", queue, 1500, CROSS), "progress") == ("FAIL", ("a0", "a0+1", "a0+2"))
    gap = {**queue, (0, 1): stands(2, -25.2), (0, 2): stands(2, -36.8)}
    assert status(drive("light4", gap, 1500, ALL_RED), "progress") == ("FAIL", ("a0+1", "a0+2")), "15.1 m behind"


@pytest.mark.extended
@pytest.mark.parametrize("colour", [Y, R])
def test_front_over_the_line_at_a_light_that_is_not_green(drive: Make, colour: Colour) -> None:
    """It overran its line by 0.3 m; a right turn, which meets others 5 m later, or a straight way."""
    for direction in (1, 2):
        first = min(common.mine.start for (key, _), common in stretches("light4").items() if key == (0, direction))
        for station, waits in ((0.3, True), (first - 0.1, True), (first + 0.1, False)):
            lights = {0: [(0, colour), (100, R)], **{e: [(0, R)] for e in (1, 2, 3)}}
            run = drive("light4", {0: (direction, station - 0.4, [(0, 4.0), (10, 0.0)])}, 1500, lights)
            failed = [rule for rule in ("progress", "keep_clear") if status(run, rule)[0] == "FAIL"]
            assert failed == ([] if waits else ["progress", "keep_clear"]), station
        entered_at_green = drive("light4", {0: (direction, -0.1, [(0, 4.0), (10, 0.0)])}, 1500, {0: [(0, G), (100, R)]})
        assert [status(entered_at_green, rule)[0] for rule in ("progress", "keep_clear")] == ["PASS", "FAIL"]
        green_again = drive("light4", {0: (direction, -0.1, [(0, 4.0), (10, 0.0)])}, 1500, {0: [(0, Y), (300, G)]})
        assert [status(green_again, rule)[0] for rule in ("progress", "keep_clear")] == ["FAIL", "FAIL"]


def stretches(name: str) -> dict[Any, Any]:
    found = find(name).stretches
    assert found is not None
    return dict(found)


@pytest.mark.parametrize(("exits", "rear", "waits"), [((2, 2), 9.0, True), ((2, 1), 9.0, False), ((2, 1), 7.0, True)])
def test_vehicle_inside_the_junction_is_ahead_only_in_the_way(
    drive: Make, exits: tuple[int, int], rear: float, waits: bool
) -> None:
    """From one entrance: a0 stands 4 m inside, another one ahead. Right turn and straight way: 2.4 m apart at 8 m, 3.0 at 9."""
    one, two = (
        drive("light4", {0: (exit, station, [(0, 0.0)])}, 3, CROSS)
        for exit, station in zip(exits, (4.0, rear + 4.6), strict=True)
    )
    assert may_go(together(one, two), 0).all() == (not waits)


def test_an_exit_road_without_room_is_a_reason(drive: Make) -> None:
    # a1 turns right into the exit that a0 wants, and stands there: a0 needs 4.6 m and 2.5 m behind its rear.
    end = find("light4").movements[1, 2].length
    for behind, waits in ((7.0, True), (7.2, False)):
        run = drive("light4", {0: stands(2), 1: (1, end + behind + 4.6, [(0, 0.0)])}, 1200, CROSS)
        assert may_go(run, 0)[0] == (not waits)
        assert idles(run, 0).any() == (not waits)
        assert status(run, "progress") == ("FAIL", ("a1",) if waits else ("a0", "a1")), "a1 has no reason to stand"


def test_vehicle_inside_and_earlier_arrival_are_reasons_to_wait_at_a_stop_sign(drive: Make) -> None:
    run = drive("stop4", {0: stands(2), 1: (2, 8.0, [(0, 0.0)])}, 1200)
    assert not may_go(run, 0).any()
    assert status(run, "progress") == ("FAIL", ("a1",)), "the one inside stands for nobody"
    later = drive("stop4", {0: stands(2), 1: (2, -2.0, [(0, 1.0), (150, 0.0)])}, 1300)
    assert may_go(later, 0)[300], "a0 was first"
    assert not may_go(later, 1)[300]
    assert status(later, "progress") == ("FAIL", ("a0",))


def test_who_comes_from_the_right_at_about_the_same_time_comes_first(drive: Make) -> None:
    # a1 arrives 0.4 s or 0.6 s after a0: within half a second it is at about the same time.
    for delay, first in ((40, 1), (60, 0)):
        run = drive("stop4", {0: stands(2), 1: (2, -1.0 - delay * 0.01 * 0.5, [(0, 0.5), (delay + 20, 0.0)])}, 300)
        one, two = comes_first(run, 0, 1)[250], comes_first(run, 1, 0)[250]
        right = (1, 0) in run.junction.right_of
        assert right, "entrance 1 is to the right of entrance 0"
        assert (bool(one), bool(two)) == (first == 1, first == 0)


@pytest.mark.parametrize(("delay", "right_first"), [(0, True), (49, True), (50, True), (51, False)])
def test_half_a_second_is_about_the_same_time(make: Make, delay: int, right_first: bool) -> None:
    run = make("stop4", {0: (2, 10, None, None), 1: (2, 10 + delay, None, None)}, 100)
    assert (comes_first(run, 0, 1)[-1], comes_first(run, 1, 0)[-1]) == (right_first, not right_first)


def test_a_due_oncoming_vehicle_is_a_reason_for_a_left_turn(drive: Make) -> None:
    common = find("light4").stretches
    assert common is not None
    start = common[(0, 3), (2, 0)].yours.start
    for speed, ahead, waits in ((8.0, 31.0, True), (8.0, 33.0, False), (0.0, 31.0, False)):
        run = drive("light4", {0: (3, 4.0, [(0, 0.0)]), 2: (2, start - ahead, [(0, speed)])}, 3, CROSS)
        assert may_go(run, 0)[0] == (not waits)


def test_vehicle_that_stands_at_its_line_with_the_better_right_is_a_reason(drive: Make) -> None:
    # On right4 a2 is on the right of a1, and a1 on the right of a0: a1 stands because of a2, which stands for nobody.
    run = drive("right4", {e: stands(2) for e in (0, 1, 2)}, 1500)
    assert status(run, "progress") == ("FAIL", ("a2",))
    circle = drive("right4", {e: stands(2) for e in range(4)}, 1500)
    assert status(circle, "progress") == ("FAIL", ("a0", "a1", "a2", "a3"))


def test_circle_of_waiting_vehicles_begins_anew_after_a_departure(drive: Make) -> None:
    # Four stand at right4. a0 goes after 8 s, and a0+1 comes to the line behind it, and goes after 7 s more.
    first, second = stands(2, -0.5, (800, 8.0)), stands(2, -6.2, (900, 5.0), (1014, 0.0), (1700, 8.0))
    run = drive("right4", {0: first, (0, 1): second, **{e: stands(2) for e in (1, 2, 3)}}, 1800)
    assert status(run, "progress") == ("PASS", ())


def test_circle_of_waiting_vehicles_may_wait_for_passing_traffic(drive: Make) -> None:
    # a1, a2 and a3, which turns left, wait for each other. Six vehicles pass in front of a1 and a3, not of a2.
    passing = {(0, k): (2, -20.0 - 24.0 * k, [(0, 8.0)]) for k in range(6)}
    run = drive("right4", {1: stands(2), 2: stands(2), 3: stands(3), **passing}, 1500)
    assert status(run, "progress") == ("PASS", ())


def test_earlier_arrival_is_a_reason_until_it_is_waived(drive: Make) -> None:
    # a0 and a2 go straight on and never meet. a2 arrives 2 s later, and need not wait once a0 has stood there for 3 s.
    run = drive("stop4", {0: stands(2), 2: (2, -3.0, [(0, 1.0), (250, 0.0)])}, 1500)
    assert not may_go(run, 2 - 1)[200:300].any()
    assert may_go(run, 1)[320:].all()
    assert status(run, "progress") == ("FAIL", ("a0", "a2"))
    meets = drive("stop4", {0: stands(2), 1: (2, -3.0, [(0, 1.0), (250, 0.0)])}, 1500)
    assert status(meets, "progress") == ("FAIL", ("a0",)), "nobody must use a waiver of a vehicle that it meets"


def test_vehicle_on_the_right_at_equal_arrival_is_a_reason_until_it_waives(drive: Make) -> None:
    """Both turn right and never meet; a1 stands to the right of a0."""
    run = drive("stop4", {0: stands(1), 1: stands(1)}, 1200)
    assert not may_go(run, 0)[:300].any()
    assert may_go(run, 0)[301:].all()
    assert may_go(run, 1).all()
    assert status(run, "progress") == ("FAIL", ("a1",))


def test_courtesy_to_a_vehicle_whose_way_does_not_meet_makes_no_circle(drive: Make) -> None:
    """All arrive at once. a0 waits for a1, a1 for a2, and a3 for a0. a2 turns right beside a3, whose way a2 does not meet."""
    ways = {0: stands(2), 1: stands(2), 2: stands(1), 3: stands(3)}
    run = drive("stop4", ways, 1500)
    meets = run.junction.stretches
    assert meets is not None
    assert ((2, 3), (3, 2)) not in meets
    assert {((0, 2), (1, 3)), ((1, 3), (2, 3)), ((3, 2), (0, 2))} <= meets.keys()
    assert status(run, "progress") == ("FAIL", ("a2",))


def test_vehicle_with_priority_that_could_still_turn_is_a_reason_before_a_sign(drive: Make) -> None:
    # On yield4 a0 has a yield sign. a3 has priority and turns right, away from a0, but it might go straight on across its way.
    start = stretches("yield4")[(0, 1), (3, 1)].yours.start
    assert ((0, 1), (3, 0)) not in stretches("yield4")
    for front, waits in ((start - 31.0, True), (start - 33.0, False), (1.0, False)):
        run = drive("yield4", {0: (1, -0.5, [(0, 0.0)]), 3: (1, front, [(0, 8.0)])}, 2)
        assert may_go(run, 0)[0] == (not waits), front


def test_turning_on_red_is_no_duty(drive: Make) -> None:
    run = drive("light4", {1: stands(1)}, 3000, CROSS)
    assert not idles(run, 0).any()


# Waiting for each other


def test_standing_vehicle_in_the_way_is_responsible_for_the_wait(drive: Make) -> None:
    common = find("stop4").stretches
    assert common is not None
    mine, yours, _ = common[(0, 3), (1, 0)]
    run = drive("stop4", {0: (3, mine.start - 0.5, [(0, 0.0)]), 1: (3, yours.start + 1.0, [(0, 0.0)])}, 1500)
    assert not may_go(run, 0).any()
    assert may_go(run, 1).all()
    assert status(run, "progress") == ("FAIL", ("a1",))


def test_two_vehicles_waiting_for_each_other_are_both_responsible(drive: Make) -> None:
    common = find("stop4").stretches
    assert common is not None
    both = common[(0, 2), (1, 3)]
    run = drive("stop4", {0: (2, both.mine.start + 1.0, [(0, 0.0)]), 1: (2, both.yours.start + 1.0, [(0, 0.0)])}, 1500)
    assert may_go(run, 0).all()
    assert may_go(run, 1).all()
    verdict = check(run, "progress")
    assert (verdict.status, {i.responsible for i in verdict.instances}) == ("FAIL", {("a0",), ("a1",)})
    assert status(run, "keep_clear")[0] == "FAIL"


def test_blocked_vehicle_with_green_is_excused_by_the_vehicle_that_entered_on_red(drive: Make) -> None:
    common = find("light4").stretches
    assert common is not None
    both = common[(0, 2), (1, 3)]
    stop_there = [(0, 5.0), (400, 0.0)]
    run = drive("light4", {0: (2, both.mine.start - 19.0, stop_there), 1: (2, both.yours.start - 19.0, stop_there)}, 1600, CROSS)
    assert (facing(run)[500] == [G, R]).all()
    assert not may_go(run, 0)[500]
    assert may_go(run, 1)[500]
    assert status(run, "progress") == ("FAIL", ("a1",))


def test_blocked_vehicles_that_entered_on_red_are_not_excused(drive: Make) -> None:
    both = stretches("light4")[(0, 2), (1, 3)]
    stop_there = [(0, 5.0), (400, 0.0)]
    run = drive(
        "light4", {0: (2, both.mine.start - 19.0, stop_there), 1: (2, both.yours.start - 19.0, stop_there)}, 1600, ALL_RED
    )
    assert (facing(run)[500] == R).all()
    assert status(run, "progress") == ("FAIL", ("a0", "a1"))


@pytest.mark.parametrize(("start", "blamed"), [(0, ("a2",)), (200, ("a2", "a3"))])
def test_vehicle_that_came_in_on_the_way_of_a_vehicle_with_priority(drive: Make, start: int, blamed: tuple[str, ...]) -> None:
    """a2 has a yield sign and enters at 2.8 s, a3 has priority and enters at 1.4 s or at 3.4 s. Each stands on the other's way.

    The vehicle with priority has an excuse if it was inside first.
    """
    both = stretches("yield4")[(2, 0), (3, 2)]
    head, tail = [(0, 0.0), (start, 5.0), (start + 400, 0.0)], [(0, 5.0), (400, 0.0)]
    run = drive("yield4", {2: (2, both.mine.start - 19.0, tail), 3: (3, both.yours.start - 19.0, head)}, 2000)
    assert [run.entry(column) for column in range(2)] == pytest.approx([2.8, 1.4 + start / 100], abs=0.02)
    assert [status(run, rule) for rule in ("progress", "keep_clear")] == [("FAIL", blamed)] * 2


# Blocking the junction


def test_three_seconds_in_the_junction(drive: Make) -> None:
    assert BLOCKING_TIME == 3.0
    run = drive("light4", {0: (2, 8.0, [(0, 0.0)])}, 400, CROSS)
    assert np.flatnonzero(blocks(run, 0))[0] == 300
    assert status(run, "keep_clear") == ("FAIL", ("a0",))


def test_many_short_stands_add_up(drive: Make) -> None:
    """Twenty times 2.9 s, moving on by 0.1 m in between."""
    speeds = [(0, 0.0)]
    for k in range(1, 20):
        speeds += [(k * 300 - 10, 1.0), (k * 300, 0.0)]
    run = drive("light4", {0: (2, 8.0, speeds)}, 6000, CROSS)
    assert np.flatnonzero(blocks(run, 0))[0] == pytest.approx(310, abs=12)
    assert status(run, "keep_clear") == ("FAIL", ("a0",))


@pytest.mark.parametrize("speed", [0.11, 0.5, -0.5])
def test_creeping_blocks_by_its_amount_and_backing_off_is_moving(drive: Make, speed: float) -> None:
    run = drive("light4", {0: (2, 8.0, [(0, speed)])}, 1100, CROSS)
    assert (run.zone == Zone.JUNCTION).all()
    assert np.flatnonzero(blocks(run, 0))[0] * run.dt == pytest.approx(3.0 / (1.0 - abs(speed) / PACE), abs=0.02)


@pytest.mark.parametrize("speeds", [[(0, 0.6)], [(10 * k, 0.02 * k) for k in range(100)]], ids=["steady", "setting off"])
def test_slow_crossing_blocks_nothing(drive: Make, speeds: list[tuple[int, float]]) -> None:
    """A truck of 12 m crosses at 0.6 m/s, or sets off inside at 0.2 m/s^2."""
    run = drive("light4", {0: (2, 1.0, speeds)}, 2000, CROSS, size=(12.0, 2.5))
    assert status(run, "keep_clear")[0] == "PASS"


@pytest.mark.parametrize(("rolls", "rear", "blames"), [(0.0, 10.0, True), (2.0, 5.4, True), (2.0, 5.6, False)])
def test_vehicle_that_entered_without_room_to_leave(drive: Make, rolls: float, rear: float, blames: bool) -> None:
    """It is 4.6 m long, and gets stuck for 1.1 s behind a body that stood when it entered, or left it less than 5.6 m."""
    ways = find("light4").movements
    end, stop = ways[1, 2].length, round(100 * (ways[0, 2].length - 2.5) / 8.0)
    # The body moves on for a second, and then comes back to 1 m behind the junction.
    back = 110 + round(100 * (rear + rolls - 1.0) / 8.0)
    body = (1, end + rear + 4.6, [(0, rolls), (100, 0.0), (110, -8.0), (back, 0.0)])
    for lasts, found in ((95, "PASS"), (110, "FAIL" if blames else "PASS")):
        run = drive("light4", {0: (2, -0.5, [(0, 8.0), (stop, 0.0), (stop + lasts, 8.0)]), 1: body}, 600, CROSS)
        assert status(run, "keep_clear")[0] == found


def test_rear_left_in_the_junction_blocks_it(drive: Make) -> None:
    end = find("light4").movements[0, 2].length
    for station, found in ((end + 4.5, "FAIL"), (end + 4.7, "NA")):
        assert status(drive("light4", {0: (2, station, [(0, 0.0)])}, 400, CROSS), "keep_clear")[0] == found


def test_the_body_counts_to_its_rear(drive: Make) -> None:
    end = find("light4").movements[0, 2].length
    for station, part in ((-0.1, False), (0.1, True), (end + 4.5, True), (end + 4.7, False)):
        run = drive("light4", {0: (2, station, [(0, 0.0)])}, 3, CROSS)
        assert inside(run, 0).all() == part, station


def test_giving_way_blocks_nothing(drive: Make) -> None:
    common = find("light4").stretches
    assert common is not None
    mine, yours, _ = common[(0, 3), (2, 0)]
    # a0 waits 6 s in the middle while a2 comes slowly, and goes on when it has passed.
    run = drive("light4", {0: (3, mine.start - 1.0, [(0, 0.0)]), 2: (2, yours.start - 12.0, [(0, 3.0)])}, 600, CROSS)
    assert losses(run).blocked[-1, 0] == 0.0
    assert status(run, "keep_clear")[0] == "PASS"


def test_second_waiting_left_turn_does_not_block_the_junction(drive: Make) -> None:
    mine, yours, _ = stretches("light4")[(0, 3), (2, 3)]
    # Both turn left, and wait for a2, which comes slowly and turns right. The first one stood there when the second one entered.
    second = (3, -0.5, [(0, 5.0), (round(20 * (mine.start - 5.5)), 0.0)])
    run = drive("light4", {0: stands(3, mine.start - 0.5), (0, 1): second, 2: (1, yours.start - 14.0, [(0, 3.6)])}, 400, CROSS)
    assert inside(run, 1)[250:].all()
    assert status(run, "keep_clear")[0] == "PASS"


def test_entering_behind_a_full_exit_road_blocks_the_junction(drive: Make) -> None:
    """Who enters although the exit road is full stands in the junction by its own doing."""
    ways = find("light4").movements
    run = drive("light4", {0: (2, ways[0, 2].length - 3.0, [(0, 0.0)]), 1: (1, ways[1, 2].length + 6.0, [(0, 0.0)])}, 400, CROSS)
    assert not may_go(run, 0).any(), "it can't get on"
    assert blocks(run, 0).any()
    for gap, waits in ((5.9, True), (6.1, False)):
        out = ways[1, 2].length - 3.0 + gap + 4.6
        near = drive("light4", {0: (2, ways[0, 2].length - 3.0, [(0, 0.0)]), 1: (1, out, [(0, 0.0)])}, 3, CROSS)
        assert may_go(near, 0).any() != waits, "six metres are room enough"


def test_unless_the_other_one_came_in_afterwards(drive: Make) -> None:
    ways = find("light4").movements
    first = (2, -0.5, [(0, 6.0), (round(100 * (ways[0, 2].length - 2.5) / 6.0), 0.0)])
    out = ways[1, 2].length + 5.5
    afterwards = (1, -0.5, [(0, 0.0), (100, 8.0), (100 + round(100 * (out + 0.5) / 8.0), 0.0)])
    for second, blamed in ((afterwards, False), ((1, out, [(0, 0.0)]), True)):
        run = drive("light4", {0: first, 1: second}, 1000, CROSS)
        assert blocks(run, 0).any() == blamed
