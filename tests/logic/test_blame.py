"""Who is to blame: for a collision, and whether it is the subject or the traffic around it."""

from collections.abc import Callable
from typing import Any

import pytest

from pytest_rvads.logic.check import check
from pytest_rvads.semantics.collisions import cause_of
from pytest_rvads.semantics.run import Run
from pytest_rvads.semantics.states import Colour

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
    "stands": ("stop4", {0: wait(2, 10_000), 1: through(2)}, 200, ("a1",), "drove into a0, which stood"),
    "red": ("light4", {0: wait(2, 100), 1: through(2)}, 180, ("a1",), "had entered on red"),
    "sign": ("stop4", {0: wait(2, 100), 1: through(2)}, 180, ("a1",), "had not stopped at the stop sign"),
    "sign, later": ("stop4", {0: wait(2, 130), 1: through(2)}, 180, ("a1",), "had not stopped at the stop sign"),
    "left turn": ("light4", {0: wait(3, 100), 2: through(2)}, 200, ("a0",), "turned across the way of a2"),
    "last": ("stop4", {0: wait(2, 100), 1: wait(2, 150)}, 200, ("a1",), "entered the junction after a0"),
    "both": ("stop4", {0: wait(2, 100), 1: wait(2, 100)}, 200, ("a0", "a1"), "are equally to blame"),
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
    assert f"who caused the collision: {' and '.join(agents)} {reason}" in verdict.explanation


def test_whoever_is_behind_ran_into_who_is_ahead(drive: Make) -> None:
    run = drive("stop4", {0: through(2), 1: through(1)}, 300, None, [(250, "a0", "a1")])
    assert run.pose is not None
    run.pose[250, :, 0] = 10.0, 16.0  # a1 is 6 m ahead, both heading east
    assert cause_of(run, run.collisions[0]).agents == ("a0",)
    run.pose[250, :, 2] = 3.0  # both heading west: now a0 is ahead
    assert cause_of(run, run.collisions[0]).agents == ("a1",)


def subject(entrance: int) -> dict[str, Any]:
    return {"scenario": {"subject": entrance}}


@pytest.mark.parametrize(("seat", "blamed"), [(0, False), (1, True), (2, False)])
def test_a_violation_counts_against_the_subject_that_is_to_blame_for_it(drive: Make, seat: int, blamed: bool) -> None:
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
    verdict = check(drive("stop4", vehicles, 900, **subject(seat)), "first_come")
    assert (verdict.status, verdict.provoked) == ("OPEN", not blamed)


def test_who_is_waited_for_has_time_to_go(drive: Make) -> None:
    """a1 arrives at 2 s and waits for a0, the subject, which was first; six seconds in all, or nine."""
    vehicles = {0: wait(2, 10_000), 1: (2, -3.0, [(0, 1.0), (200, 0.0)])}
    assert [check(drive("stop4", vehicles, steps, **subject(0)), "first_come").provoked for steps in (600, 900)] == [True, False]


def test_a_subject_at_red_is_alone_with_its_open_obligation(drive: Make) -> None:
    run = drive("light4", {1: wait(2, 10_000)}, 600, CROSS, **subject(1))
    assert (check(run, "red").status, check(run, "red").provoked) == ("OPEN", False)


def test_without_a_subject_nothing_is_provoked(drive: Make) -> None:
    verdict = check(drive("stop4", {1: through(2)}, 600), "full_stop")
    assert (verdict.status, verdict.provoked, verdict.subject) == ("FAIL", False, None)


@pytest.mark.parametrize(("before", "provoked"), [(0, True), (5, True), (90, True), (120, False)])
def test_whoever_had_no_time_to_let_the_other_in_is_not_to_blame(drive: Make, before: int, provoked: bool) -> None:
    """Both drive on green, a0 to the left across the way of a2, the subject, which enters some ticks later."""
    run = drive("light4", {0: wait(3, 100), 2: wait(2, 100 + before)}, 600, CROSS, **subject(2))
    verdict = check(run, "no_conflict")
    assert verdict.responsible == (("a0", "a2") if before == 0 else ("a2",)), "as the rule has it"
    assert (verdict.status, verdict.provoked) == ("FAIL", provoked)


def test_who_had_to_wait_is_to_blame_however_soon(drive: Make) -> None:
    run = drive("light4", {0: wait(3, 100), 2: wait(2, 95)}, 600, CROSS, **subject(0))
    assert not check(run, "no_conflict").provoked
    # At a stop sign, after a stop, nobody has the better right: both are to blame.
    run = drive("stop4", {0: wait(2, 100), 1: wait(2, 100)}, 600, **subject(0))
    assert not check(run, "no_conflict").provoked


def test_who_waits_at_red_is_not_to_blame_where_somebody_is_stuck(drive: Make) -> None:
    """a1 stands in the junction for good, after a collision say; a2 had no chance to go."""
    vehicles = {1: (2, -10.0, [(0, 5.0), (300, 0.0)]), 3: wait(2, 10_000)}
    run = drive("light4", vehicles, 600, CROSS, **subject(3))
    assert (check(run, "red").status, check(run, "red").provoked) == ("FAIL", True), "a1 entered on red"
    vehicles = {0: (2, -10.0, [(0, 5.0), (300, 0.0)]), 3: wait(2, 10_000)}
    assert check(drive("light4", vehicles, 600, CROSS, **subject(3)), "red").provoked
    vehicles = {0: (2, -10.0, [(0, 5.0)]), 3: wait(2, 10_000)}
    assert not check(drive("light4", vehicles, 600, CROSS, **subject(3)), "red").provoked


def test_a_subject_that_has_to_wait_itself_keeps_others_waiting_with_good_reason(drive: Make) -> None:
    """a2 came last and waits for a0, the subject, which came together with a1, on its right, and waits for it."""
    vehicles = {0: wait(2, 10_000), 1: wait(2, 10_000), 2: (2, -3.0, [(0, 1.0), (200, 0.0)])}
    run = drive("stop4", vehicles, 1500, **subject(0))
    for rule in ("right_first", "first_come"):
        assert (check(run, rule).status, check(run, rule).provoked) == ("OPEN", True), rule
    run = drive("stop4", vehicles, 1500, **subject(1))
    assert not check(run, "first_come").provoked, "a1 may go and does not"
