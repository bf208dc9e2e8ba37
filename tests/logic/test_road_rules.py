"""The rules of the road: for each a drive that breaks it and nothing else, and one that keeps it.

Vehicles are given by direction (1 right, 2 straight, 3 left), station at the start [m] and speeds [m/s] from ticks on.
The entrance zone begins 1 m before the entrance vertex, where the stopping line of the built-in maps lies.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.logic.check import check
from pytest_rvads.logic.conduct.standing import speeding, stopped
from pytest_rvads.logic.conduct.stretches import shared
from pytest_rvads.logic.rules.book import rules_for
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Colour

Make = Callable[..., Run]
G, R = Colour.GREEN, Colour.RED
CROSS = {0: [(0, G)], 2: [(0, G)], 1: [(0, R)], 3: [(0, R)]}
STAND = (0, 0.0)


def wait(direction: int, go: int) -> Any:
    """Stand 0.5 m before the line from the start and set off at tick `go`."""
    return direction, -0.5, [STAND, (go, 8.0)]


Broken = tuple[str, dict[int, Any], list[Any]]
BREAKS: dict[str, Broken] = {
    "full_stop": ("stop4", {0: (2, -10.0, [(0, 5.0)])}, []),
    "first_come": ("stop4", {0: wait(2, 800), 1: (2, -2.5, [(0, 1.0), (200, 0.0), (250, 8.0)])}, []),
    "right_first": ("stop4", {0: wait(2, 100), 1: wait(2, 900)}, []),
    "red": ("light4", {1: wait(2, 100)}, []),
    "right_on_red": ("light4", {1: (1, -10.0, [(0, 5.0)])}, []),
    "left_yields": ("light4", {0: wait(3, 100), 2: wait(2, 150)}, []),
    "no_collision": ("stop4", {0: wait(2, 100), 2: wait(2, 900)}, [(1500, "a0", "a2")]),
    "no_conflict": ("stop4", {0: wait(2, 100), 2: wait(3, 100)}, []),
    "keep_clear": ("light4", {0: (2, -10.0, [(0, 5.0), (300, 0.0), (700, 5.0)])}, []),
    "progress": ("light4", {0: wait(2, 1200)}, []),
    "keep_lane": ("light4", {0: (2, -10.0, [(0, 5.0)], 1.3)}, []),
    "speed_limit": ("light4", {0: (2, -10.0, [(0, 15.0)])}, []),
}


@pytest.mark.parametrize("name", BREAKS)
def test_every_rule_is_broken_alone_by_its_example(drive: Make, name: str) -> None:
    junction, vehicles, collisions = BREAKS[name]
    run = drive(junction, vehicles, 2500, CROSS if junction == "light4" else None, collisions)
    statuses = {r.name: str(check(run, r).status) for r in rules_for("road", run.junction)}
    assert [n for n, status in statuses.items() if status not in ("PASS", "NA")] == [name]
    assert statuses[name] == "FAIL"


def test_who_leaves_the_route_has_left_its_lane(drive: Make) -> None:
    run = drive("light4", {0: (2, -10.0, [(0, 5.0)], 3.2)}, 2500, CROSS)
    statuses = {r.name: str(check(run, r).status) for r in rules_for("road", run.junction)}
    assert [n for n, status in statuses.items() if status not in ("PASS", "NA")] == ["keep_lane", "on_route"]


KEEPS: dict[str, tuple[str, dict[int, Any]]] = {
    "full_stop": ("stop4", {0: (2, -10.0, [(0, 5.0), (190, 0.0), (300, 5.0)])}),
    "first_come": ("stop4", {0: wait(2, 400), 1: (2, -2.5, [(0, 1.0), (200, 0.0), (1500, 8.0)])}),
    "right_first": ("stop4", {0: wait(2, 900), 1: wait(2, 100)}),
    "red": ("light4", {1: wait(2, 1201)}),
    "right_on_red": ("light4", {1: wait(1, 100)}),
    "left_yields": ("light4", {0: wait(3, 900), 2: wait(2, 100)}),
    "no_collision": ("stop4", {0: wait(2, 100), 2: wait(2, 900)}),
    "no_conflict": ("stop4", {0: wait(2, 100), 2: wait(3, 700)}),
    "keep_clear": ("light4", {0: (2, -10.0, [(0, 5.0), (300, 0.0), (599, 5.0)])}),
    "progress": ("light4", {0: wait(2, 950)}),
    "keep_lane": ("light4", {0: (2, -10.0, [(0, 5.0)], -1.0)}),
    "on_route": ("light4", {0: (3, -10.0, [(0, 5.0)], 2.9)}),
    "speed_limit": ("light4", {0: (2, -10.0, [(0, 11.5)])}),
}


@pytest.mark.parametrize("name", KEEPS)
def test_every_rule_is_kept_by_its_example(drive: Make, name: str) -> None:
    junction, vehicles = KEEPS[name]
    lights = {e: [*phases, (1200, G if e % 2 else R)] for e, phases in CROSS.items()}
    run = drive(junction, vehicles, 2500, lights if junction == "light4" else None)
    assert check(run, name).status == "PASS"


def test_right_on_red_yields_to_who_comes_from_the_left_on_green(drive: Make) -> None:
    before = drive("light4", {1: wait(1, 100), 0: wait(2, 120)}, 1500, CROSS)
    after = drive("light4", {1: wait(1, 500), 0: wait(2, 100)}, 1500, CROSS)
    verdict = check(before, "right_on_red")
    assert (verdict.status, verdict.responsible) == ("FAIL", ("a1",))
    # a0 has had green for 1 s when a1 sets off: a1 takes the shared stretch from a vehicle that is about to go.
    common = shared(before, 0, 1)
    assert common is not None
    takes = 1.0 + (common.mine.start + 0.5) / 8.0
    assert verdict.time == pytest.approx(takes, abs=0.011)
    assert verdict.message == f"right_on_red at t={verdict.time:.2f} s: a1 gets in the way of a0"
    assert check(after, "right_on_red").status == "PASS"


def test_the_messages_say_what_happened(drive: Make) -> None:
    def message(name: str) -> str:
        junction, vehicles, collisions = BREAKS[name]
        return check(drive(junction, vehicles, 2500, CROSS if junction == "light4" else None, collisions), name).message

    assert message("full_stop") == "full_stop at t=2.01 s: a0 entered the junction before it had stopped at the line"
    assert message("no_collision") == "no_collision at t=15.00 s: a0 and a2 collide"
    assert message("keep_clear") == "keep_clear at t=6.00 s: a0 blocks the junction"
    assert message("progress") == "progress at t=10.00 s: a0 could have gone and has not"
    assert message("keep_lane") == "keep_lane at t=0.00 s: a0 is outside its lane"
    assert message("speed_limit") == "speed_limit at t=0.00 s: a0 is over the speed limit"
    assert message("no_conflict").endswith(" s: a0 and a2 meet where their ways cross or join (the first of 2 instances)")


def test_the_explanation_of_a_full_stop_speaks_of_one_vehicle(drive: Make) -> None:
    junction, vehicles, _ = BREAKS["full_stop"]
    text = check(drive(junction, vehicles, 2500), "full_stop").explanation.splitlines()
    assert text[2:5] == [
        "must wait a0 @ entrance 0, straight   arrived 1.80 s, waited 0.21 s",
        "obligation since 1.80 s: a0 stays out of the junction until a0 has stopped at the line",
        "broken at 2.01 s: a0 is in the junction (0.05 m, v = 5.0 m/s)",
    ]


def test_explanation_shows_the_speed_of_the_acting_vehicle(drive: Make) -> None:
    junction, vehicles, _ = BREAKS["speed_limit"]
    text = check(drive(junction, vehicles, 2500, CROSS), "speed_limit").explanation
    assert "\nvehicle   a0 from entrance 0, straight   v = 15.0 m/s   <- acts\n" in text


def test_a_cause_names_no_vehicle_by_number(drive: Make) -> None:
    # The other vehicle of right_on_red is bound by an inner quantifier.
    verdict = check(drive("light4", {1: wait(1, 100), 0: wait(2, 120)}, 1500, CROSS), "right_on_red")
    assert verdict.cause == "a gets in the way of another vehicle (a right from entrance +0)"


def test_positions_are_relative_to_the_entrance_vertex(drive: Make) -> None:
    junction, vehicles, _ = BREAKS["right_first"]
    verdict = check(drive(junction, vehicles, 2500), "right_first")
    row = next(line for line in verdict.explanation.splitlines() if "violated" in line)
    assert "+0.06 m" in row
    assert "-0.50 m" in row
    assert "a0 in the junction (0.06 m) while a1 is still at entrance 1 (-0.50 m, v = 0.0 m/s)" in verdict.explanation


def test_a_stop_counts_only_before_the_line_and_in_this_approach(drive: Make) -> None:
    run = drive("stop4", {0: (2, -7.0, [(0, 1.0), (190, 0.0), (200, 1.0), (300, 0.0), (310, 1.0)])}, 1000)
    # It stands at -5.1 m, more than five metres before the sign, then at -4.1 m; from there on it has stopped, until it enters.
    assert np.flatnonzero(stopped(run, 0)).tolist() == list(range(300, 721))
    late = drive("stop4", {0: (2, -0.5, [(0, 1.0), (45, 0.05), (60, 1.0)])}, 100)
    assert np.flatnonzero(stopped(late, 0))[0] == 45, "slower than 0.1 m/s is a stop, the bumper at the line"


def test_the_limit_of_the_run_counts(drive: Make) -> None:
    slow = drive("stop4", {0: (2, -10.0, [(0, 9.0)])}, 10, speed_limit=8.0)
    assert speeding(slow, 0).all()
    assert not speeding(drive("stop4", {0: (2, -10.0, [(0, 9.0)])}, 10), 0).any()


@pytest.mark.parametrize(
    ("rule", "lacks", "what"),
    [("speed_limit", {"speed_limit": None}, "no speed limit"), ("keep_clear", {"size": None}, "no size of its vehicles")],
)
def test_rules_about_unrecorded_quantities_are_na(drive: Make, rule: str, lacks: dict[str, None], what: str) -> None:
    verdict = check(drive("stop4", {0: (2, -10.0, [(0, 30.0)])}, 10, **lacks), rule)
    assert (verdict.status, verdict.reason) == ("NA", f"not recorded: the run holds {what}")


def test_conflicts_in_an_x() -> None:
    found = find("stop4").conflicts
    assert found is not None
    right, straight, left = ((0, 1), (0, 2), (0, 3))
    assert ((straight), (1, 3)) in found, "crossing"
    assert (straight, (2, 0)) not in found, "side by side"
    assert (left, (2, 0)) in found, "left in front of oncoming"
    assert (right, (3, 1)) in found, "the same exit"
    assert (right, (1, 2)) not in found, "two right turns"
    assert all((b, a) in found for a, b in found)
    assert all(a[0] != b[0] for a, b in found), "from one entrance they follow each other"


def test_waiting_times_may_count_from_standstill(drive: Make) -> None:
    # a0 arrives first and stops later than a1: who waits longer depends on the reading.
    run = drive(
        "stop4", {0: (2, -2.0, [(0, 1.0), (100, 0.2), (300, 0.0), (900, 8.0)]), 1: (2, -2.0, [(0, 0.8), (150, 0.0)])}, 1200
    )
    assert check(run, "p3").status == "PASS"
    literal = check(run, "p3", standing=True)
    assert (literal.status, literal.responsible) == ("FAIL", ("a0",))
