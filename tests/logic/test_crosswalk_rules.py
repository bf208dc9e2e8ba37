"""The rules of crosswalks: for each a drive that breaks it and nothing else, and one that keeps it; who is to blame.

All numbers follow from the layout of the crosswalks: over every arm with lanes of 3.5 m, 1.2 to 4.2 m behind the entrance vertex.
Vehicles from entrance 0 come onto the painted area at station 1.2, and drive in the middle of the first 3.5 m from the near kerb.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from pytest_rvads.geometry.crosswalks import Side
from pytest_rvads.geometry.finder import find
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.logic.check import check
from pytest_rvads.logic.ltl.ltl3 import Truth
from pytest_rvads.logic.rules.book import rulebook, rules_for
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour
from pytest_rvads.satellites.live.instant import Seen
from pytest_rvads.satellites.live.rule_monitor import RuleMonitor
from pytest_rvads.support.errors import RunError

from ..strollers import stroll
from ..zebras import zebra

Make = Callable[..., Run]
G, Y, R = Colour.GREEN, Colour.YELLOW, Colour.RED
NEAR, FAR = Side.NEAR, Side.FAR
PLAIN, LIT = zebra("right4").walked, zebra("light4", lit=True).walked
CROSS = {0: [(0, G)], 2: [(0, G)], 1: [(0, R)], 3: [(0, R)], **{4 + k: [(0, R if k % 4 < 2 else G)] for k in range(8)}}
"""Vehicles of arms 0 and 2 have green, so pedestrians have WALK on the crosswalks of arms 1 and 3."""
Walk = tuple[int, Side, float, Sequence[tuple[int, float]]]
"""Number of the crosswalk, side, station at the start [m], ticks with speeds [m/s]."""
STEADY = [(0, 1.4)]


def scene(drive: Make, place: Junction, car: Any, *walks: Walk, steps: int = 1500, **facts: Any) -> Run:
    """Return a run of vehicles from entrance 0 (or of vehicles by entrance) and of pedestrians p0, p1, ..."""
    vehicles = car if isinstance(car, dict) else {0: car}
    run = drive(place, vehicles, steps, CROSS if place is LIT else None, **facts)
    for number, walk in enumerate(walks):
        run = stroll(run, *walk, name=f"p{number}")
    return replace(run, collisions=None)


def outcomes(run: Run) -> dict[str, str]:
    """Return the outcomes of the rules of the road that are neither PASS nor NA."""
    verdicts = {rule.name: check(run, rule).outcome for rule in rules_for("road", run.junction)}
    return {name: str(outcome) for name, outcome in verdicts.items() if outcome not in ("PASS", "NA")}


DRIVES_ON = (2, -25.0, [(0, 5.0)])
"""Comes onto the crosswalk at 5.26 s, and is over it for 1.5 s."""
STOPS = (2, -25.0, [(0, 5.0), (510, 0.0), (1050, 5.0)])
"""Stands 0.7 m before the crosswalk from 5.1 s to 10.5 s."""
TURNS = (1, -25.0, [(0, 5.0)])
"""Turns right, and comes onto the crosswalk of the exit arm, 16.6 m behind the entrance vertex, at 8.3 s."""
WAITS = (1, -25.0, [(0, 5.0), (815, 0.0), (1400, 5.0)])
"""Turns right, and stands 0.8 m before that crosswalk from 8.15 s to 14 s."""
SLOW = [(0, 1.0)]

BREAKS: dict[str, tuple[Junction, Any, tuple[Walk, ...]]] = {
    # Leaves the kerb 2 s before the car comes, 4 s before the lane of the car, which begins in the middle of the roadway.
    "crosswalk": (PLAIN, DRIVES_ON, ((0, FAR, -3.3, SLOW),)),
    "crosswalk_turning": (LIT, TURNS, ((1, NEAR, -6.3, SLOW),)),
    "crosswalk_clear": (PLAIN, (2, -25.0, [(0, 5.0), (560, 0.0), (662, 5.0)]), ()),
}
KEEPS: dict[str, tuple[Junction, Any, tuple[Walk, ...]]] = {
    "crosswalk": (PLAIN, STOPS, ((0, FAR, -3.3, SLOW),)),
    "crosswalk_turning": (LIT, WAITS, ((1, NEAR, -6.3, SLOW),)),
    "crosswalk_clear": (PLAIN, (2, -25.0, [(0, 5.0), (560, 0.0), (660, 5.0)]), ()),
}


@pytest.mark.parametrize("name", BREAKS)
def test_every_rule_is_broken_alone_by_its_example(drive: Make, name: str) -> None:
    place, car, walks = BREAKS[name]
    assert outcomes(scene(drive, place, car, *walks)) == {name: "FAIL"}


@pytest.mark.parametrize("name", KEEPS)
def test_every_rule_is_kept_by_its_example(drive: Make, name: str) -> None:
    place, car, walks = KEEPS[name]
    run = scene(drive, place, car, *walks)
    assert check(run, name).status == "PASS"
    assert outcomes(run) == {}


def test_crosswalk_rules_hold_only_where_pedestrians_walk() -> None:
    for place, names in (
        (find("right4"), set()),
        (zebra("right4"), set()),
        (PLAIN, {"crosswalk", "crosswalk_clear"}),
        (zebra("stop4").walked, {"crosswalk", "crosswalk_clear"}),
        (LIT, {"crosswalk_turning", "crosswalk_clear"}),
        (zebra("light4").walked, {"crosswalk", "crosswalk_clear"}),
    ):
        assert {rule.name for rule in rules_for("road", place)} - {
            rule.name for rule in rules_for("road", find(place.name))
        } == names
    assert not {"crosswalk", "crosswalk_clear"} & {rule.name for rule in rules_for("road", PLAIN.control)}


def test_rulebook_leaves_out_rules_of_crosswalks_where_nobody_walks(drive: Make) -> None:
    counts = [
        sum(int(number) for number in re.findall(r"\d+", check(run, "road").message.split(";")[0]))
        for run in (drive("right4", {0: DRIVES_ON}, 100), scene(drive, PLAIN, DRIVES_ON, steps=100))
    ]
    of_crosswalks = {rule.name for rule in rulebook("road") if rule.crosswalks}
    assert of_crosswalks == {"crosswalk", "crosswalk_turning", "crosswalk_clear"}
    assert counts == [len(rulebook("road")) - 3, len(rulebook("road")) - 1]


def test_rules_of_crosswalks_say_where_they_apply(drive: Make) -> None:
    verdict = check(drive("right4", {0: DRIVES_ON}, 100), "crosswalk")
    assert (verdict.status, verdict.reason) == (
        "NA",
        "crosswalk is about pedestrians on crosswalks without lights, and none walk at this junction",
    )
    with pytest.raises(RunError, match="crosswalk_turning is about junctions with lights or partial and pedestrians on"):
        RuleMonitor("crosswalk_turning", PLAIN)


def test_violation_is_the_moment_in_which_the_front_comes_onto_the_crosswalk(drive: Make) -> None:
    verdict = check(scene(drive, *BREAKS["crosswalk"][:2], *BREAKS["crosswalk"][2]), "crosswalk")
    assert verdict.time == pytest.approx((25.0 + 1.2) / 5.0, abs=0.03)  # areas are sampled every 0.1 m
    assert verdict.responsible == ("a0",)
    assert verdict.message == f"crosswalk at t={verdict.time:.2f} s: a0 takes the crosswalk from p0"
    assert "to blame: a0 drove on though it could have stopped for p0" in verdict.notes


@pytest.mark.parametrize(
    ("walk", "status"),
    [
        ((0, FAR, -5.2, SLOW), "NA"),  # still at the kerb when the car comes
        ((0, FAR, -4.9, SLOW), "NA"),  # 3.6 s before the lane, and 3.1 s when the front of the car is past
        ((0, FAR, -4.0, SLOW), "FAIL"),  # 2.8 s before the lane
        ((0, FAR, 2.0, [(0, 0.0)]), "NA"),  # stands on the other half
        ((0, FAR, 4.5, [(0, 0.0)]), "FAIL"),  # stands on the half of the car
        ((0, FAR, 6.3, SLOW), "NA"),  # past the lane before the car is near
        ((0, NEAR, 0.2, [(0, 0.0)]), "FAIL"),  # stands on the half of the car, a step from the kerb
        ((0, NEAR, 4.5, [(0, 0.0), (480, -1.0)]), "FAIL"),  # turns back into the lane
    ],
)
def test_who_is_owed_the_crosswalk(drive: Make, walk: Walk, status: str) -> None:
    run = scene(drive, PLAIN, DRIVES_ON, walk, steps=700)
    assert [instance.status for instance in check(run, "crosswalk").instances] == [status]


def test_vehicle_that_sets_off_on_the_crosswalk_takes_it(drive: Make) -> None:
    # Stands with its front 0.5 m over the edge, until p0 is 1.5 s before its lane.
    car = (2, -25.0, [(0, 5.0), (534, 0.0), (700, 2.0)])
    verdict = check(scene(drive, PLAIN, car, (0, FAR, -4.5, SLOW)), "crosswalk")
    assert [(i.status, i.failed) for i in verdict.instances] == [("FAIL", 700)]


def test_slow_vehicle_that_is_in_the_way_of_a_pedestrian_takes_the_crosswalk(drive: Make) -> None:
    # Comes onto the crosswalk at 4.3 s, when p0 is 3.5 s before its lane, and needs 7 s to leave it.
    verdict = check(scene(drive, PLAIN, (2, -3.0, [(0, 1.0)]), (0, FAR, -2.24, [(0, 0.8)])), "crosswalk")
    (instance,) = verdict.instances
    assert instance.status == "FAIL"
    assert verdict.time == pytest.approx((2.24 + 4.0) / 0.8, abs=0.02)
    assert verdict.responsible == ("a0",)


def test_who_waits_at_the_kerb_is_owed_the_crosswalk_by_the_variant_alone(drive: Make) -> None:
    stands: Walk = (0, NEAR, -0.5, [(0, 0.0)])
    assert check(scene(drive, PLAIN, DRIVES_ON, stands), "crosswalk").status == "NA"
    verdict = check(scene(drive, PLAIN, DRIVES_ON, stands), "crosswalk_waiting")
    assert (verdict.status, verdict.responsible) == ("FAIL", ("a0",))
    assert verdict.time == pytest.approx((25.0 + 1.2) / 5.0, abs=0.03)
    for seconds, status in ((2.95, "FAIL"), (3.05, "PASS")):  # the vehicle stands for so long before it goes first
        car = (2, -25.0, [(0, 5.0), (510, 0.0), (510 + round(100 * seconds), 5.0)])
        assert check(scene(drive, PLAIN, car, stands), "crosswalk_waiting").status == status
    behind: Walk = (0, NEAR, -1.5, [(0, 0.0)])
    assert check(scene(drive, PLAIN, DRIVES_ON, behind), "crosswalk_waiting").status == "NA"


@pytest.mark.parametrize(("colour", "status"), [(G, "FAIL"), (Y, "NA"), (R, "NA")])
def test_lawful_is_who_stepped_onto_the_crosswalk_on_walk(drive: Make, colour: Colour, status: str) -> None:
    place, car, walks = BREAKS["crosswalk_turning"]
    run = scene(drive, place, car, *walks)
    lights = run.lights.copy()
    entered = 631  # of p0, to within a step
    lights[: entered + 5, 6], lights[entered + 5 :, 6] = colour, Y
    assert check(replace(run, lights=lights), "crosswalk_turning").status == status


def test_vehicle_that_goes_straight_on_is_not_asked_by_the_rule_on_turning(drive: Make) -> None:
    assert check(scene(drive, LIT, DRIVES_ON, (0, FAR, -3.3, SLOW)), "crosswalk_turning").status == "NA"


# Which vehicle could have stopped. The car drives 5 m/s: 3.68 m to stop at 3.4 m/s^2, after 5 m in the second of reaction.
@pytest.mark.parametrize(
    ("metres", "outcome", "responsible"),
    [
        (8.5, "PROVOKED", ("p0",)),
        (8.9, "FAIL", ("a0",)),
    ],  # from the front to the stretch that the ways share, as p0 leaves the kerb
)
@pytest.mark.parametrize("subject", [None, "a0"])
def test_dart_out_is_provoked_if_nobody_could_have_stopped(
    drive: Make, metres: float, outcome: str, responsible: tuple[str, ...], subject: str | None
) -> None:
    begin = (PLAIN.stretches or {})[(0, 2), PLAIN.further[0].way.key].mine.start
    leaves = (25.0 + begin - metres) / 5.0
    walk: Walk = (0, NEAR, -1.0, [(0, 0.0), (round(100 * leaves) - 100, 1.0)])
    run = scene(drive, PLAIN, DRIVES_ON, walk, subject=subject)
    verdict = check(run, "no_conflict")
    assert (verdict.outcome, verdict.responsible) == (outcome, responsible)
    # The painted area begins 0.2 m before.
    place = PLAIN.covers[0, (0, 2)].start
    walk = (0, NEAR, -1.0, [(0, 0.0), (round(100 * (25.0 + place - metres) / 5.0) - 100, 1.0)])
    verdict = check(scene(drive, PLAIN, DRIVES_ON, walk, subject=subject), "crosswalk")
    assert (verdict.outcome, verdict.responsible) == (outcome, responsible)


def test_vehicle_that_stood_when_the_pedestrian_came_could_have_stopped(drive: Make) -> None:
    car = (2, -25.0, [(0, 5.0), (510, 0.0), (700, 5.0)])
    walk: Walk = (0, NEAR, -0.5, [(0, 0.0), (640, 1.0)])  # leaves the kerb at 6.9 s
    verdict = check(scene(drive, PLAIN, car, walk), "crosswalk")
    assert (verdict.outcome, verdict.responsible) == ("FAIL", ("a0",))
    walk = (0, NEAR, -0.5, [(0, 0.0), (655, 1.0)])  # leaves the kerb at 7.05 s, when the car drives
    verdict = check(scene(drive, PLAIN, car, walk), "crosswalk")
    assert (verdict.outcome, verdict.responsible) == ("PROVOKED", ("p0",))
    assert "provoked by pedestrians: no vehicle is to blame" in verdict.notes


@pytest.mark.parametrize(("start", "responsible"), [(-3.2, ("a0", "p0")), (-5.3, ("p0",))])
def test_pedestrian_against_its_light_is_to_blame_and_a_vehicle_that_could_stop_shares_the_blame(
    drive: Make, start: float, responsible: tuple[str, ...]
) -> None:
    run = scene(drive, LIT, DRIVES_ON, (0, NEAR, start, [(0, 1.0)]))
    verdict = check(run, "no_conflict")
    assert verdict.responsible == responsible
    assert verdict.outcome == ("PROVOKED" if len(responsible) == 1 else "FAIL")
    assert check(run, "crosswalk_turning").status == "NA"


def test_vehicle_that_entered_on_red_is_to_blame_even_if_it_could_not_stop(drive: Make) -> None:
    walk: Walk = (1, NEAR, -5.5, [(0, 1.0)])
    run = scene(drive, LIT, {1: DRIVES_ON}, walk)
    verdict = check(run, "no_conflict")
    assert (verdict.outcome, verdict.responsible) == ("FAIL", ("a1",))
    assert "to blame: a1 had entered on red" in verdict.notes


@pytest.mark.parametrize(
    ("car", "walk", "outcome", "reason"),
    [
        (DRIVES_ON, (0, NEAR, -4.8, SLOW), "FAIL", "a0 had not stopped at the stop sign"),
        (TURNS, (1, FAR, -7.6, SLOW), "PROVOKED", "p0 came when a0 could no longer stop"),
    ],
    ids=["crosswalk behind the sign", "crosswalk of the exit"],
)
def test_vehicle_that_ran_the_stop_sign_is_to_blame_on_the_crosswalk_behind_the_sign(
    drive: Make, car: Any, walk: Walk, outcome: str, reason: str
) -> None:
    verdict = check(scene(drive, zebra("stop4").walked, car, walk), "no_conflict")
    assert verdict.outcome == outcome
    assert f"to blame: {reason}" in verdict.notes


def test_pedestrian_who_walks_into_a_standing_vehicle_is_to_blame(drive: Make) -> None:
    car = (2, -25.0, [(0, 5.0), (560, 0.0), (1400, 5.0)])
    run = scene(drive, PLAIN, car, (0, NEAR, -8.0, [(0, 1.0)]))
    for rule in ("no_collision", "no_conflict"):
        verdict = check(run, rule)
        assert (verdict.outcome, verdict.responsible) == ("PROVOKED", ("p0",))
        assert "to blame: p0 walked into a0, which stood" in verdict.notes


def test_pedestrian_who_waits_for_ever_does_not_excuse_a_vehicle_that_waits_for_ever(drive: Make) -> None:
    car = (2, -25.0, [(0, 5.0), (480, 0.0)])  # stands 1 m before the line
    at_kerb: Walk = (0, NEAR, -0.6, [(0, 0.0)])
    on_the_way: Walk = (0, NEAR, 1.0, [(0, 0.0)])
    for place in (PLAIN, zebra("yield4").walked, zebra("stop4").walked, LIT):
        assert check(scene(drive, place, car, at_kerb, steps=1700), "progress").status == "FAIL", place.name
        assert check(scene(drive, place, car, on_the_way, steps=1700), "progress").status == "PASS", place.name
    elsewhere: Walk = (3, NEAR, 1.0, [(0, 0.0)])
    assert check(scene(drive, zebra("stop4").walked, car, elsewhere, steps=1700), "progress").status == "FAIL"


def test_vehicle_behind_one_that_waits_for_a_pedestrian_has_progress(drive: Make) -> None:
    cars = {0: (2, -25.0, [(0, 5.0), (480, 0.0)]), (0, 1): (2, -33.0, [(0, 5.0), (480, 0.0)])}
    run = scene(drive, PLAIN, cars, (0, NEAR, 1.0, [(0, 0.0)]), steps=1700)
    assert check(run, "progress").status == "PASS"


def test_turning_vehicle_that_waits_in_the_junction_for_a_pedestrian_keeps_clear(drive: Make) -> None:
    car = (1, -25.0, [(0, 5.0), (800, 0.0)])
    run = scene(drive, PLAIN, car, (1, NEAR, 4.5, [(0, 0.0)]), steps=2500)
    assert check(run, "keep_clear").status == "PASS"
    assert check(run, "progress").status == "PASS"
    run = scene(drive, PLAIN, car, (1, NEAR, -0.6, [(0, 0.0)]), steps=2500)
    assert check(run, "keep_clear").status == "FAIL"


def test_stopping_on_the_crosswalk_for_somebody_who_steps_out_is_no_fault(drive: Make) -> None:
    car = (2, -25.0, [(0, 5.0), (530, 0.0), (1000, 5.0)])  # the front 0.3 m over the edge
    steps_out: Walk = (0, NEAR, -0.5, [(0, 0.0), (440, 1.0), (650, 0.0), (750, 1.0)])
    assert check(scene(drive, PLAIN, car, steps_out, steps=1200), "crosswalk_clear").status == "PASS"
    assert check(scene(drive, PLAIN, car, steps=1200), "crosswalk_clear").status == "FAIL"


@pytest.mark.parametrize(("gap", "status"), [(5.4, "FAIL"), (5.7, "PASS")])
def test_room_behind_the_crosswalk_when_the_vehicle_drives_onto_it(drive: Make, gap: float, status: str) -> None:
    # The car ahead stands with its rear `gap` behind the crosswalk of the exit arm, or rolls back to where it leaves no room.
    end = PLAIN.covers[2, (0, 2)].end
    front = end + gap + 4.6
    begin = PLAIN.covers[2, (0, 2)].start
    comes = round(100 * (25.0 + begin) / 5.0)
    ahead = (2, front, [(0, 0.0), (comes + 20, -2.0), (comes + 70, 0.0)])
    follower = (2, -25.0, [(0, 5.0), (comes + 70, 0.0)])
    run = scene(drive, PLAIN, {0: ahead, (0, 1): follower}, steps=comes + 400)
    assert check(run, "crosswalk_clear").status == status


@pytest.mark.parametrize(("leaves", "status"), [(400, "FAIL"), (700, "PASS")])
def test_left_turn_that_stops_for_who_steps_out_later_obstructs_nobody(drive: Make, leaves: int, status: str) -> None:
    # a0 enters at 5 s and stops before the crosswalk of its exit, with its rear where a2 comes, which brakes.
    stop = round(100 * (25.0 + 21.0) / 5.0)
    cars = {0: (3, -25.0, [(0, 5.0), (stop, 0.0)]), 2: (2, -60.0, [(0, 8.0), (stop + 50, 5.0), (stop + 60, 0.0)])}
    run = scene(drive, PLAIN, cars, (3, FAR, 0.0, [(0, 0.0), (leaves, 0.5)]), steps=stop + 400)
    assert check(run, "left_yields").status == status


@pytest.mark.parametrize(("walks", "responsible"), [(True, ("a0+1",)), (False, ("a0", "a0+1"))])
def test_braking_for_a_pedestrian_is_no_braking_for_nothing(drive: Make, walks: bool, responsible: tuple[str, ...]) -> None:
    # a0 brakes from 8 to 2 m/s in 0.2 s, 7.4 m before the line, and a0+1 runs into it.
    cars = {0: (2, -25.0, [(0, 8.0), (200, 6.0), (210, 4.0), (220, 2.0)]), (0, 1): (2, -34.0, [(0, 8.0)])}
    steps_out: Walk = (0, NEAR, -0.3, [(0, 0.0), (100, 1.0)])
    run = scene(drive, PLAIN, cars, *([steps_out] if walks else []), steps=400)
    assert check(run, "no_collision").responsible == responsible


@pytest.mark.parametrize(("island", "status"), [(0.0, "FAIL"), (1.0, "NA")])
def test_who_stands_on_the_island_is_on_no_half_of_the_roadway(drive: Make, island: float, status: str) -> None:
    plain = zebra("right4")
    place = replace(plain, crossings=tuple(replace(crosswalk, island=island) for crosswalk in plain.crossings)).walked
    run = scene(drive, place, DRIVES_ON, (0, FAR, 3.9, [(0, 0.0)]), steps=700)
    assert [instance.status for instance in check(run, "crosswalk").instances] == [status]


def test_pedestrian_at_the_kerb_holds_nobody_up_who_still_owes_something(drive: Make) -> None:
    enters = Rule("enters", "forall a, j.en. G(a@j.en -> F a@j)")
    car = (2, -25.0, [(0, 5.0), (490, 0.0)])
    run = scene(drive, PLAIN, car, (0, NEAR, -0.6, [(0, 0.0)]), subject="a0")
    assert check(run, enters).outcome == "OPEN"


def test_live_monitors_find_the_same_violations(drive: Make) -> None:
    for name, (place, car, walks) in BREAKS.items():
        run = scene(drive, place, car, *walks, steps=1000)
        monitor = RuleMonitor([name], place, dt=run.dt)
        found = []
        for tick in range(run.steps):
            seen = [
                Seen(
                    agent,
                    float(run.need("station")[tick, k]),
                    float(run.need("speed")[tick, k]),
                    *run.need("pose")[tick, k].tolist(),
                )
                for k, agent in enumerate(run.agents)
            ]
            found += [one.time for one in monitor.see(seen, run.lights[tick]) if one.verdict is Truth.FALSE]
        assert found == [pytest.approx(check(run, name).time, abs=1e-9)]


def test_explanations_name_the_crosswalk(drive: Make) -> None:
    place, car, walks = BREAKS["crosswalk"]
    verdict = check(scene(drive, place, car, *walks), "crosswalk")
    assert "p0 on the crosswalk of arm 0" in verdict.explanation
    assert (
        verdict.cause == "a takes the crosswalk from a', caused by a (a straight from entrance +0, a' on the crosswalk of arm +0)"
    )
