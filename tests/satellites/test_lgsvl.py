"""The LGSVL-like autopilot: each deficiency alone is caught where the paper says, and without any of them it behaves."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from pytest_rvads.geometry.finder import find
from pytest_rvads.runs.run import Run
from pytest_rvads.runs.states import Zone
from pytest_rvads.satellites.lgsvl import Box, Constants, LgsvlLike, Whole, ZoneBox, frame, zone_of
from pytest_rvads.satellites.paper.tables import LIGHT, STOP, Entry, Setup, crossing_wait, outcome, run_entry
from pytest_rvads.scenarios.case import Case
from pytest_rvads.scenarios.scenario import Scenario
from pytest_rvads.simulators.simulator import simulate
from pytest_rvads.support.errors import AutopilotError

ALL = ("i1", "i2", "i3", "i4", "i5")
# The deficiency, where the paper's analysis puts it (class, configuration), and the rules that it breaks there.
SHOWN = [
    ("i1", Entry(STOP, 1, 0, "A"), "p1"),
    ("i1", Entry(LIGHT, 3, 0, "F"), "p4 p6"),
    ("i2", Entry(STOP, 1, 0, "B"), "p1"),
    ("i2", Entry(STOP, 1, 0, "C"), "p1"),
    ("i3", Entry(STOP, 1, 0, "E"), "p2"),
    ("i4", Entry(LIGHT, 4, 0, "J"), "p5"),
    ("i5", Entry(LIGHT, 3, 0, "G"), "p6"),
]
MORE = [
    ("i3", Entry(STOP, 1, 2, "E"), "p2"),
    ("i4", Entry(LIGHT, 4, 3, "J"), "p5"),
    ("i5", Entry(LIGHT, 3, 1, "H"), "p6"),
    ("i5", Entry(LIGHT, 3, 2, "I"), "p6"),
    ("i5", Entry(LIGHT, 3, 3, "J"), "p6"),
]
"""Other rows and configurations in which the same deficiencies show."""


def name(value: object) -> str:
    return f"{value.number}{value.configuration}r{value.row}" if isinstance(value, Entry) else str(value)


@pytest.mark.parametrize(
    ("deficiency", "entry", "broken"), [*SHOWN, *(pytest.param(*shown, marks=pytest.mark.extended) for shown in MORE)], ids=name
)
def test_a_deficiency_alone_is_caught(deficiency: str, entry: Entry, broken: str) -> None:
    setup = Setup(off=tuple(x for x in ALL if x != deficiency))
    # Without the creep of I1 a right turn needs longer to its line, so the draw that shows I4 is another one.
    setup = replace(setup, wait=crossing_wait(setup)) if deficiency == "i4" else setup
    found = outcome(run_entry(entry, setup), entry.table.rules)
    assert {rule for rule, value in found.items() if value == "FAIL"} >= set(broken.split())


@pytest.mark.parametrize(
    "entry",
    [*(entry for _, entry, _ in SHOWN), *(pytest.param(entry, marks=pytest.mark.extended) for _, entry, _ in MORE)],
    ids=name,
)
def test_without_deficiencies_the_same_cells_pass(entry: Entry) -> None:
    run = run_entry(entry, Setup(off=ALL))
    found = outcome(run, entry.table.rules)
    if entry.table is STOP and entry.configuration != "E":
        assert found.pop("p2") == "FAIL", "nobody can pass p2 when four arrive at once"
    assert "FAIL" not in found.values()
    assert not run.collisions
    assert all(run.entry(column) is not None for column in range(4))


def creep(direction: int, constants: Constants) -> float:
    """How far a vehicle creeps that starts 0.3 m before a red light [m]."""
    scenario = Scenario(find("paper_light4"), (0, direction, 0, 0), distance=0.3, speed=0, duration=3.0)
    run = simulate(Case(scenario, partial(LgsvlLike, constants=constants)))
    assert run.station is not None
    return float(run.station[-1, 0] + 0.3)


def test_a_launch_creeps_half_as_far_into_a_turn_and_never_over_a_line_at_0_3_m() -> None:
    straight, left = creep(2, Constants()), creep(3, Constants())
    assert 0.01 < left < straight < 0.3, "the paper's F fails and its G passes"
    assert left / straight == pytest.approx(0.5, abs=0.1), "LGSVL's creep is 0.015 m in a turn, 0.029 m straight on"


def test_a_vehicle_stops_three_quarters_of_a_metre_before_the_line() -> None:
    run = simulate(Case(Scenario(find("paper_light4"), (0, 2, 0, 0), distance=20, speed=10, duration=15), LgsvlLike))
    assert run.speed is not None
    assert run.station is not None
    assert run.speed[-1, 0] < 0.01
    assert run.station[-1, 0] == pytest.approx(-0.76, abs=0.1)


def order(run: Run) -> list[str]:
    entries = [(run.entry(column), agent.name) for column, agent in enumerate(run.agents)]
    return [name for _, name in sorted(entries, key=lambda e: e[0] if e[0] is not None else np.inf)]


@pytest.mark.parametrize("rotation", range(4))
def test_same_tick_arrivals_go_in_creation_order(rotation: int) -> None:
    scenario = Scenario(find("paper_stop4"), "2222", distance=0.3, rotation=rotation, duration=30)
    assert order(simulate(Case(scenario, LgsvlLike))) == [f"a{(k + rotation) % 4}" for k in range(4)]


def test_with_a_tie_rule_the_right_one_goes_first() -> None:
    scenario = Scenario(find("paper_stop4"), "2200", distance=0.3, duration=20)
    assert order(simulate(Case(scenario, LgsvlLike))) == ["a0", "a1"]
    assert order(simulate(Case(scenario, partial(LgsvlLike, i3=False)))) == ["a1", "a0"]


def test_only_the_hidden_zone_lets_two_into_the_junction() -> None:
    scenario = Scenario(find("paper_stop4"), "1111", distance=20, duration=30)
    inside = [
        (simulate(Case(scenario, partial(LgsvlLike, i1=False, i2=i2))).zone == Zone.JUNCTION).sum(axis=1).max()
        for i2 in (True, False)
    ]
    assert inside == [2, 1]


def test_a_light_is_looked_at_once() -> None:
    # Green at the decision, 15 m out, and red for ten seconds when it arrives: a vehicle that looked again would stop.
    late = simulate(Case(Scenario(find("paper_light4"), (2, 0, 0, 0), distance=60, speed=0, duration=40), LgsvlLike))
    assert late.entry(0) is not None
    waits = simulate(Case(Scenario(find("paper_light4"), (0, 2, 0, 0), distance=20, speed=0, duration=40), LgsvlLike))
    entry = waits.entry(0)
    assert entry is not None
    assert 20.0 < entry < 22.0, "red until 20 s, and the look at 15 m says stop"


def test_a_t_junction_works_too() -> None:
    run = simulate(Case(Scenario(find("stop3"), "111", distance=0.3, duration=40), LgsvlLike))
    assert not run.collisions
    assert order(run) == ["a0", "a1", "a2"]


def test_a_zone_needs_an_extent() -> None:
    with pytest.raises(AutopilotError, match="positive extents"):
        ZoneBox(0.0, 0.0, 0.0, 1.0)


def test_junction_with_an_arm_without_entrances_has_no_box() -> None:
    assert isinstance(zone_of(find("roundabout4"), Constants(), hidden=True), Whole)


def test_the_zone_reaches_towards_exits_0_and_1() -> None:
    junction = find("paper_stop4")
    origin = frame(junction)
    assert junction.drivable
    assert (origin.x, origin.y) == pytest.approx((0.0, 0.0), abs=1e-6)
    east = junction.way_out(1).pose(0.0)
    assert math.remainder(east.heading - origin.heading, math.tau) == pytest.approx(0.0, abs=1e-6)
    zone = zone_of(junction, Constants(), hidden=True)
    assert isinstance(zone, Box)
    corners = zone.corners()
    x, y = (sum(corner[axis] for corner in corners) / 4 for axis in (0, 1))
    assert x > 0.5 > -0.5 > y, "arm 1 lies in the east, arm 0 in the south; the paper: the zone is close to exits 0 and 1"
