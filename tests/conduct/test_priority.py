"""Who owes the way to whom, and whether it was taken: by hand, on two ways that cross or join."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.conflicts import Shared
from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.conduct.priority import BEND_BRAKING, HARD_BRAKING, MIN_GAP, obstructs, owes
from pytest_rvads.logic.conduct.rights import DUE
from pytest_rvads.logic.conduct.stretches import shared
from pytest_rvads.logic.conduct.waiting import due
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour, Zone

Make = Callable[..., Run]
G, Y, R = Colour.GREEN, Colour.YELLOW, Colour.RED
CROSS = {e: [(0, R if e % 2 else G)] for e in range(4)}
LEFT, STRAIGHT = ((0, 3), (2, 0))
"""A left turn, and the straight way of oncoming traffic."""


def common(one: tuple[int, int] = LEFT, two: tuple[int, int] = STRAIGHT) -> Shared:
    found = find("light4").stretches
    assert found is not None
    return found[one, two]


def at(station: float, *speeds: tuple[int, float]) -> Any:
    return station, list(speeds)


def meeting(drive: Make, left: Any, oncoming: Any, steps: int = 600, lights: Any = CROSS, turn: int = 2, **more: Any) -> Run:
    """a0 turns left, a2 comes from the opposite entrance: straight on, or by `turn`."""
    return drive("light4", {0: (3, *left), 2: (turn, *oncoming)}, steps, lights, **more)


# Due


@pytest.mark.parametrize(
    ("speed", "ahead", "is_due"),
    [(8.0, 31.9, True), (8.0, 32.1, False), (2.0, 7.9, True), (2.0, 8.1, False), (0.0, 0.1, False), (0.2, 0.9, False)],
)
def test_who_is_four_seconds_away_is_due(drive: Make, speed: float, ahead: float, is_due: bool) -> None:
    assert DUE == 4.0
    stretch = common().yours
    run = meeting(drive, at(-50.0, (0, 0.0)), at(stretch.start - ahead, (0, speed)), 1, {e: [(0, R)] for e in range(4)})
    assert due(run, 0, 1)[0] == is_due


def test_who_stands_first_at_its_green_light_is_due_and_at_red_is_not(drive: Make) -> None:
    stands = meeting(drive, at(-50.0, (0, 0.0)), at(-0.5, (0, 0.0)), 20, {**CROSS, 2: [(0, R), (10, G), (15, Y)]})
    assert due(stands, 0, 1).tolist() == [False] * 10 + [True] * 5 + [False] * 5
    near, far = (meeting(drive, at(-50.0, (0, 0.0)), at(station, (0, 0.0)), 1) for station in (-4.9, -5.1))
    assert due(near, 0, 1)[0]
    assert not due(far, 0, 1)[0], "not in its stop place"


def test_vehicle_past_the_conflict_is_not_due(drive: Make) -> None:
    stretch = common().yours
    for rear, is_due in ((-0.1, True), (0.1, False)):
        run = meeting(drive, at(-50.0, (0, 0.0)), at(stretch.end + 4.6 + rear, (0, 8.0)), 1)
        assert due(run, 0, 1)[0] == is_due
    backwards = meeting(drive, at(-50.0, (0, 0.0)), at(stretch.start - 5.0, (0, -3.0)), 1)
    assert not due(backwards, 0, 1)[0]


# Owing


def test_a_left_turn_owes_the_way_to_oncoming_traffic_with_the_right_to_go(drive: Make) -> None:
    def owed(lights: Any) -> bool:
        return bool(owes(meeting(drive, at(-0.5, (0, 0.0)), at(-10.0, (0, 8.0)), 1, lights), 0, 1)[0])

    assert owed(CROSS)
    assert owed({**CROSS, 0: [(0, Y)], 2: [(0, Y)]}), "whoever comes on yellow may not be able to stop"
    assert not owed({**CROSS, 2: [(0, R)]})
    assert not owed({**CROSS, 0: [(0, R)]}), "at red it has to wait for green, not for anybody"


def test_the_way_is_owed_from_the_entrance_zone_until_the_rear_has_left_the_stretch(drive: Make) -> None:
    stretch = common().mine
    clear = stretch.end + 4.6
    for station, owed in ((-1.1, False), (-0.9, True), (stretch.start + 0.1, True), (clear - 0.1, True)):
        run = meeting(drive, at(station, (0, 0.0)), at(-10.0, (0, 8.0)), 1)
        assert owes(run, 0, 1)[0] == owed, station


@pytest.mark.parametrize(("turn", "owed"), [(1, True), (2, True), (3, False)])
def test_left_turn_owes_nothing_to_an_opposite_left_turn(drive: Make, turn: int, owed: bool) -> None:
    run = meeting(drive, at(-0.5, (0, 0.0)), at(-10.0, (0, 8.0)), 1, turn=turn)
    assert owes(run, 0, 1)[0] == owed
    assert not owes(run, 1, 0).any(), "who comes straight on owes nothing"


def test_turn_on_red_owes_the_way_to_crossing_vehicles_with_green(drive: Make) -> None:
    vehicles = {1: (1, -0.5, [(0, 0.0)]), 0: (2, -10.0, [(0, 8.0)]), 3: (3, -10.0, [(0, 8.0)])}
    run = drive("light4", vehicles, 1, {**CROSS, 3: [(0, G)]})
    assert owes(run, 0, 1)[0], "from the left, into the same exit"
    assert owes(run, 0, 2)[0], "a left turn into the same exit"
    assert not owes(drive("light4", vehicles, 1, {**CROSS, 1: [(0, G)]}), 0, 1)[0]
    straight = drive("light4", {1: (2, -0.5, [(0, 0.0)]), 0: (2, -10.0, [(0, 8.0)])}, 1, CROSS)
    assert not owes(straight, 0, 1)[0], "straight on at red it just has to wait"


def test_at_a_stop_sign_nobody_owes_by_lights(drive: Make) -> None:
    run = drive("stop4", {0: (3, -0.5, [(0, 0.0)]), 2: (2, -10.0, [(0, 8.0)])}, 1)
    assert not owes(run, 0, 1).any()


# Taking the way


def crossing(drive: Make, gap: float) -> Run:
    """a0 turns left at 6 m/s from its line at 1 s; a2 comes at 8 m/s, `gap` seconds after a0's rear has left the stretch."""
    mine, yours, _ = common()
    left = 1.0 + (0.5 + mine.end + 4.6) / 6.0
    return meeting(drive, at(-0.5, (0, 0.0), (100, 6.0)), at(yours.start - 8.0 * (left + gap), (0, 8.0)), 800)


