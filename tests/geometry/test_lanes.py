"""Where an arm has several lanes: numbers of entrances, exits, arms and vehicles differ there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import pytest_rvads as rvads
from pytest_rvads.geometry.control import Sign
from pytest_rvads.geometry.junction import Junction
from pytest_rvads.geometry.turns import Turn
from pytest_rvads.geometry.ways import Entrance, Exit, Movement
from pytest_rvads.logic.conduct.static_model import extract
from pytest_rvads.logic.judging.instances import ground
from pytest_rvads.logic.rules.rule import parse
from pytest_rvads.satellites.relations.variants import RELATIONS, Incomparable, Symmetry, Variant, broken_by, rotations_of
from pytest_rvads.scenarios.case import Case
from pytest_rvads.search.strategies import scenarios

TURNS = {1: Turn.RIGHT, 2: Turn.STRAIGHT, 3: Turn.LEFT}


def wide_x() -> Junction:
    """An X with two entrance lanes on arms 0 and 2: right and straight on from the one at the kerb, left from the other one."""
    lanes = [(0, (1, 2)), (0, (3,)), (1, (1, 2, 3)), (2, (1, 2)), (2, (3,)), (3, (1, 2, 3))]
    entrances = (Entrance(0, 0), Entrance(0, 1), Entrance(1), Entrance(2, 0), Entrance(2, 1), Entrance(3))
    ways = [(e, (arm + d) % 4, TURNS[d]) for e, (arm, leading) in enumerate(lanes) for d in leading]
    arms = [arm for arm, _ in lanes]
    pairs = [(a, b) for a in range(6) for b in range(6)]
    return Junction(
        "wide",
        "1",
        tuple(replace(entrance, sign=Sign.STOP) for entrance in entrances),
        tuple(map(Exit, range(4))),
        {(e, x): Movement(e, x, turn, 20.0, f"{e}to{x}") for e, x, turn in ways},
        frozenset((a, b) for a, b in pairs if (arms[a] - arms[b]) % 4 == 1),
        frozenset((a, b) for a, b in pairs if (arms[a] - arms[b]) % 4 == 2),
    )


def test_entrances_exits_and_arms_have_numbers_of_their_own() -> None:
    junction = wide_x()
    assert junction.entex == {(0, 0), (1, 0), (2, 1), (3, 2), (4, 2), (5, 3)}
    assert [junction.directions(e) for e in range(6)] == [(1, 2), (3,), (1, 2, 3), (1, 2), (3,), (1, 2, 3)]
    assert junction.leads(4, 3).exit == 1
    assert junction.yields is junction.conflicts is None, "nobody knows where its lanes lie"


def test_a_rotation_keeps_lanes_and_signs() -> None:
    junction = wide_x()
    assert rotations_of(junction) == (Symmetry(0, 0), Symmetry(2, 3))
    assert broken_by(junction, 1) == ("lanes",)
    one = replace(junction.entrances[5], sign=Sign.NONE)
    assert broken_by(replace(junction, entrances=(*junction.entrances[:5], one)), 2) == ("signs",)
    stop4 = rvads.find("stop4")
    lanes = tuple(replace(lane, sign=sign) for lane, sign in zip(stop4.entrances, [Sign.STOP, Sign.NONE] * 2, strict=True))
    assert [symmetry.arms for symmetry in rotations_of(replace(stop4, entrances=lanes))] == [0, 2]


def test_a_rotated_scenario_has_every_vehicle_on_its_lane() -> None:
    case = Case(rvads.Scenario(wide_x(), "130000"), rvads.Reference)
    first, second, third = RELATIONS["rotation"](case)
    assert isinstance(first, Incomparable)
    assert isinstance(third, Incomparable)
    assert isinstance(second, Variant)
    assert second.image == (3, 4, 5, 0, 1, 2)
    there = second.case.scenario.agents()
    assert [(agent.name, agent.way.key) for agent in there] == [("a2.0", (3, 3)), ("a2.1", (4, 1))]


def test_generated_scenarios_use_existing_movements_only() -> None:
    junction = rvads.find("stop4")
    narrow = replace(junction, movements={key: m for key, m in junction.movements.items() if key != (0, 1)})

    @settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(scenarios(narrow))
    def have_agents(scenario: rvads.Scenario) -> None:
        assert scenario.directions[0] != 1
        assert scenario.agents()

    have_agents()


def test_rules_tell_lanes_apart() -> None:
    junction = wide_x()
    agents = tuple(rvads.Agent(junction.vehicle_at(e), junction.leads(e, d)) for e, d in ((1, 3), (5, 2)))
    zone = np.array([[0, 0], [1, 1], [2, 2], [3, 3]], dtype=np.int8)
    run = rvads.Run("hand", junction, agents, zone, np.zeros((4, 6), dtype=np.int8))
    assert rvads.check(run, "p1").roles == "a left from entrance +0.1, a' straight from entrance +3"
    found = ground(parse("forall a, j.en, j.ex. G(j.en entex j.ex -> !a@j.ex)"), extract(run))
    # a0.1 leaves by exit 3, a3 by exit 1: each has one entrance beside it.
    assert [[(name, element.name) for name, element in i.binding] for i in found.instances] == [
        [("a", "a0.1"), ("j.en", "j.en5"), ("j.ex", "j.ex3")],
        [("a", "a3"), ("j.en", "j.en2"), ("j.ex", "j.ex1")],
    ]


def test_a_scenario_counts_the_arms_of_its_junction_and_one_direction_per_entrance() -> None:
    scenario = rvads.Scenario(wide_x(), "130000")
    assert (scenario.ways, scenario.place.ways, len(scenario.directions)) == (4, 4, 6)


def test_a_rotation_takes_arms_to_arms() -> None:
    assert [a.name for a in rvads.Scenario(wide_x(), "130000", rotation=3).agents()] == ["a2.0", "a2.1"]
    with pytest.raises(rvads.errors.ScenarioError, match="must be one of 0, 3, by so many entrances junction 'wide' keeps"):
        rvads.Scenario(wide_x(), "130000", rotation=1)
