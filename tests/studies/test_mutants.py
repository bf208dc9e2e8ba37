"""Each mutant does what its name says: the rule about that breaks, where the reference autopilot keeps it."""

from typing import Any

import pytest

import pytest_rvads as rvads
from studies.mutants import MUTANTS

BREAKS = [
    ("anticipates green", "light4", "0002", 20, 0, "p4"),
    ("blind to the left", "light4", "3121", 20, 10, "p5"),
    ("creeps", "light4", "0200", 20, 0, "p4"),
    ("dawdles", "stop4", "2200", 20, 0, "keep_clear"),
    ("half yield", "light4", "3010", 20, 0, "p6"),
    ("ignores stop", "stop4", "2000", 20, 0, "full_stop"),
    ("last come first", "stop4", "2020", (2, 20, 1.5, 20), 0, "p3"),
    ("left first", "stop4", "2200", 20, 0, "p2"),
    ("no stop right on red", "light4", "0100", 20, 0, "right_on_red"),
    ("runs red", "light4", "0200", 20, 0, "p4"),
    ("speeds", "stop4", "2000", 20, 0, "speed_limit"),
]
"""Mutant, junction, directions, distances [m], speed [m/s], the rule that forbids just this."""


def status(autopilot: Any, junction: str, directions: str, distance: Any, speed: float, rule: str) -> rvads.Status:
    run = rvads.simulate(rvads.Case(rvads.Scenario(rvads.find(junction), directions, distance=distance, speed=speed), autopilot))
    assert run.fault is None
    return rvads.check(run, rule).status


@pytest.mark.parametrize(
    ("name", "junction", "directions", "distance", "speed", "rule"), BREAKS, ids=[case[0] for case in BREAKS]
)
def test_mutant_breaks_the_rule_about_its_fault(
    name: str, junction: str, directions: str, distance: Any, speed: float, rule: str
) -> None:
    assert status(MUTANTS[name], junction, directions, distance, speed, rule) is rvads.Status.FAIL
    assert status(rvads.Reference, junction, directions, distance, speed, rule) is not rvads.Status.FAIL


def test_at_least_20_documented_mutants() -> None:
    assert len(MUTANTS) >= 20
    assert list(MUTANTS) == sorted(MUTANTS)
    assert all(mutant.__doc__ and issubclass(mutant, rvads.Reference) for mutant in MUTANTS.values())
    assert len(set(MUTANTS.values())) == len(MUTANTS)
