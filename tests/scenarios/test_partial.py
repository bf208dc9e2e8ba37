"""What full scenarios can't show: a driver that never looks straight across."""

from itertools import combinations

import pytest

import pytest_rvads as rvads
from pytest_rvads.scenarios.configurations import grid
from pytest_rvads.scenarios.selection import Selection
from studies.mutants.sight import BlindAhead

PLACE = rvads.find("stop4")
FACING = {f"0{a}0{b}" for a, b in [*combinations("123", 2), *zip("123", "123", strict=True)]}
"""Two face to face: the only scenarios of two vehicles in which nobody comes from a side."""


def broken(cover: str, count: int, stride: int = 1) -> dict[str, bool]:
    """By scenario of `count` vehicles, every `stride`-th, in which p1 to p3 are not kept, whether it collides."""
    found = {}
    selection = Selection(PLACE, grid("B", 4, PLACE.control), cover=cover)
    scenarios = [scenario for scenario in selection if len(scenario.agents()) == count]
    for scenario in scenarios[::stride]:
        run = rvads.simulate(rvads.Case(scenario, BlindAhead))
        if any(rvads.check(run, rule).status == "FAIL" for rule in ("p1", "p2", "p3")):
            found[scenario.label] = bool(run.collisions)
    return found


@pytest.mark.extended
def test_a_driver_that_never_looks_across_fails_with_empty_arms() -> None:
    alone = broken("partial", 2)
    assert set(alone) == FACING
    assert alone["0103"], "a right turn and the left turn opposite lead into the same exit"


@pytest.mark.extended
def test_a_driver_that_never_looks_across_passes_classes_of_full_scenarios() -> None:
    # Two classes, as each takes most of a second; the slow test below runs all 24.
    assert broken("class", 4, stride=12) == {}


@pytest.mark.slow
def test_a_driver_that_never_looks_across_passes_all_classes() -> None:
    assert broken("class", 4) == {}
