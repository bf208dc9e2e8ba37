"""Who is to blame: for a collision, and whether it is the subject or the traffic around it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.blame import cause_of
from pytest_rvads.logic.conduct.standing import entered
from pytest_rvads.logic.conduct.stretches import shared
from pytest_rvads.logic.rules.rule import Rule
from pytest_rvads.runs.run import Collision, Facts, Run
from pytest_rvads.runs.states import Colour, Zone

Make = Callable[..., Run]
STAND = (0, 0.0)
G, R = Colour.GREEN, Colour.RED
CROSS = {e: [(0, R if e % 2 else G)] for e in range(4)}


def wait(direction: int, go: int, speed: float = 8.0) -> Any:
    """Stand 0.5 m before the line from the start and set off at tick `go`."""
    return direction, -0.5, [STAND, (go, speed)]


def through(direction: int, speed: float = 8.0) -> Any:
    """Come along without stopping."""
    return direction, -10.0, [(0, speed)]


COLLISIONS: dict[str, tuple[str, dict[int, Any], int, tuple[str, ...], str]] = {
    "red": ("light4", {0: wait(2, 100), 1: through(2)}, 180, ("a1",), "had entered on red"),
    "red, first": ("light4", {0: wait(2, 150), 1: through(2)}, 200, ("a1",), "had entered on red"),
    "sign": ("stop4", {0: wait(2, 100), 1: through(2)}, 180, ("a1",), "had not stopped at the stop sign"),
    "sign, later": ("stop4", {0: wait(2, 130), 1: through(2)}, 180, ("a1",), "had not stopped at the stop sign"),
    "left turn": ("light4", {0: wait(3, 100), 2: through(2)}, 200, ("a0",), "took the way that it owed to a2"),
    "turn on red": ("light4", {1: wait(1, 100), 0: through(2, 7.0)}, 290, ("a1",), "took the way that it owed to a0"),
    "turn, left": ("stop4", {0: wait(2, 100), 1: wait(2, 150)}, 200, ("a0",), "had entered out of turn"),
    "turn, at once": ("stop4", {0: wait(2, 100), 1: wait(2, 100)}, 200, ("a0",), "had entered out of turn"),
    "turn, later": ("stop4", {1: wait(2, 100), 0: wait(2, 150)}, 200, ("a0",), "entered the junction after a1"),
    "both": ("stop4", {0: wait(2, 100), 2: wait(3, 100)}, 250, ("a0", "a2"), "are equally to blame"),
    "last": ("stop4", {0: wait(2, 100), 2: wait(3, 120)}, 250, ("a2",), "entered the junction after a0"),
}


@pytest.mark.parametrize("name", COLLISIONS)
def test_who_caused_a_collision(drive: Make, name: str) -> None:
    junction, vehicles, tick, agents, reason = COLLISIONS[name]
    names = [f"a{entrance}" for entrance in vehicles]
    run = drive(junction, vehicles, 400, CROSS if junction == "light4" else None, [(tick, *names)])
    cause = cause_of(run, run.collisions[0])
    assert (cause.agents, cause.reason) == (agents, reason)
    verdict = check(run, "no_collision")
    assert verdict.responsible == agents
    assert f"to blame: {' and '.join(agents)} {reason}" in verdict.explanation


def test_collision_in_a_cycle_is_the_fault_of_the_second_vehicle(drive: Make) -> None:
    """Four came at once; a0 sets off, as somebody has to, and a1, on its right, drives into the junction after it."""
    run = drive(
        "stop4", {0: wait(2, 100), 1: wait(2, 150), 2: wait(2, 10_000), 3: wait(2, 10_000)}, 400, None, [(200, "a0", "a1")]
    )
    assert cause_of(run, run.collisions[0]).agents == ("a1",)


def test_a_vehicle_that_ran_a_light_and_stands_in_the_way_shares_the_blame(drive: Make) -> None:
    """a1 ran the red light and has stood on the shared stretch ever since: for 3 s, then for 5 s."""
    for stood in (300, 500):
        vehicles = {1: (2, -10.0, [(0, 8.0), (312, 0.0)]), 0: wait(2, 112 + stood)}
        run = drive("light4", vehicles, 1000, CROSS, [(312 + stood, "a0", "a1")])
        assert cause_of(run, run.collisions[0]).agents == ("a1", "a0")


# a1 comes to the shared stretch at 4 s. At 5 s, with 3.4 m/s^2 to brake with, a0 could have stopped before the stretch, 14.5 m
# behind the entrance vertex: from 8 m/s within 9.4 m.
@pytest.mark.parametrize(
    ("junction", "driver", "could"),
    [
        ("stop4", wait(2, 420), False),
        ("stop4", wait(2, 440), True),
        ("light4", wait(2, 420), False),
        ("light4", wait(2, 440), True),
        ("light4", (2, -36.0, [(0, 8.0)]), True),
        ("light4", (2, -31.0, [(0, 8.0)]), False),
        ("light4", (2, -26.0, [(0, 6.0)]), True),
    ],
)
def test_who_could_have_stopped_shares_the_blame(drive: Make, junction: str, driver: Any, could: bool) -> None:
    """a1 has run the sign or the red light, and a0 drives into it."""
    run = drive(
        junction, {1: (2, -5.0, [(0, 4.0)]), 0: driver}, 600, CROSS if junction == "light4" else None, [(560, "a0", "a1")]
    )
    told = cause_of(run, run.collisions[0])
    assert told.agents == (("a1", "a0") if could else ("a1",))
    assert told.reason.endswith("a0 drove on though it could have stopped") == could


@pytest.mark.parametrize(("tick", "reason"), [(50, "drove into a2, which stood"), (49, "are equally to blame")])
def test_who_has_stood_for_half_a_second_stood(drive: Make, tick: int, reason: str) -> None:
    run = drive("light4", {0: through(2), 2: (2, -20.0, [STAND])}, 100, CROSS, [(tick, "a0", "a2")])
    assert cause_of(run, run.collisions[0]).reason == reason


def test_reversing_vehicle_is_blamed_for_hitting_a_standing_vehicle(drive: Make) -> None:
    # On the same road: a1 stands behind a0, which backs into it. Seen from a1, a0 is ahead.
    run = drive("stop4", {0: (2, -20.0, [(0, -1.0)]), 1: (2, -20.0, [STAND])}, 300, None, [(250, "a0", "a1")])
    pose = run.need("pose").copy()
    pose[:, 1] = pose[250, 0]
    pose[:, 1, :2] -= 4.6 * np.array([np.cos(pose[250, 0, 2]), np.sin(pose[250, 0, 2])])
    cause = cause_of(replace(run, pose=pose), run.collisions[0])
    assert (cause.agents, cause.reason) == (("a0",), "drove into a1, which stood")


def test_rear_vehicle_is_blamed_for_a_rear_end_collision(drive: Make) -> None:
    run = drive("stop4", {0: through(2), 2: through(1)}, 300, None, [(250, "a0", "a2")])
    pose = run.need("pose").copy()
    pose[250, :, 0] = 10.0, 16.0
    pose[250, :, 1:] = 0.0  # a2 is 6 m ahead, both heading east
    assert cause_of(replace(run, pose=pose), run.collisions[0]).agents == ("a0",)
    pose[250, :, 2] = 3.0  # both heading west: now a0 is ahead
    assert cause_of(replace(run, pose=pose), run.collisions[0]).agents == ("a2",)


def test_whoever_cuts_in_is_not_run_into_from_behind(drive: Make) -> None:
    """Both into exit 3: a2 turns right, a1 comes straight on; both have green, so neither owes the other the way."""
    green = {e: [(0, G)] for e in range(4)}
    vehicles = {1: (2, -10.0, [(0, 9.0)]), 2: (1, -0.5, [STAND, (230, 6.0)])}
    run = drive("light4", vehicles, 900, green)
    merged = shared(run, 1, 0)
    assert merged is not None
    place = int(np.flatnonzero(run.need("station")[:, 1] >= merged.mine.start)[0])
    pose = run.need("pose").copy()
    for later, blamed, reason in ((50, "a2", "cut in ahead of a1"), (150, "a1", "ran into a2 from behind")):
        tick = place + later
        pose[tick] = (10.0, 0.0, 0.0), (16.0, 0.0, 0.0)
        cause = cause_of(replace(run, pose=pose), Collision(tick * 0.01, ("a1", "a2"), 1.0))
        assert (cause.agents, cause.reason) == ((blamed,), reason)


def subject(entrance: int) -> dict[str, Any]:
    return {"subject": f"a{entrance}"}


@pytest.mark.parametrize(("seat", "blamed"), [(0, False), (1, True), (2, False)])
def test_violation_by_other_vehicles_is_provoked(drive: Make, seat: int, blamed: bool) -> None:
    vehicles = {0: wait(2, 100), 1: through(2), 2: wait(2, 10_000)}
    run = drive("stop4", vehicles, 600, **subject(seat))
    verdict = check(run, "full_stop")
    assert run.subject == f"a{seat}"
    assert (verdict.status, verdict.provoked, verdict.subject) == ("FAIL", not blamed, f"a{seat}")
    assert verdict.responsible == ("a1",)
    assert verdict.message.endswith("provoked by traffic") == verdict.provoked
    assert not verdict, "the run does not satisfy the rule, whoever is to blame"


def test_what_the_subject_did_leads_even_where_the_traffic_did_worse(drive: Make) -> None:
    # a1 breaks full_stop at once; a2, the subject, much later.
    vehicles = {1: through(2, 9.0), 2: (2, -10.0, [STAND, (500, 5.0)])}
    verdict = check(drive("stop4", vehicles, 1500, **subject(2)), "full_stop")
    assert (verdict.status, verdict.provoked) == ("FAIL", False)
    assert verdict.message.startswith("full_stop at t=7.01 s: a2 entered the junction")
    assert {i.responsible for i in verdict.instances if i.status == "FAIL"} == {("a1",), ("a2",)}


@pytest.mark.parametrize(("seat", "blamed"), [(0, True), (1, False)])
def test_an_open_obligation_is_kept_open_by_who_is_waited_for(drive: Make, seat: int, blamed: bool) -> None:
    # a0 came first and never goes; a1 waits for it, as it must.
    vehicles = {0: wait(2, 10_000), 1: (2, -3.0, [(0, 1.0), (200, 0.0)])}
    verdict = check(drive("stop4", vehicles, 900, **subject(seat)), "p3")
    assert (verdict.status, verdict.provoked) == ("OPEN", not blamed)


def test_first_vehicle_has_five_seconds_to_go(drive: Make) -> None:
    """a1 arrives at 2 s and waits for a0, the subject, which was first."""
    vehicles = {0: wait(2, 10_000), 1: (2, -3.0, [(0, 1.0), (200, 0.0)])}
    # The last state is one tick before `steps`: 2.99 s and 3 s after the arrival.
    assert [check(drive("stop4", vehicles, steps, **subject(0)), "p3").provoked for steps in (500, 501)] == [True, False]


@pytest.mark.parametrize("beside", [{}, {2: (2, -60.0, [STAND])}], ids=["alone", "one more stands far off"])
@pytest.mark.parametrize(("go", "waived"), [(280, False), (290, True)])
def test_a_vehicle_that_has_stood_free_to_go_for_three_seconds_waives_its_turn(
    drive: Make, go: int, waived: bool, beside: dict[int, Any]
) -> None:
    """a0 stands at its line from the start; a1, the subject, came at 2 s and enters 0.13 s after `go`."""
    vehicles = {0: wait(2, 10_000), 1: (2, -3.0, [(0, 1.0), (200, 0.0), (go, 8.0)]), **beside}
    run = drive("stop4", vehicles, 800, **subject(1))
    paper = check(run, "p3")
    assert (paper.status, paper.responsible, paper.provoked) == ("FAIL", ("a1",), waived)
    assert check(run, "first_come").status == ("PASS" if waived else "FAIL")


@pytest.mark.parametrize(("seat", "blamed"), [(0, True), (1, False)])
def test_run_without_positions_forfeits_no_turn(make: Make, seat: int, blamed: bool) -> None:
    """A run without positions: a1, on the right, stands for 20 s, and still a0 is to blame that it went first."""
    run = make("stop4", {0: (2, 10, 2000, 2100), 1: (2, 10, 2500, 2600)}, 3000)
    verdict = check(replace(run, facts=Facts(subject=f"a{seat}")), "p2")
    assert (verdict.status, verdict.responsible, verdict.provoked) == ("FAIL", ("a0",), not blamed)


def test_a_subject_at_red_is_alone_with_its_open_obligation(drive: Make) -> None:
    run = drive("light4", {1: wait(2, 10_000)}, 600, CROSS, **subject(1))
    assert (check(run, "red").status, check(run, "red").provoked) == ("OPEN", False)


def test_without_a_subject_nothing_is_provoked(drive: Make) -> None:
    verdict = check(drive("stop4", {1: through(2)}, 600), "full_stop")
    assert (verdict.status, verdict.provoked, verdict.subject) == ("FAIL", False, None)


@pytest.mark.parametrize(("before", "provoked"), [(0, True), (5, True), (90, True), (120, False)])
def test_vehicle_without_time_to_react_is_not_blamed(drive: Make, before: int, provoked: bool) -> None:
    """a1 runs the stop sign; a0, the subject, had stopped and enters some ticks later, for which p1 holds it responsible."""
    run = drive("stop4", {1: through(2, 10.0), 0: wait(2, 95 + before, 10.0)}, 600, **subject(0))
    assert entered(run)[-1, 1] - entered(run)[-1, 0] == before
    verdict = check(run, "p1")
    assert verdict.responsible == (("a1", "a0") if before == 0 else ("a0",)), "as the rule has it"
    assert (verdict.status, verdict.provoked) == ("FAIL", provoked)


@pytest.mark.parametrize("later", [0, 5, 90])
@pytest.mark.parametrize("seat", [0, 2])
def test_left_turn_is_blamed_in_any_order_of_entry(drive: Make, later: int, seat: int) -> None:
    """Both drive on green, a0 to the left across the way of a2, which stood first at its line and sets off some ticks later."""
    run = drive("light4", {0: wait(3, 100), 2: wait(2, 100 + later)}, 600, CROSS, **subject(seat))
    broken = [check(run, rule) for rule in ("left_yields", "no_conflict") if check(run, rule).status == "FAIL"]
    assert [v.rule for v in broken] == (["left_yields", "no_conflict"] if later < 50 else ["left_yields"])
    assert {(v.responsible, v.provoked) for v in broken} == {(("a0",), seat == 2)}


def test_the_victim_of_a_turn_on_red_is_not_blamed(drive: Make) -> None:
    """a1 stops at the red light, turns right without looking, and a0, which has green, hits it."""
    vehicles = {1: wait(1, 100, 4.0), 0: (2, -10.0, [(0, 7.0)])}
    for seat, provoked in ((0, True), (1, False)):
        run = drive("light4", vehicles, 470, CROSS, [(460, "a0", "a1")], **subject(seat))
        for rule in ("no_collision", "right_on_red"):
            verdict = check(run, rule)
            assert (verdict.status, verdict.responsible, verdict.provoked) == ("FAIL", ("a1",), provoked), rule


def test_passing_a_waiting_left_turn_is_no_conflict(drive: Make) -> None:
    """a0 waits in the junction to turn left, before the way of a2, the subject, which goes straight on at green."""
    vehicles = {0: (3, -0.5, [(0, 5.0), (120, 0.0), (600, 5.0)]), 2: wait(2, 200)}
    run = drive("light4", vehicles, 900, CROSS, **subject(2))
    assert (run.zone == Zone.JUNCTION).all(axis=1).any(), "both are in the junction, on ways that cross"
    assert check(run, "no_conflict").status == "PASS"
    assert check(run, "left_yields").status == "NA", "only traffic was asked"


def test_waiting_at_red_beside_a_stuck_vehicle_is_not_blamed(drive: Make) -> None:
    """a1 stands in the junction for good, after a collision say; a2 had no chance to go."""
    vehicles = {1: (2, -10.0, [(0, 5.0), (300, 0.0)]), 3: wait(2, 10_000)}
    run = drive("light4", vehicles, 600, CROSS, **subject(3))
    assert (check(run, "red").status, check(run, "red").provoked) == ("FAIL", True), "a1 entered on red"
    vehicles = {0: (2, -10.0, [(0, 5.0), (300, 0.0)]), 3: wait(2, 10_000)}
    assert check(drive("light4", vehicles, 600, CROSS, **subject(3)), "red").provoked
    vehicles = {0: (2, -10.0, [(0, 5.0)]), 3: wait(2, 10_000)}
    assert not check(drive("light4", vehicles, 600, CROSS, **subject(3)), "red").provoked


def test_waiting_subject_is_not_blamed_for_vehicles_behind_it(drive: Make) -> None:
    """a2 came last and waits for a0, the subject, which came together with a1, on its right, and waits for it."""
    vehicles = {0: wait(2, 10_000), 1: wait(2, 10_000), 2: (3, -3.0, [(0, 1.0), (200, 0.0)])}
    run = drive("stop4", vehicles, 1500, **subject(0))
    assert (check(run, "first_come").status, check(run, "first_come").provoked) == ("OPEN", True)
    run = drive("stop4", vehicles, 1500, **subject(1))
    assert check(run, "progress").status == "FAIL", "a1 may go and does not"


@pytest.mark.parametrize(("hit", "provoked"), [(199, True), (101, True), (100, False), (None, False)])
def test_vehicle_that_is_pushed_over_its_line_does_not_enter_on_red(drive: Make, hit: int | None, provoked: bool) -> None:
    """a1 stands at its red light and is over the line at 2 s; a1+1 ran into it less than 1 s before, earlier, or not at all."""
    vehicles = {1: (2, -0.01, [STAND, (199, 2.0)]), (1, 1): (2, -8.6, [(0, 2.0), (200, 0.0)])}
    run = drive("light4", vehicles, 202, CROSS, [(hit, "a1", "a1+1")] if hit else [], subject="a1")
    verdict = check(run, "red")
    assert (verdict.status, verdict.time, verdict.provoked) == ("FAIL", 2.0, provoked)


@pytest.mark.parametrize(("strayed", "provoked"), [("a0", False), ("a1", True)])
def test_obligation_is_open_by_the_subject_that_ended_the_run_itself(drive: Make, strayed: str, provoked: bool) -> None:
    """Everybody has to get into the junction, and the subject, a0, has not when a vehicle off its route ends the run."""
    vehicles = {0: (2, -20.0, [(0, 5.0)]), 1: (2, -20.0, [(0, 5.0)])}
    run = drive("stop4", vehicles, 100, subject="a0", strayed=(strayed,))
    verdict = check(run, Rule("arrives", "forall a. F a@j"))
    assert (verdict.status, verdict.provoked) == ("OPEN", provoked)