@pytest.mark.parametrize(("gap", "taken"), [(-1.0, True), (0.5, True), (0.95, True), (1.05, False), (3.0, False)])
def test_under_a_second_behind_is_too_near(drive: Make, gap: float, taken: bool) -> None:
    assert MIN_GAP == 1.0
    run = crossing(drive, gap)
    hits = np.flatnonzero(obstructs(run, 0, 1))
    assert bool(len(hits)) == taken
    if taken:
        arrives = np.flatnonzero(run.need("station")[:, 1] >= common().yours.start)[0]
        assert hits[0] == arrives, "when the other one comes to the place"
        takes = np.flatnonzero(run.need("station")[:, 0] >= common().mine.start)[0]
        assert owes(run, 0, 1)[takes : hits[0] + 1].all(), "from where the ways meet until the other one is there"


def test_vehicle_behind_the_passing_vehicle_obstructs_nobody(drive: Make) -> None:
    yours = common().yours
    passed = round(100 * (8.0 + yours.end + 4.6) / 8.0)
    run = meeting(drive, at(-0.5, (0, 0.0), (passed, 6.0)), at(-8.0, (0, 8.0)), 1200)
    assert owes(run, 0, 1).any()
    assert not obstructs(run, 0, 1).any()


def test_vehicle_waiting_inside_the_junction_obstructs_nobody(drive: Make) -> None:
    mine, yours, _ = common()
    inside = round(100 * (0.5 + mine.start - 1.0) / 5.0)
    passed = round(100 * (20.0 + yours.end + 4.6) / 8.0)
    run = meeting(drive, at(-0.5, (0, 5.0), (inside, 0.0), (passed, 5.0)), at(-20.0, (0, 8.0)), 1500)
    assert run.zone[inside + 50, 0] == Zone.JUNCTION
    assert owes(run, 0, 1)[inside + 50]
    assert not obstructs(run, 0, 1).any()


def braked(drive: Make, deceleration: float, turn: int = 2, **more: Any) -> Run:
    """a0 turns left in front of a2, which brakes from 10 m/s to 2 m/s in time, 1.5 s after a0 has entered."""
    mine, yours, _ = common() if turn == 2 else common(LEFT, (2, 3))
    enters = 100 + round(100 * 0.5 / 6.0)
    begins = enters + 50
    slowing = [(begins + k, max(10.0 - deceleration * k * 0.01, 2.0)) for k in range(round(8.0 / deceleration * 100) + 1)]
    # Without braking it would come to the place while a0 is still there.
    start = yours.start - 10.0 * (1.0 + (0.5 + mine.end) / 6.0)
    return meeting(drive, at(-0.5, (0, 0.0), (100, 6.0)), at(start, (0, 10.0), *slowing), 1200, turn=turn, **more)


@pytest.mark.parametrize(("deceleration", "taken"), [(4.1, True), (2.3, True), (1.8, False)])
def test_who_has_to_brake_hard_is_obstructed(drive: Make, deceleration: float, taken: bool) -> None:
    assert HARD_BRAKING == 2.0
    run = braked(drive, deceleration)
    arrives = np.flatnonzero(run.need("station")[:, 1] >= common().yours.start)
    left = np.flatnonzero(run.need("station")[:, 0] - 4.6 > common().mine.end)[0]
    hits = np.flatnonzero(obstructs(run, 0, 1))
    soon = len(arrives) > 0 and arrives[0] - left < 100
    assert bool(len(hits)) == (taken or soon)
    if taken:
        assert hits[0] < left, "as soon as a0 is in the way and a2 has braked"


def test_braking_for_ones_own_light_is_nobody_else_s_doing(drive: Make) -> None:
    run = braked(drive, 4.1, lights={**CROSS, 2: [(0, G), (140, Y)]})
    assert not obstructs(run, 0, 1).any()


def test_needless_braking_is_no_obstruction(drive: Make) -> None:
    run = crossing(drive, 3.0)
    speed = run.need("speed").copy()
    speed[150:, 1] = np.maximum(8.0 - 0.05 * np.arange(len(speed) - 150), 1.0)
    station = run.need("station").copy()
    station[:, 1] = station[0, 1] + np.concatenate(([0.0], np.cumsum(speed[:-1, 1]) * 0.01))
    assert not obstructs(replace(run, speed=speed, station=station), 0, 1).any()


def test_who_turns_itself_brakes_for_its_bend(drive: Make) -> None:
    assert BEND_BRAKING == 4.0
    for deceleration, taken in ((3.5, False), (4.5, True)):
        run = braked(drive, deceleration, turn=1)
        early = obstructs(run, 0, 1)[: round(100 * (1.0 + (0.5 + common(LEFT, (2, 3)).mine.end) / 6.0))]
        assert early.any() == taken


def test_touching_counts_whatever_the_times_say(drive: Make) -> None:
    run = crossing(drive, 1.05)
    assert owes(run, 0, 1).any()
    assert not obstructs(run, 0, 1).any()
    station, (mine, yours, _) = run.need("station"), common()
    taking = np.flatnonzero((station[:, 0] > mine.start) & (station[:, 1] < yours.start))
    pose = run.need("pose").copy()
    pose[taking[5], 1] = pose[taking[5], 0]
    apart = replace(run, pose=pose, collisions=None)
    assert not obstructs(apart, 0, 1).any(), "the other vehicle has not come to the shared stretch"
    station = station.copy()
    station[taking[5], 1] = yours.start
    touching = replace(apart, station=station)
    assert np.flatnonzero(obstructs(touching, 0, 1)).tolist() == [taking[5]]


def test_second_vehicle_of_a_merge_needs_a_gap(drive: Make) -> None:
    """a1 turns right on red into the lane of a0, which has green and comes at 8 m/s."""
    mine, yours, merges = common((1, 2), (0, 2))
    assert merges
    for gap, taken in ((0.5, True), (1.5, False)):
        # Where a0 comes onto their common way, a1's rear passes when it is as far from the exit.
        place = find("light4").movements[1, 2].length - (find("light4").movements[0, 2].length - yours.start)
        passes = 1.0 + (0.5 + place + 4.6) / 8.0
        start = yours.start - 8.0 * (passes + gap)
        run = drive("light4", {1: (1, -0.5, [(0, 0.0), (100, 8.0)]), 0: (2, start, [(0, 8.0)])}, 900, CROSS)
        assert obstructs(run, 0, 1).any() == taken, gap
    assert shared(run, 0, 1) == (mine, yours, True)
